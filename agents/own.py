"""A search algorithm of the user's own, in NumPy: a class in a Python file that a scenario names.

    class Upwind:
        def act(self, robots):
            robots.turn_to(np.arctan2(-robots.wind[:, 1], -robots.wind[:, 0]))
            robots.speed[:] = 0.1

Files are executed only with --allow-code; modules that one imports have to be installed, or on the PYTHONPATH.

It is made once per group, with the scenario's `parameters` as keywords, and called each tick with all robots of all
trials of the group; what it keeps from tick to tick are its own attributes. A run whose algorithm has ``state()``,
which returns all that it keeps as plain data (numbers, texts, arrays, lists, dicts), and ``restore(state)`` can be
resumed.
"""

import inspect
from pathlib import Path
from typing import Any

import numpy as np

from taichi_plume.agents.columns import COLUMNS, Rows
from taichi_plume.agents.members import Members
from taichi_plume.agents.swarm import Swarm
from taichi_plume.files import checkpoint
from taichi_plume.files.own_class import OwnAlgorithmError, failures_told
from taichi_plume.grid.state import saves_itself

SHOWN = tuple(column for column in COLUMNS if column.shown)
TOLD = tuple(column for column in COLUMNS if column.told)


class Robots:
    """What an algorithm may know of its robots, and what it tells them, as arrays over the n robots.

    Read: `reading` [ppm]; `wind` (n, 2) [m/s], zero where it is not `wind_known`; `position` (n, 2) [m], `heading`
    [rad] and `path_length` [m], with errors where the group has `odometry`; `blocked`, the bumper; `trial` and
    `robot`, numbers of each; `t`, `dt` [s].
    Write: `speed` [m/s]; `turn_rate` [rad/s]; `state`, whole numbers that index the algorithm's STATE_NAMES.
    """

    STATE = ("t", "dt", *(column.shown for column in SHOWN), *(column.told for column in TOLD))

    heading: np.ndarray
    turn_rate: np.ndarray

    def __init__(self, trial: np.ndarray, robot: np.ndarray):
        n = len(trial)
        self.trial, self.robot = trial, robot
        self.t, self.dt = 0.0, 0.0
        for column in SHOWN:
            setattr(self, column.shown, column.zeros(n))
        for column in TOLD:
            setattr(self, column.told, np.zeros(n, int if column.dtype is np.int32 else float))

    def turn_to(self, course: Any) -> None:
        """Command the turn rate that brings each heading to `course` [rad] in a tick, or as soon as the body can."""
        off = np.asarray(course) - self.heading
        self.turn_rate = (off - 2 * np.pi * np.round(off / (2 * np.pi))) / self.dt


class Kept:
    """What a user's algorithm keeps from tick to tick, as it tells it. Raises OwnAlgorithmError where it fails."""

    def __init__(self, path: Path, algorithm: Any):
        self.path, self.algorithm = path, algorithm

    def state(self) -> Any:
        """All that it keeps, as plain data."""
        with failures_told(self.path):
            state = self.algorithm.state()
            checkpoint.require_plain(state, "state()")
            return state

    def restore(self, state: Any) -> None:
        """Go back to it."""
        with failures_told(self.path):
            self.algorithm.restore(state)


class OwnAlgorithm:
    """Runs a class of the user's, `own`, for one group. Raises OwnAlgorithmError where it fails."""

    PER_GROUP = True
    STATE = ("kept", "robots")

    def __init__(self, swarm: Swarm, members: Members, own: type):
        self.members, self.own = members, own
        (group,) = members.groups
        self.size = group.size
        self.path = Path(inspect.getsourcefile(own) or "?")
        self.shown, self.told = (Rows(swarm, some, group.start, group.size) for some in (SHOWN, TOLD))
        self.begin()

    def begin(self) -> None:
        """Make the user's algorithm, with the group's parameters."""
        (group,) = self.members.groups
        number = np.arange(group.size)
        self.robots = Robots(group.model.first_trial + number // group.count, number % group.count)
        model = group.model.algorithm
        with failures_told(self.path):
            self.algorithm = self.own(**(model.parameters if model.kind == "own" else {}))
            self.STATE_NAMES = tuple(map(str, getattr(self.algorithm, "STATE_NAMES", ("SEARCH",))))
        self.kept = Kept(self.path, self.algorithm)

    @property
    def can_be_saved(self) -> bool:
        """Whether the user's class tells what it keeps."""
        return saves_itself(self.algorithm)

    def act(self, tick: int, t: float, dt: float) -> None:
        """Show the robots to the user's algorithm and carry out what it wants."""
        robots = self.robots
        robots.t, robots.dt = t, dt
        for column, values in zip(SHOWN, self.shown.read(), strict=True):
            setattr(robots, column.shown, values)
        with failures_told(self.path):
            self.algorithm.act(robots)
            commands = [self._checked(column.told) for column in TOLD]
        self.told.write(commands)

    def _checked(self, name: str) -> np.ndarray:
        """What the algorithm wrote, if it is a finite number for every robot."""
        where = f"{self.path}, act of {type(self.algorithm).__name__}: robots.{name}"
        try:
            values = np.broadcast_to(np.asarray(getattr(self.robots, name), float), self.size)
        except (TypeError, ValueError):
            shape = np.shape(getattr(self.robots, name))
            raise OwnAlgorithmError(f"{where} has the shape {shape}, not ({self.size},)") from None
        with np.errstate(over="ignore"):  # robots compute in f32
            finite = np.isfinite(values.astype(np.float32))
        if not finite.all():
            n = int(np.flatnonzero(~finite)[0])
            raise OwnAlgorithmError(f"{where}[{n}] is {values[n]}, not a finite number")
        if name == "state" and not np.isin(values, np.arange(len(self.STATE_NAMES))).all():
            raise OwnAlgorithmError(f"{where} must be whole numbers from 0 to {len(self.STATE_NAMES) - 1}")
        return values
