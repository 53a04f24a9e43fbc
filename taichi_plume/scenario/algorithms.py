"""The search algorithms of a scenario and their parameters."""

from collections.abc import Sequence
from math import ceil, sqrt
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from taichi_plume.scenario.maps import TimeSeriesMap
from taichi_plume.scenario.vocabulary import (
    COMPILED,
    Count,
    Delay,
    Diffusivity,
    Distance,
    Duration,
    Fraction,
    Frequency,
    Length,
    Model,
    NonNegative,
    Positive,
    Real,
    Speed,
    TopSpeed,
)


class PlumeTracking(Model):
    """What algorithms share that follow a plume upwind. See agents/tracking.py."""

    kind: str
    speed: Speed | None = None
    """Unless given, the body's largest."""
    threshold_ppm: Positive = 5.0
    """Reading that means plume; it is left at 70 % of it."""
    lost_distance: Length = 0.3
    """Travelled without gas before the plume counts as lost [m]."""
    find_step: Length = 0.3
    """Upwind step between sweeps of the plume finding [m]."""
    peak_fraction: Fraction = 0.7
    """Also out of the plume below this share of the last peak, so that a slow sensor notices; 0 switches it off."""
    wind_memory: Delay = 1.0
    """Time constant of the average of the measured wind direction [s]."""


class Casting(PlumeTracking):
    """Upwind while in the plume, crosswind when it is lost (Lochmatter & Martinoli's family). See agents/casting.py."""

    kind: Literal["casting"]  # type: ignore[assignment]
    upwind_angle_deg: Annotated[float, Field(ge=0, le=80)] = 20.0
    """Between the course in the plume and straight upwind."""
    cast_distance: Length = 0.6
    """First crosswind search [m]; doubled at each failure."""


class SurgeCast(PlumeTracking):
    """Straight upwind in the plume, crosswind to both sides when it is lost. See agents/surge_cast.py."""

    kind: Literal["surge_cast"]  # type: ignore[assignment]
    cast_distance: Length = 0.4
    """First crosswind search [m]; the next one goes back and as far to the other side, and each pair twice as far."""


class SurgeSpiral(PlumeTracking):
    """Straight upwind in the plume, along a spiral when it is lost. See agents/surge_spiral.py."""

    kind: Literal["surge_spiral"]  # type: ignore[assignment]
    gap: Length = 0.3
    """Between two turns of the spiral [m]."""
    turns: Positive = 4.0
    """Of a spiral, before the search starts anew."""


class Listening(Model):
    """What algorithms share that stand still to listen: an acquisition is a series of samples."""

    speed: Speed | None = None
    """Unless given, the body's largest."""
    acquisition: Duration = 30.0
    """Time of listening [s]."""
    sample_period: Duration = 0.5
    """Between the samples of an acquisition [s]."""
    settle: Delay = 1.0
    """Standing still before it [s]."""


class Spiral(Listening):
    """SPIRAL (Ferri et al. 2009). See agents/spiral.py."""

    kind: Literal["spiral"]
    acquisition: Annotated[Duration, COMPILED] = 30.0
    """Time of listening [s]."""
    sample_period: Annotated[Duration, COMPILED] = 0.5
    """Between the samples of an acquisition [s]."""
    minimum_ppm: Positive = 0.2
    """Threshold of the proximity index at the start, and after an escape: a mean index far from the source."""
    delta: Annotated[float, Field(gt=0, lt=1)] = 0.2
    """By how much misses lower the threshold below the minimum, over the minimum."""
    mean_weight: NonNegative = 1.0
    """Of the mean of an acquisition in its proximity index."""
    peak_weight: NonNegative = 0.5
    """Of the sum of its peaks."""
    peak_window: Duration = 5.0
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


class EColi(Listening):
    """Run and tumble, as bacteria do (Russell et al. 2003). See agents/ecoli.py."""

    kind: Literal["ecoli"]
    acquisition: Duration = 3.0
    step: Length = 0.25
    """Driven after each acquisition [m]."""
    step_spread: Fraction = 0.05
    """Each step is step (1 ± step_spread), drawn uniformly."""
    run_angle_deg: Annotated[float, Field(ge=0, le=180)] = 5.0
    """Largest turn before a run; a tumble turns by any angle."""


class Infotaxis(Listening):
    """The way that is expected to tell most about the source (Vergassola et al. 2007). See agents/infotaxis.py."""

    kind: Literal["infotaxis"]
    acquisition: Duration = 2.0
    threshold_ppm: Positive = 5.0
    """Mean reading of an acquisition that counts as a detection."""
    step: Length = 0.25
    """Driven after each acquisition, unless it stays [m]."""
    cell: Annotated[Length, COMPILED] = 0.1
    """Edge of the cells of its map of beliefs [m]."""
    rate: Frequency = 1.0
    """Of the model that it believes in: detections per second close to the source."""
    diffusivity: Annotated[Diffusivity, Field(gt=0)] = 0.05
    """Of patches of gas [m²/s]."""
    wind_speed: Speed = 0.5
    """Mean [m/s]."""
    lifetime: Duration = 10.0
    """Of patches of gas [s]."""
    size: Length = 0.05
    """Of what detects them [m]."""

    @property
    def reach(self) -> float:
        """How far patches get across the wind: lambda [m]."""
        D, V, tau = self.diffusivity, self.wind_speed, self.lifetime
        return sqrt(D * tau / (1.0 + V**2 * tau / (4.0 * D)))

    @model_validator(mode="after")
    def _small(self) -> "Infotaxis":
        if self.size >= self.reach:
            raise PydanticCustomError(
                "infotaxis",
                "size = {size} m must be below lambda = {reach} m; lower it, or raise diffusivity",
                {"size": f"{self.size:g}", "reach": f"{self.reach:.3g}"},
            )
        return self


class SearchSpace(Model):
    """A robot listens to those that were near it when it heard them."""

    kind: Literal["search_space"]
    distance: Length = 1.5

    @property
    def limit(self) -> float:
        """Largest distance [m] of those it listens to."""
        return self.distance


class FunctionValue(Model):
    """A robot listens to those whose best readings are most like its own."""

    kind: Literal["function_value"]
    number: Count = 2

    @property
    def limit(self) -> float:
        """How many it listens to."""
        return float(self.number)


class RandomMates(Model):
    """At each way point a robot listens to others at random."""

    kind: Literal["random"]
    probability: Fraction = 0.5
    """Of each."""

    @property
    def limit(self) -> float:
        """Probability that it listens to one."""
        return self.probability


class Dapso(Listening):
    """Particle swarm optimisation by robots without a common clock (Akat & Gazi 2008). See agents/dapso.py."""

    kind: Literal["dapso"]
    acquisition: Duration = 2.0
    threshold_ppm: NonNegative = 1.0
    """While the best reading known is smaller, the robot explores: it drives to random places; 0: never."""
    phi1: NonNegative = 2.05
    """Strength of the pull to the best place of the robot itself."""
    phi2: NonNegative = 2.05
    """Strength of the pull to the best place that its neighbours told of."""
    kappa: Annotated[float, Field(gt=0, le=1)] = 1.0
    """Of the constriction chi; less lets steps shorten sooner."""
    longest_step: Length = 0.5
    """From way point to way point [m]."""
    memory: Delay = 60.0
    """Time constant with which a best reading fades [s], as gas comes and goes; 0: it does not."""
    neighbourhood: Annotated[SearchSpace | FunctionValue | RandomMates, Field(discriminator="kind")] = (
        SearchSpace(kind="search_space")
    )
    """Whose best places count, of the team mates that were in range (see `communication`)."""
    way_point_tolerance: Length = 0.05
    way_point_timeout: Duration = 15.0
    """After it the robot measures where it is [s]."""
    restart_after: Annotated[int, Field(ge=0, le=1_000_000)] = 3
    """So many short steps in a row: the robot forgets all and drives to a random place; 0: never."""
    restart_step: Length = 0.05
    """Shorter than it is a short step [m]."""
    avoidance: Length = 0.2
    """Air to others and to walls below which they push the robot away [m]."""


class LineUp(Model):
    """A diagonal line of robots that sweeps across the wind (Marjovi & Marques 2014). See agents/lineup.py."""

    kind: Literal["lineup"]
    speed: Speed | None = None
    """Of a robot that takes its place; unless given, the body's largest."""
    line_speed: TopSpeed = 0.1
    """Of the line across the wind [m/s]."""
    wind_direction_deg: Real | None = None
    """Where the air goes, from the x axis to the left; unless given, the team measures it at the start."""
    listen: Duration = 5.0
    """Time for which it measures the wind [s]."""
    spacing: Length | None = None
    """Between neighbours, along the wind [m]; unless given, the line reaches from margin to margin."""
    stagger: Distance = 0.3
    """Between neighbours, across the wind [m]; of a lone robot, its step along the wind after each sweep."""
    mirror: bool = False
    """Whether the line forms anew before it goes back, so that the same end leads."""
    margin: Length = 0.3
    """From the walls to the line [m]."""
    tolerance: Length = 0.15
    """The line waits for robots that are farther than this from their places [m]."""
    patience: Delay = 10.0
    """Time without progress after which it no longer waits for a robot [s]."""
    avoidance: Length = 0.1
    """Air to others and to walls below which they push the robot away [m]."""


class Sweep(Model):
    """Parallel lanes to and fro, shared out between the robots of a team. See agents/sweep.py."""

    kind: Literal["sweep"]
    speed: Speed | None = None
    lane: Annotated[Length, COMPILED] = 0.3
    """Largest width of a lane [m]."""
    along: Literal["x", "y"] | None = None
    """Unless given, the longer side of the floor."""
    repeat: bool = True
    """Whether robots go back the way they came at the end, again and again; otherwise they stay there."""
    avoidance: Length = 0.05
    """Air to others and to walls below which they push the robot away [m]."""

    def lanes(self, size: Sequence[float] | np.ndarray, robots: int) -> tuple[int, int]:
        """The axis along which they run, and how many cover a floor of this size [m]: at least one per robot."""
        axis = int(size[1] > size[0]) if self.along is None else "xy".index(self.along)
        return axis, max(ceil(size[1 - axis] / self.lane - 1e-9), robots)


class LeastKnown(Model):
    """To the places that a map of the team's readings knows least (after Marjovi & Marques, ICRA 2014). See
    agents/least_known.py.
    """

    kind: Literal["least_known"]
    speed: Speed | None = None
    map: TimeSeriesMap = TimeSeriesMap(kind="time_series")
    """Whose weights count; what it has forgotten is not known."""
    share: Annotated[float, Field(gt=0, le=1)] = 0.1
    """Of all cells, those that count as the least known; the robot goes to the nearest of them."""
    apart: Length = 0.5
    """Least distance of a way point from the robot and from those of its team mates [m]."""
    avoidance: Length = 0.1
    """Air to others and to walls below which they push the robot away [m]."""


class RandomWalk(Model):
    """Straight legs in random directions. See agents/random_walk.py."""

    kind: Literal["random_walk"]
    speed: Speed | None = None
    leg: Length = 1.0
    leg_spread: Fraction = 0.5
    """Each leg is leg (1 ± leg_spread), drawn uniformly."""
    turn_angle_deg: Annotated[float, Field(ge=0, le=180)] = 180.0
    """Largest turn between legs; after a bump it is 180°."""


class Own(Model):
    """An algorithm of the user's own: a class in a Python file, in NumPy. See agents/own.py."""

    kind: Literal["own"]
    file: str = ""
    """Path, relative to the scenario's folder; empty where the class is handed over in Python."""
    name: str | None = None
    """Of the class; unless given, the only one in the file that has an `act`."""
    parameters: dict[str, Any] = Field(default_factory=dict)
    """Keywords for the class."""


Algorithm = Annotated[
    Casting
    | SurgeCast
    | SurgeSpiral
    | Spiral
    | EColi
    | Infotaxis
    | Dapso
    | LineUp
    | Sweep
    | LeastKnown
    | RandomWalk
    | Own,
    Field(discriminator="kind"),
]
