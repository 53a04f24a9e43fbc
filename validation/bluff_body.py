"""Drag and wake of a cylinder that stands in a wind or walks through still air, Re 10,000."""

from collections.abc import Callable
from functools import cache

import numpy as np

from taichi_plume.grid.cut_cells import air_of
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.shapes import Ball
from taichi_plume.scenario.obstacles import Sphere
from taichi_plume.scenario.species import AIR_DENSITY
from taichi_plume.solvers.bodies import MovingObstacle
from taichi_plume.solvers.flow import FlowSolver
from taichi_plume.solvers.forces import Forces
from taichi_plume.validation.case import Case, Expected
from taichi_plume.validation.flow_cases import Errors
from taichi_plume.validation.setups import cfd

# A cylinder at Re 10,000, started impulsively: air of 0.4 m/s passes the body, or the body walks through still air
BLUFF, SPEED = 0.4, 0.4  # m, m/s
BLUFF_PLACE = (1.6, 1.6)  # m
FINEST = 32  # cells across the reference
# s: drag and wake are averaged from BLUFF_FROM to BLUFF_TO, before the wake becomes unsteady
BLUFF_FROM, BLUFF_TO = 2.0, 6.0


def _wake(flow: FlowSolver, place: tuple[float, float], moves: float) -> tuple[float, float]:
    """Return mean velocity deficit and largest reverse flow in a body's wake, over the wind speed.

    Velocities are relative to a body at `place` that `moves` [m/s] against x. The mean covers 1.45 diameters behind the
    body, over the width of the body.
    """
    grid = flow.grid
    u = (grid.read(flow.u[0]) + moves) / SPEED
    x, y = np.arange(u.shape[0]) * grid.dx - place[0], (np.arange(u.shape[1]) + 0.5) * grid.dx - place[1]

    def share(at: np.ndarray, low: float, high: float) -> np.ndarray:
        inside = np.minimum(at + grid.dx / 2, high) - np.maximum(at - grid.dx / 2, low)
        return np.maximum(inside, 0.0) / (high - low)

    mean = share(x, 0.55 * BLUFF, 2.0 * BLUFF) @ u @ share(y, -BLUFF / 2, BLUFF / 2)
    axis = np.array([np.interp(0.0, y, line) for line in u])
    return 1.0 - float(mean), -float(axis[(x > BLUFF / 2) & (x < 3.0 * BLUFF)].min())


def _history(flow: FlowSolver, sample: Callable[[float], tuple[float, ...]]) -> np.ndarray:
    """Return the time average of sample(t) from BLUFF_FROM to BLUFF_TO while the flow advances."""
    t, times, rows = 0.0, [], []
    while t < BLUFF_TO:
        dt = min(flow.stable_dt(t), BLUFF_TO - t + 1e-9)
        flow.advance(t, dt)
        t += dt
        if t >= BLUFF_FROM:
            times.append(t)
            rows.append(sample(t))
    return np.trapezoid(rows, times, axis=0) / (times[-1] - times[0])


def _bluff_grid(n: int, length: float) -> tuple[Grid, list[dict]]:
    """Return the grid of a room 3.2 m wide, n cells across the body, and its slip boundaries."""
    grid = Grid((round(length / BLUFF * n), 8 * n), BLUFF / n)
    return grid, [{"kind": "slip", "face": face} for face in ("y-", "y+")]


def _standing(n: int) -> np.ndarray:
    """Return drag coefficient, wake deficit and reverse flow of a cylinder in a wind; n cells across."""
    grid, sides = _bluff_grid(n, 5.2)
    ends = [{"kind": "inlet", "face": "x-", "speed": SPEED}, {"kind": "outlet", "face": "x+"}]
    body = Ball(Sphere(kind="sphere", center=BLUFF_PLACE, radius=BLUFF / 2), 2)
    air = air_of([body], grid)
    flow = FlowSolver(cfd(ends + sides), grid, air)
    forces = Forces(flow, air, 1)

    def sample(t: float) -> tuple[float, ...]:
        drag = 2.0 * forces()[0, 0] / (AIR_DENSITY * SPEED**2 * BLUFF)
        return float(drag), *_wake(flow, BLUFF_PLACE, 0.0)

    return _history(flow, sample)


def _walking(n: int) -> np.ndarray:
    """Return wake deficit and reverse flow of a cylinder that walks through still air; n cells across."""
    grid, sides = _bluff_grid(n, 7.2)
    ends = [{"kind": "outlet", "face": face} for face in ("x-", "x+")]
    start, y = BLUFF_PLACE[0] + SPEED * BLUFF_TO, BLUFF_PLACE[1]
    path = [(2.0 * BLUFF_TO, start - 2.0 * SPEED * BLUFF_TO, y)]
    body = Sphere.model_validate(
        {"kind": "sphere", "center": (start, y), "radius": BLUFF / 2, "motion": {"path": path}}
    )
    moving = [lambda faces: MovingObstacle(body, grid, faces)]
    flow = FlowSolver(cfd(ends + sides), grid, air_of([], grid), resistances=moving)
    return _history(flow, lambda t: _wake(flow, (start - SPEED * t, y), SPEED))


@cache
def _finest() -> tuple[float, ...]:
    """Return drag coefficient, wake deficit and reverse flow of a cylinder in a wind with FINEST cells across."""
    return tuple(map(float, _standing(FINEST)))


def bluff_body(n: int) -> Errors:
    """Return errors of drag and wake of a cylinder that stands or walks, n cells across, against FINEST cells."""
    stands, walks, (drag, deficit, reverse) = _standing(n), _walking(n), _finest()
    return {
        "drag coefficient": float(abs(stands[0] / drag - 1.0)),
        "wake deficit": float(abs(stands[1] / deficit - 1.0)),
        "wake deficit, walking over standing": float(abs(walks[0] / stands[1] - 1.0)),
        "reverse flow": float(abs(stands[2] / reverse - 1.0)),
        "reverse flow, walking over standing": float(abs(walks[1] / stands[2] - 1.0)),
    }


CASES = (
    Case(
        "bluff_body",
        "a cylinder at Re 10,000 that stands in a wind or walks through still air",
        "the same with 32 cells across",
        bluff_body,
        evidence="exact",
        coarse=(8,),
        fine=(8, 16, 24),
        expected={
            "drag coefficient": Expected(tolerance=0.15),
            "wake deficit": Expected(tolerance=0.15),
            "wake deficit, walking over standing": Expected(tolerance=0.15),
            "reverse flow": Expected(tolerance=0.12, at=24),
            "reverse flow, walking over standing": Expected(tolerance=0.15),
        },
        discussion=(
            "Drag and mean deficit of the wake are within 15 % with 8 cells. The largest reverse flow is not: with 8 "
            "cells it is half of that with 32, with 16 three quarters. It is within 12 % from 24 cells on, which is "
            "judged: the vortices that drive the reverse flow fade where they are a few cells wide."
        ),
    ),
)
