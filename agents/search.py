"""Search algorithms: what they must offer, and which there are.

To add one: write a class with this protocol in a file of its own, its parameters as a model with a `kind` in
algorithms.py, and enter it in ALGORITHMS. For the robots of its own group it reads the swarm's `reading`,
`wind`, `wind_known`, `blocked`, `believed_heading` and `odometer` (and `believed_position`, if the robots are to have
positioning) and writes `speed_command`, `turn_rate_command` and `state`. True poses are not for it: what a robot senses
around it, such as walls and mates, it puts into its map by `swarm.as_believed`. `legs` and `potential` drive for it,
`acquisition` listens, and `radio` carries messages between the robots of a team. A Taichi kernel over the group is
fast; NumPy on ``swarm.reading.to_numpy()[group.slice]`` works as well.
"""

from typing import Any, Protocol

from taichi_plume.agents.casting import Casting
from taichi_plume.agents.dapso import Dapso
from taichi_plume.agents.ecoli import EColi
from taichi_plume.agents.infotaxis import Infotaxis
from taichi_plume.agents.least_known import LeastKnown
from taichi_plume.agents.lineup import LineUp
from taichi_plume.agents.members import Members
from taichi_plume.agents.random_walk import RandomWalk
from taichi_plume.agents.spiral import Spiral
from taichi_plume.agents.surge_cast import SurgeCast
from taichi_plume.agents.surge_spiral import SurgeSpiral
from taichi_plume.agents.swarm import Swarm
from taichi_plume.agents.sweep import Sweep


class Algorithm(Protocol):
    """Drives the robots of the groups of one kind of algorithm, all trials at once."""

    PER_GROUP: bool
    """Whether each group has an algorithm of its own."""
    STATE_NAMES: tuple[str, ...]
    """What the values of the swarm's `state` mean."""

    def __init__(self, swarm: Swarm, members: Members, tick: float):
        """Prepare the groups' robots; tick: control period [s]."""
        ...

    def begin(self) -> None:
        """Start anew, with the numbers that the groups have now."""
        ...

    def act(self, tick: int, t: float, dt: float) -> None:
        """Turn the readings at time t [s] into commands for the next dt [s]."""
        ...


def _per_group(made: Any) -> Any:
    """The class, for the one group of its members."""

    class PerGroup(made):
        PER_GROUP = True

        def __init__(self, swarm: Swarm, members: Members, tick: float):
            self._whose = swarm, members, tick
            self.begin()

        def begin(self) -> None:
            swarm, members, tick = self._whose
            super().__init__(swarm, members.groups[0], tick)

    return PerGroup


ALGORITHMS: dict[str, type[Algorithm]] = {
    kind: _per_group(made)
    for kind, made in {
        "casting": Casting,
        "surge_cast": SurgeCast,
        "surge_spiral": SurgeSpiral,
        "spiral": Spiral,
        "ecoli": EColi,
        "infotaxis": Infotaxis,
        "dapso": Dapso,
        "lineup": LineUp,
        "sweep": Sweep,
        "least_known": LeastKnown,
        "random_walk": RandomWalk,
    }.items()
}
