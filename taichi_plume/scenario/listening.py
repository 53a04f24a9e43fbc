"""What every algorithm is asked, and those that stand still to listen."""

from collections.abc import Iterator
from math import sqrt
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from taichi_plume.scenario.quantities import fault, ill_sized
from taichi_plume.scenario.vocabulary import (
    COMPILED,
    Coefficient,
    Duration,
    EddyDiffusivity,
    Fraction,
    Frequency,
    Length,
    Model,
    Pause,
    SomePpm,
    Speed,
    Wait,
)

if TYPE_CHECKING:
    from taichi_plume.scenario.arena import Arena
    from taichi_plume.scenario.robots import Group


class AnyAlgorithm(Model):
    """What is asked of every algorithm."""

    talks: ClassVar[bool] = False
    """Whether its robots keep the messages of each other."""

    @property
    def threshold(self) -> float | None:
        """Reading [ppm] at which it does something else, None where there is none."""
        return None

    def in_group(self, where: str, group: "Group", floor: "Arena") -> Iterator[str]:
        """What is wrong with it for these robots on that floor; `where` is the group."""
        yield from ()

    def unfit(self, where: str, floor: "Arena") -> str | None:
        """A line about a grid of its own that has too many or too few cells on that floor; `where` is the group."""
        return None

    def bytes(self, group: "Group", floor: "Arena", tick: float) -> float:
        """About what it needs of memory for the robots of all trials; tick: control period [s]."""
        return 0.0


class Listening(AnyAlgorithm):
    """What algorithms share that stand still to listen: an acquisition is a series of samples."""

    speed: Speed | None = None
    """Unless given, the body's largest."""
    acquisition: Wait = 30.0
    """Time of listening [s]."""
    sample_period: Wait = 0.5
    """Between the samples of an acquisition [s]."""
    settle: Pause = 1.0
    """Standing still before it [s]."""


MOST_BELIEFS = 250_000  # cells of a map of beliefs: a step of a robot looks at all of them five times


class Spiral(Listening):
    """SPIRAL (Ferri et al. 2009). See agents/spiral.py."""

    kind: Literal["spiral"]
    acquisition: Annotated[Wait, COMPILED] = 30.0
    """Time of listening [s]."""
    sample_period: Annotated[Wait, COMPILED] = 0.5
    """Between the samples of an acquisition [s]."""
    minimum_ppm: SomePpm = 0.2
    """Threshold of the proximity index at the start, and after an escape: a mean index far from the source."""
    delta: Annotated[float, Field(ge=1e-6, lt=1)] = 0.2
    """By how much misses lower the threshold below the minimum, over the minimum."""
    mean_weight: Coefficient = 1.0
    """Of the mean of an acquisition in its proximity index."""
    peak_weight: Coefficient = 0.5
    """Of the sum of its peaks."""
    peak_window: Wait = 5.0
    """Only the largest peak of so long a time counts [s]."""
    peak_height: Literal["absolute", "above_mean"] = "absolute"
    """What of a peak counts: its concentration, or what of it is above the mean."""
    arms: Annotated[tuple[Length, ...], Field(min_length=1, max_length=100)] = (
        0.35,
        0.35,
        0.7,
        0.7,
        1.05,
        1.05,
    )
    """Lengths of a spiral's arms [m]."""
    escape_length: Length = 0.75
    """Way to the place of a new spiral when all arms were in vain [m]."""
    bump_side: Literal["spiral", "gradient"] = "spiral"
    """Where it turns at a bump: as the spiral does, or to the side of the best of the last 10 acquisitions."""
    strict_minimum: bool = False
    """Whether no index below the minimum is a hit, even with a lowered threshold."""
    random: bool = False
    """Random SPIRAL: the index is drawn uniformly between 0 and 1; nothing is smelt."""

    def bytes(self, group: "Group", floor: "Arena", tick: float) -> float:
        """Of the samples of an acquisition, which every robot keeps."""
        return 4.0 * group.count * group.trials * self.acquisition / max(self.sample_period, tick)


class EColi(Listening):
    """Run and tumble, as bacteria do (Russell et al. 2003). See agents/ecoli.py."""

    kind: Literal["ecoli"]
    acquisition: Wait = 3.0
    step: Length = 0.25
    """Driven after each acquisition [m]."""
    step_spread: Fraction = 0.05
    """Each step is step (1 ± step_spread), drawn uniformly."""
    run_angle_deg: Annotated[float, Field(ge=0, le=180)] = 5.0
    """Largest turn before a run; a tumble turns by any angle."""


class Infotaxis(Listening):
    """The way that is expected to tell most about the source (Vergassola et al. 2007). See agents/infotaxis.py."""

    kind: Literal["infotaxis"]
    acquisition: Wait = 2.0
    threshold_ppm: SomePpm = 5.0
    """Mean reading of an acquisition that counts as a detection."""
    step: Length = 0.25
    """Driven after each acquisition, unless it stays [m]."""
    cell: Annotated[Length, COMPILED] = 0.1
    """Edge of the cells of its map of beliefs [m]."""
    rate: Frequency = 1.0
    """Of the model that it believes in: detections per second close to the source."""
    diffusivity: Annotated[EddyDiffusivity, Field(ge=1e-9)] = 0.05
    """Of patches of gas [m²/s]."""
    wind_speed: Speed = 0.5
    """Mean [m/s]."""
    lifetime: Duration = 10.0
    """Of patches of gas [s]."""
    size: Length = 0.05
    """Of what detects them [m]."""

    @property
    def threshold(self) -> float:
        """Mean reading of a detection [ppm]."""
        return self.threshold_ppm

    @property
    def reach(self) -> float:
        """How far patches get across the wind: lambda [m]."""
        D, V, tau = self.diffusivity, self.wind_speed, self.lifetime
        return sqrt(D * tau / (1.0 + V**2 * tau / (4.0 * D)))

    def unfit(self, where: str, floor: "Arena") -> str | None:
        """Every cell of its map is looked at, again and again."""
        return ill_sized(f"{where}.algorithm.cell", self.cell, floor.size, MOST_BELIEFS)

    def bytes(self, group: "Group", floor: "Arena", tick: float) -> float:
        """Of the beliefs of every robot, and of the chances of a detection on half cells around it."""
        cells = floor.size[0] * floor.size[1] / self.cell**2
        chances = 16.0 * (floor.size[0] ** 2 + floor.size[1] ** 2) / self.cell**2
        return 4.0 * (group.count * group.trials * cells + chances)

    @model_validator(mode="after")
    def _small(self) -> "Infotaxis":
        if self.size >= self.reach:
            raise fault(
                "size = {size} m must be below lambda = {reach} m; lower it, or raise diffusivity",
                {"size": f"{self.size:g}", "reach": f"{self.reach:.3g}"},
            )
        return self
