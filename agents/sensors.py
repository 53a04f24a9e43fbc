"""What the robots measure: gas with lagging, noisy sensors, and wind with anemometers that have a threshold."""

from collections.abc import Sequence
from math import exp

import taichi as ti

from taichi_plume.agents.anemometers import Anemometers
from taichi_plume.agents.gas_laws import LAWS
from taichi_plume.agents.gas_sensors import GasSensors
from taichi_plume.agents.members import Members
from taichi_plume.agents.swarm import Swarm
from taichi_plume.grid.fields import Odour, Species, Wind
from taichi_plume.grid.kernels import Template

WARMING = 900.0  # s, time constant after a cold start: our choice


@ti.data_oriented
class Sensors:
    """The sensors of all robots, measuring in one launch: what they are like is read when they measure.

    dim: of gas and wind; in 3-D the sensors sit at their heights. tick: control period [s]. species: of the gas.
    """

    STATE = ("noses", "vanes")

    def __init__(self, swarm: Swarm, dim: int, tick: float, species: Sequence[Species]):
        self.count = swarm.count
        alike: dict[str, list[int]] = {}
        for group in swarm.groups:
            alike.setdefault(group.model.sensors.gas.law, []).append(group.number)
        several = [(LAWS[law], Members(swarm, numbers)) for law, numbers in alike.items()]
        self.noses = tuple(GasSensors(members, law, dim, tick, species) for law, members in several)
        self.vanes = tuple(Anemometers(members, dim, tick) for _, members in several)
        self.begin()

    def begin(self) -> None:
        """Set the numbers that the groups give; clean and still air before."""
        for one in (*self.noses, *self.vanes):
            one.begin()

    def measure(self, gas: Odour, wind: Wind, tick: int, t: float) -> None:
        """Update all readings at tick `tick` (from 1 on), time t [s]."""
        if self.count:
            self._sense(gas, wind, tick, t, exp(-t / WARMING))

    @ti.kernel
    def _sense(self, gas: Template, wind: Template, tick: int, t: float, cold: float):
        for nose, vane in ti.static(zip(self.noses, self.vanes, strict=True)):
            for n in range(nose.members.size):
                i = nose.members.robot[n]
                nose.smell(gas, n, i, tick, t, cold)
                vane.feel(wind, n, i, tick, t)
