"""Coordinate frames of a ROS bag over time, from /tf and /tf_static: the transform tree of tf2."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from taichi_plume.files.bags import Bag, BagError, stamp_of

KIND = "tf2_msgs/msg/TFMessage"
STATIC = "tf_static"
DEEPEST = 100  # frames of a chain


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
                parent, child = plain_name(link.header.frame_id), plain_name(link.child_frame_id)
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

    def chain(self, frame: str, fixed: str) -> list[str] | None:
        """Return the frames from `frame` up to, but without, its ancestor `fixed`; None if they are not connected."""
        found, frame, fixed = [], plain_name(frame), plain_name(fixed)
        while frame != fixed:
            if frame in self.torn:
                raise BagError(f"{self.path}: {self.torn[frame]}")
            if frame not in self.links or len(found) >= DEEPEST:
                return None
            found.append(frame)
            frame = self.links[frame].parent
        return found

    @property
    def names(self) -> set[str]:
        """Names of all frames in the bag's transforms."""
        return {*self.links, *(link.parent for link in self.links.values())}

    def root(self, frame: str) -> str:
        """Return the frame's ancestor that has no parent; the frame itself if there is none, or frames form a loop."""
        at = plain_name(frame)
        for _ in range(DEEPEST):
            if at not in self.links or at in self.torn:
                return at
            at = self.links[at].parent
        return plain_name(frame)

    def carrier(self, chain: list[str]) -> str | None:
        """Return the body frame of a robot: a chain's first frame that moves in its parent; None if all are static."""
        return next((frame for frame in chain if not self.links[frame].static), None)

    def pose(self, chain: list[str], times: np.ndarray, body: Pose | None = None) -> Pose:
        """Return the pose of a chain's first frame at `times` (n,) [s], in the parent of the chain's last frame.

        body: poses (n) in the first frame, which are returned in that parent instead.
        """
        place, turn = np.zeros((len(times), 3)), Rotation.identity(len(times))
        if body is not None:
            place, turn = body.place, Rotation.from_rotvec(np.outer(body.heading, [0.0, 0.0, 1.0]))
        for frame in chain:
            there, turned = self.links[frame].at(times)
            place, turn = turned.apply(place) + there, turned * turn
        x = turn.apply(np.array([1.0, 0.0, 0.0]))
        heading = np.arctan2(x[:, 1], x[:, 0])
        return Pose(place, np.where(np.isfinite(place).all(axis=1), heading, np.nan))


def topics_for(bag: Bag, gas: str) -> list[str]:
    """Return the transform topics in the namespaces around a gas topic, as each robot may have its own; else all."""
    topics, parts = bag.of_kind(KIND), gas.strip("/").split("/")
    own = [topic for topic in topics if (space := topic.strip("/").split("/")[:-1]) == parts[: len(space)]]
    return own or topics


def plain_name(frame: str) -> str:
    """Return the name of a coordinate frame without the leading slash of ROS 1."""
    return frame.lstrip("/")
