"""What online gas maps (protocol `Mapper` of simulation.py) share.

A map sees what robots know: readings, the wind they feel, and where they believe to be. It covers the floor with square
cells from the origin on, for every trial by itself; axis 0 of every array is the trial. Readings that are no finite
number, and those of robots that believe to be off the map, are left out.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import ceil, floor
from typing import Any, ClassVar, Protocol, Self

import numpy as np
import taichi as ti

from taichi_plume.grid.kernels import Template
from taichi_plume.grid.series import Series


class Readers(Protocol):
    """What maps see of robots, such as a swarm: fields of numbers per robot, and the robots of each trial.

    members[trial, :team_size[trial]]: numbers of its robots. Only what follows the wind looks at wind and wind_known.
    """

    members: Any
    team_size: Any
    believed_position: Any
    """[m]"""
    reading: Any
    """[ppm]"""
    wind: Any
    """[m/s]"""
    wind_known: Any


def nowhere(points: np.ndarray) -> np.ndarray:
    """The distance [m] of points (..., 2) to the next obstacle where there is none."""
    return np.full(np.shape(points)[:-1], np.inf)


@dataclass(frozen=True)
class Floor:
    """What is mapped, and how often it is read.

    extent: from the origin on [m]; robots: most that a trial has; tick: from one reading to the next [s];
    obstacle_distance: of points (..., 2) [m], the distance [m] to the next obstacle, negative inside.
    """

    extent: tuple[float, float]
    trials: int
    robots: int
    tick: float
    obstacle_distance: Callable[[np.ndarray], np.ndarray] = nowhere


class GasMap:
    """A map of all trials, a `Mapper`; see there.

    cell: edge of its cells [m]; shape: of the map, cells along x and y; window: length of the snaps
    that it forecasts [s], None where it makes none.
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
    def reserve(cls, model: Any, floor: Floor, shared: dict) -> None:
        """Say what this map will need of what the maps of a run share, before any is made; nothing unless a kind
        does.
        """

    @classmethod
    def made(cls, model: Any, floor: Floor, shared: dict) -> Self:
        """The map of a model, among others."""
        return cls(model, floor)

    def begin(self, model: Any) -> None:
        """Begin a run with the numbers of the model, of the structure that the map was made for (see `state`)."""
        self.errors = Series(self.trials)

    def update(self, swarm: Readers, t: float, dt: float) -> None:
        raise NotImplementedError

    def remembered(self, t: np.ndarray, place: np.ndarray, dt: float) -> np.ndarray:
        """What share of the weight that they had when fresh readings of times (n,) [s] at places (n, 2) [m] on the map
        still have in it, (n,); 0 where they count no more, NaN where a kind does not tell. dt: as of `update`.
        """
        return np.full(len(t), np.nan)

    def estimate(self) -> np.ndarray:
        raise NotImplementedError

    def weight(self) -> np.ndarray:
        raise NotImplementedError


def shape(extent: tuple[float, float], cell: float) -> tuple[int, int]:
    """Cells along x and y that cover a floor of that extent [m]; the last ones may reach over its edge."""
    return ceil(extent[0] / cell - 1e-6), ceil(extent[1] / cell - 1e-6)


def ratio(numerator: np.ndarray, denominator: np.ndarray) -> np.ndarray:
    """numerator / denominator, NaN where the denominator is zero."""
    known = denominator > 0
    return np.where(known, numerator / np.where(known, denominator, 1), np.nan)


def window_of(t: np.ndarray | float, window: float, dt: float) -> np.ndarray:
    """Number, from 0 on, of the window [s] to which readings at times t [s] belong: the one they end, if they end one.

    dt: ticks [s].
    """
    return np.maximum(np.ceil((np.asarray(t) - 1e-6 * dt) / window), 1.0).astype(int) - 1


def windows(t: float, window: float, dt: float) -> tuple[int, int]:
    """How many windows [s] had ended before the readings at time t [s], and have with them; dt: ticks [s]."""
    slack = 1e-6 * dt  # t carries rounding
    return int(window_of(t, window, dt)), floor((t + slack) / window)


@ti.func
def counts(reading, p, extent):
    """Whether a reading taken at p [m] goes into a map of that extent [m]."""
    inside = (p >= 0.0).all() and (p <= extent).all()
    return inside and not (ti.math.isnan(reading) or ti.math.isinf(reading))


@ti.func
def cell_of(p, cell, shape: Template):
    """The cell in which the place p [m] on the map lies; shape: (nx, ny)."""
    return ti.min(ti.floor(p / cell, ti.i32), ti.Vector(shape) - 1)
