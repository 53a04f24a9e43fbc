"""Outlines and meshes of obstacles and windows, against closed forms and the distances of the shapes."""

from collections.abc import Callable
from math import pi
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from bodies import FLOOR, L_SHAPE, ROOM, SHAPES, random_points
from test_floor_plans import plan
from test_meshes import torus, write_obj

from taichi_plume.files.gaden import Cubes, Occupancy
from taichi_plume.grid.outlines import Mesh, ball, extruded, faceted, silhouette
from taichi_plume.grid.shapes import Blocks, Shape
from taichi_plume.grid.winding_number import solid_angles, turns
from taichi_plume.scenario import obstacles
from taichi_plume.scenario.domain import Domain
from taichi_plume.scenario.openings import Fan, Inlet, Periodic
from taichi_plume.scenario.shapes import shape

SIZE = (4.0, 3.0, 1.0)
PLANES = ((0, 1), (0, 2), (1, 2))
C, S = np.sqrt(0.75), 0.5
WALLS = np.zeros((80, 60), bool)
WALLS[10:70, 20:22] = WALLS[30:34, 5:50] = True  # a cross


def area(polygons: list[np.ndarray]) -> float:
    """Return the area of polygons; negative of those that turn clockwise."""
    return float(sum(p[:, 0] @ np.roll(p[:, 1], -1) - p[:, 1] @ np.roll(p[:, 0], -1) for p in polygons)) / 2


def volume(mesh: Mesh) -> float:
    return float(np.linalg.det(mesh.vertices[mesh.triangles]).sum()) / 6


def is_filled(polygons: list[np.ndarray], points: np.ndarray) -> np.ndarray:
    """Return which points (n, 2) the polygons wind around."""
    edges = np.concatenate([np.stack([p, np.roll(p, -1, axis=0)], axis=1) for p in polygons])
    return np.rint(turns(points, edges)) != 0


def of(name: str) -> Callable[[Domain, Path], Shape]:
    return lambda domain, folder: shape(SHAPES[name], domain, folder)


def back_to_front(domain: Domain, folder: Path) -> Shape:
    return shape(SHAPES["prism"].model_copy(update={"vertices": L_SHAPE[::-1]}), domain, folder)


def ring(domain: Domain, folder: Path) -> Shape:
    file = write_obj(folder / "torus.obj", *torus())
    return shape(
        obstacles.Mesh(kind="mesh", file=file, translate=(2.0, 1.5, 0.3), section=0.3), domain, folder
    )


def turned_box(domain: Domain, folder: Path) -> Shape:
    corners = [(x, y, z) for x in (-0.5, 0.5) for y in (-0.25, 0.25) for z in (0.0, 0.4)]
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    file = write_obj(folder / "box.obj", corners, quads)
    keys = {"kind": "mesh", "file": file, "yaw_deg": 30.0, "translate": (2.0, 1.5, 0.1), "section": 0.3}
    return shape(obstacles.Mesh.model_validate(keys), domain, folder)


def walls(domain: Domain, folder: Path) -> Shape:
    return plan(folder, WALLS, domain.extent, base=0.2, height=0.5)


def cubes(domain: Domain, folder: Path) -> Shape:
    solid = np.zeros((20, 15, 5), np.int8)
    solid[4:9, 3:12, :2] = solid[12:14, 6:8, :4] = 1
    return Cubes(Occupancy(Path("o.csv"), np.zeros(3), 0.2, solid), domain.dim, np.zeros(3), 0.3)


class Body(NamedTuple):
    """Shape in a room, its volume [m³], and the areas [m²] of its projections along z, y and x."""

    make: Callable[[Domain, Path], Shape]
    volume: float
    areas: tuple[float, ...]


BODIES = {
    "box": Body(of("box"), 0.2, (0.5, 0.4 * (C + 0.5 * S), 0.4 * (S + 0.5 * C))),
    "cylinder": Body(of("cylinder"), pi / 8, (pi / 4, 0.5, 0.5)),
    "column": Body(of("column"), pi / 4, (pi / 4, 1.0, 1.0)),
    "sphere": Body(of("sphere"), 4 / 3 * pi * 0.35**3, (pi * 0.35**2,) * 3),
    "prism": Body(of("prism"), 1.8, (3.0, 1.2, 1.2)),
    "clockwise prism": Body(back_to_front, 1.8, (3.0, 1.2, 1.2)),
    "torus": Body(ring, 2 * pi**2 * 0.6 * 0.04, (pi * (0.64 - 0.16), *(0.48 + pi * 0.04,) * 2)),
    "mesh": Body(turned_box, 0.2, (0.5, 0.4 * (C + 0.5 * S), 0.4 * (S + 0.5 * C))),
    "map": Body(walls, 0.0025 * WALLS.sum() * 0.5, (0.0025 * WALLS.sum(), 1.5, 1.125)),
    "cubes": Body(cubes, 0.008 * (5 * 9 * 2 + 2 * 2 * 4), (1.96, 0.4 + 0.32, 0.72 + 0.16)),
}
EVERY_BODY = pytest.mark.parametrize("name", BODIES)


@pytest.mark.parametrize("plane", PLANES)
@EVERY_BODY
def test_outlines_fill_projections(tmp_path, name, plane):
    body = BODIES[name]
    one = body.make(ROOM, tmp_path)
    polygons, flat = one.outline(plane), np.random.default_rng(1).uniform(0, SIZE, (400, 3))[:, [*plane]]
    (across,) = {0, 1, 2} - {*plane}
    along = np.linspace(-0.01, SIZE[across] + 0.01, 161)
    points = np.insert(np.repeat(flat[:, None], len(along), axis=1), across, along, axis=2)
    least = one.signed_distance(points).min(axis=1)
    clear = abs(least) > 0.03
    np.testing.assert_array_equal(is_filled(polygons, flat)[clear], (least < 0)[clear])
    assert clear.mean() > 0.5
    corners = np.concatenate(polygons)
    if not isinstance(one, Blocks):  # of which polygons may overlap
        assert area(polygons) == pytest.approx(body.areas[PLANES.index(plane)], rel=4e-3)
        np.testing.assert_allclose(corners.min(axis=0), one.low[[*plane]], atol=2e-3)
        np.testing.assert_allclose(corners.max(axis=0), one.high[[*plane]], atol=2e-3)
    else:
        lattice = np.stack(np.meshgrid(*(np.arange(0.0125, SIZE[d], 0.025) for d in plane)), -1).reshape(
            -1, 2
        )
        covered = is_filled(polygons, lattice).sum() * 0.025**2
        assert covered == pytest.approx(body.areas[PLANES.index(plane)], rel=1e-9)


@EVERY_BODY
def test_meshes_enclose_bodies(tmp_path, name):
    one = BODIES[name].make(ROOM, tmp_path)
    mesh = one.mesh(SIZE)
    if name != "cubes":  # whose faces meet inside
        assert volume(mesh) == pytest.approx(BODIES[name].volume, rel=8e-3)
        points = random_points(2000)
        distance = one.signed_distance(points)
        clear = abs(distance) > 0.02
        winding = solid_angles(points, mesh.vertices[mesh.triangles])
        np.testing.assert_allclose(winding[clear], (distance < 0)[clear], atol=1e-6)
    corners = mesh.vertices[mesh.triangles]
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    thin = np.linalg.norm(facing, axis=1) < 1e-12
    for n in range(3):
        assert (np.einsum("ij,ij->i", facing, mesh.normals[mesh.triangles[:, n]]) > 0)[~thin].all()
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1.0)


FLAT = {
    "box": 0.5,
    "cylinder": pi / 4,
    "sphere": pi * 0.35**2,
    "prism": 3.0,
    "torus": pi * 0.48,
    "mesh": 0.5,
    "map": 0.0025 * WALLS.sum(),
    "cubes": 1.96,
}


@pytest.mark.parametrize("name", FLAT)
def test_in_2d_obstacles_are_sections_as_high_as_the_walls(tmp_path, name):
    one = BODIES[name].make(FLOOR, tmp_path)
    polygons = one.outline((0, 1))
    assert area(polygons) == pytest.approx(FLAT[name], rel=4e-3)
    points = random_points(2000, dim=2)
    distance = one.signed_distance(points)
    clear = abs(distance) > 0.01
    np.testing.assert_array_equal(is_filled(polygons, points)[clear], (distance < 0)[clear])
    if name in ("torus", "mesh"):
        return  # the whole body is shown
    mesh = one.mesh((4.0, 3.0, 0.2))
    assert (mesh.vertices[:, 2].min(), mesh.vertices[:, 2].max()) == (0.0, 0.2)
    if name != "cubes":
        assert volume(mesh) == pytest.approx(0.2 * FLAT[name], rel=6e-3)


def test_obstacles_end_at_the_ceiling():
    tall = shape(SHAPES["cylinder"].model_copy(update={"height": 5.0}), ROOM, Path())
    assert tall.mesh(SIZE).vertices[:, 2].max() == 1.0


def test_walls_end_at_the_room(tmp_path):
    everywhere = plan(tmp_path, np.ones((120, 100), bool), (4.0, 3.0), at=(-0.5, -0.5, 0.0))
    assert volume(everywhere.mesh((4.0, 3.0, 0.2))) == pytest.approx(4.0 * 3.0 * 0.2)


def test_an_empty_map_has_no_walls(tmp_path):
    empty = plan(tmp_path, np.zeros((40, 40), bool), (2.0, 2.0))
    assert empty.outline((0, 1)) == []
    assert len(empty.mesh((2.0, 2.0, 0.2)).triangles) == 0


def test_a_notch_is_triangulated():
    notch = np.array([[0, 0], [4, 0], [4, 3], [2, 0.5], [0, 3]], float)
    assert volume(extruded(notch, 0.5, 2.0)) == pytest.approx(1.5 * 7.0)


def test_round_bodies_are_shaded_smoothly():
    """Normals of a cylinder and a ball point away from the axis and the middle, those of facets do not."""
    mesh = ball(np.zeros(3), 2.0)
    np.testing.assert_allclose(mesh.normals, mesh.vertices / 2.0, atol=1e-12)
    column = shape(SHAPES["column"], ROOM, Path()).mesh(SIZE)
    side = column.normals[:, 2] == 0
    away = (column.vertices - [1.8, 1.6, 0.0])[side, :2] / 0.5
    np.testing.assert_allclose(column.normals[side, :2], away, atol=1e-12)
    box = shape(SHAPES["box"], ROOM, Path()).mesh(SIZE)
    assert len(np.unique(np.round(box.normals, 9), axis=0)) == 6
    corners = mesh.vertices[mesh.triangles]
    assert volume(faceted(corners)) == pytest.approx(volume(mesh))


def test_thin_parts_stay_in_silhouettes():
    """A plate of a hundredth of a pixel is drawn as wide as a pixel."""
    plate = np.array([[[0, 0], [1, 0], [1, 1e-5]], [[0, 0], [1, 1e-5], [0, 1e-5]]], float)
    wide = np.array([[[0.0, 0.5], [1, 0.5], [1, 1.0]]])
    polygons = silhouette(np.concatenate([plate, wide]))
    assert is_filled(polygons, np.array([[0.5, 0.0], [0.5, 0.4], [0.9, 0.7]])).tolist() == [True, False, True]


# ---------------------------------------------------------------- windows


FAN = Fan(kind="fan", face="x-", center=(1.5, 0.5), diameter=0.4, speed=1.0)
INLET = Inlet(kind="inlet", face="y+", center=(1.5, 0.5), size=(1.0, 0.4), speed=1.0)


def test_a_fan_is_a_disc_on_its_face():
    outline = FAN.outline(SIZE)
    assert np.all(outline[:, 0] == 0)
    assert np.hypot(outline[:, 1] - 1.5, outline[:, 2] - 0.5) == pytest.approx(0.2)
    assert area([outline[:, 1:]]) == pytest.approx(FAN.area(SIZE, 1.0), rel=1e-3)
    np.testing.assert_array_equal(FAN.outline(SIZE, (1, 2)), outline[:, 1:])


def test_an_inlet_is_a_rectangle_on_its_face():
    assert np.all(INLET.outline(SIZE)[:, 1] == 3.0)
    assert area([INLET.outline(SIZE, (0, 2))]) == pytest.approx(0.4)


def test_edge_on_windows_are_lines():
    np.testing.assert_allclose(FAN.outline(SIZE, (0, 1)), [[0, 1.3], [0, 1.7]])
    np.testing.assert_allclose(FAN.outline(SIZE, (0, 2)), [[0, 0.3], [0, 0.7]])
    np.testing.assert_allclose(INLET.outline(SIZE, (1, 2)), [[3, 0.3], [3, 0.7]])


def test_in_2d_windows_are_as_high_as_the_walls():
    slot = Fan(kind="fan", face="x+", center=(1.5,), diameter=0.4, speed=1.0)
    np.testing.assert_allclose(slot.outline(SIZE[:2], (0, 1)), [[4, 1.3], [4, 1.7]])
    outline = slot.outline(SIZE[:2], height=0.2)
    assert np.all(outline[:, 0] == 4.0)
    assert area([outline[:, 1:]]) == pytest.approx(0.4 * 0.2)


def test_periodic_faces_are_opposite():
    low, high = Periodic(kind="periodic", axis="y").faces
    np.testing.assert_allclose(low.outline(SIZE, (0, 1)), [[0, 0], [4, 0]])
    np.testing.assert_allclose(high.outline(SIZE, (0, 1)), [[0, 3], [4, 3]])


@pytest.mark.parametrize(("speed", "direction"), [(0.5, 1), (-0.5, -1)])
def test_direction_is_that_of_the_air(speed, direction):
    assert FAN.model_copy(update={"speed": speed}).direction == direction
