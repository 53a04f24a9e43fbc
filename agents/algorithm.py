"""Protocol of search algorithms, and base class of search algorithms in Taichi kernels over robots."""

from typing import Any, ClassVar, Protocol

from taichi_plume.agents.decisions import Decision
from taichi_plume.agents.groups import GroupRange
from taichi_plume.agents.members import Members
from taichi_plume.agents.parameters import Numbers, Parameters
from taichi_plume.agents.serial_loops import runs_serially
from taichi_plume.agents.swarm import Swarm
from taichi_plume.engine import ti
from taichi_plume.grid.kernels import long_kernel


class Algorithm(Protocol):
    """Protocol of an object that drives the robots of the groups with one kind of search algorithm, in all trials."""

    PER_GROUP: bool
    """True if each group needs an object of its own."""
    STATE: tuple[str, ...]
    """Names of the attributes that change during a run, for checkpoints (see grid/state.py)."""
    STATE_NAMES: tuple[str, ...]
    """Names of the algorithm's states, indexed by the swarm's column `state`."""
    DECISIONS: tuple[Decision, ...]
    """Quantities by which the algorithm decides, columns of `robots.parquet`."""

    def __init__(self, swarm: Swarm, members: Members, tick: float):
        """Make the algorithm for the robots `members`, at the start of a run; tick: control period [s]."""
        ...

    def act(self, tick: int, t: float, dt: float) -> None:
        """Convert the robots' readings at time t [s] to commands for the next dt [s]; tick: index of the period."""
        ...


class KernelAlgorithm:
    """Base class of search algorithms in Taichi kernels. tick: control period [s].

    A subclass defines `numbers`, allocates its fields and parts in `_allocate`, and overrides `_step`, the
    commands of a robot for a tick, and `_start`, the initial state of a robot if not zero. In these methods robot n of
    the algorithm is robot i = `robot[n]` of the swarm, and `p.threshold[n]` is the parameter "threshold" of its group.
    """

    PER_GROUP: bool = False
    STATE: tuple[str, ...]
    STATE_NAMES: tuple[str, ...]
    DECISIONS: tuple[Decision, ...] = ()
    STREAM: ClassVar[str] = ""
    """Name of the random stream whose key is `p.stream`; empty for algorithms without random numbers."""
    TALKS: ClassVar[bool] = False
    """True if robots send radio messages: `p.radio` is then the key of the random stream for lost messages."""
    WORK: ClassVar[int] = 1
    """Computing work per robot, as a multiple of that of a simple algorithm, see `serial`."""

    def __init__(self, swarm: Swarm, members: Members, tick: float):
        self.swarm, self.members, self.tick = swarm, members, tick
        self.size, self.robot, self.number = members.size, members.robot, members.number
        streams = {"stream": self.STREAM, "radio": "radio" if self.TALKS else ""}
        self.p = Parameters(
            members,
            lambda group: self.numbers(group, group.model.algorithm),
            **{key: name for key, name in streams.items() if name},
        )
        self._allocate()
        self._start_all()

    @property
    def model(self) -> Any:
        """Scenario section of the first group's algorithm."""
        return self.members.groups[0].model.algorithm

    def numbers(self, group: GroupRange, model: Any) -> Numbers:
        """Return the parameters of a group that kernels read. model: the algorithm's section of the scenario."""
        raise NotImplementedError

    def _allocate(self) -> None:
        """Allocate the algorithm's fields and components, and set fields that `_start` does not set."""

    @ti.kernel
    def _start_all(self):
        ti.loop_config(serialize=ti.static(runs_serially(self.WORK * self.size)))
        for n in range(self.size):
            self._start(n)

    @long_kernel
    def act(self, tick: int, t: float, dt: float):
        ti.loop_config(serialize=ti.static(runs_serially(self.WORK * self.size)))
        for n in range(self.size):
            self._step(n, tick, t, dt)

    @ti.func
    def _start(self, n):
        """Set the algorithm's state of robot n at the start of a run."""

    @ti.func
    def _step(self, n, tick, t, dt):
        """Convert the readings of robot n at time t [s] into its commands for the next dt [s]."""
