"""Time averages of flows that are compared with measurements: mean of u along x at the points of the measurement.

Means are over time and over y, or over the middle part of y. The two halves of the time are stored separately: if both
agree, the averaging time was long enough.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from taichi_plume.grid.cut_cells import air_of
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.shapes import Shape
from taichi_plume.scenario.winds import CfdWind
from taichi_plume.solvers.flow import FlowSolver
from taichi_plume.solvers.openings import opening_cells, periodic_axes
from taichi_plume.validation.flow_cases import velocities
from taichi_plume.validation.setups import advance


def columns(table: str) -> np.ndarray:
    """Return the columns of a table in a text: rows separated by white space, numbers by commas."""
    return np.array([row.split(",") for row in table.split()], float).T


class Times(NamedTuple):
    """Durations of settling and of averaging, and time between samples [s], of a run."""

    settled: float
    averaged: float
    every: float


class Record(NamedTuple):
    """Time-averaged flow on cells of edge dx [m].

    halves: u along x [m/s] on the lower faces of the cells, mean across and over each half of the time, (2, nx, nz).
    end: face velocities [m/s] per axis at the end.
    """

    dx: float
    halves: np.ndarray
    end: list[np.ndarray]

    @property
    def mean(self) -> np.ndarray:
        """Mean of u along x over the whole time, (nx, nz) [m/s]."""
        return self.halves.mean(axis=0)


def flow_in_box(
    wind: Mapping[str, object], shape: tuple[int, ...], dx: float, seed: int, bodies: Sequence[Shape] = ()
) -> FlowSolver:
    """Return the flow solver of a scenario's `wind` in a box around bodies; Taichi must have been started."""
    model = CfdWind.model_validate({"kind": "cfd"} | dict(wind))
    grid = Grid(shape, dx, periodic=periodic_axes(model.openings, len(shape)))
    return FlowSolver(model, grid, air_of(bodies, grid, opening_cells(model.openings, grid)), seed=seed)


def recorded(flow: FlowSolver, times: Times, middle: int = 1) -> Record:
    """Return the time-averaged flow from 0 s on; in 3-D averaged over the middle 1/`middle` of y."""
    advance(flow, times.settled)
    grid, looks = flow.grid, round(0.5 * times.averaged / times.every)
    halves, off = np.zeros((2, grid.shape[0], grid.shape[-1])), (grid.shape[1] - grid.shape[1] // middle) // 2
    across = slice(off, grid.shape[1] - off)
    t = times.settled
    for half in halves:
        for _ in range(looks):
            advance(flow, t + times.every, t)
            t += times.every
            u = grid.read(flow.u[0]).astype(float)
            half += (u if grid.dim == 2 else u[:, across].mean(axis=1)) / looks
    return Record(grid.dx, halves, velocities(flow))


def as_before(record: Record) -> Callable[[np.ndarray], np.ndarray]:
    """Return a record's final flow as a function of points (..., dim) [m], for `start_from` on other cells.

    Points beyond the outermost faces along x take the values there; other components are extrapolated linearly.
    """
    parts = []
    for d, u in enumerate(record.end):
        axes = [(np.arange(n) + (0.0 if a == d else 0.5)) * record.dx for a, n in enumerate(u.shape)]
        parts.append(RegularGridInterpolator(axes, u, bounds_error=False, fill_value=None))  # type: ignore[arg-type]
    low, high = ([axis[end] for axis in parts[0].grid] for end in (0, -1))

    def velocity(points: np.ndarray) -> np.ndarray:
        return np.stack([part(np.clip(points, low, high)) for part in parts], axis=-1)

    return velocity


def along_x(mean: np.ndarray, dx: float, places: np.ndarray, top: str = "wall") -> np.ndarray:
    """Return the mean u (nx, nz) [m/s] interpolated at points (n, 2) [m], x and z; 0 at the walls below and above.

    Beyond the last lower face u is constant. top: "slip" for a plane of symmetry above.
    """
    nx, nz = mean.shape
    above = mean[:, -1:] if top == "slip" else np.zeros((nx, 1))
    u = np.hstack([np.zeros((nx, 1)), mean, above])
    z = np.concatenate([[0.0], (np.arange(nz) + 0.5) * dx, [nz * dx]])
    x = np.arange(nx) * dx
    return RegularGridInterpolator((x, z), u)(np.minimum(places, [x[-1], z[-1]]))


def rms(error: np.ndarray) -> float:
    """Return the root mean square of an error."""
    return float(np.sqrt(np.mean(np.asarray(error) ** 2)))
