import struct
from math import inf, pi, sqrt
from pathlib import Path

import numpy as np
import pytest
import taichi as ti

from taichi_plume.grid.clearance import ClearanceMap
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.kernels import Template
from taichi_plume.grid.meshes import MeshError, Solid
from taichi_plume.scenario import resources
from taichi_plume.scenario.domain import Domain
from taichi_plume.scenario.gases import EulerianGas
from taichi_plume.scenario.obstacles import Box, Cylinder, Mesh, Prism, Sphere
from taichi_plume.scenario.resources import shape
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.sources import Source
from taichi_plume.scenario.winds import CfdWind

pytestmark = pytest.mark.usefixtures("taichi")

ROOM = Domain(size=(4.0, 3.0, 1.0), spacing=0.1)
FLOOR = Domain(size=(4.0, 3.0), spacing=0.1)
L_SHAPE = ((1.0, 0.5), (3.0, 0.5), (3.0, 1.5), (2.0, 1.5), (2.0, 2.5), (1.0, 2.5))
SHAPES = {
    "box": Box(kind="box", center=(2.0, 1.4, 0.3), size=(1.0, 0.5, 0.4), yaw_deg=30.0),
    "cylinder": Cylinder(kind="cylinder", center=(1.8, 1.6), radius=0.5, base=0.2, height=0.5),
    "column": Cylinder(kind="cylinder", center=(1.8, 1.6), radius=0.5),
    "sphere": Sphere(kind="sphere", center=(2.1, 1.3, 0.4), radius=0.35),
    "prism": Prism(kind="prism", vertices=L_SHAPE, base=0.1, height=0.6),
}


def is_inside(name, p):
    """The bodies of SHAPES once more, as inequalities."""
    x, y, z = p[..., 0], p[..., 1], p[..., 2]
    if name == "box":
        u = (x - 2.0) * sqrt(0.75) + (y - 1.4) * 0.5
        v = (y - 1.4) * sqrt(0.75) - (x - 2.0) * 0.5
        return (abs(u) < 0.5) & (abs(v) < 0.25) & (abs(z - 0.3) < 0.2)
    if name == "cylinder":
        return ((x - 1.8) ** 2 + (y - 1.6) ** 2 < 0.25) & (z > 0.2) & (z < 0.7)
    if name == "column":
        return ((x - 1.8) ** 2 + (y - 1.6) ** 2 < 0.25) & (z > 0.0) & (z < 1.0)
    if name == "sphere":
        return (x - 2.1) ** 2 + (y - 1.3) ** 2 + (z - 0.4) ** 2 < 0.35**2
    low = (x > 1) & (x < 3) & (y > 0.5) & (y < 1.5)
    return (low | ((x > 1) & (x < 2) & (y > 0.5) & (y < 2.5))) & (z > 0.1) & (z < 0.7)


def random_points(n=20_000, dim=3, seed=0):
    return np.random.default_rng(seed).uniform(0.0, [4.0, 3.0, 1.0][:dim], (n, dim))


@pytest.mark.parametrize("name", SHAPES)
def test_sign_is_that_of_the_body(name):
    p = random_points()
    distance = shape(SHAPES[name], ROOM, Path()).signed_distance(p)
    away = abs(distance) > 1e-9
    assert ((distance < 0) == is_inside(name, p))[away].all()
    assert 100 < (distance < 0).sum() < len(p) - 100


@pytest.mark.parametrize("name", SHAPES)
def test_distance_is_the_radius_of_the_largest_ball_on_one_side(name):
    ways = np.random.default_rng(1).normal(size=(40_000, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    one = shape(SHAPES[name], ROOM, Path())
    for p in random_points(40, seed=2):
        distance = abs(one.signed_distance(p))
        for share in (0.5, 0.9, 0.999):
            assert (is_inside(name, p + share * distance * ways) == is_inside(name, p)).all()
        assert (is_inside(name, p + 1.1 * distance * ways) != is_inside(name, p)).any()


@pytest.mark.parametrize("name", SHAPES)
def test_distance_changes_by_no_more_than_the_way(name):
    one = shape(SHAPES[name], ROOM, Path())
    p, q = random_points(seed=3), random_points(seed=4)
    difference = abs(one.signed_distance(p) - one.signed_distance(q))
    assert (difference <= np.linalg.norm(p - q, axis=-1) + 1e-12).all()


def test_2d_shapes_are_footprints():
    p = random_points(dim=2)
    disc = shape(Sphere(kind="sphere", center=(2.0, 1.0), radius=0.4), FLOOR, Path())
    column = shape(
        Cylinder(kind="cylinder", center=(2.0, 1.0), radius=0.4, base=0.3, height=0.1), FLOOR, Path()
    )
    expected = np.hypot(p[:, 0] - 2.0, p[:, 1] - 1.0) - 0.4
    np.testing.assert_allclose(disc.signed_distance(p), expected, atol=1e-12)
    np.testing.assert_allclose(column.signed_distance(p), expected, atol=1e-12)
    box = shape(Box(kind="box", center=(2.0, 1.0), size=(0.6, 0.4)), FLOOR, Path())
    at = np.array([[2.0, 1.0], [2.0, 1.15], [2.4, 1.0], [2.6, 1.6]])
    np.testing.assert_allclose(box.signed_distance(at), [-0.2, -0.05, 0.1, 0.5], atol=1e-12)
    np.testing.assert_allclose(column.low, [1.6, 0.6])


def test_prism_may_turn_either_way():
    p = random_points()
    forth, back = (Prism(kind="prism", vertices=v) for v in (L_SHAPE, L_SHAPE[::-1]))
    np.testing.assert_allclose(
        shape(forth, ROOM, Path()).signed_distance(p),
        shape(back, ROOM, Path()).signed_distance(p),
        atol=1e-12,
    )


def test_shadow_is_what_a_low_robot_can_touch():
    at = np.array([[3.0, 1.3]])
    sphere = shape(SHAPES["sphere"], ROOM, Path())  # centre at (2.1, 1.3, 0.4), radius 0.35
    assert sphere.horizontal_distance(at, 0.0, 0.5) == pytest.approx(0.9 - 0.35)
    assert sphere.horizontal_distance(at, 0.0, 0.2) == pytest.approx(0.9 - sqrt(0.35**2 - 0.2**2))
    assert sphere.horizontal_distance(at, 0.0, 0.05) == inf
    cylinder = shape(SHAPES["cylinder"], ROOM, Path())  # from 0.2 m up
    assert cylinder.horizontal_distance(at, 0.0, 0.2) == inf
    assert cylinder.horizontal_distance(at, 0.0, 0.3) == pytest.approx(np.hypot(1.2, 0.3) - 0.5)


# ---------------------------------------------------------------- clearance


@ti.kernel
def clearance_of(clearance: Template, points: Template, distance: Template, normal: Template):
    for n in points:
        distance[n] = clearance.distance(points[n])
        normal[n] = clearance.normal(points[n])


def sample(clearance, at):
    points, normal = ti.Vector.field(2, ti.f32, len(at)), ti.Vector.field(2, ti.f32, len(at))
    distance = ti.field(ti.f32, len(at))
    points.from_numpy(at.astype(np.float32))
    clearance_of(clearance, points, distance, normal)
    return distance.to_numpy(), normal.to_numpy()


def to_walls(p):
    return np.min([p[:, 0], 4.0 - p[:, 0], p[:, 1], 3.0 - p[:, 1]], axis=0)


@pytest.mark.parametrize("resolution", [0.1, None])
def test_clearance_is_a_tight_lower_bound(resolution):
    obstacles = [shape(SHAPES[name], ROOM, Path()) for name in ("box", "sphere")]
    obstacles.append(shape(Cylinder(kind="cylinder", center=(0.9, 2.2), radius=0.2), ROOM, Path()))
    height = 0.25
    p = random_points(dim=2)
    truth = to_walls(p)
    for one in obstacles:
        truth = np.minimum(truth, one.horizontal_distance(p, 0.0, height))
    clearance = ClearanceMap(obstacles, ROOM.extent, height, resolution)
    distance, normal = sample(clearance, p)
    assert (distance <= truth + 1e-5).all()
    assert (distance >= truth - sqrt(2) * clearance.resolution - 1e-5).all()
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1.0, atol=1e-5)
    np.testing.assert_allclose(clearance.distance_at(p), distance, atol=1e-5)


def test_normals_point_away_from_the_nearest_surface():
    column = shape(Cylinder(kind="cylinder", center=(2.0, 1.5), radius=0.5), ROOM, Path())
    clearance = ClearanceMap([column], ROOM.extent, 0.2)
    p = np.array(
        [[2.6, 1.5], [2.0, 0.9], [2.0 + 0.4, 1.5 + 0.4], [0.1, 1.5], [3.95, 0.5], [1.0, 2.9], [0.5, 0.1]]
    )
    s = sqrt(0.5)
    expected = [[1, 0], [0, -1], [s, s], [1, 0], [-1, 0], [0, -1], [0, 1]]
    np.testing.assert_allclose(sample(clearance, p)[1], expected, atol=0.02)


def test_clearance_without_obstacles_is_the_distance_to_the_walls():
    p = random_points(dim=2)
    clearance = ClearanceMap([], FLOOR.extent, 0.2)
    np.testing.assert_allclose(sample(clearance, p)[0], to_walls(p), atol=1e-6)
    np.testing.assert_allclose(clearance.distance_at(np.array([4.5, 1.0])), -0.5)


def test_clearance_of_a_part_of_the_floor():
    column = shape(Cylinder(kind="cylinder", center=(2.0, 1.5), radius=0.5), ROOM, Path())
    low, high = np.array([0.7, 0.4]), np.array([3.1, 2.8])
    p = random_points(dim=2)
    p = p[((p > low) & (p < high)).all(axis=1)]
    edges = np.minimum(p - low, high - p).min(axis=1)
    truth = np.minimum(edges, np.hypot(*(p - [2.0, 1.5]).T) - 0.5)
    clearance = ClearanceMap([column], tuple(high), 0.2, low=tuple(low))
    distance, _ = sample(clearance, p)
    np.testing.assert_allclose(clearance.distance_at(p), distance, atol=1e-5)
    assert (distance <= truth + 1e-5).all()
    assert (distance >= truth - sqrt(2) * clearance.resolution - 1e-5).all()


def test_robots_pass_under_what_is_above_them():
    table = shape(Box(kind="box", center=(2.0, 1.5, 0.5), size=(2.0, 2.0, 0.1)), ROOM, Path())
    under = np.array([[2.0, 1.5]])
    assert ClearanceMap([table], ROOM.extent, 0.3).distance_at(under) == pytest.approx(1.5)
    assert ClearanceMap([table], ROOM.extent, 0.5).distance_at(under) < -0.9


def test_clearance_grid_is_bounded_for_large_arenas():
    pole = shape(Cylinder(kind="cylinder", center=(2.0, 1.5), radius=0.5), FLOOR, Path())
    nodes = ClearanceMap([pole], (200.0, 100.0), 0.2).nodes
    assert 300_000 < nodes[0] * nodes[1] < 420_000


# ---------------------------------------------------------------- meshes


def box_triangles(low, high):
    """The 12 triangles (12, 3, 3) of an upright box."""
    low, high = np.array(low, float), np.array(high, float)
    corner = np.array([[low[0], high[0]], [low[1], high[1]], [low[2], high[2]]])
    triangles = []
    for axis in range(3):
        first, second = (axis + 1) % 3, (axis + 2) % 3
        for side in range(2):
            quad = np.zeros((4, 3))
            quad[:, axis] = corner[axis, side]
            quad[:, first] = corner[first, [0, 1, 1, 0]]
            quad[:, second] = corner[second, [0, 0, 1, 1]]
            triangles += [quad[[0, 1, 2]], quad[[0, 2, 3]]]
    return np.array(triangles)


def write_stl(path, triangles):
    with path.open("wb") as file:
        file.write(b"\0" * 80 + struct.pack("<I", len(triangles)))
        for triangle in triangles:
            file.write(struct.pack("<12fH", 0, 0, 0, *triangle.ravel(), 0))
    return path.name


def write_obj(path, vertices, quads):
    lines = [f"v {x} {y} {z}" for x, y, z in vertices]
    lines += [f"f {a + 1} {b + 1} {c + 1}\nf {a + 1} {c + 1} {d + 1}" for a, b, c, d in quads]
    path.write_text("\n".join(lines) + "\n")
    return path.name


def torus(n=60, m=40, ring_radius=0.6, tube=0.2):
    """Vertices and quads of a torus about the z axis."""
    a, b = np.meshgrid(np.arange(n), np.arange(m), indexing="ij")
    u, v = 2 * pi * a / n, 2 * pi * b / m
    across = ring_radius + tube * np.cos(v)
    vertices = np.stack([across * np.cos(u), across * np.sin(u), tube * np.sin(v)], axis=-1).reshape(-1, 3)
    right, up = (a + 1) % n, (b + 1) % m
    quads = np.stack([a * m + b, right * m + b, right * m + up, a * m + up], axis=-1).reshape(-1, 4)
    return vertices, quads


def test_mesh_box_is_the_box(tmp_path):
    file = write_stl(tmp_path / "box.stl", box_triangles((-50, -25, 0), (50, 25, 40)))  # in cm
    mesh = Mesh(kind="mesh", file=file, scale=0.01, yaw_deg=30.0, translate=(2.0, 1.4, 0.1))
    one = shape(mesh, ROOM, tmp_path)
    box = shape(SHAPES["box"], ROOM, Path())
    p = random_points(5000)
    np.testing.assert_allclose(one.signed_distance(p), box.signed_distance(p), atol=1e-5)
    np.testing.assert_allclose([one.low, one.high], [box.low, box.high], atol=1e-6)
    assert isinstance(one, Solid)
    assert one.vertices.shape == (8, 3)
    assert one.triangles.shape == (12, 3)
    for height in (0.05, 0.2, 0.9):
        away = box.horizontal_distance(p[:, :2], 0.0, height)
        mine = one.horizontal_distance(p[:, :2], 0.0, height)
        assert ((mine < 0) == (away < 0)).all()
        np.testing.assert_allclose(mine[away > 0], away[away > 0], atol=1e-5)
    c = Grid.of(Domain(size=(4.0, 3.0, 1.0), spacing=0.05)).centers()
    np.testing.assert_array_equal(one.inside(c), is_inside("box", c))


def test_mesh_section_is_a_2d_shape(tmp_path):
    file = write_obj(tmp_path / "torus.obj", *torus())
    p = random_points(dim=2)
    radius = np.hypot(p[:, 0] - 2.0, p[:, 1] - 1.5)
    for section in (0.3, 0.4):  # the torus lies at z = 0.3
        one = shape(Mesh(kind="mesh", file=file, translate=(2.0, 1.5, 0.3), section=section), FLOOR, tmp_path)
        half = sqrt(0.2**2 - (section - 0.3) ** 2)
        np.testing.assert_allclose(one.signed_distance(p), abs(radius - 0.6) - half, atol=0.003)
        np.testing.assert_array_equal(one.inside(p), one.signed_distance(p) < 0)


def test_a_section_along_the_bottom_of_a_mesh_is_its_footprint(tmp_path):
    file = write_stl(tmp_path / "box.stl", box_triangles((1, 1, 0), (2, 2, 0.5)))
    one = shape(Mesh(kind="mesh", file=file), FLOOR, tmp_path)
    at = np.array([[1.5, 1.4], [0.5, 1.5], [3.0, 3.0]])
    np.testing.assert_allclose(one.signed_distance(at), [-0.4, 0.5, sqrt(2)], atol=1e-5)


def test_mesh_torus_in_3d(tmp_path):
    file = write_obj(tmp_path / "torus.obj", *torus())
    one = shape(Mesh(kind="mesh", file=file, translate=(2.0, 1.5, 0.3)), ROOM, tmp_path)
    p = random_points(5000)
    exact = np.hypot(np.hypot(p[:, 0] - 2.0, p[:, 1] - 1.5) - 0.6, p[:, 2] - 0.3) - 0.2
    np.testing.assert_allclose(one.signed_distance(p), exact, atol=0.003)
    c = Grid.of(Domain(size=(4.0, 3.0, 1.0), spacing=0.05)).centers()
    volume = one.inside(c).sum() * 0.05**3
    assert volume == pytest.approx(2 * pi**2 * 0.6 * 0.2**2, rel=0.03)
    # a robot 0.2 m high meets the lower part alone: its shadow is narrower than the torus seen from above
    truth = abs(np.hypot(p[:, 0] - 2.0, p[:, 1] - 1.5) - 0.6) - sqrt(0.2**2 - 0.1**2)
    shadow = one.horizontal_distance(p[:, :2], 0.0, 0.2)
    np.testing.assert_allclose(shadow[truth > 0.003], truth[truth > 0.003], atol=0.003)
    assert (shadow[truth < -0.003] <= 0).all()


def test_overlapping_bodies_of_a_mesh_are_united(tmp_path):
    bodies = [((1, 1, 0), (2, 2, 0.6)), ((1.5, 1.5, 0.2), (2.5, 2.5, 0.8))]
    file = write_stl(tmp_path / "two.stl", np.concatenate([box_triangles(*b) for b in bodies]))
    one = shape(Mesh(kind="mesh", file=file), ROOM, tmp_path)
    grid = Grid.of(Domain(size=(4.0, 3.0, 1.0), spacing=0.05))
    c = grid.centers()
    expected = np.zeros(grid.shape, bool)
    for low, high in bodies:
        expected |= ((c > low) & (c < high)).all(axis=-1)
    np.testing.assert_array_equal(one.inside(c), expected)


def test_faulty_meshes_are_told(tmp_path):
    triangles = box_triangles((1, 1, 0), (2, 2, 0.5))
    (tmp_path / "junk.stl").write_text("no mesh")
    faults = {
        "none.stl": "no such file",
        "junk.stl": "no triangles",
        write_stl(tmp_path / "hole.stl", triangles[1:]): "body 0 is not watertight: 3 open",
        write_stl(
            tmp_path / "lid.stl", np.concatenate([box_triangles((3, 1, 0), (4, 2, 1)), triangles[:10]])
        ): ("body 1 is not watertight: 4 open"),
    }
    for file, told in faults.items():
        with pytest.raises(MeshError, match=told):
            shape(Mesh(kind="mesh", file=file), ROOM, tmp_path)
    with pytest.raises(MeshError, match=r"section 0\.7 m does not cut it"):
        shape(Mesh(kind="mesh", file=write_stl(tmp_path / "b.stl", triangles), section=0.7), FLOOR, tmp_path)


def test_shapes_come_in_the_order_of_the_obstacles():
    scenario = Scenario(
        duration=1.0,
        domain=ROOM,
        wind=CfdWind(kind="cfd"),
        obstacles=(SHAPES["sphere"], SHAPES["box"], SHAPES["prism"]),
        gas=EulerianGas(kind="eulerian", sources=(Source(position=(1.0, 1.0, 0.1), rate=1e-5),)),
    )
    assert [one.model for one in resources.shapes(scenario, Path())] == list(scenario.obstacles)
