"""A team: the sensors and the search algorithm of one group."""

from pathlib import Path

from taichi_plume.agents.members import Members
from taichi_plume.agents.own import OwnAlgorithm
from taichi_plume.agents.search import ALGORITHMS, Algorithm
from taichi_plume.agents.sensors import Sensors
from taichi_plume.agents.swarm import GroupRange, Swarm
from taichi_plume.files.own_class import own_class
from taichi_plume.grid.fields import Odour, Wind
from taichi_plume.scenario.algorithms import Own


class Team:
    """Measures and acts for the robots of `group`, all its trials at once.

    dim: of gas and wind. tick: control period [s]. folder: of the scenario. own: class of an algorithm of the
    user's that is not in a file.
    """

    def __init__(
        self,
        swarm: Swarm,
        group: GroupRange,
        dim: int,
        tick: float,
        folder: Path = Path(),
        own: type | None = None,
    ):
        self.group = group
        self.sensors = Sensors(swarm, group, dim, tick)
        model = group.model.algorithm
        self.algorithm: Algorithm
        if isinstance(model, Own):
            own = own or own_class(folder / model.file, model.name)
            self.algorithm = OwnAlgorithm(swarm, group, own, model.parameters)
        else:
            self.algorithm = ALGORITHMS[model.kind](swarm, Members(swarm, [group.number]), tick)

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
