"""Online gas maps: the base class of all kinds (protocol `Mapper` of simulation.py), windows and cells.

A map sees what robots know: readings, measured wind and believed positions. It covers the floor with square cells
from the origin on, separately for every trial; axis 0 of every array is the trial. Readings that are not finite, and
those of robots that believe to be off the map, are left out.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import ceil, floor
from typing import Any, ClassVar, Protocol, Self

import numpy as np
import taichi as ti

from taichi_plume.grid.kernels import Field, Template
from taichi_plume.grid.series import Series


class Readers(Protocol):
    """The fields of robots that maps read, as of a swarm: numbers per robot, and the robots of each trial.

    members[trial, :team_size[trial]]: numbers of its robots. Only maps that follow the wind use wind and wind_known.
    """

    members: Field
    team_size: Field
    believed_position: Field  # m
    reading: Field  # ppm
    wind: Field  # m/s
    wind_known: Field


def nowhere(points: np.ndarray) -> np.ndarray:
    """Return the distance [m] of points (..., 2) to the next obstacle on a floor without obstacles."""
    return np.full(np.shape(points)[:-1], np.inf)


@dataclass(frozen=True)
class Floor:
    """The mapped floor, and the sampling of the readings.

    extent: from the origin on [m]; robots: largest number in a trial; tick: from one reading to the next [s];
    obstacle_distance: of points (..., 2) [m], the distance [m] to the next obstacle, negative inside.
    """

    extent: tuple[float, float]
    trials: int
    robots: int
    tick: float
    obstacle_distance: Callable[[np.ndarray], np.ndarray] = nowhere


class GasMap:
    """The base of a map of all trials, which a kind completes to a `Mapper`; see there.

    cell: edge of its cells [m]; shape: cells along x and y; window: length of the snapshots that the map forecasts
    [s], None if it makes no forecast.
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
        """Note the needs of this map in what the maps of a run share, before any is made; by default nothing."""

    @classmethod
    def made(cls, model: Any, floor: Floor, shared: dict) -> Self:
        """Return the map of a model, among the other maps of a run."""
        return cls(model, floor)

    def begin(self, model: object) -> None:
        """Start a run with the numbers of the model, of the structure that the map was made for (see `state`)."""
        self.errors = Series(self.trials)

    def update(self, swarm: Readers, t: float, dt: float) -> None:
        raise NotImplementedError

    def estimate(self) -> np.ndarray:
        raise NotImplementedError

    def weight(self) -> np.ndarray:
        raise NotImplementedError

    def remembered(self, t: np.ndarray, place: np.ndarray, dt: float) -> np.ndarray:
        """Return the fraction of their first weight that readings of times (n,) [s] at points (n, 2) [m] on the map
        still have, (n,); 0 if forgotten, NaN if a kind does not tell. dt: as of `update`.
        """
        return np.full(len(t), np.nan)


def shape(extent: tuple[float, float], cell: float) -> tuple[int, int]:
    """Return the cells along x and y that cover a floor of that extent [m]; the last ones may reach over its edge."""
    return ceil(extent[0] / cell - 1e-6), ceil(extent[1] / cell - 1e-6)


def ratio(numerator: np.ndarray, denominator: np.ndarray) -> np.ndarray:
    """Return numerator / denominator, NaN where the denominator is zero."""
    known = denominator > 0
    return np.where(known, numerator / np.where(known, denominator, 1), np.nan)


def window_of(t: np.ndarray | float, window: float, dt: float) -> np.ndarray:
    """Return the number, from 0 on, of the window [s] of readings at times t [s]; a reading at the end of a window
    belongs to that window. dt: ticks [s].
    """
    return np.maximum(np.ceil((np.asarray(t) - 1e-6 * dt) / window), 1.0).astype(int) - 1


def windows(t: float, window: float, dt: float) -> tuple[int, int]:
    """Return the number of windows [s] that ended before the readings at time t [s], and with them; dt: ticks [s]."""
    slack = 1e-6 * dt  # t carries rounding
    return int(window_of(t, window, dt)), floor((t + slack) / window)


@ti.func
def counts(reading, p, extent):
    """Return whether a reading taken at p [m] goes into a map of that extent [m]."""
    inside = (p >= 0.0).all() and (p <= extent).all()
    return inside and not (ti.math.isnan(reading) or ti.math.isinf(reading))


@ti.func
def cell_of(p, cell, shape: Template):
    """Return the cell with the point p [m] on the map; shape: (nx, ny)."""
    return ti.min(ti.floor(p / cell, ti.i32), ti.Vector(shape) - 1)
