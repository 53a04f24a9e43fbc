"""Inbox for the commands to a group of external robots: validates messages and keeps the newest command per robot.

A message is counted as

    taken        the robots execute the command in the next time step (tick)
    malformed    wrong type, unknown robots or values that are not numbers
    oversized    longer than any valid message of the group; not decoded
    late         answers readings that are too old, or arrived after a newer command

Messages of the last three kinds have no effect. All methods are thread-safe.
"""

import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np

from taichi_plume.agents.external import AWAITED, DRIVEN, LOST, Orders
from taichi_plume.files import ros_messages as ros
from taichi_plume.files.ros_robots import MapFrame
from taichi_plume.guard.terminal import visible

HEADROOM = 4096  # bytes of a message without the entries of the robots
PER_ROBOT = 64  # bytes per robot
IN_JSON = 8  # largest ratio of the lengths in JSON and CDR
DOMAIN = MapFrame()
UNNUMBERED = 0  # number of commands without a sequence number, such as those of ROS

NEEDED = {"poses": ("x", "y", "heading"), "velocities": ("speed", "turn_rate")}
FLOWN = {"poses": ("z",), "velocities": ("left", "climb")}
"""Fields of `Commands` that a group takes, and those that drones may take too."""
DECLARED = ("declared_x", "declared_y")
ORDERS = (*NEEDED["poses"], *NEEDED["velocities"], "z", "left", "climb", *DECLARED)
LARGEST = float(np.finfo(np.float32).max)

RosMessage: TypeAlias = Any
"""Decoded ROS message, with the fields of its type."""


class MalformedError(ValueError):
    """Error of an invalid message, described in one line."""


class Inbox:
    """Inbox of one group of `size` robots (all trials), which takes poses if `placed`, else velocities.

    floor: lower and upper corner of the valid positions [m]; timeout [s]; clock: returns seconds; ceiling: greatest
    height of drones [m], None for ground robots; frame: of poses in ROS messages. remark: called with a line about a
    refused message, in the thread of the transport.
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
        frame: MapFrame = DOMAIN,
    ):
        self.group, self.size, self.placed, self.timeout = group, size, placed, timeout
        self.low, self.high = (np.asarray(corner[:2], float) for corner in floor)
        self.remark, self.clock, self.ceiling = remark, clock, ceiling
        self.frame = frame
        self.longest = HEADROOM + PER_ROBOT * size
        self.counts: Counter[str] = Counter()
        self.news = threading.Condition()
        """Lock of the attributes below; notified when they change."""
        self.heard = np.full(size, -np.inf)  # time of the last command, by the clock
        self.number = np.zeros(size, np.uint64)  # sequence number of the last command
        self.answers = np.full(size, -1, np.int64)  # tick of the readings that the last command answers
        self.oldest = 0  # oldest tick whose readings may still be answered
        self.tick = 0  # tick of the newest readings
        self._orders = Orders.none(size)

    # ------------------------------------------------------------ threads of the transports

    def hear_commands(self, data: bytes, json: bool = False) -> None:
        """Process a message of type taichi_plume_msgs/Commands, encoded in CDR or, with `json`, in JSON."""
        self._hear(ros.COMMANDS, data, json, self._take_commands)

    def hear_twist(self, n: int, data: bytes, json: bool = False) -> None:
        """Process a geometry_msgs/Twist as the velocity command of robot n; data, json: as for `hear_commands`."""
        self._hear("geometry_msgs/msg/Twist", data, json, lambda twist: self._take_twist(n, twist))

    def hear_pose(self, n: int, data: bytes, json: bool = False) -> None:
        """Process a geometry_msgs/PoseStamped as the pose of robot n; data, json: as for `hear_commands`."""
        self._hear("geometry_msgs/msg/PoseStamped", data, json, lambda stamped: self._take_pose(n, stamped))

    def _hear(self, name: str, data: bytes, json: bool, take: Callable[[RosMessage], None]) -> None:
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
        if count & (count - 1) == 0:  # the first, second, fourth, eighth ...
            self.remark(f"{self.group}: {what} messages: {count:,}, the last one: {why}")

    def _take_commands(self, given: RosMessage) -> None:
        robots, fields = given.robot.astype(np.int64), vars(given)
        if not len(robots):
            raise MalformedError("its field 'robot' is empty; give robot numbers")
        if robots.max() >= self.size:
            raise MalformedError(f"robot {robots.max()} does not exist; allowed: 0 to {self.size - 1}")
        if given.tick > self.tick:
            raise MalformedError(f"answers readings of tick {given.tick}, the newest are of {self.tick}")
        self._take(robots, {name: fields[name] for name in ORDERS}, given.number, given.tick)

    def _take_twist(self, n: int, twist: RosMessage) -> None:
        linear = {"speed": [twist.linear.x], "left": [twist.linear.y], "climb": [twist.linear.z]}
        self._take(np.array([n]), {**linear, "turn_rate": [twist.angular.z]})

    def _take_pose(self, n: int, stamped: RosMessage) -> None:
        at, frame = stamped.pose.position, ros.plain_name(stamped.header.frame_id)
        if frame not in ("", self.frame.name):
            raise MalformedError(f"a pose in frame '{visible(frame)}'; allowed: {self.frame.name}")
        x, y = self.frame.corner
        values = {"x": [at.x - x], "y": [at.y - y], "heading": [ros.yaw(stamped.pose.orientation)]}
        height = {} if self.ceiling is None else {"z": [at.z]}
        sent = f"; sent as ({at.x:.4g}, {at.y:.4g}) m of frame {self.frame.name}" if x or y else ""
        self._take(np.array([n]), values | height, sent=sent)

    def _columns(self, robots: np.ndarray, fields: Mapping[str, Any]) -> dict[str, np.ndarray]:
        """Return the values of the given fields, each with an entry per robot. Raises MalformedError."""
        own, other = ("poses", "velocities") if self.placed else ("velocities", "poses")
        given = {name for name, values in fields.items() if len(values)}
        if given.intersection(NEEDED[other]) and not given.intersection(NEEDED[own]):
            raise MalformedError(f"{other}, but the group takes {own}")
        taken = given.intersection(FLOWN[own]).union(NEEDED[own], DECLARED if given & {*DECLARED} else ())
        columns: dict[str, np.ndarray] = {}
        for name in sorted(taken):
            columns[name] = values = np.array(fields[name], float)
            if len(values) != len(robots):
                raise MalformedError(f"{name} has {len(values)} entries, robot has {len(robots)}")
            wrong = np.abs(values) > LARGEST if name in DECLARED else ~(np.abs(values) <= LARGEST)
            if wrong.any():
                raise MalformedError(f"{name} of robot {robots[wrong.argmax()]} is no number")
        return columns

    def _orders_in(self, columns: dict[str, np.ndarray], sent: str) -> dict[str, np.ndarray]:
        """Return orders by the fields of `Orders`; sent: end of the text about a position. Raises MalformedError."""
        orders = {name: columns[name] for name in ("speed", "turn_rate", "heading") if name in columns}
        if self.placed:
            orders["position"] = places = np.column_stack([columns["x"], columns["y"]])
            outside = ((places < self.low) | (places > self.high)).any(axis=1)
            if outside.any():
                x, y = places[outside.argmax()]
                edges = zip("xy", self.low, self.high, strict=True)
                floor = ", ".join(f"{axis} {low:.4g} to {high:.4g} m" for axis, low, high in edges)
                raise MalformedError(f"({x:.4g}, {y:.4g}) m is not on the floor, {floor} of the domain{sent}")
        for name in ("left", "climb", "z"):
            values = columns.get(name, np.zeros(0))
            if self.ceiling is None and values.any():
                raise MalformedError(f"{name} is for drones, the group's robots do not fly")
            if name == "z" and ((values < 0.0) | (values > (self.ceiling or 0.0))).any():
                raise MalformedError(f"z is not between the floor and the ceiling, {self.ceiling:g} m")
            if self.ceiling is not None and len(values):
                orders["altitude" if name == "z" else name] = values
        return orders

    def _take(
        self,
        robots: np.ndarray,
        fields: Mapping[str, Any],
        number: int = UNNUMBERED,
        tick: int = 0,
        sent: str = "",
    ) -> None:
        """Take the command of fields with an entry per robot, unless the command is late. Raises MalformedError."""
        columns = self._columns(robots, fields)
        orders = self._orders_in(columns, sent)
        with self.news:
            now = self.clock()
            gone = now - self.heard[robots] > self.timeout  # a lost robot's client may restart its numbers
            newest = self.number[robots][~gone].max(initial=UNNUMBERED)
            outrun = number != UNNUMBERED and number <= newest
            if not outrun and not (tick != 0 and tick < self.oldest):
                self.counts["taken"] += 1
                for name, given in orders.items():
                    getattr(self._orders, name)[robots] = given
                if "declared_x" in columns:
                    declared = np.column_stack([columns[name] for name in DECLARED])
                    complete = np.isfinite(declared).all(axis=1)
                    self._orders.declared[robots[complete]] = declared[complete]
                self.heard[robots], self.number[robots] = now, number
                # a command without a number answers the newest readings
                self.answers[robots] = self.tick if number == UNNUMBERED else tick
                self.news.notify_all()
                return
            oldest = self.oldest
        if outrun:
            why = f"number {number} came after {newest}; does another client drive these robots?"
        else:
            why = f"answers readings of tick {tick}, ticks before {oldest} are too old; wait for new readings"
        self._refuse("late", why)

    # ------------------------------------------------------------ the thread of the clock

    def published(self, tick: int, oldest: int) -> None:
        """Note that readings of time step `tick` were sent; commands that answer steps before `oldest` are now late."""
        with self.news:
            self.tick, self.oldest = tick, oldest

    def begin(self) -> None:
        """Start the timeouts of all robots that have already sent a command, at the start of the run."""
        with self.news:
            self.heard[np.isfinite(self.heard)] = self.clock()

    def lost(self) -> np.ndarray:
        """Return a mask of the robots that have sent a command, but none within the timeout."""
        return np.isfinite(self.heard) & (self.clock() - self.heard > self.timeout)

    def awaited(self) -> np.ndarray:
        """Return a mask of the robots that have not sent a command yet."""
        return ~np.isfinite(self.heard)

    def orders(self) -> Orders:
        """Return the robots' orders for the next time step; robots that are lost or not connected yet stand still."""
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
            ours.declared[:] = np.nan  # a declaration counts once
            return orders
