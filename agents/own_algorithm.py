"""User's own search algorithm in NumPy: a class in a Python file that a scenario names.

    class Upwind:
        def act(self, robots):
            robots.turn_to(np.arctan2(-robots.wind[:, 1], -robots.wind[:, 0]))
            robots.speed[:] = 0.1

Files are executed only with --allow-code; modules that a file imports have to be installed, or on the PYTHONPATH.

The class is instantiated once per group, with the scenario's `parameters` as keywords, and called in each time step
(tick) with all robots of all trials of the group; its state between calls is in its own attributes. A run can be
resumed if the algorithm has ``state()``, which returns its whole state as plain data (numbers, texts, arrays, lists,
dicts), and ``restore(state)``. Robots of a team (a group's robots in one trial) send each other messages of as many
numbers as the class states, ``MESSAGE = 3``, within the group's `communication`. Attributes that
``DECISIONS = (("lost", "s", "time since the last detection"),)`` lists are decision quantities, see `decisions`.
"""

from copy import deepcopy
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from taichi_plume.agents.columns import RANGE, Rows
from taichi_plume.agents.decisions import Decision
from taichi_plume.agents.members import Members
from taichi_plume.agents.own_robots import GOALS, Outputs, Robots, readable_columns, writable_columns
from taichi_plume.agents.parameters import Parameters
from taichi_plume.agents.priors import prior_weights
from taichi_plume.agents.radio import NEVER, Radio
from taichi_plume.agents.swarm import Swarm
from taichi_plume.files import checkpoint
from taichi_plume.files.own_class import OwnAlgorithmError, failures_named, file_of
from taichi_plume.grid.state import saves_itself
from taichi_plume.guard.terminal import visible
from taichi_plume.scenario.algorithms import Own
from taichi_plume.scenario.loading import ScenarioError
from taichi_plume.scenario.robots import Group

MOST_NUMBERS = 16  # largest count of numbers in a message
MOST_HEARD = 20_000_000  # limit of the numbers in the messages that all robots of a group store


class UserState:
    """State of a user's algorithm by its methods state() and restore(). Raises OwnAlgorithmError if these fail."""

    def __init__(self, path: Path, algorithm: object):
        self.path, self.algorithm = path, algorithm

    def state(self) -> object:
        """Return the state of the user's algorithm as plain data (numbers, texts, arrays, lists, dicts)."""
        with failures_named(self.path):
            state = self.algorithm.state()
            checkpoint.require_plain(state, "state()")
            return state

    def restore(self, state: object) -> None:
        with failures_named(self.path):
            self.algorithm.restore(state)


class Messages:
    """Radio messages of several numbers between the robots of each team; `radio` decides which robots receive them.

    words: count of numbers in a message. heard (size, count, words): last message from each teammate, NaN if none;
    heard_at (size, count): time of that message [s].
    """

    STATE = ("radio", "heard", "heard_at")

    def __init__(self, members: Members, words: int):
        self.p = Parameters(members, Radio.numbers, radio="radio")
        self.radio, self.words = Radio(members, self.p), words
        self.radio.time.fill(NEVER)
        shape = self.radio.time.shape
        count = shape[1]
        self.first = np.arange(members.size) // count * count  # first robot of each robot's team
        self.heard, self.heard_at = np.full((*shape, self.words), np.nan), np.full(shape, np.nan)

    def deliver(self, outputs: Outputs, tick: int, t: float) -> None:
        """Deliver the messages that robots sent in this time step, at time t [s], to the teammates in radio contact."""
        if not outputs.speaks.any():
            return
        self.radio.speaks.from_numpy(outputs.speaks)
        self.radio.deliver(tick, t)
        n, m = np.nonzero(
            self.radio.time.values == np.float32(t)
        )  # late in a run this may also be the previous tick
        now = outputs.speaks[self.first[n] + m] > 0
        n, m = n[now], m[now]
        self.heard[n, m] = outputs.message[self.first[n] + m]
        self.heard_at[n, m] = t


@dataclass(frozen=True)
class OwnDecision(Decision):
    """Quantity by which a user's algorithm decides: an attribute of the user's object."""

    def read(self, algorithm: "OwnAlgorithm") -> np.ndarray:
        return algorithm.decided(self.name)


def _parameters(group: Group) -> dict[str, Any]:
    """Return the keyword arguments of the user's class that drives a group."""
    return group.algorithm.parameters if isinstance(group.algorithm, Own) else {}


class OwnAlgorithm:
    """Adapter that runs a user's algorithm class `own` for a group.

    before: the adapter of a running simulation, whose state is restored next. With equal parameters the user's
    algorithm stays the same object. Raises OwnAlgorithmError if the class fails, and ScenarioError if the parameters of
    a running algorithm without state() and restore() change.
    """

    PER_GROUP = True

    def __init__(self, swarm: Swarm, members: Members, own: type, before: "OwnAlgorithm | None" = None):
        self.swarm, self.members, self.own = swarm, members, own
        (group,) = members.groups
        self.size, self.start = group.size, group.start
        self.path = file_of(own)
        self.flies = group.model.body.flies
        self.commands, goals = writable_columns(self.flies), GOALS if self.flies else ()
        self.readings = Rows(swarm, readable_columns(self.flies), group.start, group.size)
        self.orders = Rows(swarm, (*self.commands, *goals), group.start, group.size)
        sensors = group.model.sensors
        self.further = self._rows({f"reading_{k}" for k in range(1, len(sensors.noses))})
        self.ranges = self._rows({f"{RANGE}_{k}" for k in range(sensors.ranges)})
        self.words = self._words(group.count)
        self.messages = Messages(members, self.words) if self.words else None
        self.DECISIONS: tuple[Decision, ...] = self._decisions()
        number = np.arange(group.size)
        trial = group.model.first_trial + number // group.count
        prior = partial(prior_weights, members)
        self.robots = Robots(
            trial, number % group.count, *self._heard(), self.flies, group.model.turn_time, prior
        )
        self.algorithm: Any = self._made(before)
        with failures_named(self.path):
            self.STATE_NAMES = tuple(map(str, getattr(self.algorithm, "STATE_NAMES", ("SEARCH",))))
        self.kept = UserState(self.path, self.algorithm)
        self.STATE = ("robots", "messages", *(("kept",) if self.can_be_saved else ()))

    def _rows(self, names: set[str]) -> Rows:
        """Return the columns of these names, of the group's robots."""
        columns = [column for column in self.swarm.columns if column.name in names]
        return Rows(self.swarm, columns, self.start, self.size)

    def _words(self, count: int) -> int:
        """Return MESSAGE, the class's count of numbers in a message. Raises OwnAlgorithmError if not allowed."""
        words, where = getattr(self.own, "MESSAGE", 0), f"{self.path}, MESSAGE of {self.own.__name__}"
        if not isinstance(words, int) or not 0 <= words <= MOST_NUMBERS:
            raise OwnAlgorithmError(f"{where} is {words!r}, not a whole number from 0 to {MOST_NUMBERS}")
        if self.size * count * words > MOST_HEARD:
            raise OwnAlgorithmError(
                f"{where}: {self.size:,} robots would keep {self.size * count * words:,} numbers of each other, more "
                f"than {MOST_HEARD:,}; use smaller teams or fewer trials"
            )
        return words

    def _decisions(self) -> tuple[OwnDecision, ...]:
        """Return DECISIONS, the class's decision quantities. Raises OwnAlgorithmError if not allowed."""
        given = getattr(self.own, "DECISIONS", ())
        if not isinstance(given, tuple | list) or not all(map(_is_decision, given)):
            raise OwnAlgorithmError(
                f"{self.path}, DECISIONS of {self.own.__name__} is {visible(repr(given), 200)}; must be a tuple of "
                "(name, unit, meaning), texts, where name is an attribute of the class"
            )
        names = [name for name, _, _ in given]
        if len(names) > len(set(names)):
            twice = next(name for name in names if names.count(name) > 1)
            raise OwnAlgorithmError(f"{self.path}, DECISIONS of {self.own.__name__}: has {twice!r} twice")
        return tuple(OwnDecision(*each) for each in given)

    def _made(self, before: "OwnAlgorithm | None") -> Any:
        """Return the user's algorithm: a new object, or that of `before`."""
        parameters = _parameters(self.members.groups[0].model)
        if before and self.own is before.own and parameters == _parameters(before.members.groups[0].model):
            return before.algorithm
        if before and not before.can_be_saved:
            raise ScenarioError(
                [f"robots[{self.members.numbers[0]}].algorithm.parameters: cannot change during a run, as "
                 f"{self.own.__name__} has no state() and restore(), which carry its state to a new object"]
            )  # fmt: skip
        with failures_named(self.path):
            return self.own(**deepcopy(parameters))

    @property
    def can_be_saved(self) -> bool:
        """True if the user's class has methods that save and restore its state."""
        return saves_itself(self.algorithm)

    def act(self, tick: int, t: float, dt: float) -> None:
        robots = self.robots
        robots.t, robots.dt = t, dt
        robots.heard, robots.heard_at = self._heard()
        robots.said = outputs = Outputs(self.size, self.words)
        for column, values in zip(self.readings.columns, self.readings.read(), strict=True):
            setattr(robots, column.read_as, values)
        robots.readings = np.column_stack(
            [robots.reading, *(self.further.read() if self.further.columns else ())]
        )
        robots.ranges = np.column_stack([np.zeros((self.size, 0)), *self.ranges.read()])
        with failures_named(self.path), robots.sealed():
            self.algorithm.act(robots)
            commands = [self._checked(column.written_as) for column in self.commands]
        if self.flies:
            commands += [outputs.goals, outputs.goal_headings]
        self.orders.write(commands)
        self.swarm.declare_all(self.start, outputs.places, t)
        if self.messages:
            self.messages.deliver(outputs, tick, t)

    def decided(self, name: str) -> np.ndarray:
        """Return the attribute `name` of the user's object for each robot (size,); NaN if it is None.

        Raises OwnAlgorithmError if there is none, or if it is neither a number nor one per robot.
        """
        with failures_named(self.path):
            try:
                held = getattr(self.algorithm, name)
            except AttributeError:
                if hasattr(self.own, name):
                    raise  # from within a property
                raise OwnAlgorithmError(
                    f"{self.path}: {self.own.__name__} has no attribute {name!r}, which its DECISIONS list; set it in "
                    "__init__, to None if there is none yet"
                ) from None
        values = self._per_robot(np.nan if held is None else held, f"{self.path}, {self.own.__name__}.{name}")
        with np.errstate(over="ignore"):
            return values.astype(np.float32)

    def _heard(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the last messages that the robots received, and their times [s], as read-only views."""
        if not self.messages:
            return np.zeros((self.size, 0, 0)), np.zeros((self.size, 0))
        views = self.messages.heard.view(), self.messages.heard_at.view()
        for array in views:
            array.flags.writeable = False
        return views

    def _checked(self, name: str) -> np.ndarray:
        """Return the commands (size,) in the robots' attribute `name`. Raises OwnAlgorithmError if invalid."""
        where = f"{self.path}, act of {type(self.algorithm).__name__}: robots.{name}"
        values = self._per_robot(getattr(self.robots, name), where)
        with np.errstate(over="ignore"):  # robots compute in f32
            finite = np.isfinite(values.astype(np.float32))
        if not finite.all():
            n = int(np.flatnonzero(~finite)[0])
            raise OwnAlgorithmError(f"{where}[{n}] is {values[n]}, not a finite number")
        if name == "state" and not np.isin(values, np.arange(len(self.STATE_NAMES))).all():
            raise OwnAlgorithmError(f"{where} must be whole numbers from 0 to {len(self.STATE_NAMES) - 1}")
        return values

    def _per_robot(self, given: Any, where: str) -> np.ndarray:
        """Return a number, or one per robot, as an array (size,). Raises OwnAlgorithmError if it is neither."""
        try:
            return np.broadcast_to(np.asarray(given, float), self.size)
        except (TypeError, ValueError):
            shape = np.shape(given)
            raise OwnAlgorithmError(f"{where} has the shape {shape}, not ({self.size},)") from None


def _is_decision(given: object) -> bool:
    """Return whether an entry of a class's DECISIONS is (name, unit, meaning), of which none is empty."""
    return (
        isinstance(given, tuple | list)
        and len(given) == 3
        and all(isinstance(text, str) and text for text in given)
        and given[0].isidentifier()
    )
