"""Online gas maps: base class of all kinds (protocol `Mapper` of time_loop.py), windows and cells.

The inputs of a map are readings, measured wind and believed positions of robots. A map covers the floor with square
cells from the origin on, separately for every trial; axis 0 of every array is the trial. Readings that are not finite,
or whose believed position is off the map, are left out.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from math import ceil, floor
from typing import Any, ClassVar, Protocol, Self

import numpy as np

from taichi_plume.engine import ti
from taichi_plume.engine.fields import Field
from taichi_plume.grid.grid import centers
from taichi_plume.grid.kernels import Template
from taichi_plume.grid.series import Series
from taichi_plume.scenario.maps import Levels


class Readers(Protocol):
    """Protocol of the robots' fields that gas maps read.

    members[trial, :team_size[trial]]: robots of a trial. Only maps that follow the wind use wind and wind_known.
    """

    members: Field
    team_size: Field
    flies: bool  # whether robots have an altitude
    altitude: Field  # m
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
    lasers: open-path gas sensors (protocol `tomography.Lasers`) of some of the robots; None without. room: extent of a
    room [m]; solid_distance: distances [m] of points (..., 3) to the next obstacle, negative inside; sensor_height:
    height of each robot's gas sensor above the lower end of the body (robots,) [m]: for maps with layers.
    """

    extent: tuple[float, float]
    trials: int
    robots: int
    tick: float
    obstacle_distance: Callable[[np.ndarray], np.ndarray] = nowhere
    edge: Callable[[int, int, np.ndarray, float], np.ndarray] | None = None
    lasers: Any = None
    room: tuple[float, ...] = ()
    solid_distance: Callable[[np.ndarray], np.ndarray] = nowhere
    sensor_height: np.ndarray = field(default_factory=lambda: np.zeros(1))


class GasMap:
    """Base class of gas maps over all trials; each kind of map completes it to a `Mapper`.

    cell: edge of the cells [m]; shape: number of cells along x and y; window: length of the time windows whose gas the
    map forecasts [s], None without forecasts. levels: layers of a map in three dimensions; None on the floor. Fields of
    such a map have `rows` rows (x, y), those of the layers of a trial one after the other.
    """

    STATE: ClassVar[tuple[str, ...]] = ("errors",)

    def __init__(self, cell: float, floor: Floor, levels: Levels | None = None):
        self.cell = cell
        self.levels = levels
        self.layered, self.depth = levels is not None, levels.count if levels else 1
        self.rows = floor.trials * self.depth
        if levels:
            self.low, self.high, self.layer = levels.low, levels.high, levels.layer
            self.sensor_height = ti.filled(np.asarray(floor.sensor_height, np.float32))
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

    def places(self) -> np.ndarray:
        """Return the centres of the cells [m], (nx, ny, 2) or (nx, ny, nz, 3)."""
        return cell_centers(self.shape, self.cell, self.levels)

    def by_trial(self, values: np.ndarray) -> np.ndarray:
        """Return an array (rows, nx, ny) as (trials, nx, ny), with layers as (trials, nx, ny, nz)."""
        if self.levels is None:
            return values
        return np.moveaxis(values.reshape(self.trials, self.depth, *self.shape), 1, -1)

    @ti.func
    def height(self, swarm: Template, i):
        """Return the height [m] of the gas sensor of robot i; 0 for a map of the floor."""
        z = 0.0
        if ti.static(self.layered):
            z = self.sensor_height[i]
            if ti.static(swarm.flies):
                z += swarm.altitude[i]
        return z

    @ti.func
    def on_layers(self, z):
        """Return whether a map has a layer at the height z [m]."""
        found = True
        if ti.static(self.layered):
            found = self.low <= z and z <= self.high
        return found

    @ti.func
    def row(self, k, z):
        """Return the row of trial k at the height z [m]."""
        row = k
        if ti.static(self.layered):
            layer = ti.floor((z - self.low) / self.layer, ti.i32)
            row = k * self.depth + ti.math.clamp(layer, 0, self.depth - 1)
        return row

    @ti.func
    def trial(self, row):
        """Return the trial of a row."""
        k = row
        if ti.static(self.layered):
            k = row // self.depth
        return k

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


def cell_centers(shape: tuple[int, ...], cell: float, levels: Levels | None = None) -> np.ndarray:
    """Return the centres of cells [m], (nx, ny, 2), with layers (nx, ny, nz, 3); shape: numbers along x and y."""
    place = centers(shape[:2], cell)
    if levels is None:
        return place
    flat = np.broadcast_to(place[:, :, None], (*shape[:2], levels.count, 2))
    height = np.broadcast_to(levels.middle, flat.shape[:3])
    return np.concatenate([flat, height[..., None]], axis=-1)


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
