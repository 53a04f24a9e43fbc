"""Client of the live service: drive robots of a scenario that `taichi_plume.serve` runs, from any Python program.

    from taichi_plume.client import Team

    with Team("127.0.0.1:7447", group="robots") as team:
        for now in team:                                  # once per control period (tick)
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
from taichi_plume.serve.address import address, endpoint, token_of, zenoh_config

if TYPE_CHECKING:
    import zenoh

Maybe = ArrayLike | None


@dataclass(frozen=True)
class Readings:
    """Sensor readings of n external robots at time t [s], as arrays over the robots; tick: number of the time step.

    robot: numbers in the group. position (n, 2) [m] and heading [rad] as the robots estimate them, altitude [m] of
    drones; gas [ppm, or ppm m of a laser] and resistance [ohm], NaN without a metal oxide, of the first gas sensor;
    gases and resistances (n, sensors) of all sensors; wind (n, 2) [m/s], zero where not `wind_known`; blocked: state of
    the bumper; over: whether a robot's search is over; lost: whether a robot stands still for lack of commands;
    answered: number of the last command that each robot has executed.
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
    """Connection of a client to the robots of an external group, or to some of them: readings in, commands out.

    where: HOST:PORT of the service. group: name in the scenario. robots: numbers of the robots, trial by trial; default
    all. token: of the service; default from the environment (TAICHI_PLUME_TOKEN). patience: longest silence of the
    service [s], also at the start. Raises ConnectionError in one line, and ValueError for unknown robots.
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
        self._session: Any = _connected(where, (token or "").strip() or token_of(), patience)
        self._news = threading.Condition()
        self._newest: Readings | None = None
        self._shown, self._ended = -1, False
        self._number = time.time_ns() // 1000  # larger than the numbers of earlier clients
        self._answered = -1  # tick of the last readings that a command has answered
        self._subscriber = self._session.declare_subscriber(f"{self.group}/readings", self._hear)
        self._publisher = self._session.declare_publisher(f"{self.group}/commands")
        if type(self) is Team:  # subclasses have attributes of their own
            self._seal("patience")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Disconnect from the service. The robots then count as lost and stand still."""
        self._session.close()

    # ------------------------------------------------------------ in

    def __iter__(self) -> Iterator[Readings]:
        """Yield the newest readings until the run is over. Readings of missed time steps are skipped.

        Raises ConnectionError if no readings arrive within `patience`.
        """
        while (now := self.wait()) is not None:
            yield now
        if not self._ended:
            what = "no more readings came of" if self._newest else "no readings came of"
            raise ConnectionError(
                f"{what} group {self.group} for {self.patience:g} s; check that the run has a group of kind external "
                "with this name and is still running"
            )

    def wait(self, seconds: float | None = None) -> Readings | None:
        """Wait at most `seconds` (default `patience`) for a new time step; return its readings, or None if the run is
        over or the time has passed. Raises ValueError for unknown robots.
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
        """Decode and store the readings of a received zenoh message and wake `wait`; called in a thread of zenoh."""
        fault, now = "", None
        try:
            message = ros.decode(ros.READINGS, sample.payload.to_bytes())
            if (
                self.robots is not None
                and self.robots.max(initial=0) >= len(message.robot)
                and not message.ended
            ):
                last = len(message.robot) - 1
                fault = f"robot {self.robots.max()} of group {self.group} is none of 0 to {last}"
            elif not message.ended:
                now = _readings(message, slice(None) if self.robots is None else self.robots)
        except (ros.RosError, ValueError, IndexError):  # not a message of the service
            return
        with self._news:
            if now and self.robots is None:
                vars(self)["robots"] = message.robot.copy()
            self._ended |= bool(message.ended)
            self._fault, self._newest = fault, now or self._newest
            self._news.notify_all()

    # ------------------------------------------------------------ out

    def drive(
        self,
        speed: ArrayLike,
        turn_rate: ArrayLike = 0,
        declared: Maybe = None,
        left: Maybe = None,
        climb: Maybe = None,
    ) -> int:
        """Command forward speeds [m/s] and turn rates to the left [rad/s], one for all robots or (n,). Drones also take
        speeds to the left and upward [m/s].

        declared: (n, 2) declared positions of the source [m], NaN for no declaration. Returns the number of the
        command. Raises ValueError for invalid numbers or shapes, and before the first readings unless `robots` were
        given.
        """
        flown = {name: value for name, value in (("left", left), ("climb", climb)) if value is not None}
        return self._send({"speed": speed, "turn_rate": turn_rate} | flown, declared)

    def be_at(
        self, x: ArrayLike, y: ArrayLike, heading: ArrayLike, declared: Maybe = None, z: Maybe = None
    ) -> int:
        """Send the positions [m] and headings [rad] of real robots, (n,) or one for all. z: heights of the lower ends
        of drones [m]. Other arguments as in `drive`.
        """
        flown = {} if z is None else {"z": z}
        return self._send({"x": x, "y": y, "heading": heading} | flown, declared)

    def _send(self, values: dict[str, ArrayLike], declared: Maybe) -> int:
        if self.robots is None:
            raise ValueError("the robots are unknown before the first readings; call wait() first")
        count = len(self.robots)
        fields = {name: _spread(name, value, (count,)) for name, value in values.items()}
        for name, each in fields.items():
            if not np.isfinite(each).all():
                n = self.robots[np.argmin(np.isfinite(each))]
                raise ValueError(f"{name} of robot {n}: got {each[~np.isfinite(each)][0]}, must be finite")
        if declared is not None:
            places = _spread("declared", declared, (count, 2))
            fields |= {"declared_x": places[:, 0], "declared_y": places[:, 1]}
        with self._news:
            # a command answers the readings last returned, once; further commands answer the newest readings
            newest = self._newest.tick if self._newest else 0
            tick = self._shown if self._shown > self._answered else newest
            self._answered = tick
        self._number += 1
        message = ros.message(ros.COMMANDS, number=self._number, tick=tick, robot=self.robots, **fields)
        self._publisher.put(ros.encode(message))
        return self._number


def _numbers(robots: ArrayLike) -> np.ndarray:
    """Return robot numbers, checked to be whole and not negative, as an array (n,). Raises ValueError."""
    given = np.atleast_1d(np.asarray(robots))
    if given.ndim != 1 or not len(given) or not np.issubdtype(given.dtype, np.integer) or given.min() < 0:
        raise ValueError(f"robots: got {robots!r}, must be whole numbers from 0 on")
    return given.astype(np.uint32)


def _spread(name: str, value: ArrayLike, shape: tuple[int, ...]) -> np.ndarray:
    """Return one value for all robots, or one per robot, broadcast to `shape`. Raises ValueError."""
    given = np.asarray(value, float)
    try:
        return np.broadcast_to(given, shape)
    except ValueError:
        raise ValueError(
            f"{name}: got an array of shape {given.shape}, must have shape {shape} or be one value for all robots"
        ) from None


def _readings(message: Any, robots: slice | np.ndarray) -> Readings:
    """Return the readings of the selected robots, taken from a decoded message of the service."""
    count = len(message.robot)
    gases, resistances = (each.reshape(count, -1)[robots] for each in (message.gas, message.resistance))
    fields: dict[str, Any] = vars(message)
    return Readings(
        t=message.t,
        tick=message.tick,
        position=np.column_stack([message.x, message.y])[robots],
        altitude=message.z[robots],
        gas=gases[:, 0],
        resistance=resistances[:, 0],
        gases=gases,
        resistances=resistances,
        wind=np.column_stack([message.wind_x, message.wind_y])[robots],
        **{name: fields[name][robots] for name in ("robot", "heading", "answered")},
        **{name: fields[name][robots] > 0 for name in ("wind_known", "blocked", "over", "lost")},
    )


def _connected(where: str, token: str | None, patience: float) -> "zenoh.Session":
    """Return a zenoh session with the service at HOST:PORT, retried for `patience` [s]. Raises ConnectionError."""
    from argparse import ArgumentTypeError

    try:
        import zenoh

    except ImportError as error:
        raise ConnectionError(f"{error.name} is missing: pip install 'taichi_plume[ros]'") from None
    try:
        end = endpoint(*address(where))
    except ArgumentTypeError as error:
        raise ConnectionError(f"where {error}") from None
    until = time.monotonic() + patience
    while True:
        try:
            return zenoh.open(zenoh_config("client", {"connect": [end]}, token))
        except zenoh.ZError:
            if time.monotonic() > until:
                why = "with this token" if token else "without a token"
                raise ConnectionError(f"{where}: no service answers there, {why}") from None
