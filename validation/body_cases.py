"""Immersed boundaries (cut cells): flow around a cylinder, through a pipe and an oblique channel."""

from collections.abc import Callable
from functools import partial
from math import pi, sqrt

import numpy as np

from taichi_plume.grid.cut_cells import Air, air_of
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.shapes import Ball, Shape
from taichi_plume.scenario.obstacles import Sphere
from taichi_plume.scenario.species import AIR_DENSITY
from taichi_plume.scenario.winds import CfdWind
from taichi_plume.solvers.flow import FlowSolver
from taichi_plume.solvers.forces import Forces
from taichi_plume.validation.case import Case, Comparison, Expected
from taichi_plume.validation.flow_cases import Errors, at_both_steps, both_steps, laminar_wind, periodic
from taichi_plume.validation.setups import advance

# Cylinder 2D-1 of Schäfer & Turek 1996, doi:10.1007/978-3-322-89849-4_39: values of G. Nabh's spectral solution, given
# at featflow.de
DRAG, LIFT, PRESSURE_DROP = 5.57953523384, 0.010618948146, 0.11752016697
# Case 2D-2, Re 100: mid-ranges of Schäfer & Turek, 0.295 to 0.305, 3.22 to 3.24 and 0.99 to 1.01
STROUHAL, LARGEST_DRAG, LARGEST_LIFT = 0.300, 3.23, 1.00
DIAMETER = 0.1  # m
# Displacements of the cylinder [cells], away from the middle of the channel, where shedding would not start
OFFSETS = ((0.0, 0.0), (0.5, 0.0), (0.0, -0.25), (0.0, -0.5))


def _around_cylinder(
    n: int, mean: float, offset: tuple[float, float] = (0.0, 0.0)
) -> tuple[CfdWind, Callable[[CfdWind], FlowSolver], Air]:
    """Return the wind past a cylinder of 0.1 m, slightly off the middle of a channel, its solver, and the air.

    The channel is 2.2 x 0.41 m. mean: mean speed [m/s]; offset: displacement of the cylinder [cells].
    """
    grid = Grid((22 * n, round(4.1 * n)), DIAMETER / n)
    x, y = (0.2 + part * grid.dx for part in offset)
    body = Ball(Sphere(kind="sphere", center=(x, y), radius=DIAMETER / 2), 2)
    openings = [
        {"kind": "inlet", "face": "x-", "speed": mean, "profile": "parabolic"},
        {"kind": "outlet", "face": "x+"},
    ]
    wind = laminar_wind(1e-3, openings)
    air = air_of([body], grid)
    return wind, partial(FlowSolver, grid=grid, air=air), air


def _drag_and_lift(flow: FlowSolver, air: Air, mean: float) -> np.ndarray:
    """Return the present drag and lift coefficients of the cylinder; mean: mean speed [m/s]."""
    return 2.0 * Forces(flow, air, 1)()[0] / (AIR_DENSITY * mean**2 * DIAMETER)


def cylinder(n: int) -> Errors:
    """Return errors of the steady flow around the cylinder, Re 20; n cells across."""
    mean = 0.2
    wind, flow_of, air = _around_cylinder(n, mean)

    def errors(flow: FlowSolver) -> Errors:
        advance(flow, 5.0)  # the drag then changes by less than 1e-4 (relative)
        drag, lift = _drag_and_lift(flow, air, mean)
        front, back = (_pressure(flow, air, x, side) for x, side in ((0.15, -1), (0.25, 1)))
        return {
            "drag coefficient": float(abs(drag / DRAG - 1.0)),
            "pressure drop": abs((front - back) / PRESSURE_DROP - 1.0),
            "lift coefficient over drag": float(abs(lift - LIFT) / DRAG),
            "drag coefficient, computed": float(drag),
            "pressure drop, computed": front - back,
        }

    return at_both_steps(wind, flow_of, errors)


def _shed(flow: FlowSolver, air: Air, mean: float) -> np.ndarray:
    """Return times [s], drag and lift coefficients over four periods of regular vortex shedding."""
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
    """Return errors of vortex shedding at Re 100: frequency, and largest drag and lift over some periods."""
    mean = 1.0
    wind, flow_of, air = _around_cylinder(n, mean)

    def errors(flow: FlowSolver) -> Errors:
        times, drag, lift = _shed(flow, air, mean)
        up = np.flatnonzero((lift[:-1] < 0.0) & (lift[1:] >= 0.0))
        passes = times[up] - lift[up] * np.diff(times)[up] / np.diff(lift)[up]
        frequency = (len(passes) - 1) / (passes[-1] - passes[0])
        return {
            "Strouhal number": float(abs(frequency * DIAMETER / mean / STROUHAL - 1.0)),
            "largest drag": float(abs(drag.max() / LARGEST_DRAG - 1.0)),
            "largest lift": float(abs(lift.max() / LARGEST_LIFT - 1.0)),
            "largest drag, computed": float(drag.max()),
            "largest lift, computed": float(lift.max()),
        }

    return at_both_steps(wind, flow_of, errors)


def shedding_positions(n: int) -> Errors:
    """Return errors of the lift amplitude of vortex shedding at several positions of the cylinder in the cells.

    The amplitude is half the range. It excludes the mean lift, which depends on the distance to the middle of the
    channel. Scatter is the range over the positions.
    """
    mean, amplitudes = 1.0, []
    for offset in OFFSETS:
        wind, flow_of, air = _around_cylinder(n, mean, offset)
        flow = flow_of(wind)
        _, _, lift = _shed(flow, air, mean)
        amplitudes.append(float(np.ptp(lift)) / 2.0 / LARGEST_LIFT)
    return {
        "lift amplitude, worst position": max(abs(part - 1.0) for part in amplitudes),
        "lift amplitude, mean over positions": abs(float(np.mean(amplitudes)) - 1.0),
        "lift amplitude, scatter": max(amplitudes) - min(amplitudes),
    }


def _pressure(flow: FlowSolver, air: Air, x: float, side: int) -> float:
    """Return the pressure at (x, 0.2 m): linear along y, extrapolated along x from the next two uncut cells."""
    grid = flow.grid
    places = (np.arange(grid.shape[1]) + 0.5) * grid.dx
    p = np.array([np.interp(0.2, places, line) for line in grid.read(flow.p)])
    whole = np.array([np.interp(0.2, places, line) for line in air.volume]) > 0.99
    centers = (np.arange(grid.shape[0]) + 0.5) * grid.dx
    first = np.flatnonzero(whole & (side * (centers - x) > 0))[0 if side > 0 else -1]
    slope = (p[first + side] - p[first]) / (side * grid.dx)
    return float(p[first] + slope * (x - centers[first]))


class Outside(Shape):
    """Solid obstacle with a straight passage, a band or a bore. `away`: distance [m] of points from the axis."""

    def __init__(self, grid: Grid, half: float, away: Callable[[np.ndarray], np.ndarray]):
        self.low, self.high = np.zeros(grid.dim), np.array(grid.extent)
        self.half, self.away = half, away

    def signed_distance(self, points: np.ndarray) -> np.ndarray:
        """Return the distance [m] of points (..., dim) from the surface, negative in the solid."""
        return self.half - self.away(points)

    def horizontal_distance(self, points: np.ndarray, low: float, high: float) -> np.ndarray:
        """Raise NotImplementedError: the cases have no robots."""
        raise NotImplementedError


def pipe(n: int) -> Errors:
    """Return errors of Hagen-Poiseuille flow in a pipe 1 m wide along z: u = G (R² - r²)/(4 nu); n cells across."""
    radius, viscosity, force = 0.5, 1.0, 1.0
    m = n + 4
    grid = Grid((m, m, 1), 1.0 / n, periodic=(False, False, True))
    center = np.array(grid.extent[:2]) / 2 + (0.013, 0.021)  # not symmetric to the cells
    body = Outside(grid, radius, lambda x: np.linalg.norm(x[..., :2] - center, axis=-1))
    wind = laminar_wind(viscosity, periodic("z"), acceleration=(0.0, 0.0, force))
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
    """Return errors of Poiseuille flow in a channel at 45 degrees to the grid, 0.4 m wide; n cells per metre."""
    width, viscosity, force = 0.4, 0.1, 1.0
    grid = Grid((n, n), 1.0 / n, periodic=(True, True))

    def away(x: np.ndarray) -> np.ndarray:
        period = 1.0 / sqrt(2.0)
        across = (x[..., 0] - x[..., 1] - 0.013) / sqrt(2.0)
        return np.abs((across + period / 2) % period - period / 2)

    along = force / sqrt(2.0)
    wind = laminar_wind(viscosity, periodic("xy"), acceleration=(along, along))
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


CASES = (
    Case(
        "cylinder",
        "steady flow around a cylinder in a channel, Re 20",
        "Schäfer & Turek 1996, case 2D-1, doi:10.1007/978-3-322-89849-4_39",
        cylinder,
        evidence="exact",
        compared=(
            Comparison("drag", "drag coefficient, computed", measured=DRAG),
            Comparison("drag", "pressure drop, computed", measured=PRESSURE_DROP),
        ),
        coarse=(10,),
        fine=(10, 20),
        expected=both_steps(
            {
                "drag coefficient": Expected(tolerance=0.03, at=20),
                "pressure drop": Expected(tolerance=0.03, at=20),
            }
        ),
    ),
    Case(
        "shedding",
        "eddies behind a cylinder in a channel, Re 100",
        "Schäfer & Turek 1996, case 2D-2, doi:10.1007/978-3-322-89849-4_39",
        shedding,
        evidence="exact",
        compared=(
            Comparison("drag", "largest drag, computed", measured=LARGEST_DRAG),
            Comparison("drag", "largest lift, computed", measured=LARGEST_LIFT),
        ),
        coarse=(10,),
        fine=(10, 20),
        expected=both_steps(
            {
                "Strouhal number": Expected(tolerance=0.0167),
                "largest drag": Expected(tolerance=0.03),
                "largest lift": Expected(tolerance=0.08, at=20),
            }
        ),
    ),
    Case(
        "shedding_positions",
        "lift of a shedding cylinder at four positions relative to the cells",
        "Schäfer & Turek 1996, case 2D-2, doi:10.1007/978-3-322-89849-4_39",
        shedding_positions,
        evidence="exact",
        coarse=(),
        fine=(10, 20),
        expected={"lift amplitude, worst position": Expected(tolerance=0.08, at=20)},
    ),
    Case(
        "pipe",
        "developed flow in a round pipe that the grid cuts",
        "Hagen-Poiseuille",
        pipe,
        evidence="exact",
        coarse=(8, 16),
        fine=(8, 16, 32),
        expected={"flow rate": Expected(order=0.9, tolerance=0.02, at=32)},
    ),
    Case(
        "oblique_channel",
        "developed flow in a channel at 45 degrees to the grid",
        "parabola",
        oblique_channel,
        evidence="exact",
        coarse=(16,),
        fine=(32, 64),
        expected={"flow rate": Expected(tolerance=0.08), "divergence": Expected(tolerance=1e-5)},
    ),
)
