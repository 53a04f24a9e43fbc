"""Online gas maps: base class of all kinds (protocol `Mapper` of time_loop.py), windows and cells.

The inputs of a map are readings, measured wind and believed positions of robots. A map covers the floor with square
cells from the origin on, separately for every trial; axis 0 of every array is the trial. Readings that are not finite,
or whose believed position is off the map, are left out.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import ceil, floor
from typing import Any, ClassVar, Protocol, Self

import numpy as np

from taichi_plume.engine import ti
from taichi_plume.engine.fields import Field
from taichi_plume.grid.kernels import Template
from taichi_plume.grid.series import Series


class Readers(Protocol):
    """Protocol of the robots' fields that gas maps read.

    members[trial, :team_size[trial]]: robots of a trial. Only maps that follow the wind use wind and wind_known.
    """

    members: Field
    team_size: Field
    believed_position: Field  # m
    reading: Field  # ppm
    wind: Field  # m/s
    wind_known: Field


def nowhere(points: np.ndarray) -> np.ndarray:
    """Return infinite obstacle distances (...) for points (..., 2), as on a floor without obstacles."""
    return np.full(np.shape(points)[:-1], np.inf)


@dataclass(frozen=True)
class Floor:
    """Floor that a gas map covers, and sampling of the readings.

    extent: size of the floor, from the origin on [m]; robots: largest number in a trial; tick: time between readings
    [s]; obstacle_distance: function from points (..., 2) [m] to distances [m] to the next obstacle, negative inside.
    edge: function (axis, side, positions (n,) [m], cell [m]) that returns whether air passes an edge of the floor in
    cells at these positions along the edge, (n,); axis normal to the edge, side 0 or 1. None: air passes everywhere.
    lasers: open-path gas sensors (protocol `tomography.Lasers`) of some of the robots; None without.
    """

    extent: tuple[float, float]
    trials: int
    robots: int
    tick: float
    obstacle_distance: Callable[[np.ndarray], np.ndarray] = nowhere
    edge: Callable[[int, int, np.ndarray, float], np.ndarray] | None = None
    lasers: Any = None


class GasMap:
    """Base class of gas maps over all trials; each kind of map completes it to a `Mapper`.

    cell: edge of the cells [m]; shape: number of cells along x and y; window: length of the time windows whose gas the
    map forecasts [s], None without forecasts.
    """

    STATE: ClassVar[tuple[str, ...]] = ("errors",)

    def __init__(self, cell: float, floor: Floor):
        self.cell = cell
        self.extent = ti.math.vec2(floor.extent)
        self.shape = shape(floor.extent, cell)
        self.trials = floor.trials
        self.errors = Series(floor.trials)
        self.window: float | None = None

    @classmethod
    def reserve(cls, model: object, floor: Floor, shared: dict) -> None:
        """Add the map's needs to `shared`, the data that a run's maps share, before any map is made; default: none."""

    @classmethod
    def made(cls, model: Any, floor: Floor, shared: dict) -> Self:
        """Return a new map for the scenario section `model`; shared: data that the maps of the run share."""
        return cls(model, floor)

    def update(self, swarm: Readers, t: float, dt: float) -> None:
        raise NotImplementedError

    def estimate(self) -> np.ndarray:
        raise NotImplementedError

    def weight(self) -> np.ndarray:
        raise NotImplementedError

    def remembered(self, t: np.ndarray, place: np.ndarray, dt: float) -> np.ndarray:
        """Return the fraction (n,) of their initial weight that readings at times t (n,) [s] and points `place` (n, 2)
        [m] still have in the map; 0 if forgotten, NaN if undefined for this kind of map. dt: see `update`.
        """
        return np.full(len(t), np.nan)


def shape(extent: tuple[float, float], cell: float) -> tuple[int, int]:
    """Return the number of cells along x and y that cover a floor of this extent [m], rounded up."""
    return ceil(extent[0] / cell - 1e-6), ceil(extent[1] / cell - 1e-6)


def ratio(numerator: np.ndarray, denominator: np.ndarray) -> np.ndarray:
    """Return numerator / denominator elementwise, NaN where the denominator is zero."""
    known = denominator > 0
    return np.where(known, numerator / np.where(known, denominator, 1), np.nan)


def window_of(t: np.ndarray | float, window: float, dt: float) -> np.ndarray:
    """Return the index, from 0 on, of the time window of length `window` [s] that contains each time t [s]; the end of
    a window belongs to that window. dt: control period [s].
    """
    return np.maximum(np.ceil((np.asarray(t) - 1e-6 * dt) / window), 1.0).astype(int) - 1


def windows(t: float, window: float, dt: float) -> tuple[int, int]:
    """Return the number of time windows that ended before time t [s], and the number that ended by t.

    window: length of a time window [s]; dt: time step [s].
    """
    slack = 1e-6 * dt  # t has rounding errors
    return int(window_of(t, window, dt)), floor((t + slack) / window)


@ti.func
def counts(reading, p, extent):
    """Return whether a reading is finite and its position p [m] lies on a map of this extent [m]."""
    inside = (p >= 0.0).all() and (p <= extent).all()
    return inside and not (ti.math.isnan(reading) or ti.math.isinf(reading))


@ti.func
def cell_of(p, cell, shape: Template):
    """Return the indices of the map cell that contains the point p [m]; cell: edge [m]; shape: (nx, ny)."""
    return ti.min(ti.floor(p / cell, ti.i32), ti.Vector(shape) - 1)
