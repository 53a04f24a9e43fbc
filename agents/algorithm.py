"""Protocol of search algorithms, and base class of search algorithms in Taichi kernels over robots."""

from contextlib import nullcontext
from typing import Any, ClassVar, Protocol

import taichi as ti

from taichi_plume.agents.groups import GroupRange
from taichi_plume.agents.members import Members
from taichi_plume.agents.parameters import Numbers, Parameters
from taichi_plume.agents.serial import runs_serially
from taichi_plume.agents.swarm import Swarm
from taichi_plume.grid.kernels import data_flow_by_llvm


class Algorithm(Protocol):
    """Drives the robots of the groups of one kind of algorithm, all trials at once."""

    PER_GROUP: bool
    """True if each group has an algorithm of its own."""
    STATE: tuple[str, ...]
    """Names of the attributes that change in a run, see grid/state.py."""
    STATE_NAMES: tuple[str, ...]
    """Names of the values of the swarm's `state`."""

    def __init__(self, swarm: Swarm, members: Members, tick: float):
        """Prepare the robots, and `begin`; tick: control period [s]."""
        ...

    def begin(self) -> None:
        """Set the numbers to the present ones of `members.groups`, and the state to the start of a run."""
        ...

    def act(self, tick: int, t: float, dt: float) -> None:
        """Turn the readings at time t [s] into commands for the next dt [s]."""
        ...


@ti.data_oriented
class KernelAlgorithm:
    """Search algorithm in Taichi. tick: control period [s].

    A subclass defines `numbers`, allocates its fields and parts in `_allocate`, and overrides `_step`, a tick of a
    robot, and `_start`, the initial state of a robot if it is not zero. In these, robot n of the algorithm is robot i =
    `robot[n]` of the swarm, and `p.threshold[n]` the number "threshold" of its group.
    """

    PER_GROUP: bool = False
    STATE: tuple[str, ...]
    STATE_NAMES: tuple[str, ...]
    STREAM: ClassVar[str] = ""
    """Name of the random stream whose key is `p.stream`; none if empty."""
    TALKS: ClassVar[bool] = False
    """True if robots send messages: `p.radio` is then the key of the random stream of their losses."""
    WORK: ClassVar[int] = 1
    """Work of a robot, as a multiple of that of a simple algorithm, see `serial`."""

    def __init__(self, swarm: Swarm, members: Members, tick: float):
        self.swarm, self.members, self.tick = swarm, members, tick
        self.size, self.robot, self.number = members.size, members.robot, members.number
        streams = {"stream": self.STREAM, "radio": "radio" if self.TALKS else ""}
        self.p = Parameters(
            members,
            lambda group: self.numbers(group, group.model.algorithm),
            **{key: name for key, name in streams.items() if name},
        )
        self._compiled = False
        self._allocate()
        self.begin()

    @property
    def model(self) -> Any:
        """Section of the first group, with the numbers of the present run."""
        return self.members.groups[0].model.algorithm

    def numbers(self, group: GroupRange, model: Any) -> Numbers:
        """Return the numbers of a group that kernels read. model: section of the scenario."""
        raise NotImplementedError

    def _allocate(self) -> None:
        """Make fields and parts."""

    def begin(self) -> None:
        self.p.begin()
        self._start_all()

    def act(self, tick: int, t: float, dt: float) -> None:
        with nullcontext() if self._compiled else data_flow_by_llvm():
            self._step_all(tick, t, dt)
        self._compiled = True

    @ti.kernel
    def _start_all(self):
        ti.loop_config(serialize=ti.static(runs_serially(self.WORK * self.size)))
        for n in range(self.size):
            self._start(n)

    @ti.kernel
    def _step_all(self, tick: int, t: float, dt: float):
        ti.loop_config(serialize=ti.static(runs_serially(self.WORK * self.size)))
        for n in range(self.size):
            self._step(n, tick, t, dt)

    @ti.func
    def _start(self, n):
        """Set the state of robot n at the start of a run."""

    @ti.func
    def _step(self, n, tick, t, dt):
        """Turn the readings of robot n at time t [s] into commands for the next dt [s]."""
