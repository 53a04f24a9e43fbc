"""Coordinate frames of a ROS bag over time, from /tf and /tf_static: the transform tree of tf2."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from taichi_plume.files import ros_messages as ros
from taichi_plume.files.bags import Bag, BagError, stamp_of

KIND = "tf2_msgs/msg/TFMessage"
STATIC = "tf_static"
DEEPEST = 100  # frames of a chain
BODIES = ("base_link", "base_footprint")
"""Usual names of a robot's body frame (REP 105), preferred names first."""


class Pose(NamedTuple):
    """Positions (n, 3) [m] and headings (n,) [rad] of a body at n times; NaN where unknown."""

    place: np.ndarray
    heading: np.ndarray


@dataclass(frozen=True)
class Link:
    """Transform of a frame in its parent: times t (n,) [s], place (n, 3) [m], turn: quaternions x, y, z, w (n, 4)."""

    parent: str
    t: np.ndarray
    place: np.ndarray
    turn: np.ndarray
    static: bool

    def at(self, times: np.ndarray) -> tuple[np.ndarray, Rotation]:
        """Interpolate to `times` (m,) [s]: return positions (m, 3), NaN outside the recorded times, and rotations."""
        if self.static or len(self.t) == 1:
            place, turn = (np.tile(values[-1], (len(times), 1)) for values in (self.place, self.turn))
            return place, Rotation.from_quat(turn)
        axes = [np.interp(times, self.t, axis, left=np.nan, right=np.nan) for axis in self.place.T]
        turns = Slerp(self.t, Rotation.from_quat(self.turn))
        return np.stack(axes, axis=-1), turns(np.clip(times, self.t[0], self.t[-1]))


Step = tuple[Link, bool]
"""Link of a chain of frames, which leads from child to parent, or back if the second entry is true."""


class Frames:
    """Transform tree from the /tf topics of a bag. stamped: use header stamps instead of recording times."""

    def __init__(self, bag: Bag, stamped: bool, topics: Sequence[str]):
        self.path = bag.path
        self.torn: dict[str, str] = {}
        """Error of each frame that has several parents; such frames lead nowhere."""
        rows: dict[str, list[tuple[float, ...]]] = {}
        parents: dict[str, str] = {}
        fixed: set[str] = set()
        for topic, logged, message in bag.messages(*topics):
            for link in message.transforms:
                parent, child = ros.plain_name(link.header.frame_id), ros.plain_name(link.child_frame_id)
                if parents.setdefault(child, parent) != parent:
                    self.torn[child] = f"frame '{child}' is in '{parents[child]}' and in '{parent}'"
                p, q = link.transform.translation, link.transform.rotation
                row = (stamp_of(link.header) if stamped else logged, p.x, p.y, p.z, q.x, q.y, q.z, q.w)
                rows.setdefault(child, []).append(row)
                if topic.endswith(STATIC):
                    fixed.add(child)
        self.links = {}
        for child, known in rows.items():
            table = np.array(known, float)
            table = table[np.isfinite(table).all(axis=1) & ((table[:, 4:] ** 2).sum(axis=1) > 0)]
            t, first = np.unique(table[:, 0], return_index=True)
            table = table[first]
            if len(table):
                self.links[child] = Link(parents[child], t, table[:, 1:4], table[:, 4:], child in fixed)

    def line(self, frame: str) -> list[str]:
        """Return a frame and its ancestors, up to one without a parent; the frame alone if frames form a loop."""
        line = [frame]
        while line[-1] in self.links and line[-1] not in self.torn:
            parent = self.links[line[-1]].parent
            if parent in line or len(line) >= DEEPEST:
                return line[:1]
            line.append(parent)
        return line

    def chain(self, frame: str, fixed: str) -> list[Step] | None:
        """Return the steps from `frame` by the nearest common ancestor to `fixed`; None if they are not connected.

        Raises BagError if the frame, or an ancestor on the way, has several parents.
        """
        up, down = self.line(frame), self.line(fixed)
        common = next((name for name in up if name in down), None)
        if common is None:
            if up[-1] in self.torn:
                raise BagError(f"{self.path}: {self.torn[up[-1]]}")
            return None
        back = [(self.links[name], True) for name in reversed(down[: down.index(common)])]
        return [*((self.links[name], False) for name in up[: up.index(common)]), *back]

    @property
    def names(self) -> set[str]:
        """Names of all frames in the bag's transforms."""
        return {*self.links, *(link.parent for link in self.links.values())}

    def bodies(self) -> list[str]:
        """Return the frames that may be robots: those of usual names, or else moving ones that carry none.

        Of the usual names, BODIES, the first that a frame has counts.
        """
        moving = []
        for name, line in ((name, self.line(name)) for name in self.links):
            if line[-1] not in self.torn and any(not self.links[up].static for up in line[:-1]):
                moving.append(name)
        for body in BODIES:
            if named := [name for name in moving if name.rpartition("/")[2] == body]:
                return named
        movers = [name for name in moving if not self.links[name].static]
        carrying = {up for name in movers for up in self.line(name)[1:]}
        return [name for name in movers if name not in carrying]

    def root(self, frame: str, target: str) -> str:
        """Return the frame `target` if `frame` leads to it, or else the frame's ancestor that has no parent."""
        return self.line(frame)[-1] if self.chain(frame, target) is None else target

    def pose(self, chain: Sequence[Step], times: np.ndarray, body: Pose | None = None) -> Pose:
        """Return the pose of a chain's first frame at `times` (n,) [s], in the frame to which the chain leads.

        body: poses (n) in the first frame, which are returned in the last frame instead.
        """
        place, turn = np.zeros((len(times), 3)), Rotation.identity(len(times))
        if body is not None:
            place, turn = body.place, Rotation.from_rotvec(np.outer(body.heading, [0.0, 0.0, 1.0]))
        for link, is_inverse in chain:
            there, turned = link.at(times)
            if is_inverse:
                there, turned = -turned.inv().apply(there), turned.inv()
            place, turn = turned.apply(place) + there, turned * turn
        x = turn.apply(np.array([1.0, 0.0, 0.0]))
        heading = np.arctan2(x[:, 1], x[:, 0])
        return Pose(place, np.where(np.isfinite(place).all(axis=1), heading, np.nan))


def carrier(chain: Sequence[Step]) -> int | None:
    """Return the index of a chain's first frame that moves in its parent, the robot's body; None if all are static."""
    return next((n for n, (link, _) in enumerate(chain) if not link.static), None)


def topics_for(bag: Bag, gas: str) -> list[str]:
    """Return the transform topics in the namespaces around a gas topic, as each robot may have its own; else all."""
    topics, parts = bag.of_kind(KIND), gas.strip("/").split("/")
    own = [topic for topic in topics if (space := topic.strip("/").split("/")[:-1]) == parts[: len(space)]]
    return own or topics
