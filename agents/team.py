"""Team: the robots that one search algorithm drives, and their wait before the search starts."""

from collections.abc import Mapping, Sequence
from typing import Any

from taichi_plume.agents import decisions
from taichi_plume.agents.algorithm import Algorithm
from taichi_plume.agents.algorithm_table import ALGORITHMS
from taichi_plume.agents.members import Members
from taichi_plume.agents.own_algorithm import OwnAlgorithm
from taichi_plume.agents.policy import PolicyAlgorithm
from taichi_plume.agents.replay import ReplayAlgorithm
from taichi_plume.agents.swarm import Swarm
from taichi_plume.engine import ti
from taichi_plume.files.network import Network
from taichi_plume.files.trajectories import Way

HANDED = ("own", "policy", "replay")  # kinds with a class, network or paths from files
BEFORE = "BEFORE_BEGIN"  # state of robots that have not set off, used by no algorithm


class Team:
    """Robots of the groups with indices `numbers`, which one algorithm drives in all trials.

    Until the groups set off, at their `begin`, the robots get no command; their state is BEFORE, and the algorithm's
    first state is stored. tick: control period [s]. own: class of a user's algorithm. network: of a policy. ways:
    recorded paths. before: the user's algorithm of a running simulation, see `OwnAlgorithm`.
    """

    STATE: tuple[str, ...] = ("algorithm",)

    @ti.shared_memory()
    def __init__(
        self,
        swarm: Swarm,
        numbers: Sequence[int],
        tick: float,
        own: type | None = None,
        network: Network | None = None,
        ways: Sequence[Way] | None = None,
        before: OwnAlgorithm | None = None,
    ):
        self.swarm, self.members = swarm, Members(swarm, numbers)
        self.numbers = self.members.numbers
        group = self.members.groups[0].model
        model = group.algorithm
        self.first_tick = self.members.groups[0].waits(tick) + 1  # in which the robots get a command
        self.algorithm: Algorithm
        if own is not None:
            self.algorithm = OwnAlgorithm(swarm, self.members, own, before)
        elif network is not None:
            self.algorithm = PolicyAlgorithm(swarm, self.members, tick, network)
        elif ways is not None:
            self.algorithm = ReplayAlgorithm(swarm, self.members, tick, ways)
        else:
            self.algorithm = ALGORITHMS[model.kind](swarm, self.members, tick)
        self.waits = group.begin > 0
        if self.waits:
            self.STATE = (*self.STATE, "first_state")
            self._robots = self.members.robot.to_numpy()
            self.first_state = swarm.state[self._robots]
            swarm.state[self._robots] = len(self.algorithm.STATE_NAMES)

    @property
    def state_names(self) -> tuple[str, ...]:
        return (*self.algorithm.STATE_NAMES, BEFORE) if self.waits else self.algorithm.STATE_NAMES

    def act(self, tick: int, t: float, dt: float) -> None:
        if tick < self.first_tick:
            return
        if self.waits and tick == self.first_tick:
            self.swarm.state[self._robots] = self.first_state
        self.algorithm.act(tick, t, dt)


def teams(
    swarm: Swarm,
    tick: float,
    own: Mapping[str, type] | None = None,
    networks: Mapping[str, Network] | None = None,
    ways: Mapping[str, Sequence[Way]] | None = None,
    before: Sequence[Any] = (),
) -> list[Team]:
    """Return a `Team` (groups and the algorithm that drives them) per kind of algorithm and start time, or per group.

    own: users' classes, networks: networks of policies, ways: recorded paths, by the names of their groups.
    before: teams of a running simulation, whose users' algorithms go on, see `OwnAlgorithm`.
    """
    alike: dict[tuple[str, int, float], list[int]] = {}
    for group in swarm.groups:
        kind = group.model.algorithm.kind
        per_group = kind in HANDED or ALGORITHMS[kind].PER_GROUP
        key = kind, group.number if per_group else -1, group.model.begin
        alike.setdefault(key, []).append(group.number)
    handed, learnt, recorded = own or {}, networks or {}, ways or {}
    running = {team.numbers: team.algorithm for team in before if isinstance(team.algorithm, OwnAlgorithm)}
    names = [(numbers, swarm.groups[numbers[0]].name) for numbers in alike.values()]
    result = [
        Team(
            swarm,
            numbers,
            tick,
            handed.get(name),
            learnt.get(name),
            recorded.get(name),
            running.get(tuple(numbers)),
        )
        for numbers, name in names
    ]
    decisions.require_distinct(result, swarm.columns)
    return result
