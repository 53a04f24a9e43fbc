"""The maps of a scenario: what is told of each kind of online gas map."""

from collections.abc import Iterator
from math import ceil, prod
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, model_validator

from taichi_plume.scenario.domain import Context
from taichi_plume.scenario.quantities import fault, ill_sized, round_up
from taichi_plume.scenario.vocabulary import (
    COMPILED,
    Count,
    Delay,
    Duration,
    Exponent,
    Length,
    Model,
    SomeCoefficient,
)

MOST_CELLS = 4_000_000
LOG_SNAPS = 120  # of a whole log, at most; a log of ten minutes has so many of 5 s
LOG_BYTES = 1e9  # of the snaps of a whole log, at most
LOG_WORK = 3e10  # of a whole log: terms of sums, at most; some seconds
MOST_NEIGHBOURS = 1_000_000  # members of a neighbourhood in space and time, made and gone through one by one
BORDER = 1e-9  # a distance this close to beta is outside, whatever the rounding
MOST_FIELD_COLUMN = 400  # cells: its third power is the work of an update


class AnyMap(Model):
    """What is asked of every map."""

    times: ClassVar[tuple[str, ...]] = ()
    """Keys that say for how long readings count. A map of a log chooses them, unless one of them is given."""
    kind: str
    cell: Length
    """Edge of the square cells of the map."""

    def of_log(self, duration: float, size: tuple[float, float]) -> dict[str, Any]:
        """What `times` have to be for a map of a log, on a floor of that size [m], that forgets nothing of its
        `duration` [s]; nothing where it does not forget anyway.
        """
        return {}

    def bytes(self, size: tuple[float, ...], readings: float) -> float:
        """About what it needs of memory on a floor of that size [m], and trial: its fields, and what solves it.

        readings: of the robots of a trial, per second.
        """
        return 40.0 * prod(extent / self.cell for extent in size[:2])

    def remarks(self, where: str, context: Context) -> Iterator[str]:
        window = vars(self).get("window") or 0.0
        if window > context.scenario.duration:
            yield (
                f"{where}.window: {window:g} s is longer than duration: {context.scenario.duration:g} s; the map "
                "will know nothing"
            )

    def unfit(self, where: str, size: tuple[float, ...]) -> str | None:
        """A line about cells that are too many or too few for it on a floor of that size [m]."""
        return ill_sized(f"{where}.cell", self.cell, size, MOST_CELLS)


class Snaps(AnyMap):
    """Readings of a window each, and what they tell of the cells of a map."""

    cell: Annotated[Length, COMPILED] = 0.25
    window: Annotated[Duration, COMPILED] = 5.0
    """Length of a snap: readings within it count as taken at once."""
    power: Annotated[Exponent, COMPILED] = 2.0
    """Exponent of the inverse distance: more lets the nearest reading count more."""
    min_distance: Annotated[Length, COMPILED] | None = None
    """Distances below it count as it; unless given, half a cell."""

    def bytes(self, size: tuple[float, ...], readings: float) -> float:
        return super().bytes(size, readings) + 12.0 * readings * self.window


class TimeSeriesMap(Snaps):
    """A map from neighbours in space and time: readings count less, the farther and the older they are.

    Marjovi & Marques, ICRA 2014, eq 1-7.
    """

    kind: Literal["time_series"]  # type: ignore[assignment]
    alpha: Annotated[float, Field(ge=1e-6, lt=1), COMPILED] = 0.9
    """Weight of distance against age in the neighbourhood: near 1, old readings still count."""
    beta: Annotated[SomeCoefficient, COMPILED] = 0.5
    """Size of the neighbourhood. A reading counts where alpha distance + (1 - alpha) time_scale age is below it."""
    time_scale: Annotated[SomeCoefficient, COMPILED] = 0.1
    """Distance that a second of age counts as. More forgets faster."""
    raw_samples: bool = False
    """Take the samples themselves as neighbours, rather than the cells interpolated from them."""
    times: ClassVar[tuple[str, ...]] = ("window", "time_scale")

    @model_validator(mode="after")
    def _has_neighbours(self) -> "TimeSeriesMap":
        age = (1.0 - self.alpha) * self.time_scale * self.window
        if age >= self.beta - BORDER:
            raise fault(
                "sees no past snap: (1 - alpha) time_scale window = {age} must be below beta = {beta}",
                {"age": f"{age:g}", "beta": f"{self.beta:g}"},
            )
        return self

    def of_log(self, duration: float, size: tuple[float, float]) -> dict[str, Any]:
        """Age may take half of the neighbourhood. What is oldest still counts half as far around as what is new, and
        there what is new counts most. Of a long log, or a large floor, the snaps are longer.
        """
        snaps = min(LOG_SNAPS, ceil(duration / self.window) or 1)
        terms = prod(extent / self.cell for extent in size) * (
            1.0 + (self.beta / self.alpha / self.cell) ** 2
        )
        while True:
            window = max(self.window, duration / snaps)
            reach = window * (ceil(duration / window) + 1)
            chosen = {"window": window, "time_scale": 0.5 * self.beta / ((1.0 - self.alpha) * reach)}
            most = (
                self.model_copy(update=chosen).bytes(size, 1.0) <= LOG_BYTES and terms * snaps**2 <= LOG_WORK
            )
            if most or snaps == 1:
                return chosen
            snaps //= 2

    def unfit(self, where: str, size: tuple[float, ...]) -> str | None:
        line = super().unfit(where, size)
        reach = min(max(size[:2]) / self.cell, self.beta / self.alpha / self.cell + 1.0)
        members = self.lags * (2.0 * reach + 1.0) ** 2
        if line is None and members > MOST_NEIGHBOURS:
            return (
                f"{where}.beta: {self.beta:g} makes a neighbourhood of {members:.2g} cells of past snaps, at most "
                f"{MOST_NEIGHBOURS:.2g} are looked at; lower it, or raise cell, window or time_scale"
            )
        return line

    @property
    def lags(self) -> float:
        """How many past snaps are near enough in time."""
        return self.beta / ((1.0 - self.alpha) * self.time_scale * self.window)

    def bytes(self, size: tuple[float, ...], readings: float) -> float:
        """With the samples or the cells of the snaps that are near enough in time, these with cells around."""
        if self.raw_samples:
            return super().bytes(size, readings) * (1.0 + self.lags)
        long, short = sorted((extent / self.cell for extent in size[:2]), reverse=True)
        margin = 2.0 * min(long, self.beta / self.alpha / self.cell)
        return super().bytes(size, readings) + 8.0 * self.lags * (long + margin) * (short + margin)


class InverseDistanceMap(Snaps):
    """A map from the readings of one snap alone, weighted by the inverse distance.

    Marjovi & Marques, ICRA 2014, eq 1-3.
    """

    times: ClassVar[tuple[str, ...]] = ("window",)
    kind: Literal["inverse_distance"]  # type: ignore[assignment]

    def of_log(self, duration: float, size: tuple[float, float]) -> dict[str, Any]:
        """All readings are of one snap."""
        return {"window": max(self.window, duration)}


class KernelMap(AnyMap):
    """Mean and variance by Gaussian weights: Kernel DM+V (Lilienthal et al., IROS 2009)."""

    times: ClassVar[tuple[str, ...]] = ("memory",)
    kind: Literal["kernel_dmv"]  # type: ignore[assignment]
    cell: Annotated[Length, COMPILED] = 0.1
    window: ClassVar[None] = None
    """It has none: each reading counts at once."""
    sigma: Length = 0.25
    """Width of the kernel: how far a reading tells of the gas around it."""
    sigma_omega: SomeCoefficient = 5.0
    """Readings in the middle of a cell that make its confidence 1 - 1/e; with few, the mean of all counts."""
    memory: Duration | None = None
    """Age at which a reading counts 1/e of a fresh one (TD Kernel DM+V: Asadi et al. 2011). Unless given, all count
    alike. One minute is a good begin."""
    wind_stretch: Delay = 0.0
    """Widening of the kernel along the wind that a robot feels, per wind speed. 0.25 s suits winds of 0.7 m/s (Kernel
    DM+V/W: Reggente & Lilienthal 2009); 0 keeps it round."""
    exact: Count = 2000
    """Latest readings of a trial for which the variance is reckoned anew as the mean changes."""

    def of_log(self, duration: float, size: tuple[float, float]) -> dict[str, Any]:
        """All readings count alike."""
        return {}

    def bytes(self, size: tuple[float, ...], readings: float) -> float:
        return super().bytes(size, readings) + 70.0 * self.exact


class MarkovMap(AnyMap):
    """Mean and variance by a Gaussian Markov random field, cut by obstacles (Monroy et al. 2016, Autonomous Robots)."""

    times: ClassVar[tuple[str, ...]] = ("memory",)
    kind: Literal["gmrf"]  # type: ignore[assignment]
    cell: Annotated[Length, COMPILED] = 0.1
    lambda_prior: SomeCoefficient = 0.01
    """Precision of the difference of neighbouring cells, in 1/ppm²: less lets the map vary more."""
    lambda_observation: SomeCoefficient = 10.0
    """Precision of a fresh reading, in 1/ppm². The mean depends on the two by their ratio alone."""
    memory: Duration | None = 60.0
    """Age at which a reading counts no more, after steady loss; null: readings count for ever."""
    window: Duration = 1.0
    """Time between updates; readings within it are of the same age."""

    def of_log(self, duration: float, size: tuple[float, float]) -> dict[str, Any]:
        """All readings count alike."""
        return {"memory": None}

    def bytes(self, size: tuple[float, ...], readings: float) -> float:
        long, short = sorted((extent / self.cell for extent in size[:2]), reverse=True)
        return super().bytes(size, readings) + 8.0 * long * short**2

    def unfit(self, where: str, size: tuple[float, ...]) -> str | None:
        width = min(size[:2])
        line = super().unfit(where, size)
        if line is None and width / self.cell > MOST_FIELD_COLUMN:
            return (
                f"{where}.cell: {self.cell:g} m is too fine for a Markov field, which takes {MOST_FIELD_COLUMN} "
                f"cells along the shorter side; use {round_up(width / MOST_FIELD_COLUMN):g} m or more"
            )
        return line


Map = Annotated[TimeSeriesMap | InverseDistanceMap | KernelMap | MarkovMap, Field(discriminator="kind")]
