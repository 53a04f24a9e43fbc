"""Meshes are the bodies that they enclose, in 3-D and in section, and faulty ones are reported."""

import struct
from math import pi, sqrt
from pathlib import Path

import numpy as np
import pytest
from bodies import FLOOR, ROOM, SHAPES, is_inside, random_points

from taichi_plume.assembly.preparation import load, load_scenario
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.meshes import MeshError, Solid
from taichi_plume.grid.winding_number import Cluster, solid_angles
from taichi_plume.scenario.domain import Domain
from taichi_plume.scenario.loading import ScenarioError
from taichi_plume.scenario.obstacles import Mesh
from taichi_plume.scenario.shapes import shape

centers = Grid.of(Domain(size=(4.0, 3.0, 1.0), spacing=0.05)).centers()


def box_triangles(low, high):
    """Return the 12 triangles (12, 3, 3) of an upright box."""
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


def stl_bytes(triangles):
    facets = [struct.pack("<12fH", 0, 0, 0, *triangle.ravel(), 0) for triangle in triangles]
    return b"\0" * 80 + struct.pack("<I", len(triangles)) + b"".join(facets)


def write_stl(path, triangles):
    path.write_bytes(stl_bytes(triangles))
    return path.name


def write_obj(path, vertices, quads):
    lines = [f"v {x} {y} {z}" for x, y, z in vertices]
    lines += [f"f {a + 1} {b + 1} {c + 1}\nf {a + 1} {c + 1} {d + 1}" for a, b, c, d in quads]
    path.write_text("\n".join(lines) + "\n")
    return path.name


def torus(n=60, m=40, ring_radius=0.6, tube=0.2):
    """Return vertices and quads of a torus about the z axis."""
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
    np.testing.assert_array_equal(one.inside(centers), is_inside("box", centers))


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
    volume = one.inside(centers).sum() * 0.05**3
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
    expected = [((centers > low) & (centers < high)).all(axis=-1) for low, high in bodies]
    np.testing.assert_array_equal(one.inside(centers), expected[0] | expected[1])


@pytest.mark.parametrize("yaw", [0.0, 35.0])
def test_y_up_models_are_turned_before_all_else(tmp_path, yaw):
    """An upright box whose file has (x, z, -y) for the room's (x, y, z)."""
    low, high = np.array([-0.3, -0.2, 0.0]), np.array([0.5, 0.2, 0.4])
    triangles = box_triangles(low, high)
    upright = write_stl(tmp_path / "z.stl", triangles)
    lying = write_stl(
        tmp_path / "y.stl", np.stack([triangles[..., 0], triangles[..., 2], -triangles[..., 1]], axis=-1)
    )
    keys = {"kind": "mesh", "yaw_deg": yaw, "translate": (2.0, 1.4, 0.1), "scale": 1.5}
    expected = shape(Mesh(file=upright, **keys), ROOM, tmp_path)
    found = shape(Mesh(file=lying, up="y", **keys), ROOM, tmp_path)
    np.testing.assert_allclose([found.low, found.high], [expected.low, expected.high], atol=1e-6)
    np.testing.assert_array_equal(found.inside(centers), expected.inside(centers))
    turned = shape(Mesh(file=lying, **keys), ROOM, tmp_path)
    assert isinstance(turned, Solid)
    np.testing.assert_allclose(turned.turned_up(), [expected.low, expected.high], atol=1e-6)
    assert isinstance(found, Solid)
    np.testing.assert_allclose(found.turned_up(), [turned.low, turned.high], atol=1e-6)
    assert "y up" in found.text


def room(obstacle: dict, size: list) -> dict:
    return {
        "duration": 1.0,
        "domain": {"size": size, "spacing": 0.1},
        "wind": {"kind": "synthetic", "speed": 0.1},
        "obstacles": [{"kind": "mesh", **obstacle}],
        "gas": {"kind": "eulerian", "sources": [{"position": [0.2] * len(size), "rate": 1e-6}]},
    }


def test_a_mesh_that_fits_with_another_axis_up_is_told_the_key(tmp_path):
    """Outside of the room, below its floor, or beside the height of its section."""
    cupboard = box_triangles((1, 1, 0), (2, 1.5, 0.8))
    lying = np.stack([cupboard[..., 0], cupboard[..., 2], -cupboard[..., 1]], axis=-1)
    write_stl(tmp_path / "y.stl", lying)
    write_stl(tmp_path / "z.stl", cupboard)
    for file, size, other in (("y.stl", [4, 3, 1], "y"), ("y.stl", [4, 3], "y"), ("z.stl", [4, 3, 1], "z")):
        up = {"y": "z", "z": "y"}[other]
        with pytest.raises(ScenarioError, match=f"give up: {other}|or up: {other}"):
            load_scenario(room({"file": file, "up": up, "section": 0.4}, size), folder=tmp_path)
        fits = room({"file": file, "up": other, "section": 0.4}, size)
        _, resources = load(fits, folder=tmp_path)
        assert not any(line.startswith("obstacles") for line in resources.warnings)
        assert "x 1 to 2 m, y 1 to 1.5 m, z 0 to 0.8 m" in resources.facts["obstacles[0]"].text
    lying[..., 2] += 1.3  # partly below the floor
    write_stl(tmp_path / "part.stl", lying)
    fits = {"file": "part.stl", "translate": [0, 1.3, 0]}
    warnings = load(room(fits, [4, 4, 1]), folder=tmp_path).resources.warnings
    assert any("give up: y" in line for line in warnings)


def fine(low, high, n=10):
    """Return the triangles of an upright box that face outwards, 2 n² on each of its sides."""
    steps = np.linspace(0.0, 1.0, n + 1)
    a, b = (x.ravel() for x in np.meshgrid(steps[:-1], steps[:-1], indexing="ij"))
    corners = np.array([(0, 0), (1, 0), (1, 1), (0, 0), (1, 1), (0, 1)]) / n
    flat = np.stack([a[:, None] + corners[:, 0], b[:, None] + corners[:, 1]], axis=-1).reshape(-1, 3, 2)
    triangles = []
    for axis in range(3):
        for side in (0.0, 1.0):
            one = np.insert(flat, axis, side, axis=-1)
            triangles.append(one if (side == 1.0) == (axis != 1) else one[:, ::-1])
    return np.concatenate(triangles) * (np.array(high) - low) + low


def without(triangles, low, high):
    """Return the triangles whose middle is outside of a box."""
    middle = triangles.mean(axis=1)
    return triangles[~((middle > low) & (middle < high)).all(axis=1)]


def placed(folder, triangles, **keys):
    found = shape(Mesh(kind="mesh", file=write_stl(folder / "open.stl", triangles), **keys), ROOM, folder)
    assert isinstance(found, Solid)
    return found


def ball(n=48, radius=0.45):
    """Return triangles of a sphere about (2, 1.5, 0.5) that face outwards."""
    u, v = np.meshgrid(np.linspace(0, 2 * pi, 2 * n + 1), np.linspace(0, pi, n + 1), indexing="ij")
    p = radius * np.stack([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)], axis=-1) + (
        2.0,
        1.5,
        0.5,
    )
    p[-1] = p[0]
    first = np.stack([p[:-1, :-1], p[:-1, 1:], p[1:, 1:]], axis=2).reshape(-1, 3, 3)
    second = np.stack([p[:-1, :-1], p[1:, 1:], p[1:, :-1]], axis=2).reshape(-1, 3, 3)
    return np.concatenate([first, second])


@pytest.mark.parametrize("lost", [1, 30, pytest.param(150, marks=pytest.mark.slow)])
@pytest.mark.parametrize("facing", ["outwards", "inwards", "at random"])
def test_a_sphere_with_holes_is_the_sphere(tmp_path, lost, facing):
    random = np.random.default_rng(lost)
    triangles = random.permutation(ball())[lost:]
    turned = {"outwards": 0.0, "inwards": 1.0, "at random": 0.3}[facing]
    some = random.random(len(triangles)) < turned
    triangles[some] = triangles[some][:, ::-1]
    one = placed(tmp_path, triangles)
    volume = one.inside(centers).sum() * 0.05**3
    assert volume == pytest.approx(4 / 3 * pi * 0.45**3, rel=0.02)
    p = random_points(5000)
    away = np.linalg.norm(p - (2.0, 1.5, 0.5), axis=-1) - 0.45
    distance = one.signed_distance(p)
    np.testing.assert_array_equal(one.inside(p), distance < 0)
    far = abs(away) > 0.05  # beyond the width of the holes
    np.testing.assert_allclose(distance[far], away[far], atol=0.02)
    words = " ".join(one.remarks)
    assert "not watertight" in words
    assert "open" in words
    assert ("turned" in words) == (facing == "at random")


def test_a_flat_hole_is_closed_flat(tmp_path):
    """In space and in section, also beside a closed body, and for a shape that is turned and moved."""
    low, high = np.array([1.0, 1.0, 0.1]), np.array([2.2, 2.0, 0.9])
    holed = without(fine(low, high), (2.19, 1.3, 0.3), (2.21, 1.7, 0.6))
    beside = box_triangles((3.0, 1.0, 0.0), (3.5, 2.0, 0.5))
    one = placed(tmp_path, np.concatenate([holed, beside]))
    p = random_points(20_000)
    first = ((p > low) & (p < high)).all(axis=1)
    second = ((p > (3.0, 1.0, 0.0)) & (p < (3.5, 2.0, 0.5))).all(axis=1)
    np.testing.assert_array_equal(one.inside(p), first | second)
    bodies = [((1.0, 1.0, 0.1), (2.2, 2.0, 0.9)), ((3.0, 1.0, 0.0), (3.5, 2.0, 0.5))]
    exact = np.min([_box_distance(p, *map(np.array, body)) for body in bodies], axis=0)
    np.testing.assert_allclose(one.signed_distance(p), exact, atol=1e-5)
    above = _box_distance(p[:, :2], low[:2], high[:2])  # of robots 0.3 m high, which meet the hole
    near = p[:, 0] < 2.5
    found = one.horizontal_distance(p[:, :2], 0.0, 0.3)
    np.testing.assert_allclose(found[near & (above > 0)], above[near & (above > 0)], atol=1e-4)
    flat = shape(Mesh(kind="mesh", file="open.stl", section=0.45), FLOOR, tmp_path)
    np.testing.assert_array_equal(flat.inside(p[:, :2]), flat.signed_distance(p[:, :2]) < 0)
    np.testing.assert_array_equal(flat.inside(p[:, :2]), _in_rectangles(p))
    assert "2 bodies" in one.text


def _box_distance(p, low, high):
    """Return the signed distance of points (n, d) to an upright box."""
    beyond = np.maximum(low - p, p - high)
    return np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(beyond.max(axis=1), 0.0)


def _in_rectangles(p):
    x, y = p[:, 0], p[:, 1]
    return (y > 1) & (y < 2) & (((x > 1) & (x < 2.2)) | ((x > 3) & (x < 3.5)))


def test_walls_of_a_house_with_open_door_frames_hold_its_air(tmp_path):
    """Outer and inner faces of walls, whose frame around the door is missing."""
    outer = without(fine((0.2, 0.2, -0.2), (3.8, 2.8, 1.2), 26), (3.79, 1.2, 0.1), (3.81, 1.7, 0.6))
    inner = without(fine((0.4, 0.4, 0.0), (3.6, 2.6, 1.0), 26)[:, ::-1], (3.59, 1.2, 0.1), (3.61, 1.7, 0.6))
    one = placed(tmp_path, np.concatenate([outer, inner]))
    p = random_points(20_000)
    rooms = ((p > (0.4, 0.4, 0.0)) & (p < (3.6, 2.6, 1.0))).all(axis=1)
    whole = ((p > (0.2, 0.2, -0.2)) & (p < (3.8, 2.8, 1.2))).all(axis=1)
    door = (p[:, 0] > 3.3) & (abs(p[:, 1] - 1.45) < 0.5) & (p[:, 2] < 0.8)
    np.testing.assert_array_equal(one.inside(p)[~door], (whole & ~rooms)[~door])
    assert not one.inside(np.array([[3.7, 1.45, 0.35]]))[0]  # the doorway itself is open


def test_bodies_that_share_an_edge_are_their_union(tmp_path):
    boxes = [((1.0, 1.0, 0.0), (2.0, 2.0, 1.0)), ((2.0, 2.0, 0.0), (3.0, 3.0, 1.0))]
    for make in (fine, lambda low, high, n: box_triangles(low, high)):
        one = placed(tmp_path, np.concatenate([make(*box, 1) for box in boxes]))
        p = random_points()
        inside = [((p > low) & (p < high)).all(axis=1) for low, high in boxes]
        np.testing.assert_array_equal(one.inside(p), inside[0] | inside[1])
        assert "non-manifold" in " ".join(one.remarks)


@pytest.mark.parametrize("holes", [False, True])
def test_faces_that_are_drawn_from_both_sides_count_once(tmp_path, holes):
    box = fine((1, 1, 0.1), (2, 2, 0.7))
    box = without(box, (0.9, 1.4, 0.3), (1.1, 1.6, 0.5)) if holes else box
    one = placed(tmp_path, np.concatenate([box, box[:, ::-1]]))
    p = random_points()
    np.testing.assert_array_equal(one.inside(p), ((p > (1, 1, 0.1)) & (p < (2, 2, 0.7))).all(axis=1))
    assert "twice" in " ".join(one.remarks)


def test_corners_that_differ_by_rounding_are_joined(tmp_path):
    """As in text files of six digits."""
    box = fine((1, 1, 0), (2, 2, 0.5))
    one = placed(tmp_path, box + np.random.default_rng(0).uniform(-1e-6, 1e-6, box.shape))
    p = random_points()
    np.testing.assert_array_equal(one.inside(p), ((p > (1, 1, 0)) & (p < (2, 2, 0.5))).all(axis=1))
    (remark,) = one.remarks
    assert "joined" in remark


def test_solid_angles_are_those_of_closed_forms():
    """A square of half-width a at height d covers 4 asin(a²/(a² + d²)); a closed box all or nothing."""
    square = np.array([[[-1, -1, 0], [1, -1, 0], [1, 1, 0]], [[-1, -1, 0], [1, 1, 0], [-1, 1, 0]]], float)
    d = np.array([0.1, 1.0, 7.0])
    points = np.stack([0 * d, 0 * d, -d], axis=-1)
    np.testing.assert_allclose(solid_angles(points, square), np.arcsin(1 / (1 + d**2)) / pi, rtol=1e-12)
    p = random_points(1000)
    inside = ((p > (1, 1, 0.2)) & (p < (2, 2, 0.6))).all(axis=1)
    np.testing.assert_allclose(solid_angles(p, fine((1, 1, 0.2), (2, 2, 0.6), 3)), inside, atol=1e-9)


def test_distant_clusters_of_triangles_are_dipoles():
    random = np.random.default_rng(0)
    triangles = np.concatenate([fine((1, 1, 0.2), (3, 1.2, 0.9), 12), ball()])
    p = random.uniform((0, 0, -1), (4, 3, 2), (2000, 3))
    tree = Cluster.of(triangles).winding_number(p)
    exact = solid_angles(p, triangles)
    np.testing.assert_allclose(tree, exact, atol=0.15)
    np.testing.assert_array_equal(np.rint(tree), np.rint(exact))
    assert np.abs(tree - exact).max() > 1e-6  # some are


HOUSES = {
    "touching": [((0, 0), (4, 0.2)), ((0, 2.8), (4, 3)), ((0, 0.2), (0.2, 2.8)), ((3.8, 0.2), (4, 2.8))],
    "overlapping": [((0, 0), (4, 0.3)), ((0, 2.8), (4, 3)), ((0, 0), (0.2, 3)), ((3.7, 0), (4, 3))],
    "apart": [((0.1, 0.1), (3.8, 0.4)), ((0.1, 0.6), (0.3, 2.8)), ((2.4, 0.6), (2.6, 2.0))],
}


@pytest.mark.parametrize("n", [1, 5])
@pytest.mark.parametrize("lost", ["lids", "bottoms", "part of the lids"])
@pytest.mark.parametrize("house", HOUSES)
def test_walls_without_lids_are_walls_also_where_they_meet(tmp_path, house, lost, n):
    walls = [((*low, 0.0), (*high, 1.0)) for low, high in HOUSES[house]]
    floor, ceiling = (0.99, 2.0) if "lids" in lost else (-1.0, 0.01)
    far = 1.7 if "part" in lost else 9.0
    parts = [without(fine(*wall, n), (-1, -1, floor), (far, 9, ceiling)) for wall in walls]
    one = placed(tmp_path, np.concatenate(parts))
    middles = np.stack(np.meshgrid(*(np.arange(k) / 10 + 0.05 for k in (40, 30, 10)), indexing="ij"), -1)
    cells = np.any([((middles > low) & (middles < high)).all(axis=-1) for low, high in walls], axis=0)
    np.testing.assert_array_equal(one.inside(middles), cells)
    np.testing.assert_array_equal(one.signed_distance(middles) < 0, cells)
    on_joint = np.array([[0.1, 0.2, 0.45], [3.9, 0.2, 0.45], [0.1, 2.8, 0.55]])  # in a face of two walls
    assert one.inside(on_joint).all() or house == "apart"


@pytest.mark.parametrize("lost", [None, 7, -20])
@pytest.mark.parametrize("facing", ["opposite", "reversed", "at random", "same"])
def test_inner_faces_make_a_room_hollow(tmp_path, facing, lost):
    """As do those around its air, in which a lamp hangs and a table stands on the floor."""
    outer, inner, lamp, table = (
        ((0.2, 0.2, 0.0), (3.8, 2.8, 1.0)),
        ((0.4, 0.4, 0.1), (3.6, 2.6, 0.9)),
        ((1.0, 1.0, 0.5), (1.4, 1.4, 0.7)),
        ((2.0, 1.0, 0.1), (2.6, 1.6, 0.5)),
    )
    inward = fine(*inner, 2) if facing == "same" else fine(*inner, 2)[:, ::-1]
    triangles = np.concatenate([fine(*outer, 2), fine(*lamp, 1), fine(*table, 1), inward])
    if facing == "reversed":
        triangles = triangles[:, ::-1].copy()
    if facing == "at random":
        some = np.random.default_rng(1).random(len(triangles)) < 0.3
        triangles[some] = triangles[some][:, ::-1]
    triangles = triangles if lost is None else np.delete(triangles, lost, axis=0)
    one = placed(tmp_path, triangles)
    p = random_points(5000)
    bodies = [((p > low) & (p < high)).all(axis=1) for low, high in (outer, inner, lamp, table)]
    expected = bodies[0] if facing == "same" else (bodies[0] & ~bodies[1]) | bodies[2] | bodies[3]
    np.testing.assert_array_equal(one.inside(p), expected)
    np.testing.assert_array_equal(one.signed_distance(p) < 0, expected)
    assert ("united" if facing == "same" else "hollow") in " ".join(one.remarks)


@pytest.mark.parametrize("copies", [1, 5, 12])
def test_triangles_that_are_there_again_count_once(tmp_path, copies):
    boxes = [((0.5, 1.0, 0.1), (1.5, 2.0, 0.6)), ((2.0, 1.0, 0.1), (3.0, 2.0, 0.9))]
    first, second = (fine(*box, 1) for box in boxes)
    again = np.roll(first[:copies], 1, axis=1)  # from another corner
    one = placed(tmp_path, np.concatenate([first, second, again]))
    p = random_points(5000)
    expected = np.min([_box_distance(p, *map(np.array, box)) for box in boxes], axis=0)
    np.testing.assert_allclose(one.signed_distance(p), expected, atol=1e-5)
    (remark,) = one.remarks
    assert remark.split()[1] == str(copies)


def test_in_2d_walls_need_to_be_closed_only_at_the_section(tmp_path):
    """They have neither lids nor bottoms. Without the face at an end, they are refused."""
    walls = [
        ((0.2, 0.2, 0.0), (3.8, 0.5, 1.0)),
        ((0.2, 0.5, 0.0), (0.6, 2.8, 1.0)),
        ((0.4, 2.0, 0), (3, 2.4, 1)),
    ]
    hollow = np.concatenate([fine(low, high, 4) for low, high in walls])
    sides = hollow[np.abs(hollow.mean(axis=1)[:, 2] - 0.5) < 0.49]
    file = write_stl(tmp_path / "sides.stl", sides)
    one = shape(Mesh(kind="mesh", file=file, section=0.6), FLOOR, tmp_path)
    p = random_points(dim=2)
    expected = np.any([((p > low[:2]) & (p < high[:2])).all(axis=1) for low, high in walls], axis=0)
    np.testing.assert_array_equal(one.inside(p), expected)
    np.testing.assert_array_equal(one.signed_distance(p) < 0, expected)
    assert isinstance(one, Solid)
    assert "its section at 0.6 m is closed" in " ".join(one.remarks)
    with pytest.raises(MeshError, match="mesh editor"):
        placed(tmp_path, sides)
    cut = write_stl(tmp_path / "cut.stl", sides[np.abs(sides.mean(axis=1)[:, 0] - 3.8) > 0.01])
    with pytest.raises(MeshError, match="mesh editor"):
        shape(Mesh(kind="mesh", file=cut, section=0.6), FLOOR, tmp_path)


def test_in_2d_a_body_with_a_hole_may_lie_above_the_section(tmp_path):
    low = box_triangles((1, 1, 0), (2, 2, 0.4))
    above = fine((2.2, 1, 0.5), (3, 2, 0.9), 4)[1:]
    file = write_stl(tmp_path / "two.stl", np.concatenate([low, above]))
    one = shape(Mesh(kind="mesh", file=file, section=0.2), FLOOR, tmp_path)
    p = random_points(dim=2)
    np.testing.assert_array_equal(one.inside(p), ((p > 1) & (p < 2)).all(axis=1))


@pytest.mark.parametrize("missing", range(12))
def test_a_box_with_a_missing_triangle_is_the_box(tmp_path, missing):
    low, high = np.array([1.0, 1.0, 0.1]), np.array([1.8, 1.7, 0.7])
    one = placed(tmp_path, np.delete(fine(low, high, 1), missing, axis=0))
    p = random_points(5000)
    np.testing.assert_allclose(one.signed_distance(p), _box_distance(p, low, high), atol=1e-5)
    (remark,) = one.remarks
    assert "not watertight: 3 open" in remark
    assert "% of the surface" in remark


def test_a_deep_bin_is_filled_with_a_remark(tmp_path):
    one = placed(tmp_path, without(fine((1, 1, 0), (1.3, 1.3, 0.9)), (0, 0, 0.89), (4, 4, 1)))
    assert one.inside(np.array([[1.15, 1.15, 0.85]]))[0]
    assert "holes are closed" in one.remarks[0]
    assert "holes are 7.69 % of the surface" in one.remarks[0]


@pytest.mark.parametrize("name", ["sheet", "tray", "tube"])
def test_bodies_that_are_truly_open_are_refused(tmp_path, name):
    triangles = {
        "sheet": fine((1, 1, 0.2), (2, 2, 0.8))[:200],
        "tray": without(fine((1, 1, 0), (2, 2, 0.2)), (0, 0, 0.19), (4, 4, 1)),
        "tube": without(
            without(fine((1, 1, 0), (2, 1.3, 0.3)), (0, 0, 0), (1.01, 4, 4)), (1.99, 0, 0), (4, 4, 4)
        ),
    }
    with pytest.raises(MeshError, match=r"not watertight: \d+ open") as caught:
        placed(tmp_path, triangles[name])
    assert "mesh editor" in str(caught.value)


def test_faulty_meshes_are_reported(tmp_path):
    triangles = box_triangles((1, 1, 0), (2, 2, 0.5))
    beside = np.concatenate([box_triangles((3, 1, 0), (4, 2, 1)), triangles[:10]])
    faults = {
        "none.stl": "no such file",
        write_stl(tmp_path / "hole.stl", triangles[2:]): "body 0 is not watertight: 4 open",
        write_stl(tmp_path / "lid.stl", beside): "body 1 is not watertight: 4 open",
    }
    for file, reported in faults.items():
        with pytest.raises(MeshError, match=reported):
            shape(Mesh(kind="mesh", file=file), ROOM, tmp_path)
    with pytest.raises(MeshError, match=r"section 0\.7 m does not cut it"):
        shape(Mesh(kind="mesh", file=write_stl(tmp_path / "b.stl", triangles), section=0.7), FLOOR, tmp_path)
