from math import hypot

import numpy as np
import pytest
from rooms import cfd

from taichi_plume.grid.cut_cells import Air, air_of
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.kernels import Pass
from taichi_plume.grid.shapes import Ball, Shape, UprightBox
from taichi_plume.scenario.obstacles import Box, Sphere
from taichi_plume.solvers.extension import oblique_planes
from taichi_plume.solvers.flow import FlowSolver
from taichi_plume.solvers.surfaces import CONVEX, curvatures
from taichi_plume.validation.body_cases import Outside
from taichi_plume.validation.flow_cases import advance, periodic

pytestmark = pytest.mark.usefixtures("taichi")
WIDTH, SPEED = 0.4, 0.5  # m, m/s


def channel(slope: tuple[int, int], shift: float = 0.0, **more) -> tuple[FlowSolver, Air, np.ndarray]:
    """Air that is set in motion between plane walls along `slope`, 20 cells per metre; and the direction."""
    x, y = slope
    along = np.array(slope) / hypot(x, y)
    if y == 0:
        grid = Grid((8, round(20 * WIDTH)), 0.05, periodic=(True, False))
        air = Air.everywhere(grid)
    else:
        grid, period = Grid((20 * x, 20 * y), 0.05, periodic=(True, True)), x * y / hypot(x, y)

        def away(place: np.ndarray) -> np.ndarray:
            across = along[0] * place[..., 1] - along[1] * place[..., 0] - shift
            return np.abs((across + period / 2) % period - period / 2)

        air = air_of([Outside(grid, WIDTH / 2, away)], grid)
    flow = FlowSolver(cfd(periodic("xy" if y else "x"), **more), grid, air)
    flow.start_from(lambda place: SPEED * along * np.ones_like(place))
    return flow, air, along


def lost(flow: FlowSolver, air: Air, along: np.ndarray) -> float:
    """Momentum [m²/s] that each wall has taken per area."""
    area = [flow.grid.inner(flow.grid.pad_faces(a, d)).astype(float) for d, a in enumerate(air.area)]
    moved = sum((flow.grid.read(u) * a).sum() * e for u, a, e in zip(flow.u, area, along, strict=True))
    whole = sum(a.sum() * e**2 for a, e in zip(area, along, strict=True))
    return (SPEED - moved / whole) * WIDTH / 2


@pytest.mark.parametrize("kind", ["vreman", "none"])
@pytest.mark.slow
def test_an_oblique_wall_takes_no_momentum_by_convection(kind):
    """At 45 degrees what comes to a closed face has the velocity of what leaves it: only friction is left."""
    flow, _, along = channel((1, 1), 0.013, turbulence={"kind": kind})
    advance(flow, 1.0)
    loss = flow.momentum_loss()
    closed = [flow.grid.inner(area) == 0.0 for area in flow._area]
    for u, shut in zip(flow.u, closed, strict=True):
        np.testing.assert_array_equal(flow.grid.read(u)[shut], 0.0)
    taken = sum(part.sum() * e for part, e in zip(loss, along, strict=True))
    passed_on = sum(part[shut].sum() * e for part, shut, e in zip(loss, closed, along, strict=True))
    if kind == "vreman":
        assert abs(passed_on) < 1e-4 * taken
    else:  # there is no law of the wall that would tell whether the layer is resolved
        one = Pass(lambda a, b: None, 0)
        assert flow.surfaces.slipping([one]) == [one]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("slope", "shift"), [((1, 1), 0.013), ((1, 1), 0.03), ((3, 1), 0.013), ((3, 1), 0.025)]
)
def test_oblique_walls_take_what_walls_along_the_grid_take(slope, shift):
    straight, oblique = channel((1, 0)), channel(slope, shift)
    for flow, _, _ in (straight, oblique):
        advance(flow, 4.0)
    assert lost(*oblique) == pytest.approx(lost(*straight), rel=0.2)


def surface_of(shape: Shape, size: tuple[int, ...]) -> tuple[Grid, np.ndarray, np.ndarray]:
    """A grid of cells of 1 m, the vectors of the surface in it, and the cells that hold some of it, (n, dim)."""
    grid = Grid(size, 1.0)
    vectors = np.stack(
        [grid.pad(part) for part in np.moveaxis(air_of([shape], grid).surface(), -1, 0)], axis=-1
    )
    return grid, vectors, np.argwhere(np.linalg.norm(vectors, axis=-1) > 0.01)


def planes(shape: Shape) -> tuple[np.ndarray, np.ndarray]:
    """Centres of the cells at a surface, of 40 x 40 x 8; whether air slips there."""
    grid, vectors, cells = surface_of(shape, (40, 40, 8))
    return cells - grid.ghost + 0.5, oblique_planes(vectors, cells, grid)


def box(yaw: float, width: float) -> UprightBox:
    return UprightBox(Box(kind="box", center=(20.0, 20.0, 4.0), size=(24.0, width, 40.0), yaw_deg=yaw), 3)


@pytest.mark.parametrize("width", [16.0, 3.0])  # the other side is near or far
def test_air_slips_along_oblique_planes(width):
    places, slips = planes(box(30.0, width))
    angle = np.deg2rad(30.0)
    x, y = places[:, 0] - 20.0, places[:, 1] - 20.0
    along, across = np.cos(angle) * x + np.sin(angle) * y, np.cos(angle) * y - np.sin(angle) * x
    middle = (np.abs(along) < 5.0) & (np.abs(np.abs(across) - width / 2) < 1.0)
    middle &= (places[:, 2] > 0.0) & (places[:, 2] < 8.0)
    assert middle.sum() > 100
    assert slips[middle].all()
    assert not slips[(np.abs(along) > 10.0) & (np.abs(across) > width / 2 - 2.0)].any()


def test_air_slips_neither_along_the_grid_nor_along_curved_surfaces():
    assert not planes(box(0.0, 16.0))[1].any()
    assert not planes(Ball(Sphere(kind="sphere", center=(20.0, 20.0, 4.0), radius=6.0), 3))[1].any()


CENTRE = np.array([20.2, 19.9])


def curvature(shape: Shape, size: tuple[int, ...] = (40, 40)) -> tuple[np.ndarray, np.ndarray]:
    """Centres (n, dim) of the cells at a surface; its curvature there [1/m]."""
    grid, vectors, cells = surface_of(shape, size)
    at_cells = vectors[tuple(cells.T)]
    normals = at_cells / np.linalg.norm(at_cells, axis=-1, keepdims=True)
    return cells - grid.ghost + 0.5, curvatures(vectors, cells, normals)


@pytest.mark.parametrize("radius", [4.0, 8.0, 16.0, 32.0])
def test_a_disc_has_the_curvature_of_its_circle(radius):
    size = 40 if radius < 20.0 else 100
    disc = Sphere(kind="sphere", center=(size / 2 + 0.2, size / 2 - 0.1), radius=radius)
    found = curvature(Ball(disc, 2), (size, size))[1]
    assert radius > 20.0 or np.median(found) == pytest.approx(1.0 / radius, rel=0.25)
    assert (found > CONVEX).all()


def test_a_ball_has_twice_the_curvature():
    ball = Ball(Sphere(kind="sphere", center=(12.2, 11.9, 12.1), radius=8.0), 3)
    assert np.median(curvature(ball, (24, 24, 24))[1]) == pytest.approx(2.0 / 8.0, rel=0.25)


@pytest.mark.parametrize("radius", [4.0, 8.0, 15.0])
def test_a_bore_is_concave(radius):
    bore = Outside(Grid((40, 40), 1.0), radius, lambda x: np.linalg.norm(x - CENTRE, axis=-1))
    places, found = curvature(bore)
    inner = np.linalg.norm(places - CENTRE, axis=-1) < radius + 2.0
    assert inner.sum() > 20
    assert np.median(found[inner]) == pytest.approx(-1.0 / radius, rel=0.25)
    assert (found[inner] < 0.0).all()


@pytest.mark.parametrize("yaw", [0.0, 7.0, 20.0, 27.0, 45.0])
def test_the_edges_of_a_box_are_convex_and_its_sides_plane(yaw):
    box = Box(kind="box", center=(20.3, 20.1), size=(22.0, 18.0), yaw_deg=yaw)
    places, found = curvature(UprightBox(box, 2))
    angle = np.deg2rad(yaw)
    x, y = (places - (20.3, 20.1)).T
    along, across = np.cos(angle) * x + np.sin(angle) * y, np.cos(angle) * y - np.sin(angle) * x
    edges = (np.abs(along) > 9.5) & (np.abs(across) > 7.5)
    assert edges.sum() >= 8
    assert (found[edges] > CONVEX).all()
    sides = (np.abs(along) < 5.0) | (np.abs(across) < 3.0)
    assert sides.sum() >= 20
    assert (found[sides] < CONVEX).all()
