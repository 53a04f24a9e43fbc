"""The gas of a scenario: its kinds, species and sources."""

import re
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from pydantic import Field, field_validator, model_validator
from pydantic_core import PydanticCustomError

from taichi_plume.species import SPECIES, TEMPERATURE, Species
from taichi_plume.vocabulary import (
    Convection,
    Count,
    Diffusivities,
    Diffusivity,
    Dissipation,
    Duration,
    Face,
    Fraction,
    Frequency,
    FullScale,
    Intensities,
    LatentHeat,
    Length,
    Mass,
    Model,
    MolarMass,
    NonNegative,
    Point,
    Point2,
    Positive,
    Pressure,
    Rate,
    Speed,
    Temperature,
    Time,
)
from taichi_plume.winds import Playback, PlumeSimLog, PointPlayback


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


class Target(Source):
    """A source of a plume that is given: robots search for it, here it emits nothing."""

    rate: Rate = 0.0


class OneGas(Model):
    """What every gas of one species has."""

    sources_key: ClassVar[str] = "sources"
    """Where a scenario lists what the robots search for."""
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


class PercentGas(OneGas):
    """A plume that is known in percent of a full scale, as PlumeSim's are; in 3-D it is the same at every height."""

    full_scale_ppm: FullScale = 100.0
    """What 100 percent stand for."""
    sources: tuple[Target, ...] = ()
    """What the robots search for."""


class PlumeSimGas(PercentGas, PlumeSimLog):
    """The plume of a log of PlumeSim."""

    kind: Literal["plumesim_log"]


class FluentGas(PercentGas, PointPlayback):
    """A plume computed by Fluent, exported as text, one file per frame; see point_frames.py."""

    kind: Literal["fluent"]
    files: Annotated[str, Field(min_length=1)]
    """Path of the files, relative to the scenario's folder, such as plume%03d.txt for plume001.txt and so on."""
    frames: Count | None = None
    """Number of files; unless given, all there are."""
    period: Duration = 1.0
    """Time between frames [s]."""
    cell: Length = 0.1
    """Points count up to this distance [m]."""
    largest: Positive | None = None
    """Concentration that counts as 100 percent; unless given, the largest in the files."""

    @field_validator("files")
    @classmethod
    def _numbered(cls, files: str) -> str:
        if not re.fullmatch(r"[^%]*%(0?[1-9])?d[^%]*", Path(files).name):
            raise PydanticCustomError(
                "files", "must hold one number, such as plume%03d.txt, in the file's name"
            )
        return files


Spread = Annotated[float, Field(ge=1e-6, le=1e6)]


class PlumeSimPuff(PercentGas):
    """PlumeSim's Gaussian plume: a puff that spreads, frame by frame, on nodes to the right of and above its release.

    Percent = amount/(4 pi sqrt(Dx Dy) n) exp(-(dx²/Dx + dy²/Dy)/(4 n)) with the number n of the frame: 1, 2, ... last,
    then again from `repeat_from`. A reading is that of the nearest node that is closer than the cell, else zero. The
    program has a wind of 0.5 m/s along x with it.
    """

    kind: Literal["plumesim_gaussian"]
    release_point: Point2
    diffusion: tuple[Spread, Spread] = (0.2, 0.005)
    """Dx, Dy [m² per frame]."""
    amount: Annotated[float, Field(gt=0, le=1e6)] = 100.0
    """Percent m² that are released."""
    cell: Length = 0.1
    """Distance of the nodes [m]."""
    all_around: bool = False
    """Nodes to the left of and below the release too, which the program has not."""
    period: Duration = 1.0
    """Time between frames [s]."""
    last: Count = 25
    repeat_from: Count = 20
    start: Time = 0.0
    """Time since the release [s] when the robots start."""

    @model_validator(mode="after")
    def _returns(self) -> "PlumeSimPuff":
        if self.repeat_from > self.last:
            raise PydanticCustomError("source", "repeat_from must not be above last")
        return self


class PlumeSimMeander(PercentGas):
    """PlumeSim's meandering plume: points strewn about a random line along x, once for the whole run.

    A reading is the number of points within the radius, as a share of that one radius downwind of the release, 100
    percent at most. The program has a wind of 0.5 m/s along x with it.
    """

    kind: Literal["plumesim_meandering"]
    release_point: Point2
    points: Annotated[int, Field(ge=20, le=1_000_000)] = 200
    """About so many."""
    release_rate: Annotated[float, Field(ge=0, le=1e6)] = 10.0
    dispersion: Annotated[float, Field(ge=0, le=1e3)] = 0.1
    """Points stray across by a standard deviation of dispersion release_rate (x - x0)."""
    radius: Length = 0.1


class ClosedForm(OneGas):
    """A gas that a formula tells at any place and time: in a uniform wind, without obstacles, reflected by walls."""

    walls: tuple[Face, ...] | None = None
    """Faces of the domain that let no gas through; unless given the ground, z-, in 3-D and none in 2-D."""

    def reflecting(self, dim: int) -> tuple[Face, ...]:
        """The faces that let no gas through, in `dim` dimensions."""
        return (("z-",) if dim == 3 else ()) if self.walls is None else self.walls


class Release(Model):
    """A puff, at first a Gaussian of standard deviation `radius`."""

    position: Point
    mass: Mass
    time: Time = 0.0
    """When it is released [s]; the robots start at 0."""
    radius: Length = 0.05


class GaussianPuffGas(ClosedForm):
    """Puffs that drift and spread: one Gaussian each."""

    kind: Literal["gaussian_puff"]
    sources_key: ClassVar[str] = "releases"
    releases: Annotated[tuple[Release, ...], Field(min_length=1)]
    diffusivity: Diffusivities | None = None
    """One for all axes or one per axis [m²/s]; unless given, the species' in still air."""

    @property
    def sources(self) -> tuple[Release, ...]:
        """What the robots search for."""
        return self.releases


class PlumeSource(Model):
    """A steady source, at its place a Gaussian of standard deviation `radius`."""

    position: Point
    rate: Rate
    """Mass per time [kg/s]."""
    radius: Length = 0.05


class ContinuousSource(PlumeSource):
    """A source that emits evenly from `start` to `stop`, from and for ever unless they are given."""

    start: Time | None = None
    stop: Time | None = None

    @model_validator(mode="after")
    def _ordered(self) -> "ContinuousSource":
        if self.start is not None and self.stop is not None and self.stop <= self.start:
            raise PydanticCustomError("source", "stop must be later than start")
        return self


class ContinuousGas(ClosedForm):
    """What steady sources emit drifts and spreads: the exact solution for constant diffusivities."""

    kind: Literal["continuous"]
    sources: Annotated[tuple[ContinuousSource, ...], Field(min_length=1)]
    diffusivity: Diffusivities | None = None
    """One for all axes or one per axis [m²/s]; unless given, the species' in still air."""


class GaussianPlumeGas(ClosedForm):
    """Mean plume: a Gaussian across the wind whose standard deviation grows with the distance x from the source."""

    kind: Literal["gaussian_plume"]
    sources: Annotated[tuple[PlumeSource, ...], Field(min_length=1)]
    intensity: Intensities | None = None
    """sigma = radius + intensity x; one number, or two: horizontal and vertical. Of turbulence, about 0.05 to 0.15."""
    diffusivity: Diffusivities | None = None
    """sigma² = radius² + 2 diffusivity x/U [m²/s]; one number, or two: horizontal and vertical."""

    @model_validator(mode="after")
    def _one_law(self) -> "GaussianPlumeGas":
        if (self.intensity is None) == (self.diffusivity is None):
            raise PydanticCustomError(
                "spread", "takes either intensity or diffusivity, which widen the plume"
            )
        return self


class MeanderingGas(ClosedForm):
    """A plume that the gusts of the wind sweep to and fro: it is thin in every moment, and wide in the mean.

    Across, Q/(U w h) exp(-(y - y_c)²/(2 s_y²)), w = sqrt(2 pi) s_y, h = sqrt(2 pi) s_z; s² = radius² + (slope x)².
    """

    kind: Literal["meandering"]
    sources: Annotated[tuple[PlumeSource, ...], Field(min_length=1)]
    width_slope: NonNegative = 0.08
    """Growth of the horizontal standard deviation with the distance from the source."""
    height_slope: NonNegative = 0.06
    """Growth of the vertical one."""
    width_fluctuation: NonNegative = 0.0
    """Standard deviation of the logarithm of the width, which varies as the gusts do."""


AnySource = Source | Release | PlumeSource
"""What has a position and a radius: what the robots search for."""

PureGas = Annotated[
    EulerianGas
    | PuffGas
    | PlaybackGas
    | GaussianPuffGas
    | ContinuousGas
    | GaussianPlumeGas
    | MeanderingGas
    | PlumeSimGas
    | FluentGas
    | PlumeSimPuff
    | PlumeSimMeander,
    Field(discriminator="kind"),
]


class MixtureGas(Model):
    """Several gases at once, of any kinds and species; what they have in common adds up."""

    kind: Literal["mixture"]
    parts: Annotated[tuple[PureGas, ...], Field(min_length=1, max_length=16)]


Gas = Annotated[
    EulerianGas
    | PuffGas
    | PlaybackGas
    | GaussianPuffGas
    | ContinuousGas
    | GaussianPlumeGas
    | MeanderingGas
    | PlumeSimGas
    | FluentGas
    | PlumeSimPuff
    | PlumeSimMeander
    | MixtureGas,
    Field(discriminator="kind"),
]
