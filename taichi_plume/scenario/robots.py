"""The robots of a scenario: groups, where they start, bodies."""

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from taichi_plume.scenario.algorithms import Algorithm
from taichi_plume.scenario.sensors import Sensors
from taichi_plume.scenario.vocabulary import (
    COMPILED,
    Count,
    Distance,
    Fraction,
    Length,
    Model,
    NonNegative,
    Point2,
    Positive,
    Real,
    TopSpeed,
)


class StartAt(Model):
    """Robots at given places."""

    kind: Literal["positions"]
    positions: Annotated[tuple[Point2, ...], Field(min_length=1)]
    heading_deg: Real | None = None
    """Unless given, each robot starts with a random heading."""


class StartLine(Model):
    """Robots at equal distances from `begin` to `end`."""

    kind: Literal["line"]
    begin: Point2
    end: Point2
    heading_deg: Real | None = None


class StartArea(Model):
    """Robots at random free places of a rectangle."""

    kind: Literal["area"]
    low: Point2
    high: Point2
    heading_deg: Real | None = None


Start = Annotated[StartAt | StartLine | StartArea, Field(discriminator="kind")]


# Footprints, speeds and wheel bases from the makers' sheets and from the papers that used the robots: MOMO in Ferri et
# al. 2009, the miniQ in Marjovi & Marques 2014 (its speed is our choice).
BODIES: dict[str, dict[str, float]] = {
    "free": {},
    "momo": {"radius": 0.085, "height": 0.2, "max_speed": 0.2, "max_turn_rate_deg": 90.0},
    "roomba_560": {"radius": 0.17, "height": 0.09, "max_speed": 0.5, "wheel_base": 0.235},
    "miniq": {"radius": 0.05, "height": 0.1, "max_speed": 0.1, "wheel_base": 0.08},
    "khepera_3": {"radius": 0.065, "height": 0.07, "max_speed": 0.5, "wheel_base": 0.088},
}


class Body(Model):
    """A disc that drives like a unicycle or, with a wheel base, on two wheels. Defaults: a small indoor robot."""

    kind: Literal["free", "momo", "roomba_560", "miniq", "khepera_3"] = "free"
    """A robot whose figures are the defaults of the others."""
    radius: Length = 0.08
    height: Annotated[Length, COMPILED] = 0.15
    max_speed: TopSpeed = 0.2
    max_turn_rate_deg: Positive = 180.0
    """Degrees per second."""
    wheel_base: Length | None = None
    """Between the two wheels [m], of which none goes faster than max_speed: in a bend the robot is slower."""
    max_acceleration: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None
    """Of the speed [m/s²]; unless given, it changes at once."""

    @model_validator(mode="before")
    @classmethod
    def _figures(cls, data: Any) -> Any:
        if isinstance(data, dict) and isinstance(data.get("kind"), str):
            return BODIES.get(data["kind"], {}) | data
        return data


class Arena(Model):
    """Part of the floor that the robots do not leave: its edges stop them as walls do, air passes them."""

    low: Annotated[Point2, COMPILED]
    high: Annotated[Point2, COMPILED]

    @property
    def size(self) -> tuple[float, float]:
        """Edges [m]."""
        return self.high[0] - self.low[0], self.high[1] - self.low[1]


class Communication(Model):
    """Messages between the robots of a team, for algorithms that use them."""

    range: Length | None = None
    """How far a message reaches [m]; unless given, everywhere."""
    loss: Fraction = 0.0
    """Probability that a robot misses a message."""


Slight = Annotated[float, Field(ge=0, le=0.2, allow_inf_nan=False)]


class Odometry(Model):
    """Errors of robots that know their pose from their wheels alone; at the start they know it exactly.

    It is the group's and not the body's: the same robot is followed by cameras in one arena and by none in another. The
    first three are a robot's own for the whole run, normally distributed over the robots; the others are random, and
    their variance grows with the distance driven and the angle turned. Defaults: a small indoor robot, not calibrated.
    """

    distance_scale: Slight = 0.01
    """Relative error of distances, from the size of the wheels."""
    turn_scale: Slight = 0.01
    """Relative error of angles turned, from the distance between the wheels."""
    veer_deg: NonNegative = 0.5
    """Angle per metre that it turns without knowing [degrees], from wheels of unequal size."""
    distance_noise: Distance = 0.01
    """Standard deviation of the distance after a metre driven [m]."""
    turning_distance_noise: Distance = 0.005
    """Standard deviation of the distance after a full turn [m]."""
    heading_noise_deg: NonNegative = 1.0
    """Standard deviation of the heading after a metre driven [degrees]."""
    turn_noise_deg: NonNegative = 2.0
    """Standard deviation of the heading after a full turn [degrees]."""


class Group(Model):
    """Robots of one kind. `trials` independent copies of the team run at once in the same air."""

    name: str = "robots"
    count: Count
    trials: Count = 1
    first_trial: Annotated[int, Field(ge=0, le=1_000_000)] = 0
    """Number of the first of them: with `trials: 1`, one of many is run again alone, to the same result."""
    start: Start
    algorithm: Algorithm
    body: Body = Body()
    sensors: Sensors = Sensors()
    communication: Communication = Communication()
    odometry: Odometry | None = None
    """Unless given, robots know exactly where they are, as if cameras told them."""
    reach: Distance = 0.35
    """A robot whose centre comes this close to a source has found it and stops [m]; the robot itself does not know."""
    capture: Literal["disc", "square"] = "disc"
    """Whether `reach` is the radius of a disc around the source or half the edge of a square."""
    wake: bool = False
    """Whether the robots disturb the air: in 3-D as solid bodies, in 2-D by their drag; of one trial only."""
