"""Interface of a user's own algorithm to its robots: readings, commands, source declarations and radio messages."""

from collections.abc import Callable, Generator
from contextlib import contextmanager

import numpy as np
from numpy.typing import ArrayLike

from taichi_plume.agents.columns import Column, Columns, columns_of
from taichi_plume.guard.attributes import KnownAttributes

GOALS = (Columns.goal, Columns.goal_heading)
"""Additional columns that an own algorithm commands for drones, see `Robots.go_to`."""


def readable_columns(flies: bool) -> tuple[Column, ...]:
    """Return the columns (quantities of robots) that own algorithms may read. flies: whether the swarm has drones."""
    return tuple(column for column in columns_of(flies) if column.read_as)


def writable_columns(flies: bool) -> tuple[Column, ...]:
    """Return the columns (quantities of robots) that own algorithms may set. flies: whether the swarm has drones."""
    return tuple(column for column in columns_of(flies) if column.written_as)


class Outputs:
    """Declarations, messages of `words` numbers and flight goals of n robots in a tick: `places` (n, 2) [m], NaN if
    none; `speaks` and `message`; `goals` (n, 3) [m] and `goal_headings` [rad], NaN for drones that fly by their speeds.
    """

    def __init__(self, n: int, words: int):
        self.goals, self.goal_headings = np.full((n, 3), np.nan), np.full(n, np.nan)
        self.places = np.full((n, 2), np.nan)
        self.speaks, self.message = np.zeros(n, bool), np.zeros((n, words))


class Robots(KnownAttributes):
    """Robots of an algorithm: readings and commands, as arrays over the n robots.

    Read: `reading` [ppm], the first column of `readings` (n, gas sensors) [ppm], above those in clean air; `wind` (n,
    2) [m/s], zero if not `wind_known`; `ranges` (n, range sensors) [m]; `position` (n, 2) [m], `heading` [rad] and
    `path_length` [m], with the errors of the group's `localization`; `blocked`, the bumper; `trial` and `robot`,
    numbers of each; `t`, `dt` [s]; of classes with a MESSAGE `heard` (n, robots of a team, MESSAGE), the last message
    from each mate, NaN if none, and `heard_at` (n, robots of a team), its time [s]. Write: `speed` [m/s]; `turn_rate`
    [rad/s]; `state`, whole numbers that index the algorithm's STATE_NAMES. Other attributes cannot be set:
    AttributeError. Call: `turn_to`, `declare`, `tell`, `prior`; `said` holds the calls of this step.

    Of drones also, read: `altitude` [m]. Write: `left_speed` [m/s], `climb_rate` [m/s]. Call in each step: `go_to`.

    >>> import numpy as np, taichi_plume as tp
    >>> class Upwind:
    ...     def act(self, robots: tp.Robots):
    ...         robots.turn_to(np.arctan2(-robots.wind[:, 1], -robots.wind[:, 0]))
    ...         robots.speed[:] = 0.2
    >>> sim = tp.Simulation("plumesim_casting", overrides={"robots.0.algorithm": tp.Own(Upwind)})
    >>> before = sim.robots.x
    >>> sim.run(until=5)  # the wind blows towards larger x
    >>> bool((sim.robots.x < before).all())
    True
    """

    reading: np.ndarray
    wind: np.ndarray
    wind_known: np.ndarray
    position: np.ndarray
    heading: np.ndarray
    path_length: np.ndarray
    blocked: np.ndarray
    speed: np.ndarray
    turn_rate: np.ndarray
    state: np.ndarray
    altitude: np.ndarray
    left_speed: np.ndarray
    climb_rate: np.ndarray

    def __init__(
        self,
        trial: np.ndarray,
        robot: np.ndarray,
        heard: np.ndarray,
        heard_at: np.ndarray,
        flies: bool = False,
        turn_time: float = 0.0,
        prior: Callable[[float], np.ndarray] | None = None,
    ):
        n = len(trial)
        self.flies, self._turn_time, self._prior = flies, turn_time, prior
        self.trial, self.robot = trial, robot
        self.t, self.dt = 0.0, 0.0
        self.heard, self.heard_at = heard, heard_at
        self.readings, self.ranges = np.zeros((n, 1)), np.zeros((n, 0))
        self.said = Outputs(n, heard.shape[2])
        arrays = {column.read_as: column.zeros(n) for column in readable_columns(flies)}
        for column in writable_columns(flies):
            arrays[column.written_as] = np.zeros(n, int if column.dtype is np.int32 else float)
        for name, array in arrays.items():
            setattr(self, name, array)
        self.STATE = ("t", "dt", *arrays)

    @contextmanager
    def sealed(self) -> Generator[None]:
        """Context in which a user's code may set only the command attributes; others raise AttributeError."""
        self._seal(*(column.written_as for column in writable_columns(self.flies)))
        try:
            yield
        finally:
            self._open()

    def turn_to(self, course: ArrayLike) -> None:
        """Set turn rates that bring the headings to `course` [rad] within a time step, or as soon as the bodies can.

        With late poses of a camera the turn is slower, so that the robots do not overshoot.
        """
        off = np.asarray(course) - self.heading
        self.turn_rate = (off - 2 * np.pi * np.round(off / (2 * np.pi))) / max(self.dt, self._turn_time)

    def go_to(
        self,
        x: ArrayLike,
        y: ArrayLike,
        z: ArrayLike,
        heading: ArrayLike | None = None,
        which: ArrayLike | None = None,
    ) -> None:
        """Command drones to fly straight to a position in this time step, as fast as they can stop there.

        x, y, z [m], z of the lower end of the body, and heading [rad], by default controlled by `turn_rate`: a number
        for all drones or one each. which: as for `declare`, by default all. Raises ValueError.
        """
        if not self.flies:
            raise ValueError("go_to needs drones: give body.kind: drone")
        indices = np.arange(len(self.trial)) if which is None else self._numbers(which)
        try:
            goals = np.stack(
                [np.broadcast_to(np.asarray(values, float), len(indices)) for values in (x, y, z)], axis=1
            )
            to = np.broadcast_to(np.asarray(np.nan if heading is None else heading, float), len(indices))
        except (TypeError, ValueError):
            raise ValueError(f"x, y, z and heading are numbers, one for all or {len(indices)} each") from None
        _require_finite(goals, "place")
        if heading is not None:
            _require_finite(to[:, None], "heading")
        self.said.goals[indices], self.said.goal_headings[indices] = goals, to

    def declare(self, which: ArrayLike, place: ArrayLike | None = None) -> None:
        """Declare that a source is at `place`, by default at the believed positions of the declaring robots.

        which: a boolean mask over the robots, or a list of robot indices; place: (2,) for all declaring robots or one
        row per declaring robot (k, 2) [m]. Raises ValueError.
        """
        indices = self._numbers(which)
        places = self.position[indices] if place is None else _numbers(place, "place", (len(indices), 2))
        _require_finite(places, "place")
        self.said.places[indices] = places

    def tell(self, values: ArrayLike, which: ArrayLike | None = None) -> None:
        """Send a message to the senders' teams; teammates in range receive it a time step later.

        values: (MESSAGE,) or a row per sender (k, MESSAGE). which: senders as for `declare`, by default all. Raises
        ValueError.
        """
        words = self.said.message.shape[1]
        if not words:
            raise ValueError("the class has no MESSAGE: add MESSAGE, the count of numbers in a message")
        indices = np.arange(len(self.trial)) if which is None else self._numbers(which)
        message = _numbers(values, "values", (len(indices), words))
        _require_finite(message, "values")
        self.said.speaks[indices], self.said.message[indices] = True, message

    def prior(self, cell: float) -> np.ndarray:
        """Return the scenario's prior of the source on square cells of edge `cell` [m], (nx, ny), sum 1.

        The first cell is at the lower corner of the robots' floor. The prior is uniform unless the algorithm's key
        `prior` gives another. Raises ValueError.
        """
        if self._prior is None or not cell > 0.0:
            raise ValueError(f"cell is {cell}; must be a positive length in metres")
        weights = self._prior(cell)
        return weights / weights.sum()

    def _numbers(self, which: ArrayLike) -> np.ndarray:
        """Return the indices of the robots that the mask or index list `which` selects. Raises ValueError."""
        n, indices = len(self.trial), np.asarray(which)
        if indices.dtype == bool and indices.shape in ((n,), ()):
            return np.flatnonzero(np.broadcast_to(indices, n))
        if indices.size == 0 and indices.ndim <= 1:
            return np.zeros(0, int)
        whole = np.issubdtype(indices.dtype, np.integer) and indices.ndim <= 1
        if not whole or indices.min() < 0 or indices.max() >= n:
            raise ValueError(
                f"which must be a boolean mask of length {n} or a list of robot indices from 0 to {n - 1}"
            )
        return indices.ravel()


def _numbers(values: ArrayLike, name: str, shape: tuple[int, int]) -> np.ndarray:
    """Return `values` as an array of this shape, repeating a single row. Raises ValueError that names the argument."""
    try:
        array = np.asarray(values, float)
        if array.ndim == 0 and shape[1] != 1:
            raise ValueError
        return np.broadcast_to(array, shape)
    except (TypeError, ValueError):
        raise ValueError(f"{name} has the shape {np.shape(values)}, not {shape} or ({shape[1]},)") from None


def _require_finite(values: np.ndarray, name: str) -> None:
    """Raise ValueError, with the argument's name, if a value is not finite in f32, the robots' precision."""
    with np.errstate(over="ignore"):
        bad = np.argwhere(~np.isfinite(values.astype(np.float32)))
    if len(bad):
        row, column = bad[0].tolist()
        raise ValueError(f"{name}[{row}, {column}] is {values[row, column]}, not a finite number")
