"""The gas of a scenario: its kinds, species and sources."""

from typing import Annotated, Literal

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from taichi_plume.species import SPECIES, TEMPERATURE, Species
from taichi_plume.vocabulary import (
    Convection,
    Diffusivity,
    Duration,
    Fraction,
    LatentHeat,
    Length,
    Model,
    MolarMass,
    Point,
    Pressure,
    Rate,
    Speed,
    Temperature,
    Time,
)
from taichi_plume.winds import Playback


class OtherSpecies(Model):
    """A vapour that is not in the table."""

    name: str = "gas"
    molar_mass: MolarMass
    diffusivity: Diffusivity
    vapour_pressure: Pressure | None = None
    """Over the liquid at the temperature of its dish [Pa]; for sources that are dishes."""
    latent_heat: LatentHeat | None = None
    """Of evaporation [J/kg]; for dishes that cool."""


class Puffing(Model):
    """A source that is on and off by turns; the durations are drawn anew each time."""

    pulse: Duration
    """Mean duration of an emission [s]."""
    pause: Duration
    """Mean time between emissions [s]."""
    spread: Fraction = 0.5
    """Durations are uniform in mean·(1 ± spread)."""


class Dish(Model):
    """A flat, open dish of liquid: the wind over it says how much evaporates; see solvers/evaporation.py."""

    diameter: Length
    temperature: Temperature = TEMPERATURE
    """Of the air and, unless evaporation cools it, of the liquid [K]."""
    cooling: bool = True
    """Whether evaporation cools the liquid; otherwise something keeps its temperature."""
    air_speed: Speed | None = None
    """Of the air over the dish [m/s]; unless given, of the wind half a diameter above the source (in 2-D: there)."""


class Source(Model):
    """A ball (in 2-D a disc) that emits evenly over its volume, with a given rate or what a dish gives off."""

    position: Point
    rate: Rate | None = None
    """Mass per time while it is on [kg/s]."""
    dish: Dish | None = None
    """Instead of a rate."""
    radius: Length = 0.05
    start: Time | None = None
    """First moment of emission [s]; unless given, the start of the warm-up."""
    stop: Time | None = None
    puffing: Puffing | None = None

    @model_validator(mode="after")
    def _ordered(self) -> "Source":
        if (self.rate is None) == (self.dish is None):
            got = "neither" if self.dish is None else "both"
            raise PydanticCustomError("source", "takes a rate or a dish, got {got}", {"got": got})
        if self.start is not None and self.stop is not None and self.stop <= self.start:
            raise PydanticCustomError("source", "stop must be later than start")
        return self


class OneGas(Model):
    """What every gas of one species has."""

    species: Literal["ethanol", "acetone"] | OtherSpecies = "ethanol"

    @property
    def vapour(self) -> Species:
        """The species."""
        if isinstance(self.species, str):
            return SPECIES[self.species]
        return Species(**self.species.model_dump())


class EulerianGas(OneGas):
    """Convection and diffusion of a concentration on the grid."""

    kind: Literal["eulerian"]
    convection: Convection = "koren"
    """Scheme of convection; weno5 keeps filaments sharper on the same grid and costs more."""
    sources: Annotated[tuple[Source, ...], Field(min_length=1)]


class PlaybackGas(OneGas, Playback):
    """One species of a recorded run's gas."""

    kind: Literal["playback"]
    species: Literal["ethanol", "acetone"] | OtherSpecies | None = None  # type: ignore[assignment]
    """Unless given, the recorded one."""
    sources: tuple[Source, ...] = ()
    """What the robots search for; unless given, the recorded ones."""


PureGas = Annotated[EulerianGas | PlaybackGas, Field(discriminator="kind")]


class MixtureGas(Model):
    """Several gases at once, of any kinds and species; what they have in common adds up."""

    kind: Literal["mixture"]
    parts: Annotated[tuple[PureGas, ...], Field(min_length=1, max_length=16)]


Gas = Annotated[EulerianGas | PlaybackGas | MixtureGas, Field(discriminator="kind")]
