"""The maps of a scenario: what is told of each kind of online gas map."""

from typing import Annotated, Literal

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from taichi_plume.vocabulary import Duration, Length, Model, Positive


class TimeSeriesMap(Model):
    """Spatio-temporal gas map (Marjovi & Marques, ICRA 2014, eq 1-7)."""

    kind: Literal["time_series"]
    cell: Length = 0.25
    alpha: Annotated[float, Field(gt=0, lt=1)] = 0.9
    """Weight of distance against age in the neighbourhood."""
    beta: Positive = 0.5
    """Size of the neighbourhood."""
    window: Duration = 5.0
    """Length of a snap [s]."""
    power: Positive = 2.0
    """Exponent of the inverse distance."""
    min_distance: Length | None = None
    """Distances below it count as it [m]; unless given, half a cell."""
    time_scale: Positive = 0.1
    """Distance that a second of age counts as [m/s]."""

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


class InverseDistanceMap(Model):
    """Inverse-distance interpolation of each snap's readings (Marjovi & Marques, ICRA 2014, eq 1-3)."""

    kind: Literal["inverse_distance"]
    cell: Length = 0.25
    window: Duration = 5.0
    power: Positive = 2.0
    min_distance: Length | None = None


Map = Annotated[TimeSeriesMap | InverseDistanceMap, Field(discriminator="kind")]
