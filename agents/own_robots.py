"""What an algorithm of the user's own sees of its robots, and what it tells them and lets them say."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from taichi_plume.agents.columns import Column, Columns, columns_of
from taichi_plume.guard.attributes import KnownAttributes

GOALS = (Columns.goal, Columns.goal_heading)
"""What drones are told besides, see `Robots.go_to`."""


def shown(flies: bool) -> tuple[Column, ...]:
    """What own algorithms read; flies: of a swarm some of whose robots do."""
    return tuple(column for column in columns_of(flies) if column.shown)


def told(flies: bool) -> tuple[Column, ...]:
    """What they write."""
    return tuple(column for column in columns_of(flies) if column.told)


class Said:
    """What n robots say in a tick: the places that they declare, NaN where none, who sends which message, and where
    they fly, (n, 3) [m], to which heading [rad], NaN where they go by their speeds.
    """

    def __init__(self, n: int, words: int):
        self.goals, self.goal_headings = np.full((n, 3), np.nan), np.full(n, np.nan)
        self.places = np.full((n, 2), np.nan)
        self.speaks, self.message = np.zeros(n, bool), np.zeros((n, words))


class Robots(KnownAttributes):
    """What an algorithm may know of its robots, and what it tells them, as arrays over the n robots.

    Read: `reading` [ppm], and `readings` (n, gas sensors) [ppm], of which it is the first; `wind` (n, 2) [m/s], zero
    where it is not `wind_known`; `position` (n, 2) [m], `heading` [rad] and `path_length` [m], with errors where the
    group has `odometry`; `blocked`, the bumper; `trial` and `robot`, numbers of each; `t`, `dt` [s]; of classes with a
    MESSAGE `heard` (n, robots of a team, MESSAGE), what each heard last of each of its team, NaN where that is nothing,
    and `heard_at` (n, robots of a team), when [s].
    Write: `speed` [m/s]; `turn_rate` [rad/s]; `state`, whole numbers that index the algorithm's STATE_NAMES. Other
    attributes cannot be set: AttributeError.
    Call: `turn_to`, `declare`, `tell`; what is `said` of the last two is of this tick.

    Of drones besides, read: `altitude` [m]. Write: `left_speed` [m/s], `climb_rate` [m/s]. Call in each tick: `go_to`.
    """

    altitude: np.ndarray
    heading: np.ndarray
    position: np.ndarray
    turn_rate: np.ndarray

    def __init__(
        self,
        trial: np.ndarray,
        robot: np.ndarray,
        heard: np.ndarray,
        heard_at: np.ndarray,
        flies: bool = False,
    ):
        n = len(trial)
        self.flies = flies
        names = (*(one.shown for one in shown(flies)), *(one.told for one in told(flies)))
        self.STATE = ("t", "dt", *names)
        self.trial, self.robot = trial, robot
        self.t, self.dt = 0.0, 0.0
        self.heard, self.heard_at = heard, heard_at
        self.readings = np.zeros((n, 1))
        self.said = Said(n, heard.shape[2])
        for column in shown(flies):
            setattr(self, column.shown, column.zeros(n))
        for column in told(flies):
            setattr(self, column.told, np.zeros(n, int if column.dtype is np.int32 else float))

    @contextmanager
    def sealed(self) -> Iterator[None]:
        """Let only the commands be set, while the user's code runs."""
        self._seal(*(one.told for one in told(self.flies)))
        try:
            yield
        finally:
            self._open()

    def turn_to(self, course: Any) -> None:
        """Command the turn rate that brings each heading to `course` [rad] in a tick, or as soon as the body can."""
        off = np.asarray(course) - self.heading
        self.turn_rate = (off - 2 * np.pi * np.round(off / (2 * np.pi))) / self.dt

    def go_to(self, x: Any, y: Any, z: Any, heading: Any = None, which: Any = None) -> None:
        """Let all drones, or some, fly to a place in this tick, straight and as fast as they can stop there.

        x, y, z [m], z of the lower end of the body, and heading [rad], unless given as `turn_rate` makes it: a number
        for all of them or one each. which: as for `declare`. Raises ValueError.
        """
        if not self.flies:
            raise ValueError("go_to is of drones alone: give body.kind: drone")
        some = np.arange(len(self.trial)) if which is None else self._numbers(which)
        try:
            goals = np.stack(
                [np.broadcast_to(np.asarray(one, float), len(some)) for one in (x, y, z)], axis=1
            )
            to = np.broadcast_to(np.asarray(np.nan if heading is None else heading, float), len(some))
        except (TypeError, ValueError):
            raise ValueError(f"x, y, z and heading are numbers, one for all or {len(some)} each") from None
        _require_finite(goals, "place")
        if heading is not None:
            _require_finite(to[:, None], "heading")
        self.said.goals[some], self.said.goal_headings[some] = goals, to

    def declare(self, which: Any, place: Any = None) -> None:
        """Let some robots say that a source is at `place`, where they believe to be unless given.

        which: a truth for each robot, or numbers of robots; place: (2,) for all of them or (their number, 2) [m].
        Raises ValueError.
        """
        some = self._numbers(which)
        places = self.position[some] if place is None else _numbers(place, "place", (len(some), 2))
        _require_finite(places, "place")
        self.said.places[some] = places

    def tell(self, values: Any, which: Any = None) -> None:
        """Let all robots, or some, send a message to their team; it is heard by those in range, in the next tick.

        values: (MESSAGE,) for all of them or (their number, MESSAGE). which: as for `declare`. Raises ValueError.
        """
        words = self.said.message.shape[1]
        if not words:
            raise ValueError("the class has no MESSAGE: give it one, how many numbers a message has")
        some = np.arange(len(self.trial)) if which is None else self._numbers(which)
        told = _numbers(values, "values", (len(some), words))
        _require_finite(told, "values")
        self.said.speaks[some], self.said.message[some] = True, told

    def _numbers(self, which: Any) -> np.ndarray:
        """The robots that are meant. Raises ValueError."""
        n, some = len(self.trial), np.asarray(which)
        if some.dtype == bool and some.shape in ((n,), ()):
            return np.flatnonzero(np.broadcast_to(some, n))
        if some.size == 0 and some.ndim <= 1:
            return np.zeros(0, int)
        whole = np.issubdtype(some.dtype, np.integer) and some.ndim <= 1
        if not whole or some.min() < 0 or some.max() >= n:
            raise ValueError(
                f"which is neither a truth for each of the {n} robots nor numbers of robots from 0 to {n - 1}"
            )
        return some.ravel()


def _numbers(values: Any, name: str, shape: tuple[int, int]) -> np.ndarray:
    """Values of that shape, one row for all repeated. Raises ValueError."""
    try:
        array = np.asarray(values, float)
        if array.ndim == 0 and shape[1] != 1:
            raise ValueError
        return np.broadcast_to(array, shape)
    except (TypeError, ValueError):
        raise ValueError(f"{name} has the shape {np.shape(values)}, not {shape} or ({shape[1]},)") from None


def _require_finite(values: np.ndarray, name: str) -> None:
    """Robots compute in f32."""
    with np.errstate(over="ignore"):
        bad = np.argwhere(~np.isfinite(values.astype(np.float32)))
    if len(bad):
        row, column = bad[0].tolist()
        raise ValueError(f"{name}[{row}, {column}] is {values[row, column]}, not a finite number")
