"""A team: the robots of the groups that one search algorithm drives."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from taichi_plume.agents.members import Members
from taichi_plume.agents.own import OwnAlgorithm
from taichi_plume.agents.search import ALGORITHMS, Algorithm
from taichi_plume.agents.swarm import Swarm
from taichi_plume.files.own_class import own_class


class Team:
    """Acts for the robots of the groups `numbers`, whose algorithms are of one kind, all trials at once.

    tick: control period [s]. folder: of the scenario. own: class of an algorithm of the user's that is not in a file.
    """

    STATE = ("algorithm",)

    def __init__(
        self,
        swarm: Swarm,
        numbers: Sequence[int],
        tick: float,
        folder: Path = Path(),
        own: type | None = None,
    ):
        self.members = Members(swarm, numbers)
        self.numbers = self.members.numbers
        model = self.members.groups[0].model.algorithm
        self.algorithm: Algorithm
        if model.kind == "own":
            self.algorithm = OwnAlgorithm(
                swarm, self.members, own or own_class(folder / model.file, model.name)
            )
        else:
            self.algorithm = ALGORITHMS[model.kind](swarm, self.members, tick)

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the values of the swarm's `state`."""
        return self.algorithm.STATE_NAMES

    def begin(self) -> None:
        """Start anew, with the numbers that the swarm's groups have now."""
        self.algorithm.begin()

    def act(self, tick: int, t: float, dt: float) -> None:
        """Turn readings into commands."""
        self.algorithm.act(tick, t, dt)


def teams(
    swarm: Swarm, tick: float, folder: Path = Path(), own: Mapping[str, type] | None = None
) -> list[Team]:
    """A team for each kind of algorithm, or for each group where the algorithm's class is `PER_GROUP`.

    own: classes of the user's by the names of their groups.
    """
    alike: dict[tuple[str, int], list[int]] = {}
    for group in swarm.groups:
        kind = group.model.algorithm.kind
        per_group = kind == "own" or ALGORITHMS[kind].PER_GROUP
        alike.setdefault((kind, group.number if per_group else -1), []).append(group.number)
    handed = own or {}
    return [
        Team(swarm, numbers, tick, folder, handed.get(swarm.groups[numbers[0]].name))
        for numbers in alike.values()
    ]
