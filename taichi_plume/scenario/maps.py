"""Online gas maps of a scenario: time series, inverse distance, Kernel DM+V and Gaussian Markov random field."""

from collections.abc import Iterator
from math import ceil, prod, sqrt
from typing import Annotated, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field

from taichi_plume.quantities import ill_sized, round_up
from taichi_plume.scenario import si
from taichi_plume.scenario.domain import Context
from taichi_plume.scenario.vocabulary import SHAPE, Model, consistency_check

MOST_CELLS = 4_000_000
LOG_SNAPS = 120  # most snaps of a whole log, such as ten minutes of 5 s each
LOG_BYTES = 1e9  # most memory of the snaps of a whole log
LOG_WORK = 3e10  # most terms of sums of a whole log; some seconds
MOST_NEIGHBOURS = 1_000_000  # members of a neighbourhood in space and time
BORDER = 1e-9  # tolerance of rounding at the distance beta
MOST_FIELD_COLUMN = 400  # cells: its third power is the work of an update
MOST_BEAM_CELLS = 3000  # cells of a map from lasers: its third power is the work of an update
WIND_PRIOR, WIND_MASS, WIND_OBSERVATION = 10.0, 1000.0, 10.0  # s²/m²


class Levels(NamedTuple):
    """Layers of a map in three dimensions: lower end of the lowest, height of each [m], and their number."""

    low: float
    layer: float
    count: int

    @property
    def middle(self) -> np.ndarray:
        """Heights of the middles of the layers [m], (count,)."""
        return self.low + (np.arange(self.count) + 0.5) * self.layer

    @property
    def high(self) -> float:
        """Upper end of the highest layer [m]."""
        return self.low + self.count * self.layer


class AnyMap(Model):
    """Base class of the maps: their sizes and checks."""

    measures: ClassVar[str] = "gas"
    """Quantity of the map: "gas" or "wind"."""
    takes_beams: ClassVar[bool] = False
    """Whether the map takes integrals along the beams of lasers."""
    gains: ClassVar[tuple[str, ...]] = ()
    """Gains of a measurement that the map can compute, see `LeastKnown`."""
    times: ClassVar[tuple[str, ...]] = ()
    """Keys that set how long readings count. A map of a log chooses them, unless one of them is given."""
    kind: str
    cell: si.Length
    """Edge of the square cells of the map."""
    robot: Annotated[int, Field(ge=0, le=MOST_CELLS), SHAPE] | None = None
    """Number of the robot of each trial that makes the map from the readings that it receives. These are its own and
    those within the range of its `communication`, less the lost ones. Robots are counted from 0 on over all groups, of
    `rivals` within each. Unless given, all readings count."""

    def errors(self, where: str, context: Context) -> Iterator[str]:
        if self.robot is not None:
            groups, rivals = context.scenario.robots, context.scenario.rivals
            count = (min if rivals else sum)([group.count for group in groups] or [0])
            if not rivals and len({group.trials for group in groups}) > 1:
                yield f"{where}.robot: needs groups with equal trials, as robots are counted over all groups"
            elif self.robot >= count:
                yield f"{where}.robot: {self.robot} is no robot of a trial of {count}; the first one is 0"

        if self.measures == "gas" and not self.takes_beams:
            for n, group in enumerate(context.scenario.robots):
                if group.sensors.nose.integrates:
                    yield (
                        f"{where}.kind: {self.kind} takes readings in ppm, and the laser of robots[{n}] gives the "
                        "integral along its beam; use kind: gmrf, or gives: mean for readings at the robot"
                    )
                    break

    def levels(self, size: tuple[float, ...]) -> Levels | None:
        """Return the layers of a map in a room of this size [m]; None for a map of the floor."""
        return None

    def of_log(self, duration: float, size: tuple[float, float]) -> dict[str, float | None]:
        """Return values of the keys `times` with which a map of a log uses all of it; duration [s]; size: floor [m]."""
        return {}

    def bytes(self, size: tuple[float, ...], readings: float, lasers: bool = False) -> float:
        """Return about the memory [bytes] of a map per trial on a floor of this size [m], its solver included.

        readings: gas readings per second of all robots of a trial; lasers: whether some are integrals along beams.
        """
        return 40.0 * prod(self.cells(size))

    def cells(self, size: tuple[float, ...]) -> tuple[int, ...]:
        """Return the number of cells along each axis that cover a floor, or a room, of this size [m]."""
        return ceil(size[0] / self.cell - 1e-6), ceil(size[1] / self.cell - 1e-6)

    def warnings(self, where: str, context: Context) -> Iterator[str]:
        window = vars(self).get("window") or 0.0
        if window > context.scenario.duration:
            yield f"{where}.window: {window:g} s is longer than duration: {context.scenario.duration:g} s; lower it"

    def grid_error(self, where: str, size: tuple[float, ...]) -> str | None:
        """Return an error if a floor of this size [m] has too many or too few map cells; None otherwise."""
        return ill_sized(f"{where}.cell", self.cell, size, MOST_CELLS)


class SnapshotMap(AnyMap):
    """Base class of the maps of snaps. A snap holds the readings of a time window."""

    cell: si.Length = 0.25
    window: Annotated[si.Duration, SHAPE] = 5.0
    """Length of a snap: readings within a snap count as simultaneous."""
    power: Annotated[si.Exponent, SHAPE] = 2.0
    """Exponent of the inverse distance: more lets the nearest reading count more."""
    min_distance: Annotated[si.Length, SHAPE] | None = None
    """Smallest distance that counts; unless given, half a cell."""
    samples: Annotated[Literal["all", "newest"], SHAPE] = "all"
    """Samples of a snap that count: all, along the robots' paths; or the newest of each robot, one per gas sensor."""

    @property
    def least_distance(self) -> float:
        """Smallest distance that counts [m]: `min_distance`, or half a cell."""
        return self.cell / 2 if self.min_distance is None else self.min_distance

    def bytes(self, size: tuple[float, ...], readings: float, lasers: bool = False) -> float:
        return super().bytes(size, readings) + 12.0 * readings * self.window


class TimeSeriesMap(SnapshotMap):
    """A map from neighbours in space and time: readings count less, the farther and the older they are.

    Marjovi & Marques, ICRA 2014, eq 1-7.
    """

    kind: Literal["time_series"]  # type: ignore[assignment]
    alpha: Annotated[float, Field(ge=1e-6, lt=1), SHAPE] = 0.9
    """Weight of distance against age in the neighbourhood: near 1, old readings still count."""
    beta: Annotated[si.SomeCoefficient, SHAPE] = 0.5
    """Size of the neighbourhood. A reading counts where alpha distance + (1 - alpha) time_scale age is below it."""
    time_scale: Annotated[si.SomeCoefficient, SHAPE] = 0.1
    """Distance that a second of age counts as. More forgets faster."""
    time_from: Annotated[Literal["newest", "forecast"], SHAPE] = "newest"
    """Snap from which the age counts. With `newest` the last ended snap has age 0 and counts within beta / alpha; with
    `forecast` it is a window old."""
    raw_samples: bool = False
    """Whether the samples themselves are the neighbours, rather than the cells interpolated from the samples."""
    times: ClassVar[tuple[str, ...]] = ("window", "time_scale")

    @consistency_check
    def _has_neighbours(self) -> Iterator[str]:
        age = (1.0 - self.alpha) * self.time_scale * self.first_age
        if age >= self.beta - BORDER:
            yield (
                f"sees no past snap: (1 - alpha) time_scale window = {age:g} must be below beta {self.beta:g}, or "
                "time_from newest"
            )

    @property
    def first_age(self) -> float:
        """Age of the newest snap in eq 4 [s]."""
        return 0.0 if self.time_from == "newest" else self.window

    def of_log(self, duration: float, size: tuple[float, float]) -> dict[str, float | None]:
        """Return `window` and `time_scale` so that even the oldest reading of a log counts: its age is at most half of
        `beta`.

        In a long log, or on a large floor, the window is lengthened to limit memory and work.
        """
        count = min(LOG_SNAPS, ceil(duration / self.window) or 1)
        terms = prod(extent / self.cell for extent in size) * (
            1.0 + (self.beta / self.alpha / self.cell) ** 2
        )
        while True:
            window = max(self.window, duration / count)
            reach = window * (ceil(duration / window) + 1)
            chosen: dict[str, float | None] = {
                "window": window,
                "time_scale": 0.5 * self.beta / ((1.0 - self.alpha) * reach),
            }
            most = (
                self.model_copy(update=chosen).bytes(size, 1.0) <= LOG_BYTES and terms * count**2 <= LOG_WORK
            )
            if most or count == 1:
                return chosen
            count //= 2

    def grid_error(self, where: str, size: tuple[float, ...]) -> str | None:
        line = super().grid_error(where, size)
        reach = min(max(size[:2]) / self.cell, self.beta / self.alpha / self.cell + 1.0)
        members = self.lags * (2.0 * reach + 1.0) ** 2
        if line is None and members > MOST_NEIGHBOURS:
            return (
                f"{where}.beta: {self.beta:g} makes a neighbourhood of {members:.2g} cells of past snaps, at most "
                f"{MOST_NEIGHBOURS:.2g} are allowed; lower it, or raise cell, window or time_scale"
            )
        return line

    @property
    def lags(self) -> float:
        """Number of past time windows whose readings still count in the map."""
        ages = self.beta / ((1.0 - self.alpha) * self.time_scale * self.window)
        return ages + (1.0 - self.first_age / self.window)

    def bytes(self, size: tuple[float, ...], readings: float, lasers: bool = False) -> float:
        """Return the memory [bytes] of the map, with the stored samples or cells of past time windows."""
        if self.raw_samples:
            return super().bytes(size, readings) * (1.0 + self.lags)
        long, short = sorted((extent / self.cell for extent in size[:2]), reverse=True)
        margin = 2.0 * min(long, self.beta / self.alpha / self.cell)
        return super().bytes(size, readings) + 8.0 * self.lags * (long + margin) * (short + margin)


class InverseDistanceMap(SnapshotMap):
    """A map from the readings of one snap alone, weighted by the inverse distance.

    Marjovi & Marques, ICRA 2014, eq 1-3.
    """

    times: ClassVar[tuple[str, ...]] = ("window",)
    kind: Literal["inverse_distance"]  # type: ignore[assignment]

    def of_log(self, duration: float, size: tuple[float, float]) -> dict[str, float | None]:
        return {"window": max(self.window, duration)}


class LayeredMap(AnyMap):
    """Base class of the maps that can have layers of cells over the height."""

    layer: Annotated[si.Length, SHAPE] | None = None
    """Height of the cells of a map in three dimensions. Unless given, the map is of the floor."""
    heights: Annotated[tuple[si.Distance, si.Length], SHAPE] | None = None
    """Lowest and highest height of the layers. Unless given, from the floor to the ceiling."""

    @consistency_check
    def _layers_between_heights(self) -> Iterator[str]:
        if self.heights is None:
            return
        low, high = self.heights
        if self.layer is None:
            yield "heights: needs layer, the height of the cells; without it the map is of the floor"
        elif high < low + (1.0 - 1e-6) * self.layer:
            yield f"heights: from {low:g} m to {high:g} m is less than a layer of {self.layer:g} m"

    def levels(self, size: tuple[float, ...]) -> Levels | None:
        """Return the layers in a room of this size [m], of which the last may exceed the heights; None on the floor."""
        if self.layer is None:
            return None
        low, high = self.heights or (0.0, size[2])
        return Levels(low, self.layer, ceil((high - low) / self.layer - 1e-6))

    def errors(self, where: str, context: Context) -> Iterator[str]:
        yield from super().errors(where, context)
        size = context.scenario.domain.size
        if self.heights is not None and len(size) == 3 and self.heights[1] > size[2] * (1.0 + 1e-6):
            yield f"{where}.heights: {self.heights[1]:g} m is above the ceiling at {size[2]:g} m"

    def grid_error(self, where: str, size: tuple[float, ...]) -> str | None:
        line = super().grid_error(where, size)
        if line is not None or self.layer is None:
            return line
        if len(size) < 3:
            return f"{where}.layer: needs a 3-D room, and this one has two lengths; leave it out"
        if self.layer > size[2]:
            return f"{where}.layer: {self.layer:g} m is more than the height of the room, {size[2]:g} m; use less"
        cells = prod(self.cells(size))
        if cells > MOST_CELLS:
            return (
                f"{where}.layer: {self.layer:g} m makes {cells:,} map cells, at most {MOST_CELLS:,} are allowed; raise "
                "layer or cell, or narrow heights"
            )
        return None

    def cells(self, size: tuple[float, ...]) -> tuple[int, ...]:
        levels = self.levels(size)
        return (*super().cells(size), *([levels.count] if levels else []))


class KernelMap(LayeredMap):
    """Mean and variance by Gaussian weights: Kernel DM+V (Lilienthal et al., IROS 2009)."""

    times: ClassVar[tuple[str, ...]] = ("memory",)
    gains: ClassVar[tuple[str, ...]] = ("variance", "upper_bound")
    kind: Literal["kernel_dmv"]  # type: ignore[assignment]
    cell: si.Length = 0.1
    window: ClassVar[None] = None
    sigma: si.Length = 0.25
    """Width of the kernel: how far around it a reading counts."""
    sigma_omega: si.SomeCoefficient = 5.0
    """Readings in the middle of a cell that make its confidence 1 - 1/e; with few, the mean of all counts."""
    memory: si.Duration | None = None
    """Age at which a reading counts 1/e of a fresh one (TD Kernel DM+V: Asadi et al. 2011). Unless given, all count
    alike. One minute is a good start."""
    wind_stretch: si.Delay = 0.0
    """Widening of the kernel along the measured wind, per wind speed. 0.25 s suits winds of 0.7 m/s (Kernel
    DM+V/W: Reggente & Lilienthal 2009); 0 keeps it round."""
    exact: si.Count = 2000
    """Latest readings of a trial for which the variance is recomputed as the mean changes."""

    def bytes(self, size: tuple[float, ...], readings: float, lasers: bool = False) -> float:
        return super().bytes(size, readings) + 70.0 * self.exact


class FieldMap(AnyMap):
    """Base class of the maps by Gaussian Markov random fields."""

    times: ClassVar[tuple[str, ...]] = ("memory",)
    cell: si.Length = 0.1
    memory: si.Duration | None = None
    """Age at which a reading no longer counts, after a steady decrease; null: readings count for ever."""
    window: si.Duration = 1.0
    """Time between updates; readings within it are of the same age."""

    def of_log(self, duration: float, size: tuple[float, float]) -> dict[str, float | None]:
        return {"memory": None}

    def bytes(self, size: tuple[float, ...], readings: float, lasers: bool = False) -> float:
        *short, long = sorted(self.cells(size))
        return super().bytes(size, readings) + 8.0 * long * float(prod(short)) ** 2

    def grid_error(self, where: str, size: tuple[float, ...]) -> str | None:
        width = min(size[:2])
        line = super().grid_error(where, size)
        if line is None and width / self.cell > MOST_FIELD_COLUMN:
            return (
                f"{where}.cell: {self.cell:g} m makes more than {MOST_FIELD_COLUMN} cells along the shorter side; use "
                f"{round_up(width / MOST_FIELD_COLUMN):g} m or more"
            )
        return line


class MarkovMap(FieldMap, LayeredMap):
    """Mean and variance by a Gaussian Markov random field, cut by obstacles (Monroy et al. 2016, Autonomous Robots)."""

    takes_beams: ClassVar[bool] = True
    gains: ClassVar[tuple[str, ...]] = ("variance", "upper_bound", "information")
    kind: Literal["gmrf"]  # type: ignore[assignment]
    lambda_prior: si.SomeCoefficient = 0.01
    """Precision of the difference of neighbouring cells, in 1/ppm²: less lets the map vary more."""
    lambda_observation: si.SomeCoefficient = 10.0
    """Precision of a fresh reading, in 1/ppm². The mean depends on the two by their ratio alone."""
    memory: si.Duration | None = 60.0
    """Age at which a reading no longer counts, after a steady decrease; null: readings count for ever."""

    def grid_error(self, where: str, size: tuple[float, ...]) -> str | None:
        line = super().grid_error(where, size)
        if line is None and self.layer is not None:
            section = prod(sorted(self.cells(size))[:-1])
            if section > MOST_FIELD_COLUMN:
                return (
                    f"{where}.layer: {self.layer:g} m makes {section:,} cells in the smallest section of the map, at "
                    f"most {MOST_FIELD_COLUMN} are allowed; raise layer or cell, or narrow heights"
                )
        return line

    def errors(self, where: str, context: Context) -> Iterator[str]:
        yield from super().errors(where, context)
        lasers = any(group.sensors.nose.kind == "tdlas" for group in context.scenario.robots)
        size = context.scenario.domain.size
        if self.grid_error(where, size) is not None:
            return
        cells = prod(self.cells(size))
        if lasers and cells > MOST_BEAM_CELLS:
            yield (
                f"{where}.cell: {self.cell:g} m makes {cells:,} cells, and a map from lasers has at most "
                f"{MOST_BEAM_CELLS:,}; use {round_up(self.cell * sqrt(cells / MOST_BEAM_CELLS)):g} m or more"
            )

    def bytes(self, size: tuple[float, ...], readings: float, lasers: bool = False) -> float:
        cells = self.cells(size)
        beams = 24.0 * sum(cells) * readings * self.memory if self.memory else 8.0 * float(prod(cells)) ** 2
        return super().bytes(size, readings) + beams * lasers


class WindMap(FieldMap):
    """Wind over the floor from anemometers, by a random field that conserves mass (Monroy et al. 2017, ISOEN)."""

    measures: ClassVar[str] = "wind"
    kind: Literal["wind_gmrf"]  # type: ignore[assignment]
    cell: si.Length = 0.2
    lambda_prior: si.SomeCoefficient = WIND_PRIOR
    """Precision of the difference of neighbouring velocities, in s²/m²: less lets the wind vary more."""
    lambda_mass: si.SomeCoefficient = WIND_MASS
    """Precision of the outflow of a cell over its edge, in s²/m²: more conserves mass more closely."""
    lambda_observation: si.SomeCoefficient = WIND_OBSERVATION
    """Precision of a fresh reading of one component, in s²/m²: turbulence scatters readings about the mean wind."""

    def bytes(self, size: tuple[float, ...], readings: float, lasers: bool = False) -> float:
        return 8.0 * super().bytes(size, readings)


Map = Annotated[
    TimeSeriesMap | InverseDistanceMap | KernelMap | MarkovMap | WindMap, Field(discriminator="kind")
]
TEAM_MAPS = (TimeSeriesMap, KernelMap, MarkovMap)
TeamMap = Annotated[TimeSeriesMap | KernelMap | MarkovMap, Field(discriminator="kind")]
"""Map by which a team decides where to measure next."""
