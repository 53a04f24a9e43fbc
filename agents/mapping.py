"""What online gas maps (protocol `Mapper` of simulation.py) share.

A map sees what robots know: readings, the wind they feel, and where they believe to be. It covers the floor with square
cells from the origin on, for every trial by itself; axis 0 of every array is the trial. Readings that are no finite
number, and those of robots that believe to be off the map, are left out.

What they see is a swarm, or anything with its `members`, `team_size`, `believed_position` and `reading`; `wind` and
`wind_known` too where a kernel follows the wind.
"""

from math import ceil, floor

import numpy as np
import taichi as ti

from taichi_plume.grid.kernels import Template


def shape(extent: tuple[float, float], cell: float) -> tuple[int, int]:
    """Cells along x and y that cover a floor of that extent [m]; the last ones may reach over its edge."""
    return ceil(extent[0] / cell - 1e-6), ceil(extent[1] / cell - 1e-6)


def ratio(numerator: np.ndarray, denominator: np.ndarray) -> np.ndarray:
    """numerator / denominator, NaN where the denominator is zero."""
    known = denominator > 0
    return np.where(known, numerator / np.where(known, denominator, 1), np.nan)


def windows(t: float, window: float, dt: float) -> tuple[int, int]:
    """How many windows [s] had ended before the readings at time t [s], and have with them; dt: ticks [s]."""
    slack = 1e-6 * dt  # t carries rounding
    return ceil((t - slack) / window) - 1, floor((t + slack) / window)


@ti.func
def counts(reading, p, extent):
    """Whether a reading taken at p [m] goes into a map of that extent [m]."""
    inside = (p >= 0.0).all() and (p <= extent).all()
    return inside and not (ti.math.isnan(reading) or ti.math.isinf(reading))


@ti.func
def cell_of(p, cell, shape: Template):
    """The cell in which the place p [m] on the map lies; shape: (nx, ny)."""
    return ti.min(ti.floor(p / cell, ti.i32), ti.Vector(shape) - 1)
