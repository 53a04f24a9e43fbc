"""The gas of a scenario: its kinds, species and sources."""

import re
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator
from pydantic_core import PydanticCustomError

from taichi_plume.species import SPECIES, Species
from taichi_plume.vocabulary import (
    Convection,
    Count,
    Diffusivity,
    Duration,
    Fraction,
    FullScale,
    Length,
    Model,
    MolarMass,
    Point,
    Point2,
    Positive,
    Rate,
    Time,
)
from taichi_plume.winds import Playback, PlumeSimLog, PointPlayback


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


class Target(Source):
    """A source of a plume that is given: robots search for it, here it emits nothing."""

    rate: Rate = 0.0


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


PureGas = Annotated[
    EulerianGas | PlaybackGas | PlumeSimGas | FluentGas | PlumeSimPuff | PlumeSimMeander,
    Field(discriminator="kind"),
]


class MixtureGas(Model):
    """Several gases at once, of any kinds and species; what they have in common adds up."""

    kind: Literal["mixture"]
    parts: Annotated[tuple[PureGas, ...], Field(min_length=1, max_length=16)]


Gas = Annotated[
    EulerianGas | PlaybackGas | PlumeSimGas | FluentGas | PlumeSimPuff | PlumeSimMeander | MixtureGas,
    Field(discriminator="kind"),
]
