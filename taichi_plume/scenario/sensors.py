"""The sensors of a scenario: gas sensors and anemometers."""

from typing import Annotated, Literal

from pydantic import Field

from taichi_plume.scenario.vocabulary import (
    Coordinate,
    Count,
    Delay,
    Distance,
    Duration,
    Fraction,
    Model,
    NonNegative,
    Positive,
    Resistance,
    Speed,
    Temperature,
)


class GasSensor(Model):
    """What every gas sensor has. A reading is the mean of samples taken evenly since the reading before."""

    rise_time: Delay | None = None
    """Time constants of the lag [s]; unless given, the kind's or model's own."""
    decay_time: Delay | None = None
    period: Duration = 0.1
    """Time between readings [s]."""
    averaged: Count = 1
    """Samples per reading: their noise averages out. With 1 the reading is a single sample at its end."""
    height: Distance = 0.1
    """Above the ground, in 3-D [m]."""
    ahead: Coordinate = 0.0
    """In front of the robot's centre [m]."""


class MoxSensor(GasSensor):
    """A metal-oxide gas sensor: a resistance that falls with a power of the concentration, and lags.

    R = R_air (1 + sum of c_i s_i / c0)^-b over the gases i of the mixture, s_i their `sensitivity`.
    """

    kind: Literal["mox"]
    model: Literal["tgs800", "tgs822", "tgs2600", "tgs2620", "mics5524"] = "mics5524"
    noise: NonNegative = 0.003
    """Standard deviation of ln R per sample."""
    sensitivity: dict[str, NonNegative] = Field(default_factory=dict)
    """Of a species over that to ethanol, by its name; 1 unless given: the data sheets tell of ethanol alone."""
    calibration: Literal["model", "cubic"] = "model"
    """How a resistance becomes ppm: by the model's own law, or by a cubic in log R fitted to each unit."""
    spread: NonNegative = 0.0
    """Differences between units over those of the data sheet: R_air over its range, the exponent b by 8 %."""
    drift: NonNegative = 0.0
    """Random walk of ln R_air, in the root of an hour; data sheets would allow about 0.02."""
    slow_share: Fraction = 0.0
    """Of the signal that recovers by `slow_decay_time`, the rest by `decay_time`; 0.4 with 5 s and 40 s is common."""
    slow_decay_time: Duration = 40.0
    """Time constant of the slow part of the recovery [s]; without a `slow_share` there is none."""
    cold_start: NonNegative = 0.0
    """What ln R lacks when the sensor is switched on, at t = 0; it dies away with 15 min. 0.2 is common."""
    air_temperature: Temperature | None = None
    """Of the room [K]: R falls by 1.5 % per kelvin. Unless given 20 degC, at which R_air and calibration were taken."""
    air_humidity: Annotated[float, Field(ge=0.05, le=1)] | None = None
    """Relative, as a share: R goes with its power -0.25. Unless given 0.65, as for R_air and calibration."""
    bits: Annotated[int, Field(ge=4, le=24)] | None = None
    """Resolution of the converter that reads the voltage over `load`; unless given, it does not round."""
    load: Resistance | None = None
    """In series with the sensor [ohm]; unless given 10 kOhm, for the MiCS 47 kOhm."""


class PidSensor(GasSensor):
    """A photo-ionisation detector: linear, nearly without lag; its reading is in ppm of `calibrated_for`."""

    kind: Literal["pid"]
    noise_ppm: NonNegative = 0.05
    detection_limit_ppm: NonNegative = 0.1
    """Below it the reading is zero."""
    correction: dict[str, Positive] = Field(default_factory=lambda: {"ethanol": 10.0, "acetone": 1.1})
    """Concentration of a species over that of isobutylene which gives the same signal (10.6 eV lamp)."""
    calibrated_for: str = "isobutylene"
    """Species that it reads rightly."""


class IdealGasSensor(GasSensor):
    """Reads the true concentration of all species together, with an optional lag and noise."""

    kind: Literal["ideal"]
    noise_ppm: NonNegative = 0.0


class Anemometer(Model):
    """Wind relative to the ground (own motion removed). Below its threshold it reads no wind."""

    kind: Literal["ultrasonic", "thermal", "ideal"]
    threshold: Speed | None = None
    """Smallest speed it sees [m/s]; unless given 0.01 (ultrasonic), 0.05 (thermal), 0 (ideal)."""
    noise: Speed | None = None
    """Standard deviation per component [m/s]; unless given 0.01 + 2 % of the speed (ideal: 0)."""
    lag: Delay | None = None
    """Time constant [s]; unless given 0.1 (ultrasonic), 0.5 (thermal), 0 (ideal)."""
    compensated: bool = True
    """Whether the robot's own motion, as it drives, is taken out; otherwise it is felt as wind from ahead."""
    height: Distance = 0.1


class Sensors(Model):
    """What a robot carries."""

    gas: Annotated[MoxSensor | PidSensor | IdealGasSensor, Field(discriminator="kind")] = MoxSensor(
        kind="mox"
    )
    wind: Anemometer = Anemometer(kind="ultrasonic")
