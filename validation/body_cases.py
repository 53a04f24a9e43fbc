"""Flow around and between bodies that the grid cuts: their true surface must act, not the steps of its cells."""

from collections.abc import Callable
from functools import cache
from math import pi, sqrt

import numpy as np

from taichi_plume.grid.cut_cells import Air, air_of
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.shapes import Ball, Shape
from taichi_plume.scenario.obstacles import Sphere
from taichi_plume.scenario.species import AIR_DENSITY
from taichi_plume.scenario.winds import CfdWind
from taichi_plume.solvers.bodies import MovingObstacle
from taichi_plume.solvers.flow import FlowSolver
from taichi_plume.solvers.forces import Forces
from taichi_plume.validation.flow_cases import Errors, advance, at_both_steps, periodic

LAMINAR = {"kind": "cfd", "turbulence": {"kind": "none"}}

# Cylinder 2D-1 of Schäfer & Turek 1996, doi:10.1007/978-3-322-89849-4_39: values of G. Nabh's spectral solution, given
# at featflow.de
DRAG, LIFT, PRESSURE_DROP = 5.57953523384, 0.010618948146, 0.11752016697
# Case 2D-2, Re 100: the middle of what Schäfer & Turek take for certain, 0.295 to 0.305, 3.22 to 3.24 and 0.99 to 1.01
STROUHAL, LARGEST_DRAG, LARGEST_LIFT = 0.300, 3.23, 1.00
DIAMETER = 0.1  # m
# Displacements of the cylinder [cells], away from the middle of the channel, where it would not begin to shed
OFFSETS = ((0.0, 0.0), (0.5, 0.0), (0.0, -0.25), (0.0, -0.5))


def _around_cylinder(
    n: int, mean: float, offset: tuple[float, float] = (0.0, 0.0)
) -> tuple[CfdWind, FlowSolver, Air]:
    """Air with a mean speed [m/s] that passes a cylinder, 0.1 m, a little off the middle of a channel, 2.2 x 0.41 m.

    offset: displacement of the cylinder [cells].
    """
    grid = Grid((22 * n, round(4.1 * n)), DIAMETER / n)
    x, y = (0.2 + part * grid.dx for part in offset)
    body = Ball(Sphere(kind="sphere", center=(x, y), radius=DIAMETER / 2), 2)
    openings = [
        {"kind": "inlet", "face": "x-", "speed": mean, "profile": "parabolic"},
        {"kind": "outlet", "face": "x+"},
    ]
    wind = CfdWind.model_validate(LAMINAR | {"viscosity": 1e-3, "openings": openings})
    air = air_of([body], grid)
    return wind, FlowSolver(wind, grid, air), air


def _drag_and_lift(flow: FlowSolver, air: Air, mean: float) -> np.ndarray:
    """Coefficients of the cylinder."""
    return 2.0 * Forces(flow, air, 1)()[0] / (AIR_DENSITY * mean**2 * DIAMETER)


def cylinder(n: int) -> Errors:
    """Steady flow around the cylinder, Re 20; n cells across it."""
    mean = 0.2
    wind, flow, air = _around_cylinder(n, mean)

    def errors() -> Errors:
        advance(flow, 5.0)  # the drag then changes by less than 1e-4 of it
        drag, lift = _drag_and_lift(flow, air, mean)
        front, back = (_pressure(flow, air, x, side) for x, side in ((0.15, -1), (0.25, 1)))
        return {
            "drag coefficient": float(abs(drag / DRAG - 1.0)),
            "pressure drop": abs((front - back) / PRESSURE_DROP - 1.0),
            "lift coefficient over drag": float(abs(lift - LIFT) / DRAG),
        }

    return at_both_steps(flow, wind, errors)


def _shed(flow: FlowSolver, air: Air, mean: float) -> np.ndarray:
    """Times [s], drag and lift coefficients over four periods, once the shedding of eddies is regular."""
    begin, end = 5.0, 6.5  # s
    advance(flow, begin)
    t, rows = begin, []
    while t < end:
        dt = flow.stable_dt(t)
        flow.advance(t, dt)
        t += dt
        rows.append((t, *_drag_and_lift(flow, air, mean)))
    return np.transpose(rows)


def shedding(n: int) -> Errors:
    """The cylinder sheds eddies, Re 100: their frequency, and the largest drag and lift in some periods."""
    mean = 1.0
    wind, flow, air = _around_cylinder(n, mean)

    def errors() -> Errors:
        times, drag, lift = _shed(flow, air, mean)
        up = np.flatnonzero((lift[:-1] < 0.0) & (lift[1:] >= 0.0))
        passes = times[up] - lift[up] * np.diff(times)[up] / np.diff(lift)[up]
        frequency = (len(passes) - 1) / (passes[-1] - passes[0])
        return {
            "Strouhal number": float(abs(frequency * DIAMETER / mean / STROUHAL - 1.0)),
            "largest drag": float(abs(drag.max() / LARGEST_DRAG - 1.0)),
            "largest lift": float(abs(lift.max() / LARGEST_LIFT - 1.0)),
        }

    return at_both_steps(flow, wind, errors)


def shedding_positions(n: int) -> Errors:
    """Amplitude of the lift in `shedding` with the cylinder at several positions relative to the cells.

    The amplitude is half the range, which leaves out the mean lift: that depends on the distance to the middle of the
    channel. Scatter is the range over the positions.
    """
    mean, found = 1.0, []
    for offset in OFFSETS:
        _, flow, air = _around_cylinder(n, mean, offset)
        _, _, lift = _shed(flow, air, mean)
        found.append(float(np.ptp(lift)) / 2.0 / LARGEST_LIFT)
    return {
        "lift amplitude, worst position": max(abs(part - 1.0) for part in found),
        "lift amplitude, mean over positions": abs(float(np.mean(found)) - 1.0),
        "lift amplitude, scatter": max(found) - min(found),
    }


def _pressure(flow: FlowSolver, air: Air, x: float, side: int) -> float:
    """Pressure at (x, 0.2 m), linear along y and along x from the two whole cells that follow on one side of x."""
    grid = flow.grid
    places = (np.arange(grid.shape[1]) + 0.5) * grid.dx
    p = np.array([np.interp(0.2, places, line) for line in grid.read(flow.p)])
    whole = np.array([np.interp(0.2, places, line) for line in air.volume]) > 0.99
    centers = (np.arange(grid.shape[0]) + 0.5) * grid.dx
    first = np.flatnonzero(whole & (side * (centers - x) > 0))[0 if side > 0 else -1]
    slope = (p[first + side] - p[first]) / (side * grid.dx)
    return float(p[first] + slope * (x - centers[first]))


# A cylinder at Re 10,000, started impulsively: air of 0.4 m/s passes the body, or the body walks through still air
BLUFF, SPEED = 0.4, 0.4  # m, m/s
BLUFF_PLACE = (1.6, 1.6)  # m
FINEST = 32  # cells across the reference
# s: drag and wake are averaged between the two, in both runs before the wake turns unsteady
BLUFF_FROM, BLUFF_TO = 2.0, 6.0


def _wake(flow: FlowSolver, place: tuple[float, float], moves: float) -> tuple[float, float]:
    """Mean deficit of the air behind the body and largest reverse flow on the axis, over the wind, as a body at `place`
    that `moves` [m/s] against x sees them. The mean is over 1.45 diameters behind the body and as wide as the body.
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
    """Mean of sample(t) from BLUFF_FROM to BLUFF_TO."""
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
    """Cells of a room 3.2 m wide, n across the body, and its sides, where air slips."""
    grid = Grid((round(length / BLUFF * n), 8 * n), BLUFF / n)
    return grid, [{"kind": "slip", "face": face} for face in ("y-", "y+")]


def _standing(n: int) -> np.ndarray:
    """Drag coefficient, deficit and reverse flow of the cylinder in a wind; n cells across."""
    grid, sides = _bluff_grid(n, 5.2)
    ends = [{"kind": "inlet", "face": "x-", "speed": SPEED}, {"kind": "outlet", "face": "x+"}]
    body = Ball(Sphere(kind="sphere", center=BLUFF_PLACE, radius=BLUFF / 2), 2)
    air = air_of([body], grid)
    flow = FlowSolver(CfdWind.model_validate({"kind": "cfd", "openings": ends + sides}), grid, air)
    forces = Forces(flow, air, 1)

    def sample(t: float) -> tuple[float, ...]:
        drag = 2.0 * forces()[0, 0] / (AIR_DENSITY * SPEED**2 * BLUFF)
        return float(drag), *_wake(flow, BLUFF_PLACE, 0.0)

    return _history(flow, sample)


def _walking(n: int) -> np.ndarray:
    """Deficit and reverse flow of the cylinder that walks; n cells across."""
    grid, sides = _bluff_grid(n, 7.2)
    ends = [{"kind": "outlet", "face": face} for face in ("x-", "x+")]
    start, y = BLUFF_PLACE[0] + SPEED * BLUFF_TO, BLUFF_PLACE[1]
    path = [(2.0 * BLUFF_TO, start - 2.0 * SPEED * BLUFF_TO, y)]
    body = Sphere.model_validate(
        {"kind": "sphere", "center": (start, y), "radius": BLUFF / 2, "motion": {"path": path}}
    )
    wind = CfdWind.model_validate({"kind": "cfd", "openings": ends + sides})
    flow = FlowSolver(
        wind, grid, air_of([], grid), resistances=[lambda faces: MovingObstacle(body, grid, faces)]
    )
    return _history(flow, lambda t: _wake(flow, (start - SPEED * t, y), SPEED))


@cache
def _finest() -> tuple[float, ...]:
    """Drag coefficient, deficit and reverse flow with FINEST cells across."""
    return tuple(map(float, _standing(FINEST)))


def bluff_body(n: int) -> Errors:
    """Drag and wake of a cylinder that stands or walks, n cells across, against FINEST cells across."""
    stands, walks, (drag, deficit, reverse) = _standing(n), _walking(n), _finest()
    return {
        "drag coefficient": float(abs(stands[0] / drag - 1.0)),
        "wake deficit": float(abs(stands[1] / deficit - 1.0)),
        "wake deficit, walking over standing": float(abs(walks[0] / stands[1] - 1.0)),
        "reverse flow": float(abs(stands[2] / reverse - 1.0)),
        "reverse flow, walking over standing": float(abs(walks[1] / stands[2] - 1.0)),
    }


class Outside(Shape):
    """Everything but a band or a bore: what is left is the passage. `away`: distance [m] of points from its axis."""

    def __init__(self, grid: Grid, half: float, away):
        self.low, self.high = np.zeros(grid.dim), np.array(grid.extent)
        self.half, self.away = half, away

    def signed_distance(self, points: np.ndarray) -> np.ndarray:
        """Distance [m] of points (..., dim) from the surface, negative in the body."""
        return self.half - self.away(points)

    def horizontal_distance(self, points: np.ndarray, low: float, high: float) -> np.ndarray:
        """Not needed: no robots are here."""
        raise NotImplementedError


def pipe(n: int) -> Errors:
    """A force drives air through a round pipe, 1 m wide, along z: u = G (R² - r²)/(4 nu); n cells across."""
    radius, viscosity, force = 0.5, 1.0, 1.0
    m = n + 4
    grid = Grid((m, m, 1), 1.0 / n, periodic=(False, False, True))
    center = np.array(grid.extent[:2]) / 2 + (0.013, 0.021)  # in no symmetric place of a cell
    body = Outside(grid, radius, lambda x: np.linalg.norm(x[..., :2] - center, axis=-1))
    wind = CfdWind.model_validate(
        LAMINAR | {"viscosity": viscosity, "openings": periodic("z"), "acceleration": (0.0, 0.0, force)}
    )
    air = air_of([body], grid)
    flow = FlowSolver(wind, grid, air)
    advance(flow, 0.5)
    u, area = grid.read(flow.u[2])[..., 0], air.area[2][..., 0]
    rate = float((u * area).sum()) * grid.dx**2
    return {
        "flow rate": abs(rate / (pi * radius**4 * force / (8.0 * viscosity)) - 1.0),
        "u_max": float(abs(u.max() / (force * radius**2 / (4.0 * viscosity)) - 1.0)),
    }


def oblique_channel(n: int) -> Errors:
    """A force drives air along a channel at 45 degrees to the grid, 0.4 m wide: a parabola; n cells per metre."""
    width, viscosity, force = 0.4, 0.1, 1.0
    grid = Grid((n, n), 1.0 / n, periodic=(True, True))

    def away(x: np.ndarray) -> np.ndarray:
        period = 1.0 / sqrt(2.0)
        across = (x[..., 0] - x[..., 1] - 0.013) / sqrt(2.0)
        return np.abs((across + period / 2) % period - period / 2)

    along = force / sqrt(2.0)
    wind = CfdWind.model_validate(
        LAMINAR | {"viscosity": viscosity, "openings": periodic("xy"), "acceleration": (along, along)}
    )
    air = air_of([Outside(grid, width / 2, away)], grid)
    flow = FlowSolver(wind, grid, air)
    advance(flow, 1.5)
    u = [grid.read(field) for field in flow.u]
    through = float((u[0] * air.area[0][:-1]).sum(axis=1).mean()) * grid.dx
    return {
        "flow rate": abs(through / (force * width**3 / (12.0 * viscosity)) - 1.0),
        "u_max": float(abs(np.hypot(*u).max() / (force * width**2 / (8.0 * viscosity)) - 1.0)),
        "divergence": flow.diagnostics()["max_divergence"],
    }
