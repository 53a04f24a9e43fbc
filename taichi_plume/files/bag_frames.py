"""Where frames are in one another over time, as /tf and /tf_static of a bag tell: the tree that tf2 makes of them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from taichi_plume.files.bags import Bag, BagError, stamp_of
from taichi_plume.files.tables import listed

KIND = "tf2_msgs/msg/TFMessage"
STATIC = "tf_static"
DEEPEST = 100  # frames above one another


class Pose(NamedTuple):
    """Over times: place (n, 3) [m] and heading (n,) [rad]; NaN where it is not known."""

    place: np.ndarray
    heading: np.ndarray


@dataclass(frozen=True)
class Link:
    """A frame in its parent: at times t (n,) [s], place (n, 3) [m], turn (n, 4), a quaternion x, y, z, w."""

    parent: str
    t: np.ndarray
    place: np.ndarray
    turn: np.ndarray
    static: bool

    def at(self, times: np.ndarray) -> tuple[np.ndarray, Rotation]:
        """Places (m, 3), NaN before the first time and after the last, and turns."""
        if self.static or len(self.t) == 1:
            return np.tile(self.place[-1], (len(times), 1)), Rotation.from_quat(
                np.tile(self.turn[-1], (len(times), 1))
            )
        place = np.stack(
            [np.interp(times, self.t, one, left=np.nan, right=np.nan) for one in self.place.T], axis=-1
        )
        turns = Slerp(self.t, Rotation.from_quat(self.turn))
        return place, turns(np.clip(times, self.t[0], self.t[-1]))


class Frames:
    """The frames of a bag that topics tell. stamped: whether times are those of the transforms' stamps, or when they
    were recorded.
    """

    def __init__(self, bag: Bag, stamped: bool, topics: Sequence[str]):
        self.path = bag.path
        self.torn: dict[str, str] = {}
        """What is wrong with frames that were in several others: they lead nowhere."""
        rows: dict[str, list[tuple[float, ...]]] = {}
        parents: dict[str, str] = {}
        fixed: set[str] = set()
        for topic, logged, message in bag.messages(*topics):
            for one in message.transforms:
                parent, child = plain_name(one.header.frame_id), plain_name(one.child_frame_id)
                if parents.setdefault(child, parent) != parent:
                    self.torn[child] = f"frame '{child}' is in '{parents[child]}' and in '{parent}'"
                p, q = one.transform.translation, one.transform.rotation
                row = (stamp_of(one.header) if stamped else logged, p.x, p.y, p.z, q.x, q.y, q.z, q.w)
                rows.setdefault(child, []).append(row)
                if topic.endswith(STATIC):
                    fixed.add(child)
        self.links = {}
        for child, told in rows.items():
            table = np.array(told, float)
            table = table[np.isfinite(table).all(axis=1) & ((table[:, 4:] ** 2).sum(axis=1) > 0)]
            _, first = np.unique(table[:, 0], return_index=True)
            table = table[first]
            if len(table):
                self.links[child] = Link(
                    parents[child], table[:, 0], table[:, 1:4], table[:, 4:], child in fixed
                )

    def chain(self, frame: str, fixed: str) -> list[str] | None:
        """The frames from one up to another that it hangs on, without this; None where it does not."""
        found, frame, fixed = [], plain_name(frame), plain_name(fixed)
        while frame != fixed:
            if frame in self.torn:
                raise BagError(f"{self.path}: {self.torn[frame]}")
            if frame not in self.links or len(found) >= DEEPEST:
                return None
            found.append(frame)
            frame = self.links[frame].parent
        return found

    def require(self, frame: str) -> None:
        """Raise BagError where frames are told, and this is none of them."""
        known = {*self.links, *(link.parent for link in self.links.values())}
        if known and plain_name(frame) not in known:
            raise BagError(f"{self.path}: has no frame '{frame}'; it has {listed(sorted(known))}")

    def carrier(self, chain: list[str]) -> str | None:
        """The frame of the body that a sensor is fixed to: the first of a chain that moves; None where none does."""
        return next((frame for frame in chain if not self.links[frame].static), None)

    def pose(self, chain: list[str], times: np.ndarray) -> Pose:
        """Where the first frame of a chain is in what it hangs on."""
        place, turn = np.zeros((len(times), 3)), Rotation.identity(len(times))
        for frame in chain:
            there, turned = self.links[frame].at(times)
            place, turn = turned.apply(place) + there, turned * turn
        x = turn.apply(np.array([1.0, 0.0, 0.0]))
        heading = np.arctan2(x[:, 1], x[:, 0])
        return Pose(place, np.where(np.isfinite(place).all(axis=1), heading, np.nan))


def topics_for(bag: Bag, gas: str) -> list[str]:
    """The topics of frames in the namespaces of a topic of gas, as each robot may have its own; all where there is
    none.
    """
    found, parts = bag.of_kind(KIND), gas.strip("/").split("/")
    own = [one for one in found if (space := one.strip("/").split("/")[:-1]) == parts[: len(space)]]
    return own or found


def plain_name(frame: str) -> str:
    """A frame's name without the slash that ROS 1 put before."""
    return frame.lstrip("/")
