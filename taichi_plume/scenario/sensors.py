"""The sensors of a scenario: gas sensors and anemometers, and what is known of their models.

To add a gas sensor: write a `GasSensor` here and enter it in `Sensors`; name one of the laws of agents/gas_laws.py, or
write another there.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import log
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from taichi_plume.scenario.context import Context
from taichi_plume.scenario.vocabulary import (
    COMPILED,
    Coefficient,
    Coordinate,
    Count,
    Delay,
    Distance,
    Duration,
    Fraction,
    Intensity,
    Model,
    Ppm,
    Resistance,
    SomeCoefficient,
    Speed,
    Temperature,
    Wait,
)

# Thresholds: Ishida, Workshop on Robotic Olfaction, ICRA 2007, quoted by Ferri et al., Robotics and
# Autonomous Systems 57 (2009) 393-402. Noise and lag: our choice.
WIND_THRESHOLD = {"ultrasonic": 0.01, "thermal": 0.05, "ideal": 0.0}  # m/s
WIND_LAG = {"ultrasonic": 0.1, "thermal": 0.5, "ideal": 0.0}  # s
WIND_NOISE = 0.01  # m/s
WIND_NOISE_RELATIVE = 0.02
PID_LAG = 0.5  # s
# ln R per kelvin and per ln of the relative humidity: order of magnitude of the maker's plots of the TGS sensors
LN_R_PER_KELVIN = -0.015
LN_R_PER_LN_HUMIDITY = -0.25
CALIBRATED_AT = (293.15, 0.65)  # K, relative humidity
ISOBUTYLENE = "isobutylene"


@dataclass(frozen=True)
class MoxModel:
    """A metal-oxide sensor, R = R_air (1 + c/c0)^-b of ethanol.

    c0 [ppm]; b; rise and decay: time constants [s]; air: range of R_air [ohm]; load: resistor in series [ohm].
    """

    c0: float
    b: float
    rise: float
    decay: float
    air: tuple[float, float]
    load: float = 10e3


# b and c0 from R(300 ppm)/R(50 ppm) and R_air/R(300 ppm) of the data sheets, if nothing else is said. Time constants of
# the TGS 26xx: GADEN (Monroy et al. 2017, doi:10.3390/s17071479), from experiments; the others are our estimates.
MOX_MODELS = {
    # its sheet (1990) tells of hydrogen alone: taken like the TGS 822, of the same make
    "tgs800": MoxModel(c0=0.9, b=0.511, rise=4.0, decay=20.0, air=(10e3, 130e3)),
    "tgs822": MoxModel(c0=0.9, b=0.511, rise=4.0, decay=20.0, air=(19.5e3, 195e3)),
    "tgs2600": MoxModel(c0=0.299, b=0.3196, rise=4.8, decay=18.75, air=(10e3, 90e3)),  # GADEN's power law
    "tgs2620": MoxModel(c0=4.32, b=0.7155, rise=2.96, decay=15.71, air=(21e3, 105e3)),  # GADEN's power law
    # R/R0 = (c/1.62)^-0.644 in common drivers of its sensing element (in the MiCS-6814)
    "mics5524": MoxModel(c0=1.6, b=0.644, rise=1.5, decay=8.0, air=(100e3, 1500e3), load=47e3),
}


@dataclass(frozen=True)
class Signal:
    """How the signal of a gas sensor, which its law makes of a concentration, follows and scatters.

    rise, decay, slow_decay: time constants [s]; slow_share: of the signal that recovers by the slow one. noise:
    standard deviation of a sample; reading_noise: of a reading, however many samples it has; drift: of a random walk in
    the root of an hour. Added in any gas: room, for its warmth and humidity, and at t = 0 cold_start.
    """

    rise: float = 0.0
    decay: float = 0.0
    noise: float = 0.0
    reading_noise: float = 0.0
    drift: float = 0.0
    slow_share: float = 0.0
    slow_decay: float = 0.0
    room: float = 0.0
    cold_start: float = 0.0


class GasSensor(Model):
    """What every gas sensor has. A reading is the mean of samples taken evenly since the reading before."""

    rise_time: Delay | None = None
    """Time constant with which its signal follows more gas; unless given, the kind's or model's own. 0 makes it
    follow at once."""
    decay_time: Delay | None = None
    """Time constant with which its signal recovers from gas; unless given, the kind's or model's own. Metal oxides
    recover slowly, which blurs the edges of a plume."""
    period: Wait = 0.1
    """Time between readings; in between the last one holds."""
    averaged: Count = 1
    """Samples per reading, taken evenly since the one before: their noise averages out. With 1 the reading is a
    single sample at its end."""
    height: Distance = 0.1
    """Height over the floor; 3-D only. Heavy vapour from a source on the floor is met low."""
    ahead: Annotated[Coordinate, COMPILED] = 0.0
    """Distance in front of the robot's centre; negative is behind it."""

    law: ClassVar[Literal["mox", "linear"]] = "linear"
    """What makes a signal of a concentration, and a reading of it: see agents/gas_laws.py."""

    @property
    def signal(self) -> Signal:
        """How it follows and scatters."""
        raise NotImplementedError

    def weight(self, species: str) -> float:
        """How much a ppm of a species counts."""
        raise NotImplementedError

    def _lags(self, rise: float, decay: float) -> tuple[float, float]:
        """Time constants of rise and decay [s], of which these are the kind's own."""
        return (
            rise if self.rise_time is None else self.rise_time,
            decay if self.decay_time is None else self.decay_time,
        )


class MoxSensor(GasSensor):
    """A metal-oxide gas sensor: a resistance that falls with a power of the concentration, and lags.

    R = R_air (1 + sum of c_i s_i / c0)^-b over the gases i of the mixture, s_i their `sensitivity`.
    """

    kind: Literal["mox"]
    model: Literal["tgs800", "tgs822", "tgs2600", "tgs2620", "mics5524"] = "mics5524"
    """Which metal-oxide sensor, by the maker's name: its response, lag and load resistor."""
    noise: Intensity = 0.003
    """Noise of a sample, as standard deviation of ln R."""
    reading_noise: Intensity = 0.0
    """Noise of a reading that averaging its samples does not remove, as standard deviation of ln R. It comes of what
    varies more slowly than the samples are taken: the sensor's own 1/f noise, its supply and converter, the warmth and
    motion of the air at its film. Flicker noise is the largest of resistive sensors at low frequencies (Scandurra et
    al. 2024)."""
    sensitivity: dict[str, Coefficient] = Field(default_factory=dict)
    """How much it responds to a species, over ethanol, by the species' name. 1 unless given: the data sheets tell of
    ethanol alone."""
    calibration: Literal["model", "cubic"] = "model"
    """How a resistance becomes ppm: by the model's own law, or by a cubic in log R fitted to each unit."""
    spread: Intensity = 0.0
    """Differences between units, over those of the data sheet: R_air over its range, the exponent b by 8 %. 0 makes
    all alike, 1 as different as the sheet allows."""
    drift: Intensity = 0.0
    """Random walk of ln R_air, in the root of an hour; data sheets would allow about 0.02."""
    slow_share: Fraction = 0.0
    """Share of the signal that recovers by `slow_decay_time`, the rest by `decay_time`; 0.4 with 5 s and 40 s is
    common."""
    slow_decay_time: Duration = 40.0
    """Time constant of the slow part of the recovery; without a `slow_share` there is none."""
    cold_start: Intensity = 0.0
    """What ln R lacks when the sensor is switched on, at t = 0; it dies away with 15 min. 0.2 is common."""
    air_temperature: Temperature | None = None
    """Temperature of the room: R falls by 1.5 % per kelvin. Unless given 20 degC, at which R_air and calibration were
    taken."""
    air_humidity: Annotated[float, Field(ge=0.05, le=1)] | None = None
    """Relative humidity of the room, as a share: R goes with its power -0.25. Unless given 0.65, as for R_air and
    calibration."""
    bits: Annotated[int, Field(ge=4, le=24)] | None = None
    """Resolution of the converter that reads the voltage over `load`; unless given, it does not round."""
    load: Resistance | None = None
    """Resistor in series with the sensor; unless given 10 kOhm, for the MiCS 47 kOhm."""

    law: ClassVar[Literal["mox", "linear"]] = "mox"

    @property
    def signal(self) -> Signal:
        """Of ln(R_air/R)."""
        model = MOX_MODELS[self.model]
        rise, decay = self._lags(model.rise, model.decay)
        warmer = (self.air_temperature or CALIBRATED_AT[0]) - CALIBRATED_AT[0]
        damper = log((self.air_humidity or CALIBRATED_AT[1]) / CALIBRATED_AT[1])
        return Signal(
            rise,
            decay,
            self.noise,
            self.reading_noise,
            self.drift,
            self.slow_share,
            self.slow_decay_time,
            room=-(LN_R_PER_KELVIN * warmer + LN_R_PER_LN_HUMIDITY * damper),
            cold_start=self.cold_start,
        )

    def weight(self, species: str) -> float:
        """How much a ppm of a species counts."""
        return self.sensitivity.get(species, 1.0)

    def remarks(self, where: str, context: Context) -> Iterator[str]:
        """A misspelt species would not count."""
        for name in sorted(set(self.sensitivity) - {gas.vapour.name for _, gas in context.scenario.gases}):
            yield f"{where}.sensitivity: '{name}' is not in the air of this scenario; is its name right?"


class PidSensor(GasSensor):
    """A photo-ionisation detector: linear, nearly without lag; its reading is in ppm of `calibrated_for`."""

    kind: Literal["pid"]
    noise_ppm: Ppm = 0.05
    """Noise of a sample, as standard deviation."""
    detection_limit_ppm: Ppm = 0.1
    """Smallest concentration that it tells: below, the reading is zero."""
    correction: dict[str, SomeCoefficient] = Field(default_factory=lambda: {"ethanol": 10.0, "acetone": 1.1})
    """Concentration of a species over that of isobutylene which gives the same signal, by the species' name. Of a
    10.6 eV lamp."""
    calibrated_for: str = ISOBUTYLENE
    """Species that it reads rightly; others by the ratio of their corrections."""

    @property
    def signal(self) -> Signal:
        """Of its reading [ppm]."""
        return Signal(*self._lags(PID_LAG, PID_LAG), noise=self.noise_ppm)

    def weight(self, species: str) -> float:
        """How much a ppm of a species counts."""
        return self.factors[self.calibrated_for] / self.factors.get(species, 1.0)

    @property
    def factors(self) -> dict[str, float]:
        """Of all species that it knows."""
        return {ISOBUTYLENE: 1.0} | self.correction

    def problems(self, where: str, context: Context) -> Iterator[str]:
        """What it is calibrated for has to have a factor."""
        if self.calibrated_for not in self.factors:
            yield (
                f"{where}.calibrated_for: there is no correction for '{self.calibrated_for}'; add one, or use "
                f"{', '.join(self.factors)}"
            )

    def remarks(self, where: str, context: Context) -> Iterator[str]:
        """What is in the air should have a factor."""
        for name in sorted({gas.vapour.name for _, gas in context.scenario.gases} - set(self.factors)):
            yield f"{where}.correction: has no factor for '{name}', which is taken for {ISOBUTYLENE}"


class IdealGasSensor(GasSensor):
    """Reads the true concentration of all species together, with an optional lag and noise."""

    kind: Literal["ideal"]
    noise_ppm: Ppm = 0.0
    """Noise of a sample, as standard deviation."""

    detection_limit_ppm: ClassVar[float] = 0.0

    @property
    def signal(self) -> Signal:
        """Of its reading [ppm]."""
        return Signal(*self._lags(0.0, 0.0), noise=self.noise_ppm)

    def weight(self, species: str) -> float:
        """All count alike."""
        return 1.0


class Anemometer(Model):
    """Wind relative to the ground (own motion removed). Below its threshold it reads no wind."""

    kind: Literal["ultrasonic", "thermal", "ideal"]
    """What kind of anemometer it is. A thermal one, with a hot wire, has a larger threshold and lag than an ultrasonic
    one; an ideal one errs in nothing."""
    threshold: Speed | None = None
    """Smallest speed that it sees: below, it reads no wind. Unless given 0.01 (ultrasonic), 0.05 (thermal), 0
    (ideal)."""
    noise: Speed | None = None
    """Noise of each component, as standard deviation. Unless given 0.01 m/s + 2 % of the speed (ideal: 0)."""
    lag: Delay | None = None
    """Time constant with which it follows the wind. Unless given 0.1 (ultrasonic), 0.5 (thermal), 0 (ideal)."""
    compensated: bool = True
    """Whether the robot's own motion is taken out; otherwise it is felt as wind from ahead."""
    height: Distance = 0.1
    """Height over the floor; 3-D only."""

    @property
    def least(self) -> float:
        """Smallest speed it sees [m/s]."""
        return WIND_THRESHOLD[self.kind] if self.threshold is None else self.threshold

    @property
    def time_constant(self) -> float:
        """Of its lag [s]."""
        return WIND_LAG[self.kind] if self.lag is None else self.lag

    @property
    def scatter(self) -> tuple[float, float]:
        """Standard deviation per component [m/s] in calm air, and by how much it grows per speed."""
        if self.noise is not None or self.kind == "ideal":
            return self.noise or 0.0, 0.0
        return WIND_NOISE, WIND_NOISE_RELATIVE


class Sensors(Model):
    """What a robot carries."""

    gas: Annotated[MoxSensor | PidSensor | IdealGasSensor, Field(discriminator="kind")] = MoxSensor(
        kind="mox"
    )
    """Which gas sensor each robot carries."""
    wind: Anemometer = Anemometer(kind="ultrasonic")
    """Which anemometer each robot carries."""
