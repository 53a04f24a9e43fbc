"""The gas of a scenario: its kinds, species and sources."""

from typing import Annotated, Literal

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from taichi_plume.species import SPECIES, Species
from taichi_plume.vocabulary import (
    Convection,
    Count,
    Diffusivity,
    Dissipation,
    Duration,
    Fraction,
    Frequency,
    Length,
    Model,
    MolarMass,
    Point,
    Rate,
    Speed,
    Time,
)
from taichi_plume.winds import Playback


class OtherSpecies(Model):
    """A vapour that is not in the table."""

    name: str = "gas"
    molar_mass: MolarMass
    diffusivity: Diffusivity


class Puffing(Model):
    """A source that is on and off by turns; the durations are drawn anew each time."""

    pulse: Duration
    """Mean duration of an emission [s]."""
    pause: Duration
    """Mean time between emissions [s]."""
    spread: Fraction = 0.5
    """Durations are uniform in mean·(1 ± spread)."""


class Source(Model):
    """A ball (in 2-D a disc) that emits evenly over its volume."""

    position: Point
    rate: Rate
    """Mass per time while it is on [kg/s]."""
    radius: Length = 0.05
    start: Time | None = None
    """First moment of emission [s]; unless given, the start of the warm-up."""
    stop: Time | None = None
    puffing: Puffing | None = None

    @model_validator(mode="after")
    def _ordered(self) -> "Source":
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
        return Species(self.species.name, self.species.molar_mass, self.species.diffusivity)


class EulerianGas(OneGas):
    """Convection and diffusion of a concentration on the grid."""

    kind: Literal["eulerian"]
    convection: Convection = "koren"
    """Scheme of convection; weno5 keeps filaments sharper on the same grid and costs more."""
    sources: Annotated[tuple[Source, ...], Field(min_length=1)]


class DiffusiveGrowth(Model):
    """R² = R0² + rate t (Farrell et al. 2002, doi:10.1023/A:1016283702837)."""

    kind: Literal["diffusive"]
    rate: Diffusivity = 1e-4
    """[m²/s]."""


class InertialGrowth(Model):
    """R^(2/3) = R0^(2/3) + (g epsilon/6)^(1/3) t: puffs among the eddies of the inertial range.

    g = 0.5 is Richardson's constant: the mean square distance of two particles, 6 R², grows as g epsilon t³ (Ott & Mann
    2000, doi:10.1017/S0022112000001658).
    """

    kind: Literal["inertial"]
    dissipation: Dissipation = 1e-3
    """Turbulent kinetic energy lost per time, epsilon [m²/s³]."""


class PuffGas(OneGas):
    """Turbulent puffs that the wind carries, see solvers/puffs.py."""

    kind: Literal["puffs"]
    sources: Annotated[tuple[Source, ...], Field(min_length=1)]
    release_rate: Frequency = 50.0
    """Puffs per second and source [1/s]; each holds what its source has emitted since the one before."""
    poisson: bool = False
    """Whether they come at random times rather than steadily."""
    initial_size: Length = 0.01
    """Standard deviation of a new puff [m]."""
    fluctuation: Speed | None = None
    """Standard deviation of each component of the velocity that the wind leaves out [m/s]; unless given 0.05 in a
    uniform wind, which has no eddies, and 0 in the others, which have their own."""
    fluctuation_time: Duration = 0.5
    """Time over which it changes [s]."""
    growth: Annotated[DiffusiveGrowth | InertialGrowth, Field(discriminator="kind")] | None = None
    """By eddies smaller than a puff, besides what molecules and the wind's eddy viscosity do; unless given, diffusive
    in a uniform wind and none in the others."""
    buoyancy: bool = False
    """Whether heavy gas sinks (3-D)."""
    cutoff: Annotated[float, Field(ge=2, le=5)] = 3.5
    """Standard deviations at which a puff ends."""
    most: Annotated[Count, Field(ge=100)] = 200_000
    """Puffs at a time: beyond, neighbours are merged."""


class PlaybackGas(OneGas, Playback):
    """One species of a recorded run's gas."""

    kind: Literal["playback"]
    species: Literal["ethanol", "acetone"] | OtherSpecies | None = None  # type: ignore[assignment]
    """Unless given, the recorded one."""
    sources: tuple[Source, ...] = ()
    """What the robots search for; unless given, the recorded ones."""


PureGas = Annotated[EulerianGas | PuffGas | PlaybackGas, Field(discriminator="kind")]


class MixtureGas(Model):
    """Several gases at once, of any kinds and species; what they have in common adds up."""

    kind: Literal["mixture"]
    parts: Annotated[tuple[PureGas, ...], Field(min_length=1, max_length=16)]


Gas = Annotated[EulerianGas | PuffGas | PlaybackGas | MixtureGas, Field(discriminator="kind")]
