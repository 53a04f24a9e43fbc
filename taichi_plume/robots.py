"""The robots of a scenario: where they start, bodies, sensors, search algorithms."""

from typing import Annotated, Literal

from pydantic import Field

from taichi_plume.vocabulary import (
    Count,
    Delay,
    Distance,
    Duration,
    Fraction,
    Length,
    Model,
    NonNegative,
    Point2,
    Positive,
    Real,
    Speed,
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


class Body(Model):
    """A disc that drives like a unicycle. Defaults: a small indoor robot."""

    radius: Length = 0.08
    height: Length = 0.15
    max_speed: TopSpeed = 0.2
    max_turn_rate_deg: Positive = 180.0
    """Degrees per second."""


class MoxSensor(Model):
    """A metal-oxide gas sensor: power-law response that lags, faster on the rise than on the decay."""

    kind: Literal["mox"]
    model: Literal["tgs2620", "mics5524"] = "mics5524"
    noise: NonNegative = 0.003
    """Standard deviation of ln R per sample."""
    rise_time: Delay | None = None
    """Time constants [s]; unless given, the model's."""
    decay_time: Delay | None = None
    period: Duration = 0.1
    """Time between samples [s]."""
    height: Distance = 0.1
    """Above the ground, in 3-D [m]."""


class IdealGasSensor(Model):
    """Reads the true concentration, with an optional lag and noise."""

    kind: Literal["ideal"]
    noise_ppm: NonNegative = 0.0
    rise_time: Delay = 0.0
    decay_time: Delay = 0.0
    period: Duration = 0.1
    height: Distance = 0.1


class Anemometer(Model):
    """Wind relative to the ground (own motion removed). Below its threshold it reads no wind."""

    kind: Literal["ultrasonic", "thermal", "ideal"]
    threshold: Speed | None = None
    """Smallest speed it sees [m/s]; unless given 0.01 (ultrasonic), 0.05 (thermal), 0 (ideal)."""
    noise: Speed | None = None
    """Standard deviation per component [m/s]; unless given 0.01 + 2 % of the speed (ideal: 0)."""
    height: Distance = 0.1


class Sensors(Model):
    """What a robot carries."""

    gas: Annotated[MoxSensor | IdealGasSensor, Field(discriminator="kind")] = MoxSensor(kind="mox")
    wind: Anemometer = Anemometer(kind="ultrasonic")


class Casting(Model):
    """Upwind while in the plume, crosswind when it is lost (Lochmatter & Martinoli's family). See agents/casting.py."""

    kind: Literal["casting"]
    speed: Speed | None = None
    """Unless given, the body's largest."""
    threshold_ppm: Positive = 5.0
    """Reading that means plume; it is left at 70 % of it."""
    upwind_angle_deg: Annotated[float, Field(ge=0, le=80)] = 20.0
    """Between the course in the plume and straight upwind."""
    lost_distance: Length = 0.3
    """Travelled without gas before the plume counts as lost [m]."""
    cast_distance: Length = 0.6
    """First crosswind search [m]; doubled at each failure."""
    find_step: Length = 0.3
    """Upwind step between sweeps of the plume finding [m]."""
    peak_fraction: Fraction = 0.7
    """Also out of the plume below this share of the last peak, so that a slow sensor notices; 0 switches it off."""
    wind_memory: Delay = 1.0
    """Time constant of the average of the measured wind direction [s]."""


Algorithm = Casting


class Group(Model):
    """Robots of one kind. `trials` independent copies of the team run at once in the same air."""

    name: str = "robots"
    count: Count
    trials: Count = 1
    start: Start
    algorithm: Algorithm
    body: Body = Body()
    sensors: Sensors = Sensors()
    reach: Distance = 0.35
    """A robot whose centre comes this close to a source has found it and stops [m]; the robot itself does not know."""
    wake: bool = False
    """Whether the robots disturb the air: in 3-D as solid bodies, in 2-D by their drag; of one trial only."""
