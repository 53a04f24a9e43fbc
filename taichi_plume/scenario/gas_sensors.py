"""What gas sensors of all kinds have in a scenario."""

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from taichi_plume.scenario.vocabulary import COMPILED, Coordinate, Count, Delay, Distance, Model, Wait


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
    left: Annotated[Coordinate, COMPILED] = 0.0
    """Distance to the left of the robot's centre; negative is to its right."""

    law: ClassVar[Literal["mox", "linear", "line"]] = "linear"
    """What makes a signal of a concentration, and a reading of it: see agents/gas_laws.py."""

    @property
    def signal(self) -> Signal:
        """How it follows and scatters."""
        raise NotImplementedError

    @property
    def cycled(self) -> bool:
        """Whether it works in cycles of a heater."""
        return False

    def weight(self, species: str) -> float:
        """How much a ppm of a species counts."""
        raise NotImplementedError

    def bend(self, species: str) -> tuple[float, float] | None:
        """c1 [ppm] and p where a species counts as the power law a ((1 + c/c1)^p - 1), a its `weight`; else None."""
        return None

    def reads(self, species: str, ppm: float) -> float:
        """What it reads in the long run of so much of one species alone [ppm]."""
        return self.weight(species) * ppm

    def _lags(self, rise: float, decay: float) -> tuple[float, float]:
        """Time constants of rise and decay [s], of which these are the kind's own."""
        return (
            rise if self.rise_time is None else self.rise_time,
            decay if self.decay_time is None else self.decay_time,
        )
