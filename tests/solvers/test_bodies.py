from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from rooms import LAMINAR, cfd, flow_in, march

from taichi_plume.engine import ti
from taichi_plume.grid.grid import Grid
from taichi_plume.scenario.domain import Domain
from taichi_plume.scenario.obstacles import Box, Cylinder, Sphere
from taichi_plume.scenario.robots import Body
from taichi_plume.scenario.shapes import shape
from taichi_plume.solvers.bodies import Bodies, MovingObstacle, Outline, Wake
from taichi_plume.solvers.flow import FlowSolver
from taichi_plume.validation.flow_cases import advance, periodic, velocities

pytestmark = pytest.mark.usefixtures("taichi")

MODELS = {"cylinder": Cylinder, "box": Box, "sphere": Sphere}
MIDDLE = (
    {"center": [0.5, 0.4], "radius": 0.2},
    {"center": [0.5, 0.4, 0.3], "radius": 0.2},
)  # no ball, a ball
ENDS = [{"kind": "outlet", "face": "x-"}, {"kind": "outlet", "face": "x+"}]


def still_air(shape=(60, 40), dx=0.05, openings=ENDS, solid=None, bodies=(), **more) -> FlowSolver:
    """bodies: functions of the grid and of the faces that are solved for."""
    grid = Grid(shape, dx)
    return flow_in(grid, cfd(openings, **more), solid, resistances=[partial(body, grid) for body in bodies])


def walker(path: list, **outline) -> Box | Cylinder | Sphere:
    outline = {"center": [0.8, 1.0]} | (outline or {"kind": "cylinder", "radius": 0.2})
    kind = str(outline["kind"])
    return MODELS[kind].model_validate(outline | {"motion": {"path": path}})


def moving(path: list, **outline) -> Callable[..., MovingObstacle]:
    return partial(MovingObstacle, walker(path, **outline))


def walked(path: list, **outline) -> FlowSolver:
    """Still air with one body that moves along a path."""
    return still_air(bodies=[moving(path, **outline)], **LAMINAR)


def faces(grid: Grid, d: int) -> np.ndarray:
    """Places [m] of the lower d-faces."""
    return grid.centers() - 0.5 * grid.dx * np.eye(grid.dim)[d]


@pytest.mark.parametrize("outline", [{}, {"kind": "box", "size": [0.3, 0.4], "yaw_deg": 30}])
def test_the_air_inside_moves_with_the_body(outline):
    flow = walked([[2.0, 2.0, 1.4]], **outline)  # (0.6, 0.2) m/s
    advance(flow, 1.0)
    for d, speed in enumerate((0.6, 0.2)):
        inside = np.linalg.norm(faces(flow.grid, d) - (1.4, 1.2), axis=-1) < 0.12
        assert inside.sum() > 10
        np.testing.assert_allclose(velocities(flow)[d][inside], speed, atol=0.03)
    assert flow.diagnostics()["max_divergence"] < 1e-4


@pytest.mark.slow
def test_a_body_that_starts_at_once_gives_the_air_its_momentum():
    """Impulsive start: of a cylinder the added mass per length is that of the air it displaces (potential flow)."""
    R, U, L = 0.2, 0.5, 3.2
    walls = [{"kind": "slip", "face": face} for face in ("x-", "x+", "y-", "y+")]
    body = moving([[1.0, L / 2 + U, L / 2]], kind="cylinder", center=[L / 2, L / 2], radius=R)
    flow = still_air((96, 96), L / 96, walls, bodies=[body], **LAMINAR)
    march(12, 0.01, flow)
    u, v = velocities(flow)
    energy = 0.5 * ((u**2).sum() + (v**2).sum()) * flow.grid.dx**2
    assert energy == pytest.approx(2 * 0.5 * np.pi * R**2 * U**2, rel=0.15)  # inside, and as much around
    x, y = (faces(flow.grid, 0) - (L / 2 + 0.12 * U, L / 2)).transpose(2, 0, 1)
    r = np.hypot(x, y)
    around = (r > 1.4 * R) & (r < 4 * R)
    dipole = U * R**2 * (x**2 - y**2) / r**4
    assert np.corrcoef(u[around], dipole[around])[0, 1] > 0.96
    assert np.abs(u[2:4]).max() < 0.01 * U  # far from it the air is at rest


@pytest.mark.slow
def test_at_rest_it_has_the_wake_of_an_obstacle_of_cells():
    """Re = 40: the same length of the eddy, the same drag, within what the staircase leaves open at this spacing."""
    found = {}
    openings = [
        {"kind": "inlet", "face": "x-", "speed": 0.6}, {"kind": "outlet", "face": "x+"},
        {"kind": "slip", "face": "y-"}, {"kind": "slip", "face": "y+"},
    ]  # fmt: skip
    shape, dx, D = (64, 40), 0.05, 0.4
    for kind in ("cells", "body"):
        solid = np.linalg.norm(Grid(shape, dx).centers() - (0.8, 1.0), axis=-1) < D / 2
        solid &= kind == "cells"
        bodies = [moving([[1.0, 0.8, 1.0]])] if kind == "body" else []
        flow = still_air(shape, dx, openings, solid, bodies, viscosity=0.006, **LAMINAR)
        advance(flow, 8.0)
        u = velocities(flow)[0]
        p = flow.grid.inner(flow.p.to_numpy().astype(float))
        thrust = [(u[i] ** 2 + 0.5 * (p[i] + p[i - 1])).sum() * dx for i in (4, 52)]
        behind = u[21:, 19:21].mean(axis=1)
        found[kind] = (behind < 0).sum() * dx / D, (thrust[0] - thrust[1]) / (0.5 * 0.6**2 * D)
    assert 1.5 < found["body"][0] < 2.2
    assert found["body"] == pytest.approx(found["cells"], rel=0.3)
    assert found["body"][1] == pytest.approx(2.37, rel=0.03)  # what it tends to at half the spacing


@pytest.fixture(scope="module")
def distances(taichi):
    """Distances [m] of points from a body: one solver for balls, one for all others."""
    grid = Grid((10, 8, 8), 0.1)

    @ti.kernel
    def measure(
        body: ti.template(), points: ti.types.ndarray(ti.f32, ndim=2), out: ti.types.ndarray(ti.f32, ndim=1)
    ):
        for n in range(out.shape[0]):
            x = ti.Vector([points[n, 0], points[n, 1], points[n, 2]])
            out[n] = body.distance(x, 0)

    def of(model, points: np.ndarray) -> np.ndarray:
        body = MovingObstacle(model, grid, ())
        body.advance(-1.0, 0.1)
        out = np.empty(len(points), np.float32)
        measure(body, points.astype(np.float32), out)
        return out

    return of


@pytest.mark.parametrize(
    "outline",
    [
        {"kind": "sphere", "center": [0.5, 0.4, 0.3], "radius": 0.2},
        {"kind": "box", "center": [0.5, 0.4, 0.4], "size": [0.4, 0.2, 0.3], "yaw_deg": 25},
        {"kind": "cylinder", "center": [0.5, 0.4], "radius": 0.2, "base": 0.1, "height": 0.3},
    ],
)
def test_outlines_are_those_of_standing_obstacles(distances, outline):
    """The same sides of the surface as `geometry`, and beside it the same distances."""
    grid = Grid((10, 8, 8), 0.1)
    model = MODELS[outline["kind"]].model_validate(outline | {"motion": {"path": [[1, 0.6, 0.4]]}})
    points = np.random.default_rng(0).uniform((0, 0, 0), grid.extent, (2000, 3)).astype(np.float32)
    got = distances(model, points)
    wanted = shape(model, Domain(size=grid.extent, spacing=0.1), Path()).signed_distance(points)
    clear = np.abs(wanted) > 1e-5
    assert np.all((got < 0) == (wanted < 0), where=clear)
    beside = (points[:, 2] > 0.25) & (points[:, 2] < 0.4) & (wanted > 0) & (wanted < 0.1)
    beside &= np.abs(points[:, 2] - 0.3) < 0.1
    np.testing.assert_allclose(got[beside], wanted[beside], atol=1e-5)


class Parting(Bodies):
    """Solid discs whose places and velocities stay."""

    def advance(self, t: float, dt: float) -> None:
        self.pace[None] = 1.0 / dt

    def fastest(self, t: float) -> float:
        return 0.3


def parting(grid: Grid, open: tuple) -> Parting:
    """Two robots side by side that move apart."""
    place, velocity = (ti.vector_field(2, ti.f32, 2) for _ in range(2))
    place.from_numpy(np.array([[0.7, 0.75], [1.0, 0.75]], np.float32))
    velocity.from_numpy(np.array([[-0.3, 0.0], [0.3, 0.0]], np.float32))
    return Parting(grid, place, velocity, 2, open, Outline(radius=0.15))


@pytest.mark.slow
def test_bodies_that_touch_share_the_faces_between_them():
    """Side by side they move apart: each drags its own air, and equal runs are equal bit by bit."""
    runs = []
    for _ in range(2):
        flow = still_air((40, 30), bodies=[parting])
        advance(flow, 0.6)
        runs.append(velocities(flow)[0])
    np.testing.assert_array_equal(*runs)
    x = faces(flow.grid, 0)
    for middle, speed in ((0.7, -0.3), (1.0, 0.3)):
        inside = np.linalg.norm(x - (middle, 0.75), axis=-1) < 0.09
        np.testing.assert_allclose(runs[0][inside], speed, atol=0.05)


@pytest.mark.slow
def test_robots_on_a_floor_plan_have_the_drag_of_their_height():
    """Force per density of C_d = 1 in a slab of 0.5 m: 1/2 (2 R h) w |w| each, w the relative velocity."""
    R, h, depth, dt = 0.2, 0.15, 0.5, 1e-3
    grid = Grid((60, 40), 0.05, depth=depth, periodic=(True, True))
    place, velocity = (ti.vector_field(2, ti.f32, 1) for _ in range(2))
    place.from_numpy(np.array([[1.51, 1.02]], np.float32))
    velocity.from_numpy(np.array([[-0.2, 0.3]], np.float32))
    robots = partial(Wake, Body(radius=R, height=h), grid, place, velocity, 0, 1)
    flow = flow_in(grid, cfd(periodic("xy"), **LAMINAR), resistances=[robots])
    flow.start_from(lambda points: np.zeros_like(points) + np.array([0.4, 0.3]))
    for begin, force in ((-1.0, 0.0), (0.0, 0.5 * 2 * R * h * 0.6**2)):
        before = velocities(flow)
        flow.advance(begin, dt)
        lost = [(a - b).sum() * grid.cell_volume / dt for a, b in zip(before, velocities(flow), strict=True)]
        assert lost == pytest.approx([force, 0.0], rel=0.03, abs=2e-4)


def test_it_keeps_to_its_way_points():
    cylinder = {"kind": "cylinder", "center": [1, 1], "radius": 0.1}
    walk = Cylinder.model_validate(cylinder | {"motion": {"path": [[2, 2, 1], [3, 2, 1], [5, 1, 2]]}})
    times = [-1.0, 0.0, 1.0, 2.5, 4.0, 9.0]
    wanted = [(1, 1), (1, 1), (1.5, 1), (2, 1), (1.5, 1.5), (1, 2)]
    assert [walk.motion.place(walk.center, t) for t in times] == wanted
    loop = Cylinder.model_validate(cylinder | {"motion": {"path": [[2, 2, 1], [4, 1, 1]], "loop": True}})
    times = [-3.0, 0.0, 1.0, 3.0, 5.0, 403.0]
    assert [loop.motion.place(loop.center, t)[0] for t in times] == [1.5, 1, 1.5, 1.5, 1.5, 1.5]


def test_a_fast_body_shortens_the_steps_before_it_moves():
    flow = walked([[3.0, 0.8, 1.0], [4.0, 2.8, 1.0]])
    (body,) = flow.resistances
    assert body.fastest(0.0) == 0.0
    assert body.fastest(2.5) == pytest.approx(2.0)
    assert flow.stable_dt(2.5) <= flow.courant * 0.05 / 2.0
