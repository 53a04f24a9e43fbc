"""What every algorithm is asked, and those that stand still to listen."""

from collections.abc import Iterator
from math import sqrt
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from taichi_plume.scenario.quantities import fault, ill_sized, number
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
    searches: ClassVar[bool] = False
    """Whether all that its robots do is to go for a source."""

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
    """Speed at which they drive; unless given, the body's largest."""
    acquisition: Wait = 30.0
    """Time for which a robot stands still and listens. Longer averages over more whiffs, and slows the search."""
    sample_period: Wait = 0.5
    """Time between the samples of an acquisition."""
    settle: Pause = 1.0
    """Time of standing still before it listens, for a slow sensor to catch up."""


MOST_BELIEFS = 250_000  # cells of a map of beliefs: a step of a robot looks at all of them five times


class Spiral(Listening):
    """Spirals of straight arms around places that smell more and more, for rooms without strong wind.

    Ferri et al. 2009. See agents/spiral.py.
    """

    searches: ClassVar[bool] = True
    kind: Literal["spiral"]
    acquisition: Annotated[Wait, COMPILED] = 30.0
    sample_period: Annotated[Wait, COMPILED] = 0.5
    minimum_ppm: SomePpm = 0.2
    """Threshold of the proximity index at the start, and after an escape: a mean index far from the source."""
    delta: Annotated[float, Field(ge=1e-6, lt=1)] = 0.2
    """By how much misses lower the threshold below the minimum, over the minimum."""
    mean_weight: Coefficient = 1.0
    """Weight of the mean of an acquisition in its proximity index."""
    peak_weight: Coefficient = 0.5
    """Weight of the sum of its peaks in the proximity index. Peaks are higher near the source."""
    peak_window: Wait = 5.0
    """Only the largest peak within so long a time counts."""
    peak_height: Literal["above_mean", "absolute"] = "above_mean"
    """What of a peak counts: what of it is above the mean, or its whole concentration. The paper says neither, but
    that the mean is there for low peaks: a whole peak is never lower than the mean."""
    arms: Annotated[tuple[Length, ...], Field(min_length=1, max_length=100)] = (
        0.4,
        0.4,
        0.8,
        0.8,
        1.2,
        1.2,
    )
    """Lengths of a spiral's arms, in their order. The paper does not give them, but that they suit the area: these make
    random SPIRAL take as many acquisitions as published, in an arena of 3 x 2.1 m."""
    escape_length: Length = 0.75
    """Way to the place of a new spiral when all arms were in vain."""
    bump_side: Literal["spiral", "gradient"] = "spiral"
    """Where it turns at a bump: as the spiral does, or to the side of the best of the last 10 acquisitions."""
    strict_minimum: bool = False
    """Take no index below the minimum for a hit, even with a lowered threshold."""
    random: bool = False
    """Random SPIRAL, to compare with: the index is drawn between 0 and 1, and nothing is smelt."""

    def bytes(self, group: "Group", floor: "Arena", tick: float) -> float:
        """Of the samples of an acquisition, which every robot keeps."""
        return 4.0 * group.count * group.trials * self.acquisition / max(self.sample_period, tick)


class EColi(Listening):
    """Run and tumble, as bacteria do (Russell et al. 2003). See agents/ecoli.py."""

    searches: ClassVar[bool] = True
    kind: Literal["ecoli"]
    acquisition: Wait = 3.0
    step: Length = 0.25
    """Way driven after each acquisition."""
    step_spread: Fraction = 0.05
    """Randomness of the way: each step is step (1 ± step_spread), drawn uniformly."""
    run_angle_deg: number(0, 180, "deg") = 5.0
    """Largest turn before a run, that is after a rise; a tumble turns by any angle."""


class Infotaxis(Listening):
    """The way that is expected to tell most about the source (Vergassola et al. 2007). See agents/infotaxis.py."""

    searches: ClassVar[bool] = True
    kind: Literal["infotaxis"]
    acquisition: Wait = 2.0
    threshold_ppm: SomePpm = 5.0
    """Mean reading of an acquisition that counts as a detection."""
    step: Length = 0.25
    """Way driven after each acquisition, unless it stays."""
    cell: Annotated[Length, COMPILED] = 0.1
    """Edge of the cells of the robot's map of beliefs. Smaller ones take longer."""
    rate: Frequency = 1.0
    """Detections per second close to the source, in the model that the robot believes in."""
    diffusivity: Annotated[EddyDiffusivity, Field(ge=1e-9)] = 0.05
    """Diffusivity of patches of gas, in the model that the robot believes in. More makes its plume wider."""
    wind_speed: Speed = 0.5
    """Mean speed of the wind, in the model that the robot believes in."""
    lifetime: Duration = 10.0
    """How long patches of gas last, in the model that the robot believes in."""
    size: Length = 0.05
    """Size of what detects patches, in the model that the robot believes in; small beside the plume."""

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
