"""Drive robots of a scenario that `taichi_plume.serve` runs, from any program in Python.

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
from typing import Any, Self

import numpy as np

from taichi_plume.files import ros_messages as ros
from taichi_plume.guard.attributes import KnownAttributes
from taichi_plume.serve.address import address, token_of


@dataclass(frozen=True)
class Readings:
    """What the robots of a team read at time t [s], arrays over its n robots.

    robot: their numbers in the group. position (n, 2) [m] and heading [rad], where they believe to be, and altitude
    [m], of drones; gas [ppm, or ppm m of a laser] and resistance [ohm], NaN without a metal oxide, of the first gas
    sensor; gases and resistances (n, sensors) of all; wind (n, 2) [m/s], zero where not `wind_known`; blocked: the
    bumper; over: whether the search of a robot is over; lost: whether it stands as nothing was heard of it; answered:
    number of the last command that each has carried out.
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

    where: HOST:PORT of the service. group: the scenario's name of it. robots: their numbers, trial by trial; unless
    given, all. token: that of the service, unless given from the environment (TAICHI_PLUME_TOKEN). patience: how long
    the service may be silent [s], at the begin too. Raises ConnectionError, in a line, and ValueError of other robots
    than there are.
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
        """Leave; the robots are lost then, and stand still."""
        self._session.close()

    # ------------------------------------------------------------ in

    def __iter__(self) -> Iterator[Readings]:
        """The newest readings of each tick, until the run is over; ticks that went by meanwhile are left out.

        Raises ConnectionError where nothing comes any more.
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
        """The readings of a tick that has not been shown yet; None where the run is over, or none comes in time:
        `patience`, unless given. Raises ValueError where there are no such robots.
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

    def _hear(self, sample: Any) -> None:
        """Readings came, in a thread of zenoh's."""
        try:
            one = ros.decode(ros.READINGS, sample.payload.to_bytes())
            if one.ended:
                with self._news:
                    self._ended = True
                    self._news.notify_all()
                return
            if self.robots is not None and self.robots.max(initial=0) >= len(one.robot):
                with self._news:
                    most = len(one.robot) - 1
                    self._fault = f"robot {self.robots.max()} of group {self.group} is none of 0 to {most}"
                    self._news.notify_all()
                return
            now = _readings(one, slice(None) if self.robots is None else self.robots)
        except (ros.RosError, ValueError, IndexError):  # not by the service
            return
        with self._news:
            if self.robots is None:
                vars(self)["robots"] = one.robot.copy()
            self._newest = now
            self._news.notify_all()

    # ------------------------------------------------------------ out

    def drive(
        self, speed: Any, turn_rate: Any = 0.0, declared: Any = None, left: Any = None, climb: Any = None
    ) -> int:
        """Command forward speeds [m/s] and turn rates to the left [rad/s], one for all robots or (n,); of drones also
        speeds to the left and upward [m/s].

        declared: (n, 2) places where robots say that a source is [m], NaN: say nothing. Returns the command's number.
        Raises ValueError of what is no number or not of so many robots, and before the first readings, unless `robots`
        were given.
        """
        flown = {name: one for name, one in (("left", left), ("climb", climb)) if one is not None}
        return self._send({"speed": speed, "turn_rate": turn_rate} | flown, declared)

    def be_at(self, x: Any, y: Any, heading: Any, declared: Any = None, z: Any = None) -> int:
        """Tell where real robots are [m] and where they look to [rad], (n,) or one for all; else as `drive`. z: how
        high the lower ends of drones are [m].
        """
        flown = {} if z is None else {"z": z}
        return self._send({"x": x, "y": y, "heading": heading} | flown, declared)

    def _send(self, values: dict[str, Any], declared: Any) -> int:
        if self.robots is None:
            raise ValueError("which robots there are is not known before the first readings; wait for them")
        count = len(self.robots)
        fields = {name: _spread(name, value, (count,)) for name, value in values.items()}
        for name, each in fields.items():
            if not np.isfinite(each).all():
                n = self.robots[np.argmin(np.isfinite(each))]
                raise ValueError(f"{name} of robot {n}: got {each[~np.isfinite(each)][0]}, takes a number")
        if declared is not None:
            places = _spread("declared", declared, (count, 2))
            fields |= {"declared_x": places[:, 0], "declared_y": places[:, 1]}
        with self._news:
            # readings that were shown are answered once; what is told without waiting for some answers the newest
            newest = self._newest.tick if self._newest else 0
            tick = self._shown if self._shown > self._answered else newest
            self._answered = tick
        self._number += 1
        one = ros.message(ros.COMMANDS, number=self._number, tick=tick, robot=self.robots, **fields)
        self._publisher.put(ros.encode(one))
        return self._number


def _numbers(robots: Any) -> np.ndarray:
    """Numbers of robots. Raises ValueError."""
    given = np.atleast_1d(np.asarray(robots))
    if given.ndim != 1 or not len(given) or not np.issubdtype(given.dtype, np.integer) or given.min() < 0:
        raise ValueError(f"robots: got {robots!r}, takes numbers from 0 on")
    return given.astype(np.uint32)


def _spread(name: str, value: Any, shape: tuple[int, ...]) -> np.ndarray:
    """A value for all robots or for each. Raises ValueError."""
    given = np.asarray(value, float)
    try:
        return np.broadcast_to(given, shape)
    except ValueError:
        raise ValueError(
            f"{name}: got an array of shape {given.shape}, takes one of {shape}, or one for all robots"
        ) from None


def _readings(one: Any, some: Any) -> Readings:
    """Those of some robots of a message."""
    gases, resistances = (each.reshape(len(one.robot), -1)[some] for each in (one.gas, one.resistance))
    known, blocked, over, lost = (
        getattr(one, name)[some] > 0 for name in ("wind_known", "blocked", "over", "lost")
    )
    return Readings(
        one.t,
        one.tick,
        one.robot[some],
        np.column_stack([one.x, one.y])[some],
        one.z[some],
        one.heading[some],
        gases[:, 0],
        resistances[:, 0],
        gases,
        resistances,
        np.column_stack([one.wind_x, one.wind_y])[some],
        known,
        blocked,
        over,
        lost,
        one.answered[some],
    )


def _connected(where: str, token: str | None, patience: float) -> Any:
    """A session with a service, which may still be starting. Raises ConnectionError."""
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
