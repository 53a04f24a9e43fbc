"""What is told to the robots of a group: newest first, whatever comes, from any thread, as often as it comes.

A message is counted as

    taken        the robots that it names do so in the next tick
    malformed    it is no such message, or names numbers that there are not, or no numbers
    oversized    longer than any message of the group can be; it is not even read
    late         it answers readings of long ago, or came after one that was sent later

and none of the last three changes anything.
"""

import threading
import time
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from taichi_plume.agents.external import AWAITED, DRIVEN, LOST, Orders
from taichi_plume.files import ros_messages as ros

HEADROOM = 4096  # bytes of a message besides what it says of each robot
PER_ROBOT = 64  # bytes
IN_JSON = 8  # times the bytes of the same message
UNNUMBERED = 0  # a command that has no number, as of ROS


class MalformedError(ValueError):
    """What is wrong with a message, in a line."""


class Inbox:
    """Of one group of `size` robots (all trials), which take poses if `placed`.

    low, high: of the floor, in which poses lie [m]; timeout [s]; clock: seconds; ceiling: up to where its robots fly
    [m], None if they do not. remark: called with a line about a message that is not taken, from the thread in which it
    came.
    """

    def __init__(
        self,
        group: str,
        size: int,
        placed: bool,
        floor: tuple[Sequence[float], Sequence[float]],
        timeout: float,
        remark: Callable[[str], None] = lambda line: None,
        clock: Callable[[], float] = time.monotonic,
        ceiling: float | None = None,
    ):
        self.group, self.size, self.placed, self.timeout = group, size, placed, timeout
        self.low, self.high = (np.asarray(corner[:2], float) for corner in floor)
        self.remark, self.clock, self.ceiling = remark, clock, ceiling
        self.longest = HEADROOM + PER_ROBOT * size
        self.counts: Counter[str] = Counter()
        self.news = threading.Condition()
        """Held while what follows changes, and notified then."""
        self.heard = np.full(size, -np.inf)  # when, by the clock
        self.number = np.zeros(size, np.uint64)  # number of the last command
        self.answers = np.full(size, -1, np.int64)  # tick of the readings that it answers
        self.oldest = 0  # tick of readings that may still be answered
        self.tick = 0  # of the newest readings
        self._orders = Orders.none(size)

    # ------------------------------------------------------------ threads of the transports

    def hear_commands(self, data: bytes, json: bool = False) -> None:
        """A message of taichi_plume_msgs/Commands came; json: as a text."""
        self._hear(ros.COMMANDS, data, json, self._take_commands)

    def hear_twist(self, n: int, data: bytes, json: bool = False) -> None:
        """A geometry_msgs/Twist for robot n came."""
        self._hear("geometry_msgs/msg/Twist", data, json, lambda one: self._take_twist(n, one))

    def hear_pose(self, n: int, data: bytes, json: bool = False) -> None:
        """A geometry_msgs/PoseStamped of robot n came."""
        self._hear("geometry_msgs/msg/PoseStamped", data, json, lambda one: self._take_pose(n, one))

    def _hear(self, name: str, data: bytes, json: bool, take: Callable[[Any], None]) -> None:
        longest = self.longest * (IN_JSON if json else 1)
        if len(data) > longest:
            self._refuse("oversized", f"{len(data):,} bytes, more than the {longest:,} of any message")
            return
        try:
            take((ros.from_json if json else ros.decode)(name, data))
        except (ros.RosError, MalformedError) as error:
            self._refuse("malformed", str(error))

    def _refuse(self, what: str, why: str) -> None:
        with self.news:
            self.counts[what] += 1
            count = self.counts[what]
        if count & (count - 1) == 0:  # the first, and fewer and fewer
            self.remark(f"{self.group}: {what} messages: {count:,}, the last one: {why}")

    def _take_commands(self, one: Any) -> None:
        robots = one.robot.astype(np.int64)
        if not len(robots):
            raise MalformedError("names no robot")
        if robots.max() >= self.size:
            raise MalformedError(f"robot {robots.max()} is none of 0 to {self.size - 1}")
        if one.tick > self.tick:
            raise MalformedError(f"answers readings of tick {one.tick}, the newest are of {self.tick}")
        if self.placed and len(one.speed) and not len(one.x):
            raise MalformedError("velocities, but the group takes poses")
        if not self.placed and len(one.x) and not len(one.speed):
            raise MalformedError("poses, but the group takes velocities")
        if self.placed:
            place = self._columns(one, len(robots), "x", "y", "heading")
            self._require_inside(place[:, :2])
            values = {"position": place[:, :2], "heading": place[:, 2]} | self._flown(one, len(robots), "z")
        else:
            speeds = self._columns(one, len(robots), "speed", "turn_rate")
            values = {"speed": speeds[:, 0], "turn_rate": speeds[:, 1]}
            values |= self._flown(one, len(robots), "left") | self._flown(one, len(robots), "climb")
        declared = None
        if len(one.declared_x) or len(one.declared_y):
            declared = self._columns(one, len(robots), "declared_x", "declared_y", finite=False)
        self._take(robots, values, one.number, one.tick, declared)

    def _take_twist(self, n: int, one: Any) -> None:
        if self.placed:
            raise MalformedError("a velocity, but the group takes poses")
        speeds = np.array([[one.linear.x, one.angular.z, one.linear.y, one.linear.z]])
        if not np.isfinite(speeds.astype(np.float32)).all():
            raise MalformedError("linear or angular.z is no number")
        values = {"speed": speeds[:, 0], "turn_rate": speeds[:, 1]}
        values |= self._in_the_air("left", speeds[:, 2]) | self._in_the_air("climb", speeds[:, 3])
        self._take(np.array([n]), values, UNNUMBERED, 0)

    def _take_pose(self, n: int, one: Any) -> None:
        if not self.placed:
            raise MalformedError("a pose, but the group takes velocities")
        place = np.array([[one.pose.position.x, one.pose.position.y]])
        heading = np.array([ros.yaw(one.pose.orientation)])
        if not np.isfinite(place).all() or not np.isfinite(heading).all():
            raise MalformedError("position or orientation is no number")
        self._require_inside(place)
        values = {"position": place, "heading": heading}
        if self.ceiling is not None:
            height = np.array([one.pose.position.z])
            if not np.isfinite(height).all():
                raise MalformedError("position.z is no number")
            values |= self._in_the_air("z", height)
        self._take(np.array([n]), values, UNNUMBERED, 0)

    def _flown(self, one: Any, count: int, name: str) -> dict[str, np.ndarray]:
        """What is told of drones alone, if it is. Raises MalformedError."""
        if not len(getattr(one, name)):
            return {}
        return self._in_the_air(name, self._columns(one, count, name)[:, 0])

    def _in_the_air(self, name: str, values: np.ndarray) -> dict[str, np.ndarray]:
        """The same, of values that there are; robots of the floor are told nothing else than zero."""
        if self.ceiling is None:
            if values.any():
                raise MalformedError(f"{name} is of drones, the group's robots do not fly")
            return {}
        if name == "z" and ((values < 0.0) | (values > self.ceiling)).any():
            raise MalformedError(f"z is not between the floor and the ceiling, {self.ceiling:g} m")
        return {"altitude" if name == "z" else name: values}

    def _columns(self, one: Any, count: int, *names: str, finite: bool = True) -> np.ndarray:
        """What a message says of its robots, (count, names). Raises MalformedError."""
        for name in names:
            if len(getattr(one, name)) != count:
                raise MalformedError(f"{name} has {len(getattr(one, name))} entries, robot has {count}")
        values = np.column_stack([getattr(one, name) for name in names]).astype(float)
        wrong = np.isinf(values) | (np.isnan(values) if finite else False)
        if wrong.any():
            n, column = np.argwhere(wrong)[0]
            raise MalformedError(f"{names[column]} of robot {one.robot[n]} is no number")
        return values

    def _require_inside(self, places: np.ndarray) -> None:
        outside = ((places < self.low) | (places > self.high)).any(axis=1)
        if outside.any():
            x, y = places[outside.argmax()]
            raise MalformedError(f"({x:.4g}, {y:.4g}) m is not on the floor")

    def _take(
        self,
        robots: np.ndarray,
        values: dict[str, np.ndarray],
        number: int,
        tick: int,
        declared: np.ndarray | None = None,
    ) -> None:
        with self.news:
            now = self.clock()
            gone = now - self.heard[robots] > self.timeout  # who comes back may count anew
            newest = self.number[robots][~gone].max(initial=UNNUMBERED)
            outrun = number != UNNUMBERED and number <= newest
            if not outrun and not (tick != 0 and tick < self.oldest):
                self.counts["taken"] += 1
                for name, given in values.items():
                    getattr(self._orders, name)[robots] = given
                if declared is not None:
                    said = np.isfinite(declared).all(axis=1)
                    self._orders.declared[robots[said]] = declared[said]
                self.heard[robots], self.number[robots] = now, number
                # what tells no tick answers the newest readings
                self.answers[robots] = self.tick if number == UNNUMBERED else tick
                self.news.notify_all()
                return
            oldest = self.oldest
        if outrun:
            why = f"number {number} came after {newest}; does another client drive these robots?"
        else:
            why = (
                f"answers readings of tick {tick}, those before {oldest} are too old; wait for new ones first"
            )
        self._refuse("late", why)

    # ------------------------------------------------------------ the thread of the clock

    def published(self, tick: int, oldest: int) -> None:
        """Readings of a tick have been sent; those before `oldest` need not be answered any more."""
        with self.news:
            self.tick, self.oldest = tick, oldest

    def begin(self) -> None:
        """The run begins: however long some have waited for others, none is lost yet."""
        with self.news:
            self.heard[np.isfinite(self.heard)] = self.clock()

    def lost(self) -> np.ndarray:
        """Which robots have been silent for too long, of those that have been heard of."""
        return np.isfinite(self.heard) & (self.clock() - self.heard > self.timeout)

    def awaited(self) -> np.ndarray:
        """Which robots have not been heard of yet."""
        return ~np.isfinite(self.heard)

    def orders(self) -> Orders:
        """What the robots are told for the next tick; those that are lost, or not heard of yet, stand."""
        with self.news:
            lost, awaited = self.lost(), self.awaited()
            state = np.where(awaited, AWAITED, np.where(lost, LOST, DRIVEN))
            ours, driven = self._orders, state == DRIVEN
            orders = Orders(
                state,
                np.where(driven, ours.speed, 0.0),
                np.where(driven, ours.turn_rate, 0.0),
                ours.position.copy(),
                ours.heading.copy(),
                ours.declared.copy(),
                np.where(driven, ours.left, 0.0),
                np.where(driven, ours.climb, 0.0),
                ours.altitude.copy(),
            )
            ours.declared[:] = np.nan  # is said once
            return orders
