"""The maps of a scenario: what is told of each kind of online gas map."""

from typing import Annotated, Literal

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from taichi_plume.scenario.vocabulary import COMPILED, Count, Delay, Duration, Length, Model, Positive


class Snaps(Model):
    """Readings of a window each, and what they tell of the cells of a map."""

    cell: Annotated[Length, COMPILED] = 0.25
    """Edge of the cells [m]."""
    window: Annotated[Duration, COMPILED] = 5.0
    """Length of a snap [s]."""
    power: Annotated[Positive, COMPILED] = 2.0
    """Exponent of the inverse distance."""
    min_distance: Annotated[Length, COMPILED] | None = None
    """Distances below it count as it [m]; unless given, half a cell."""


class TimeSeriesMap(Snaps):
    """Spatio-temporal gas map (Marjovi & Marques, ICRA 2014, eq 1-7)."""

    kind: Literal["time_series"]
    alpha: Annotated[float, Field(gt=0, lt=1), COMPILED] = 0.9
    """Weight of distance against age in the neighbourhood."""
    beta: Annotated[Positive, COMPILED] = 0.5
    """Size of the neighbourhood."""
    time_scale: Annotated[Positive, COMPILED] = 0.1
    """Distance that a second of age counts as [m/s]."""
    raw_samples: bool = False
    """Whether the neighbourhood is one of samples, rather than of interpolated cells."""

    @model_validator(mode="after")
    def _has_neighbours(self) -> "TimeSeriesMap":
        age = (1.0 - self.alpha) * self.time_scale * self.window
        if age >= self.beta:
            raise PydanticCustomError(
                "neighbourhood",
                "sees no past snap: (1 - alpha) time_scale window = {age} must be below beta = {beta}",
                {"age": f"{age:g}", "beta": f"{self.beta:g}"},
            )
        return self


class InverseDistanceMap(Snaps):
    """Inverse-distance interpolation of each snap's readings (Marjovi & Marques, ICRA 2014, eq 1-3)."""

    kind: Literal["inverse_distance"]


class KernelMap(Model):
    """Mean and variance by Gaussian weights (Kernel DM+V: Lilienthal et al., IROS 2009)."""

    kind: Literal["kernel_dmv"]
    cell: Annotated[Length, COMPILED] = 0.1
    """Edge of the cells [m]."""
    sigma: Length = 0.25
    """Width of the kernel [m]: how far a reading tells of the gas around it."""
    sigma_omega: Positive = 5.0
    """Readings taken in the middle of a cell that make its confidence 1 - 1/e; with few, the mean of all counts."""
    memory: Duration | None = None
    """Age at which a reading counts 1/e of a fresh one [s] (TD Kernel DM+V: Asadi et al. 2011); unless given, all count
    alike. One minute is a good begin."""
    wind_stretch: Delay = 0.0
    """Widening of the kernel along the wind that a robot feels, per wind speed [s] (Kernel DM+V/W: Reggente &
    Lilienthal 2009); 0.25 s suits winds of 0.7 m/s."""
    exact: Count = 2000
    """Latest readings of a trial for which the variance is reckoned anew as the mean changes."""


class MarkovMap(Model):
    """Gaussian Markov random field with obstacles (Monroy et al., Autonomous Robots 2016)."""

    kind: Literal["gmrf"]
    cell: Annotated[Length, COMPILED] = 0.1
    """Edge of the cells [m]."""
    lambda_prior: Positive = 0.01
    """Precision of the difference of neighbouring cells [1/ppm²]: less lets the map vary more."""
    lambda_observation: Positive = 10.0
    """Precision of a fresh reading [1/ppm²]; the mean depends on the two by their ratio alone."""
    memory: Duration | None = 60.0
    """Age at which a reading counts no more, after steady loss [s]; null: readings count for ever."""
    window: Duration = 1.0
    """Time between updates [s]; readings within it are of the same age."""


Map = Annotated[TimeSeriesMap | InverseDistanceMap | KernelMap | MarkovMap, Field(discriminator="kind")]
