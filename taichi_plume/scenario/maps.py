"""The maps of a scenario: what is told of each kind of online gas map."""

from math import prod, sqrt
from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from taichi_plume.scenario.quantities import fault, round_up
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
MOST_FIELD_COLUMN = 400  # cells: its third power is the work of an update


class AnyMap(Model):
    """What is asked of every map."""

    kind: str
    cell: Length
    """Edge of the cells [m]."""

    def bytes(self, size: tuple[float, ...]) -> float:
        """About what it needs of memory on a floor of that size [m], and trial: its fields, and what solves it."""
        return 40.0 * prod(extent / self.cell for extent in size[:2])

    def too_fine(self, where: str, size: tuple[float, ...]) -> str | None:
        """A line about cells that are too many for it on that floor [m]."""
        area = size[0] * size[1]
        if area / self.cell > MOST_CELLS * self.cell:
            return (
                f"{where}.cell: {self.cell:g} m makes more than {MOST_CELLS} map cells; "
                f"use {round_up(sqrt(area / MOST_CELLS)):g} m or more"
            )
        return None


class Snaps(AnyMap):
    """Readings of a window each, and what they tell of the cells of a map."""

    cell: Annotated[Length, COMPILED] = 0.25
    """Edge of the cells [m]."""
    window: Annotated[Duration, COMPILED] = 5.0
    """Length of a snap [s]."""
    power: Annotated[Exponent, COMPILED] = 2.0
    """Exponent of the inverse distance."""
    min_distance: Annotated[Length, COMPILED] | None = None
    """Distances below it count as it [m]; unless given, half a cell."""


class TimeSeriesMap(Snaps):
    """Spatio-temporal gas map (Marjovi & Marques, ICRA 2014, eq 1-7)."""

    kind: Literal["time_series"]  # type: ignore[assignment]
    alpha: Annotated[float, Field(ge=1e-6, lt=1), COMPILED] = 0.9
    """Weight of distance against age in the neighbourhood."""
    beta: Annotated[SomeCoefficient, COMPILED] = 0.5
    """Size of the neighbourhood."""
    time_scale: Annotated[SomeCoefficient, COMPILED] = 0.1
    """Distance that a second of age counts as [m/s]."""
    raw_samples: bool = False
    """Whether the neighbourhood is one of samples, rather than of interpolated cells."""

    @model_validator(mode="after")
    def _has_neighbours(self) -> "TimeSeriesMap":
        age = (1.0 - self.alpha) * self.time_scale * self.window
        if age >= self.beta:
            raise fault(
                "sees no past snap: (1 - alpha) time_scale window = {age} must be below beta = {beta}",
                {"age": f"{age:g}", "beta": f"{self.beta:g}"},
            )
        return self

    def bytes(self, size: tuple[float, ...]) -> float:
        """With the cells of the snaps that are near enough in time, around each."""
        if self.raw_samples:
            return super().bytes(size)
        long, short = sorted((extent / self.cell for extent in size[:2]), reverse=True)
        lags = self.beta / ((1.0 - self.alpha) * self.time_scale * self.window)
        margin = 2.0 * min(long, self.beta / self.alpha / self.cell)
        return super().bytes(size) + 8.0 * lags * (long + margin) * (short + margin)


class InverseDistanceMap(Snaps):
    """Inverse-distance interpolation of each snap's readings (Marjovi & Marques, ICRA 2014, eq 1-3)."""

    kind: Literal["inverse_distance"]  # type: ignore[assignment]


class KernelMap(AnyMap):
    """Mean and variance by Gaussian weights (Kernel DM+V: Lilienthal et al., IROS 2009)."""

    kind: Literal["kernel_dmv"]  # type: ignore[assignment]
    cell: Annotated[Length, COMPILED] = 0.1
    """Edge of the cells [m]."""
    window: ClassVar[None] = None
    """It has none: each reading counts at once."""
    sigma: Length = 0.25
    """Width of the kernel [m]: how far a reading tells of the gas around it."""
    sigma_omega: SomeCoefficient = 5.0
    """Readings taken in the middle of a cell that make its confidence 1 - 1/e; with few, the mean of all counts."""
    memory: Duration | None = None
    """Age at which a reading counts 1/e of a fresh one [s] (TD Kernel DM+V: Asadi et al. 2011); unless given, all count
    alike. One minute is a good begin."""
    wind_stretch: Delay = 0.0
    """Widening of the kernel along the wind that a robot feels, per wind speed [s] (Kernel DM+V/W: Reggente &
    Lilienthal 2009); 0.25 s suits winds of 0.7 m/s."""
    exact: Count = 2000
    """Latest readings of a trial for which the variance is reckoned anew as the mean changes."""

    def bytes(self, size: tuple[float, ...]) -> float:
        """With the latest readings."""
        return super().bytes(size) + 70.0 * self.exact


class MarkovMap(AnyMap):
    """Gaussian Markov random field with obstacles (Monroy et al., Autonomous Robots 2016)."""

    kind: Literal["gmrf"]  # type: ignore[assignment]
    cell: Annotated[Length, COMPILED] = 0.1
    """Edge of the cells [m]."""
    lambda_prior: SomeCoefficient = 0.01
    """Precision of the difference of neighbouring cells [1/ppm²]: less lets the map vary more."""
    lambda_observation: SomeCoefficient = 10.0
    """Precision of a fresh reading [1/ppm²]; the mean depends on the two by their ratio alone."""
    memory: Duration | None = 60.0
    """Age at which a reading counts no more, after steady loss [s]; null: readings count for ever."""
    window: Duration = 1.0
    """Time between updates [s]; readings within it are of the same age."""

    def bytes(self, size: tuple[float, ...]) -> float:
        """With a block of its matrix for each column."""
        long, short = sorted((extent / self.cell for extent in size[:2]), reverse=True)
        return super().bytes(size) + 8.0 * long * short**2

    def too_fine(self, where: str, size: tuple[float, ...]) -> str | None:
        """Its columns must not be too long."""
        width = min(size[:2])
        line = super().too_fine(where, size)
        if line is None and width / self.cell > MOST_FIELD_COLUMN:
            return (
                f"{where}.cell: {self.cell:g} m is too fine for a Markov field, which takes {MOST_FIELD_COLUMN} "
                f"cells along the shorter side; use {round_up(width / MOST_FIELD_COLUMN):g} m or more"
            )
        return line


Map = Annotated[TimeSeriesMap | InverseDistanceMap | KernelMap | MarkovMap, Field(discriminator="kind")]
