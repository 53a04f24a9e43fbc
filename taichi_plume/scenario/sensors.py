"""Sensors of the robots: gas sensors, anemometers with their threshold, lag and noise, and range sensors.

To add a gas sensor: write a `GasSensor` in gas_sensors.py (a metal oxide: an entry in metal_oxides.py) and enter it in
`Sensors`; name one of the laws of agents/gas_laws.py, or write another there.
"""

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Discriminator, Field, Tag

from taichi_plume.quantities import number
from taichi_plume.scenario import si
from taichi_plume.scenario.gas_classes import Classifier
from taichi_plume.scenario.gas_sensors import GasSensor, IdealGasSensor, PidSensor, TdlasSensor
from taichi_plume.scenario.metal_oxides import MoxSensor
from taichi_plume.scenario.vocabulary import Model, consistency_check

__all__ = ["Anemometer", "GasSensor", "IdealGasSensor", "MoxSensor", "PidSensor", "Sensors", "TdlasSensor"]

# Thresholds: Ishida, Workshop on Robotic Olfaction, ICRA 2007, quoted by Ferri et al., Robotics and
# Autonomous Systems 57 (2009) 393-402. Noise and lag: our choice.
WIND_THRESHOLD = {"ultrasonic": 0.01, "thermal": 0.05, "ideal": 0.0}  # m/s
WIND_LAG = {"ultrasonic": 0.1, "thermal": 0.5, "ideal": 0.0}  # s
WIND_NOISE = 0.01  # m/s
WIND_NOISE_RELATIVE = 0.02
MOST_RANGES = 16
View = Annotated[float, *number(0, 180, "deg")]


class Anemometer(Model):
    """Anemometer: wind relative to the ground (own motion removed), zero below the threshold."""

    kind: Literal["ultrasonic", "thermal", "ideal"]
    """Kind of anemometer. A thermal one, with a hot wire, has a larger threshold and lag than an ultrasonic
    one; an ideal one is exact."""
    threshold: si.Speed | None = None
    """Smallest measured speed: below, it reads no wind. Unless given 0.01 (ultrasonic), 0.05 (thermal), 0
    (ideal)."""
    noise: si.Speed | None = None
    """Noise of each component, as standard deviation. Unless given 0.01 m/s + 2 % of the speed (ideal: 0)."""
    lag: si.Delay | None = None
    """Time constant of the lag behind the wind. Unless given 0.1 (ultrasonic), 0.5 (thermal), 0 (ideal)."""
    compensated: bool = True
    """Whether the robot's own motion is taken out; otherwise it adds a wind from ahead."""
    height: si.Distance = 0.1
    """Height over the floor; 3-D only."""

    @property
    def least(self) -> float:
        """Threshold [m/s]: at lower speeds the anemometer reads zero."""
        return WIND_THRESHOLD[self.kind] if self.threshold is None else self.threshold

    @property
    def time_constant(self) -> float:
        """Time constant of the anemometer's lag [s]."""
        return WIND_LAG[self.kind] if self.lag is None else self.lag

    @property
    def scatter(self) -> tuple[float, float]:
        """Standard deviation of the noise per component [m/s] in calm air, and its growth per wind speed [-]."""
        if self.noise is not None or self.kind == "ideal":
            return self.noise or 0.0, 0.0
        return WIND_NOISE, WIND_NOISE_RELATIVE


class RangeSensors(Model):
    """Range sensors, such as sonars: distance from the robot's rim to the nearest surface within the cone of each.

    Surfaces are walls of the domain, obstacles, moving ones too, and other robots of the trial.
    """

    bearings_deg: Annotated[tuple[si.Angle, ...], Field(min_length=1, max_length=MOST_RANGES)] = (
        90.0, 45.0, 0.0, -45.0, -90.0,
    )  # fmt: skip
    """Direction of each sensor from the robot's heading, to the left."""
    field_of_view_deg: View = 55.0
    """Full angle of each cone; 0: a single ray, as of a laser range finder. The default is that of an SRF08 sonar."""
    min_range: si.Distance = 0.03
    """Smallest reading; nearer surfaces read this. The default is that of an SRF08 sonar."""
    max_range: si.Length = 6.0
    """Largest reading, also if nothing is in the cone. The default is that of an SRF08 sonar."""
    noise: si.Distance = 0.01
    """Noise of a reading, as standard deviation; our choice."""
    height: si.Distance = 0.1
    """Height over the lower end of the body; 3-D only."""

    @consistency_check
    def _ordered(self) -> Iterator[str]:
        if self.min_range >= self.max_range:
            yield f"min_range: {self.min_range:g} m is not below max_range, {self.max_range:g} m; lower it"


OneGasSensor = Annotated[MoxSensor | PidSensor | TdlasSensor | IdealGasSensor, Field(discriminator="kind")]
MOST_NOSES = 8


def _one_or_several(value: object) -> str:
    """Return the tag "several" for a list of gas sensors, "one" for a single sensor."""
    return "several" if isinstance(value, list | tuple) else "one"


class Sensors(Model):
    """Sensors of a robot."""

    gas: Annotated[
        Annotated[OneGasSensor, Tag("one")]
        | Annotated[tuple[OneGasSensor, ...], Field(min_length=1, max_length=MOST_NOSES), Tag("several")],
        Discriminator(_one_or_several),
    ] = MoxSensor(kind="mox")
    """Gas sensor of each robot, or a list of several, such as one to the left and one to the right. Algorithms, maps
    and policies use the first, unless they take several."""
    classifier: Classifier | None = None
    """Classifier of the gas by all gas sensors, so that the robot follows one gas of several. Unless given, none."""
    wind: Anemometer = Anemometer(kind="ultrasonic")
    """Anemometer of each robot."""
    range: RangeSensors | None = None
    """Range sensors of each robot, such as sonars; unless given, none. Own algorithms read them."""

    @property
    def ranges(self) -> int:
        """Number of range sensors of a robot."""
        return 0 if self.range is None else len(self.range.bearings_deg)

    @property
    def noses(self) -> "tuple[MoxSensor | PidSensor | TdlasSensor | IdealGasSensor, ...]":
        """All gas sensors of a robot."""
        return self.gas if isinstance(self.gas, tuple) else (self.gas,)

    @property
    def nose(self) -> "MoxSensor | PidSensor | TdlasSensor | IdealGasSensor":
        """The robot's first gas sensor."""
        return self.noses[0]

    def placed(self) -> Iterator[tuple[str, GasSensor | Anemometer]]:
        """Yield (path, sensor) for each gas sensor and the anemometer, such as ``sensors.gas[0]``."""
        several = isinstance(self.gas, tuple)
        for n, sensor in enumerate(self.noses):
            yield f"sensors.gas[{n}]" if several else "sensors.gas", sensor
        yield "sensors.wind", self.wind
