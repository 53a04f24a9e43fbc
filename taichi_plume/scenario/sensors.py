"""The sensors of a scenario: what each robot carries, and what is known of anemometers.

To add a gas sensor: write a `GasSensor` in detectors.py (a metal oxide: an entry in metal_oxides.py) and enter it in
`Sensors`; name one of the laws of agents/gas_laws.py, or write another there.
"""

from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag

from taichi_plume.scenario.gas_sensors import GasSensor, IdealGasSensor, PidSensor, TdlasSensor
from taichi_plume.scenario.metal_oxides import MoxSensor
from taichi_plume.scenario.vocabulary import Delay, Distance, Model, Speed

__all__ = ["Anemometer", "GasSensor", "IdealGasSensor", "MoxSensor", "PidSensor", "Sensors", "TdlasSensor"]

# Thresholds: Ishida, Workshop on Robotic Olfaction, ICRA 2007, quoted by Ferri et al., Robotics and
# Autonomous Systems 57 (2009) 393-402. Noise and lag: our choice.
WIND_THRESHOLD = {"ultrasonic": 0.01, "thermal": 0.05, "ideal": 0.0}  # m/s
WIND_LAG = {"ultrasonic": 0.1, "thermal": 0.5, "ideal": 0.0}  # s
WIND_NOISE = 0.01  # m/s
WIND_NOISE_RELATIVE = 0.02


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


OneGasSensor = Annotated[MoxSensor | PidSensor | TdlasSensor | IdealGasSensor, Field(discriminator="kind")]
MOST_NOSES = 8


def _how_many(value: Any) -> str:
    return "several" if isinstance(value, list | tuple) else "one"


class Sensors(Model):
    """What a robot carries."""

    gas: Annotated[
        Annotated[OneGasSensor, Tag("one")]
        | Annotated[tuple[OneGasSensor, ...], Field(min_length=1, max_length=MOST_NOSES), Tag("several")],
        Discriminator(_how_many),
    ] = MoxSensor(kind="mox")
    """Which gas sensor each robot carries, or a list of several, such as one to the left and one to the right. The
    first is the one that algorithms, maps and policies go by unless they take several."""
    wind: Anemometer = Anemometer(kind="ultrasonic")
    """Which anemometer each robot carries."""

    @property
    def noses(self) -> tuple[GasSensor, ...]:
        """Its gas sensors."""
        return self.gas if isinstance(self.gas, tuple) else (self.gas,)

    @property
    def nose(self) -> Any:
        """The first of them."""
        return self.noses[0]

    def placed(self) -> Iterator[tuple[str, GasSensor | Anemometer]]:
        """All of them with their paths."""
        several = isinstance(self.gas, tuple)
        yield from (
            (f"sensors.gas[{n}]" if several else "sensors.gas", one) for n, one in enumerate(self.noses)
        )
        yield "sensors.wind", self.wind
