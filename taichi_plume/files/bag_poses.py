"""Positions of the robots of a ROS bag, in one frame, by default map.

Sources of a robot's positions are, in this order,

    1. the frame of its gas messages, if /tf leads from it to the target frame,
    2. pose topics in the target frame, by header.frame_id, and then those in frames that /tf connects to it: first by
       name, then by type,
    3. the body frame of /tf, if one is named base_link or base_footprint, or if there are no pose topics.

Of these, the source with poses around most readings counts. If nothing leads to the target frame and the user names no
frame, positions are in another frame, with a remark, and frames of odometry, which drift, come last.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from taichi_plume.files import ros_messages as ros
from taichi_plume.files.bag_frames import BODIES, Frames, Pose, carrier
from taichi_plume.files.bag_topics import POINTS, POSES, measured_poses, only, pose_topics, shared_parts
from taichi_plume.files.bags import Bag, BagError, Sample, Series, short, stamp_of
from taichi_plume.files.tables import listed

GAP = 2.0
"""Longest time [s] between two poses that counts as a recording without gaps."""
LEADING, UNNAMED, FIXED, DRIFTING = range(4)
"""Kinds of frames, preferred first: one that leads to the target frame, none, another, another of odometry."""


class Motion(NamedTuple):
    """Motion of a robot by a source of positions: poses `way` at times t (n,) [s] in a frame.

    here: poses of the gas sensor at its readings. kind: of the source's frame, order: among sources of this kind.
    topic: of the source, "" for a frame; text: description of the source.
    """

    kind: int
    order: tuple[float, ...]
    topic: str
    t: np.ndarray
    way: Pose
    here: Pose
    frame: str
    text: str
    remarks: list[str]


@dataclass(frozen=True)
class Positions:
    """Sources of the positions of a robot in a bag. frame: that the user names, or None; target: frame of positions.

    stamped: times are header stamps; alone: the bag has one robot; known: pose topics that were read, by name.
    """

    bag: Bag
    frame: str | None
    target: str
    frames: Frames
    stamped: bool
    alone: bool
    known: dict[str, Series]

    def motion(self, gas: Series, read_at: np.ndarray, given: str | None) -> Motion:
        """Return the motion of the robot with this gas topic, see the module. Raises BagError.

        read_at: times of the readings (m,) [s]; given: topic or frame of its poses that the user names.
        """
        if given and given not in self.bag.kinds and ros.plain_name(given) in self.frames.names:
            sources = [self._by_frame(ros.plain_name(given), (), read_at)]
        elif given:
            self.bag.require(given, POSES)
            sources = [self._by_topic(given, gas.topic, read_at)]
        else:
            self.bag.require_one_frame(gas, "; choose the robot's positions with --pose")
            sources = self._sources(gas, read_at)
        motion = self._best(sources, gas.topic, read_at)
        if motion.kind > UNNAMED:
            known = {topic: self._series(topic).frame for topic in measured_poses(self.bag)}
            others = [
                f"{topic} in {frame}" for topic, frame in known.items() if frame not in ("", motion.frame)
            ]
            motion.remarks.append(
                f"positions are in frame {motion.frame}: nothing leads from there to frame {self.target} "
                f"(--frame chooses){'; other poses: ' + listed(others) if others else ''}"
            )
        return motion if given else self._at_sensor(motion, gas.frame, read_at)

    def _sources(self, gas: Series, read_at: np.ndarray) -> list[Motion]:
        """Return all sources of the positions of the robot with this gas topic."""
        topics = pose_topics(self.bag, gas.topic, self.alone)
        found = [self._by_topic(topic, gas.topic, read_at) for topic in topics]
        fixed = self.frames.root(gas.frame, self.target)
        chain = self.frames.chain(gas.frame, fixed)
        if chain and (fixed == self.target or carrier(chain) is not None or not topics):
            return [self._by_frame(gas.frame, (-1,), read_at), *found]
        bodies = self.frames.bodies()
        nearest = max((shared_parts(gas.topic, body) for body in bodies), default=0)
        bodies = [body for body in bodies if shared_parts(gas.topic, body) == nearest]
        if bodies and not found:
            only(self.bag, bodies, f"several frames that may carry {gas.topic or 'a robot'}", "--pose")
        if (
            len(bodies) == 1
            and (self.alone or nearest)
            and (not found or bodies[0].rpartition("/")[2] in BODIES)
        ):
            found.append(self._by_frame(bodies[0], (2,), read_at))
            found[-1].remarks.append(f"the robot is assumed to be frame {bodies[0]} (--pose chooses)")
        return found

    def _best(self, sources: list[Motion], gas: str, read_at: np.ndarray) -> Motion:
        """Return the source that counts, see the module. Raises BagError."""
        bag, target = self.bag, self.target
        inside = [source for source in sources if source.kind <= UNNAMED or not self.frame]
        if not inside:
            known = {self._series(topic).frame for topic in bag.of_kind(*POSES)} - {""} | self.frames.names
            if self.frame and known:
                what = f"no pose leads from {gas} to frame" if target in known else "has no frame"
                raise BagError(f"{bag.path}: {what} '{target}'; it has {listed(sorted(known))}")
            raise BagError(
                f"{bag.path}: has no poses for {gas or 'a robot'}: neither frames that lead to it nor a topic of them "
                f"({short(POSES)}); it has {bag.contents}"
            )
        share = [_coverage(source, read_at) for source in inside]
        rank = [(not s, way.kind, -round(s, 1), way.order) for way, s in zip(inside, share, strict=True)]
        best = inside[rank.index(min(rank))]
        if best.topic:
            same = [way.topic for way in inside if (way.kind, way.order) == (best.kind, best.order)]
            only(bag, same, f"several topics of poses for {gas}", "--pose")
            bag.require_one_frame(self._series(best.topic))
        return best

    def _series(self, topic: str) -> Series:
        if topic not in self.known:
            self.known[topic] = self.bag.series(topic, _pose_of(self.bag, topic))
        return self.known[topic]

    def _kind(self, frame: str) -> int:
        leads = self.frames.root(frame, self.target) == self.target
        return UNNAMED if not frame else LEADING if leads else DRIFTING if "odom" in frame.lower() else FIXED

    def _by_frame(self, frame: str, order: tuple[float, ...], read_at: np.ndarray) -> Motion:
        """Return the motion of a frame, that of a sensor or a body, in the target frame, or else in its root."""
        frames = self.frames
        fixed = frames.root(frame, self.target)
        chain = frames.chain(frame, fixed) or []
        body = carrier(chain)
        t = np.unique(read_at[np.isfinite(read_at)]) if body is None else chain[body][0].t
        t, way = in_order(t, frames.pose(chain[body or 0 :], t))
        here, text = frames.pose(chain, read_at), f"{frame} in frame {fixed}"
        return Motion(self._kind(fixed), order, "", t, way, here, fixed, text, [])

    def _by_topic(self, topic: str, gas: str, read_at: np.ndarray) -> Motion:
        """Return the motion by a pose topic, by /tf in the target frame if possible."""
        frames, target, series = self.frames, self.target, self._series(topic)
        given = Pose(series.values[:, :3], series.values[:, 3])
        t, way = in_order(series.times(self.stamped and series.is_stamped), given)
        frame, text, remarks = series.frame or target, f"{topic} in frame {series.frame or target}", []
        if self.stamped and not series.is_stamped:
            remarks.append(f"times of {topic} are those of recording, as its messages have no stamp")
        if len(t) < len(series.values):
            count = f"{len(series.values) - len(t)} of {len(series.values)}"
            remarks.append(f"{count} poses of {topic} repeat a time or are no numbers")
        if not series.frame:
            remarks.append(f"messages of {topic} name no frame: frame {target} is assumed")
        if self.bag.kinds[topic] == POINTS[0]:
            remarks.append(f"messages of {topic} have no heading: that of the motion is assumed")
            if len(t) > 1:
                x, y = np.gradient(way.place[:, :2], t, axis=0).T
                way = Pose(way.place, np.arctan2(y, x))
        order = (frame != target, -shared_parts(gas, topic), POSES.index(self.bag.kinds[topic]))
        chain = frames.chain(frame, target)
        if chain:
            t, way = in_order(t, frames.pose(chain, t, way))
            frame, text = target, f"{text}, by /tf in {target}"
        here = between(t, way, read_at)
        return Motion(self._kind(series.frame), order, topic, t, way, here, frame, text, remarks)

    def _at_sensor(self, motion: Motion, sensor: str, read_at: np.ndarray) -> Motion:
        """Return a motion with the poses of a sensor's frame that is mounted on the body, if /tf says so."""
        if not sensor or sensor == motion.frame or motion.order == (-1,):
            return motion
        line = self.frames.line(sensor)
        chain = self.frames.chain(sensor, line[-1]) or []
        mount = chain[: carrier(chain)]
        if not mount:
            first = self.bag.first(motion.topic) if motion.topic else None
            if sensor.rpartition("/")[2] not in BODIES and sensor != ros.plain_name(
                getattr(first, "child_frame_id", "")
            ):
                motion.remarks.append(f"no frame leads to {sensor}: its readings are at the robot's position")
            return motion
        x, y, z = self.frames.pose(mount, read_at[:1]).place[0]
        c, s = np.cos(motion.here.heading), np.sin(motion.here.heading)
        shift = np.stack([x * c - y * s, x * s + y * c, np.full(len(c), z)], axis=-1)
        body = f"those of {line[len(mount)]}, on which {sensor} is mounted"
        motion.remarks.append(f"the poses of {motion.text} are assumed to be {body}")
        return motion._replace(here=motion.here._replace(place=motion.here.place + shift))


def gaps(t: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Return the times between the poses at t (n,) [s] that are before and after `times`; 0 at a pose itself."""
    after = np.clip(np.searchsorted(t, times), 0, len(t) - 1)
    return np.where(t[after] == times, 0.0, t[after] - t[np.maximum(after - 1, 0)])


def _coverage(motion: Motion, read_at: np.ndarray) -> float:
    """Return the share of readings with poses around them; those more than GAP apart count less."""
    if not len(read_at) or not len(motion.t):
        return float(len(motion.t) > 0)
    near = GAP / np.maximum(gaps(motion.t, read_at), GAP)
    return float(np.where(np.isfinite(motion.here.place).all(axis=1), near, 0.0).mean())


def _pose_of(bag: Bag, topic: str) -> Callable[[ros.Message], Sample]:
    """Return a function that extracts stamp, frame and x, y, z [m], heading [rad] from a message of a pose topic."""
    kind = bag.kinds[topic]

    def get(message: ros.Message) -> Sample:
        if kind == POINTS[1]:
            return Sample(0.0, "", (message.x, message.y, 0.0, message.theta))
        heading = 0.0
        if kind == POINTS[0]:
            at = message.point
        elif kind == POSES[3]:
            at, heading = message.transform.translation, ros.yaw(message.transform.rotation)
        else:
            pose = message.pose if kind == POSES[2] else message.pose.pose
            at, heading = pose.position, ros.yaw(pose.orientation)
        place = (at.x, at.y, at.z if np.isfinite(at.z) else 0.0, heading)
        return Sample(stamp_of(message.header), message.header.frame_id, place)

    return get


def in_order(t: np.ndarray, way: Pose) -> tuple[np.ndarray, Pose]:
    """Return sorted unique times [s] and the poses then, without those that are not finite."""
    good = np.isfinite(t) & np.isfinite(way.place).all(axis=1) & np.isfinite(way.heading)
    t, first = np.unique(t[good], return_index=True)
    return t, Pose(way.place[good][first], way.heading[good][first])


def between(t: np.ndarray, way: Pose, times: np.ndarray) -> Pose:
    """Interpolate poses `way` given at times t to other times [s]; NaN before the first and after the last."""
    if not len(t):
        return Pose(np.full((len(times), 3), np.nan), np.full(len(times), np.nan))
    columns = [*way.place.T, np.unwrap(way.heading)]
    x, y, z, heading = (np.interp(times, t, column, left=np.nan, right=np.nan) for column in columns)
    return Pose(np.stack([x, y, z], axis=-1), heading)
