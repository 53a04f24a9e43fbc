"""Client that drives robots of a scenario served by `taichi_plume.serve`, from any Python program.

    from taichi_plume.client import Team

    with Team("127.0.0.1:7447", group="robots") as team:
        for now in team:                                  # once per tick
            upwind = np.arctan2(-now.wind[:, 1], -now.wind[:, 0])
            team.drive(speed=0.1, turn_rate=upwind - now.heading)

Needs the packages of `pip install 'taichi_plume[ros]'`, and neither Taichi nor a scenario.
"""

import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike

from taichi_plume.files import ros_messages as ros
from taichi_plume.guard.attributes import KnownAttributes
from taichi_plume.serve.address import address, token_of

if TYPE_CHECKING:
    import zenoh


@dataclass(frozen=True)
class Readings:
    """Readings of a team at time t [s], arrays over its n robots.

    robot: numbers in the group. position (n, 2) [m] and heading [rad]: believed pose; altitude [m], of drones; gas
    [ppm, or ppm m of a laser] and resistance [ohm], NaN without a metal oxide, of the first gas sensor; gases and
    resistances (n, sensors) of all sensors; wind (n, 2) [m/s], zero where not `wind_known`; blocked: bumper contact;
    over: whether the robot's search is over; lost: whether the robot stands without commands; answered: number of the
    last executed command of each robot.
    """

    t: float
    tick: int
    robot: np.ndarray
    position: np.ndarray
    altitude: np.ndarray
    heading: np.ndarray
    gas: np.ndarray
    resistance: np.ndarray
    gases: np.ndarray
    resistances: np.ndarray
    wind: np.ndarray
    wind_known: np.ndarray
    blocked: np.ndarray
    over: np.ndarray
    lost: np.ndarray
    answered: np.ndarray


class Team(KnownAttributes):
    """The robots of an external group, or some of them.

    where: HOST:PORT of the service. group: its name in the scenario. robots: their numbers, trial by trial (default:
    all). token: of the service; by default from the environment (TAICHI_PLUME_TOKEN). patience: longest silence of the
    service [s], also at the start. Raises ConnectionError, in a line, and ValueError for unknown robots.
    """

    def __init__(
        self,
        where: str = "127.0.0.1:7447",
        group: str = "robots",
        robots: Sequence[int] | None = None,
        token: str | None = None,
        patience: float = 60.0,
    ):
        self.group, self.patience = ros.word(group), patience
        self.robots = None if robots is None else _numbers(robots)
        self._fault = ""
        self._session = _connected(where, (token or "").strip() or token_of(), patience)
        self._news = threading.Condition()
        self._newest: Readings | None = None
        self._shown, self._ended = -1, False
        self._number = time.time_ns() // 1000  # ahead of older clients: they send less than one per us
        self._answered = -1  # tick of the readings that were shown and answered
        self._subscriber = self._session.declare_subscriber(f"{self.group}/readings", self._hear)
        self._publisher = self._session.declare_publisher(f"{self.group}/commands")
        if type(self) is Team:  # subclasses have attributes of their own
            self._seal("patience")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Disconnect; the robots are lost then, and stand still."""
        self._session.close()

    # ------------------------------------------------------------ in

    def __iter__(self) -> Iterator[Readings]:
        """Yield the newest readings of each tick until the run ends; ticks that passed meanwhile are skipped.

        Raises ConnectionError if the service is silent.
        """
        while (now := self.wait()) is not None:
            yield now
        if not self._ended:
            what = "nothing came any more of" if self._newest else "no readings came of"
            raise ConnectionError(
                f"{what} group {self.group} for {self.patience:g} s; is there such a group of kind external, and does "
                "its run go on?"
            )

    def wait(self, seconds: float | None = None) -> Readings | None:
        """Return the readings of a new tick; None if the run has ended, or after `seconds` (default: `patience`).

        Raises ValueError for unknown robots.
        """
        with self._news:
            seconds = self.patience if seconds is None else seconds
            self._news.wait_for(lambda: self._is_new() or self._ended or self._fault, seconds)
            if self._fault:
                raise ValueError(self._fault)
            if not self._is_new():
                return None
            now = self._newest
            assert now is not None
            self._shown = now.tick
            return now

    def _is_new(self) -> bool:
        return self._newest is not None and self._newest.tick > self._shown

    def _hear(self, sample: "zenoh.Sample") -> None:
        """Receive readings, in a thread of zenoh."""
        try:
            message = ros.decode(ros.READINGS, sample.payload.to_bytes())
            ended, count = message.ended, len(message.robot)
            unknown = not ended and self.robots is not None and self.robots.max(initial=0) >= count
            now = None if ended or unknown else _readings(message, self.robots)
        except (ros.RosError, ValueError, IndexError):  # not by the service
            return
        with self._news:
            if now is not None:
                if self.robots is None:
                    vars(self)["robots"] = message.robot.copy()
                self._newest = now
            elif ended:
                self._ended = True
            else:
                assert self.robots is not None
                self._fault = f"robot {self.robots.max()} of group {self.group} is none of 0 to {count - 1}"
            self._news.notify_all()

    # ------------------------------------------------------------ out

    def drive(
        self,
        speed: ArrayLike,
        turn_rate: ArrayLike = 0.0,
        declared: ArrayLike | None = None,
        left: ArrayLike | None = None,
        climb: ArrayLike | None = None,
    ) -> int:
        """Command forward speeds [m/s] and turn rates to the left [rad/s], one for all robots or (n,); of drones also
        speeds to the left and upward [m/s].

        declared: (n, 2) declared source positions [m], NaN: none. Returns the command's number. Raises ValueError for
        values that are no numbers or of another shape, and before the first readings, unless `robots` were given.
        """
        return self._send(declared, speed=speed, turn_rate=turn_rate, left=left, climb=climb)

    def be_at(
        self,
        x: ArrayLike,
        y: ArrayLike,
        heading: ArrayLike,
        declared: ArrayLike | None = None,
        z: ArrayLike | None = None,
    ) -> int:
        """Send positions [m] and headings [rad] of real robots, (n,) or one for all; else as `drive`.

        z: altitude of the lower ends of drones [m].
        """
        return self._send(declared, x=x, y=y, heading=heading, z=z)

    def _send(self, declared: ArrayLike | None, **values: ArrayLike | None) -> int:
        if self.robots is None:
            raise ValueError("which robots there are is not known before the first readings; wait for them")
        count = len(self.robots)
        given = {name: value for name, value in values.items() if value is not None}
        fields = {name: _spread(name, value, (count,)) for name, value in given.items()}
        for name, each in fields.items():
            if not np.isfinite(each).all():
                n = self.robots[np.argmin(np.isfinite(each))]
                raise ValueError(f"{name} of robot {n}: got {each[~np.isfinite(each)][0]}, takes a number")
        if declared is not None:
            places = _spread("declared", declared, (count, 2))
            fields |= {"declared_x": places[:, 0], "declared_y": places[:, 1]}
        with self._news:
            # readings that were shown are answered once; a command without waiting answers the newest ones
            newest = self._newest.tick if self._newest else 0
            tick = self._shown if self._shown > self._answered else newest
            self._answered = tick
        self._number += 1
        message = ros.message(ros.COMMANDS, number=self._number, tick=tick, robot=self.robots, **fields)
        self._publisher.put(ros.encode(message))
        return self._number


def _numbers(robots: ArrayLike) -> np.ndarray:
    """Return numbers of robots as an array. Raises ValueError."""
    given = np.atleast_1d(np.asarray(robots))
    if given.ndim != 1 or not len(given) or not np.issubdtype(given.dtype, np.integer) or given.min() < 0:
        raise ValueError(f"robots: got {robots!r}, takes numbers from 0 on")
    return given.astype(np.uint32)


def _spread(name: str, value: ArrayLike, shape: tuple[int, ...]) -> np.ndarray:
    """Broadcast a value to all robots. Raises ValueError."""
    given = np.asarray(value, float)
    try:
        return np.broadcast_to(given, shape)
    except ValueError:
        raise ValueError(
            f"{name}: got an array of shape {given.shape}, takes one of {shape}, or one for all robots"
        ) from None


def _readings(message: Any, robots: np.ndarray | None) -> Readings:
    """Return the readings of some robots, or of all, from a message."""
    some = slice(None) if robots is None else robots
    gases, resistances = (
        values.reshape(len(message.robot), -1)[some] for values in (message.gas, message.resistance)
    )
    flags = {name: vars(message)[name][some] > 0 for name in ("wind_known", "blocked", "over", "lost")}
    return Readings(
        t=message.t,
        tick=message.tick,
        robot=message.robot[some],
        position=np.column_stack([message.x, message.y])[some],
        altitude=message.z[some],
        heading=message.heading[some],
        gas=gases[:, 0],
        resistance=resistances[:, 0],
        gases=gases,
        resistances=resistances,
        wind=np.column_stack([message.wind_x, message.wind_y])[some],
        answered=message.answered[some],
        **flags,
    )


def _connected(where: str, token: str | None, patience: float) -> "zenoh.Session":
    """Connect to a service, which may still be starting. Raises ConnectionError."""
    from argparse import ArgumentTypeError

    try:
        import zenoh

        from taichi_plume.serve.zenoh_config import config, endpoint
    except ImportError as error:
        raise ConnectionError(f"{error.name} is missing: pip install 'taichi_plume[ros]'") from None
    try:
        end = endpoint(*address(where))
    except ArgumentTypeError as error:
        raise ConnectionError(f"where {error}") from None
    until = time.monotonic() + patience
    while True:
        try:
            return zenoh.open(config("client", {"connect": [end]}, token))
        except zenoh.ZError:
            if time.monotonic() > until:
                why = "with this token" if token else "without a token"
                raise ConnectionError(f"{where}: no service answers there, {why}") from None
