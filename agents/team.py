"""A team: the sensors and the search algorithm of one group."""

from taichi_plume.agents.search import ALGORITHMS
from taichi_plume.agents.sensors import Sensors
from taichi_plume.agents.swarm import GroupRange, Swarm
from taichi_plume.fields import Odour, Wind


class Team:
    """Measures and acts for the robots of `group`, all its trials at once.

    dim: of gas and wind. tick: control period [s].
    """

    def __init__(self, swarm: Swarm, group: GroupRange, dim: int, tick: float):
        self.group = group
        self.sensors = Sensors(swarm, group, dim, tick)
        self.algorithm = ALGORITHMS[group.model.algorithm.kind](swarm, group, tick)

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the values of the swarm's `state`."""
        return self.algorithm.STATE_NAMES

    def measure(self, gas: Odour, wind: Wind, tick: int, t: float) -> None:
        """Update the readings of the group's robots."""
        self.sensors.measure(gas, wind, tick, t)

    def act(self, tick: int, t: float, dt: float) -> None:
        """Turn readings into commands."""
        self.algorithm.act(tick, t, dt)
