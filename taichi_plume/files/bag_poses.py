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
from taichi_plume.files.bags import Bag, BagError, Sample, Series, stamp_of
from taichi_plume.files.tables import listed

GAP = 2.0
"""Longest time [s] between two poses that counts as a recording without gaps."""
LEADING, UNNAMED, FIXED, DRIFTING = range(4)
"""Kinds of frames, preferred first: one that leads to the target frame, none, another, another of odometry."""


class Motion(NamedTuple):
    """Motion of a robot: poses `way` at times t (n,) [s] in a frame; here: poses of the gas sensor at its readings.

    text: the topic or frame that gave them.
    """

    t: np.ndarray
    way: Pose
    here: Pose
    frame: str
    text: str
    remarks: list[str]


class Source(NamedTuple):
    """Source of positions: the kind of its frame, its order among others of this kind, its topic or "", the motion."""

    kind: int
    order: tuple[float, ...]
    topic: str
    motion: Motion


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
        source = self._best(sources, gas.topic, read_at)
        motion = source.motion
        if source.kind > UNNAMED:
            known = {topic: self._series(topic).frame for topic in measured_poses(self.bag)}
            others = [f"{topic} in {one}" for topic, one in known.items() if one not in ("", motion.frame)]
            motion.remarks.append(
                f"positions are in frame {motion.frame}: nothing leads from there to frame {self.target} "
                f"(--frame chooses){'; other poses: ' + listed(others) if others else ''}"
            )
        return motion if given else self._at_sensor(motion, source, gas.frame, read_at)

    def _sources(self, gas: Series, read_at: np.ndarray) -> list[Source]:
        """Return all sources of the positions of the robot with this gas topic."""
        topics = pose_topics(self.bag, gas.topic, self.alone)
        found = [self._by_topic(topic, gas.topic, read_at) for topic in topics]
        chain = self.frames.chain(gas.frame, self.frames.root(gas.frame, self.target)) if gas.frame else None
        if chain and (self._leads(gas.frame) or carrier(chain) is not None or not topics):
            return [self._by_frame(gas.frame, (-1,), read_at), *found]
        bodies = self.frames.bodies()
        nearest = [shared_parts(gas.topic, body) for body in bodies]
        bodies = [body for body, near in zip(bodies, nearest, strict=True) if near == max(nearest)]
        if bodies and (self.alone or max(nearest)) and (not found or bodies[0].rpartition("/")[2] in BODIES):
            if not found:
                only(self.bag, bodies, f"several frames that may carry {gas.topic or 'a robot'}", "--pose")
            if len(bodies) == 1:
                body = self._by_frame(bodies[0], (2,), read_at)
                body.motion.remarks.append(f"the robot is assumed to be frame {bodies[0]} (--pose chooses)")
                found.append(body)
        return found

    def _best(self, sources: list[Source], gas: str, read_at: np.ndarray) -> Source:
        """Return the source that counts, see the module. Raises BagError."""
        bag, target = self.bag, self.target
        if self.frame and not any(source.kind <= UNNAMED for source in sources):
            known = {self._series(topic).frame for topic in bag.of_kind(*POSES)} | self.frames.names
            what = f"no pose leads from {gas} to frame" if target in known else "has no frame"
            if known - {""}:
                raise BagError(f"{bag.path}: {what} '{target}'; it has {listed(sorted(known - {''}))}")
        if not sources:
            has = listed(
                [f"{topic} ({kind.replace('/msg/', '/')})" for topic, kind in sorted(bag.kinds.items())]
            )
            accepted = ", ".join(kind.replace("/msg/", "/") for kind in POSES)
            raise BagError(
                f"{bag.path}: has no poses for {gas or 'a robot'}: neither frames that lead to it nor a topic of them "
                f"({accepted}); it has {has}"
            )
        share = [_coverage(source.motion, read_at) for source in sources]
        rank = [(not s, one.kind, -round(s, 1), one.order) for one, s in zip(sources, share, strict=True)]
        best = sources[rank.index(min(rank))]
        if best.topic:
            same = [one.topic for one in sources if (one.kind, one.order) == (best.kind, best.order)]
            only(bag, same, f"several topics of poses for {gas}", "--pose")
            bag.require_one_frame(self._series(best.topic))
        return best

    def _series(self, topic: str) -> Series:
        if topic not in self.known:
            self.known[topic] = self.bag.series(topic, _pose_of(self.bag, topic))
        return self.known[topic]

    def _leads(self, frame: str) -> bool:
        return self.frames.chain(frame, self.target) is not None

    def _kind(self, frame: str) -> int:
        if not frame:
            return UNNAMED
        return LEADING if self._leads(frame) else DRIFTING if "odom" in frame.lower() else FIXED

    def _by_frame(self, frame: str, order: tuple[float, ...], read_at: np.ndarray) -> Source:
        """Return the motion of a frame, that of a sensor or a body, in the target frame, or else in its root."""
        frames = self.frames
        fixed = frames.root(frame, self.target)
        chain = frames.chain(frame, fixed) or []
        body = carrier(chain)
        t = np.unique(read_at[np.isfinite(read_at)]) if body is None else chain[body].link.t
        t, way = _finite(t, frames.pose(chain[body or 0 :], t))
        motion = Motion(t, way, frames.pose(chain, read_at), fixed, f"{frame} in frame {fixed}", [])
        return Source(self._kind(fixed), order, "", motion)

    def _by_topic(self, topic: str, gas: str, read_at: np.ndarray) -> Source:
        """Return the motion by a pose topic, by /tf in the target frame if possible."""
        frames, target, series = self.frames, self.target, self._series(topic)
        t, values = in_order(series.times(self.stamped and series.is_stamped), series.values)
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
                values[:, 3] = np.arctan2(np.gradient(values[:, 1], t), np.gradient(values[:, 0], t))
        way = Pose(values[:, :3], values[:, 3])
        order = (frame != target, -shared_parts(gas, topic), POSES.index(self.bag.kinds[topic]))
        chain = frames.chain(frame, target)
        if chain:
            t, way = _finite(t, frames.pose(chain, t, way))
            frame, text = target, f"{text}, by /tf in {target}"
        motion = Motion(t, way, between(t, way, read_at), frame, text, remarks)
        return Source(self._kind(series.frame), order, topic, motion)

    def _at_sensor(self, motion: Motion, source: Source, sensor: str, read_at: np.ndarray) -> Motion:
        """Return a motion with the poses of a sensor's frame that is mounted on the body, if /tf says so."""
        if not sensor or sensor == motion.frame or source.order == (-1,):
            return motion
        line = self.frames.line(sensor)
        chain = self.frames.chain(sensor, line[-1]) or []
        mount = chain[: carrier(chain)]
        if not mount:
            first = self.bag.first(source.topic) if source.topic else None
            body = ros.plain_name(getattr(first, "child_frame_id", ""))
            if sensor.rpartition("/")[2] not in BODIES and sensor != body:
                motion.remarks.append(
                    f"no frame leads to {sensor}: its readings are taken at the robot's position"
                )
            return motion
        place, heading = motion.here
        offset = self.frames.pose(mount, read_at[:1]).place[0]
        c, s = np.cos(heading), np.sin(heading)
        ahead, left, up = offset
        shift = np.stack([ahead * c - left * s, ahead * s + left * c, np.full(len(c), up)], axis=-1)
        motion.remarks.append(
            f"the poses of {motion.text} are assumed to be those of {line[len(mount)]}, on which {sensor} is mounted"
        )
        return motion._replace(here=Pose(place + shift, heading))


def gaps(t: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Return the times between the poses at t (n,) [s] that are before and after `times`; 0 at a pose itself."""
    if not len(t):
        return np.full(len(times), np.inf)
    after = np.clip(np.searchsorted(t, times), 0, len(t) - 1)
    return np.where(t[after] == times, 0.0, t[after] - t[np.maximum(after - 1, 0)])


def _coverage(motion: Motion, read_at: np.ndarray) -> float:
    """Return the share of readings with poses around them; those more than GAP apart count less."""
    if not len(read_at):
        return float(len(motion.t) > 0)
    near = GAP / np.maximum(gaps(motion.t, read_at), GAP)
    return float(np.where(np.isfinite(motion.here.place).all(axis=1), near, 0.0).mean())


def _finite(t: np.ndarray, way: Pose) -> tuple[np.ndarray, Pose]:
    there = np.isfinite(way.place).all(axis=1)
    return t[there], Pose(way.place[there], way.heading[there])


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


def in_order(t: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return sorted unique times [s] and the rows of `values` then, without rows that are not finite."""
    good = np.isfinite(values).all(axis=1)
    t, first = np.unique(t[good], return_index=True)
    return t, values[good][first]


def between(t: np.ndarray, way: Pose, times: np.ndarray) -> Pose:
    """Interpolate poses `way` given at times t to other times [s]; NaN before the first and after the last."""
    if not len(t):
        return Pose(np.full((len(times), 3), np.nan), np.full(len(times), np.nan))
    columns = [*way.place.T, np.unwrap(way.heading)]
    x, y, z, heading = (np.interp(times, t, column, left=np.nan, right=np.nan) for column in columns)
    return Pose(np.stack([x, y, z], axis=-1), heading)
