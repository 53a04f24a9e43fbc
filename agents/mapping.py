"""What every online gas map offers, and what they share.

A map sees what robots know: readings, the wind they feel, and where they believe to be. It covers the floor with square
cells from the origin on, for every trial by itself; axis 0 of every array is the trial. Readings that are no finite
number, and those of robots that believe to be off the map, are left out.

What they see is a swarm, or anything with its `members`, `team_size`, `believed_position` and `reading`; `wind` and
`wind_known` too where a kernel follows the wind.
"""

from math import ceil, floor
from typing import Any, Protocol

import numpy as np
import taichi as ti

from taichi_plume.kernels import Template


class Mapper(Protocol):
    """An online gas map of all trials.

    cell: edge of its cells [m]. errors: (time [s], mean error [ppm] (trials,)) of each forecast that has been judged by
    the readings after it; none where the method makes none.

    Where the method tells how sure it is, there is also ``variance()`` (trials, nx, ny) [ppm²], see `Uncertain`.
    """

    cell: float
    errors: list[tuple[float, np.ndarray]]

    def update(self, swarm: Any, t: float, dt: float) -> None:
        """Take in the readings at time t [s], the end of a tick of dt [s]."""
        ...

    def estimate(self) -> np.ndarray:
        """Concentration [ppm], (trials, nx, ny); NaN where nothing is known."""
        ...

    def weight(self) -> np.ndarray:
        """What stands behind the estimate, (trials, nx, ny), in the method's own measure; 0 where nothing is known."""
        ...


class Uncertain(Mapper, Protocol):
    """A map that tells how sure it is.

    A reading to come has the variance ``variance() + noise`` about the estimate. Where the method reckons with what
    readings scatter, noise [ppm²] is 0; else variance() is how far the estimate may be off.
    """

    noise: float

    def variance(self) -> np.ndarray:
        """Variance [ppm²], (trials, nx, ny); NaN where nothing is known."""
        ...


def shape(extent: tuple[float, float], cell: float) -> tuple[int, int]:
    """Cells along x and y that cover a floor of that extent [m]; the last ones may reach over its edge."""
    return ceil(extent[0] / cell - 1e-6), ceil(extent[1] / cell - 1e-6)


def centers(cells: tuple[int, int], cell: float) -> np.ndarray:
    """Of the cells (nx, ny) of a map, (nx, ny, 2) [m]."""
    axes = [(np.arange(n) + 0.5) * cell for n in cells]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)


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
