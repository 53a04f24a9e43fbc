"""Robots of a recorded ROS bag: trajectories and readings of gas sensors and anemometers.

Each gas topic, or number named by `reading`, is a robot, named by the topic's namespace ("/r1/gas" is of r1), or by the
whole topic if a robot has several. Positions are in one frame, by default map. They are, in this order,

    1. those of the messages' own frame, if /tf connects it to the target frame,
    2. those of a pose topic in the target frame, by header.frame_id: first by name, then by type,
    3. those of a pose topic in a frame that /tf connects to the target frame,
    4. if no frame is given and nothing leads to map: those in another frame, with a remark.

Poses are interpolated to the times of the readings; readings without a pose before and after are left out. Times are
the stamps of the messages, or the times of recording if a message has no stamp. Values that mean none (NaN, -9999) are
missing readings. What was assumed is a remark.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from taichi_plume.files import ros_messages as ros
from taichi_plume.files.bag_fields import Field, NumberReader, field_of
from taichi_plume.files.bag_frames import Frames, Pose, plain_name, topics_for
from taichi_plume.files.bag_topics import (
    GAS,
    POSES,
    WINDS,
    best_pose_topic,
    chosen,
    pose_topics,
    robot_name,
    wind_topic_of,
)
from taichi_plume.files.bags import Bag, BagError, Sample, Series, confined, opened, stamp_of
from taichi_plume.files.conventions import is_missing
from taichi_plume.files.tables import listed
from taichi_plume.scenario import si
from taichi_plume.scenario.metal_oxides import MOX_MODELS, MoxName

UNITS = {"ppm": 1.0, "ppb": 1e-3, "ohm": 0.0}
"""Units of gas in ppm; a resistance is converted by the law of its sensor."""
MAP = "map"
"""Frame of positions unless another is given."""


@dataclass(frozen=True)
class BagOptions:
    """Options of reading a ROS bag. gas, pose, wind: topics, pose and wind one per gas topic; by default all.

    frame: frame of positions, by default map or, if the bag has none, that of the poses. sensor: index in a
    GasSensorArray. units: of gas, if messages give none or wrong units. reading: numbers in messages of any type, by
    topic and field, such as /enose.data[0]; after those of `gas`.
    model: metal oxide whose law converts resistances to ppm, air: resistance in clean air [ohm]; by default those of
    the messages. upwind: Anemometer messages give the direction where the wind comes from. lenient: for trajectories
    alone: readings that cannot be converted to ppm are NaN, and wind is left out.
    """

    gas: tuple[str, ...] = ()
    pose: tuple[str, ...] = ()
    wind: tuple[str, ...] = ()
    frame: str | None = None
    sensor: int | None = None
    units: Literal["ppm", "ppb", "ohm"] | None = None
    model: MoxName | None = None
    air: si.Resistance | None = None
    upwind: bool = False
    lenient: bool = False
    reading: tuple[str, ...] = ()


@dataclass(frozen=True)
class RecordedRobot:
    """A robot of a ROS bag, with trajectory and readings in order of time.

    Trajectory: t (n,) [s], place (n, 3) [m], heading (n,) [rad]. Readings: read_at (m,) [s], at (m, 2) [m] positions
    of the sensor, ppm (m,), wind (m, 2) [m/s], zero if unknown. topics: description of the topics used. frame: frame
    of the positions. remarks: what was assumed.
    """

    name: str
    t: np.ndarray
    place: np.ndarray
    heading: np.ndarray
    read_at: np.ndarray
    at: np.ndarray
    ppm: np.ndarray
    wind: np.ndarray
    topics: str
    frame: str
    remarks: tuple[str, ...] = ()


def read(path: Path, options: BagOptions | None = None) -> list[RecordedRobot]:
    """Return the robots in a ROS bag, read in a child process with limits on memory and time. Raises BagError."""
    return confined(read_here, path, options or BagOptions())


def read_here(path: Path, options: BagOptions) -> list[RecordedRobot]:
    """Return the robots in a ROS bag, read in this process. Raises BagError."""
    with opened(path) as bag:
        if options.lenient and not options.gas and not options.reading and not bag.of_kind(*GAS):
            return _without_gas(bag, options)
        fields = [field_of(bag, text) for text in options.reading]
        gas = chosen(bag, options.gas, GAS, "gas", "--topic") if options.gas or not fields else []
        if options.lenient and not options.gas:  # one trajectory per robot, however many sensors
            gas = [topic for n, topic in enumerate(gas) if robot_name(topic) not in map(robot_name, gas[:n])]
        names = [*gas, *(field.text for field in fields)]
        for topics, option in ((options.pose, "--pose"), (options.wind, "--wind")):
            if topics and len(topics) != len(names):
                raise BagError(
                    f"{path}: {option} is given {len(topics)} times for {len(names)} topics of gas, {listed(names)}; "
                    "give it once for each, in their order"
                )
        readings = [_gas_of(bag, topic, options) for topic in gas]
        readings += [_numbers_of(bag, field, options) for field in fields]
        stamped = all(gas.series.is_stamped for gas in readings)
        alone = len({robot_name(gas.series.topic) for gas in readings}) == 1
        poses: dict[str, Series] = {}
        trees: dict[tuple[str, ...], Frames] = {}
        robots = []
        for n, recorded in enumerate(readings):
            pose_topic = options.pose[n] if options.pose else None
            wind_topic = options.wind[n] if options.wind else None
            of_frames = tuple(topics_for(bag, recorded.series.topic))
            if of_frames not in trees:
                trees[of_frames] = Frames(bag, stamped, of_frames)
            source = _Source(bag, options, trees[of_frames], stamped, alone, poses)
            robots.append(_robot(source, recorded, pose_topic, wind_topic))
        ids = [robot.name for robot in robots]
        return [
            replace(robot, name=name.strip("/")) if ids.count(robot.name) > 1 else robot
            for robot, name in zip(robots, names, strict=True)
        ]


class _Source(NamedTuple):
    """An open bag, its reading options, a robot's transform tree, whether times are header stamps, whether the bag has
    one robot, and the pose topics that were read, by name.
    """

    bag: Bag
    options: BagOptions
    frames: Frames
    stamped: bool
    alone: bool
    poses: dict[str, Series]

    @property
    def target(self) -> str:
        """Frame in which positions are returned."""
        return plain_name(self.options.frame or MAP)


class _Gas(NamedTuple):
    """Readings [ppm] of a gas topic, their name and unit in the bag, and what was assumed of the unit."""

    name: str
    series: Series
    units: str
    remarks: list[str]


class _Motion(NamedTuple):
    """Motion of a robot: poses `way` at times t (n,) [s] in a frame; here: poses of the gas sensor at its readings.

    text: the topic or frame that gave them.
    """

    t: np.ndarray
    way: Pose
    here: Pose
    frame: str
    text: str
    remarks: list[str]


def _robot(source: _Source, gas: _Gas, pose_topic: str | None, wind_topic: str | None) -> RecordedRobot:
    bag, options, stamped = source.bag, source.options, source.stamped
    series, read_at = gas.series, gas.series.times(stamped)
    remarks = list(gas.remarks)
    if not stamped:
        count = np.count_nonzero(series.stamp > 0.0)
        why = (
            "other gas topics have none"
            if series.is_stamped
            else f"{count} of {len(read_at)} messages have one"
        )
        remarks.append(f"times of {gas.name} are those of recording instead of stamps: {why}")
    motion = _motion(source, series, read_at, pose_topic)
    known = np.isfinite(motion.here.place).all(axis=1) & np.isfinite(read_at)
    if not known.any() and not options.lenient:
        spans = [f"{x.min():.10g} to {x.max():.10g} s" if len(x) else "none" for x in (read_at, motion.t)]
        raise BagError(
            f"{bag.path}: no reading of {gas.name} ({spans[0]}) has a pose of {motion.text} ({spans[1]}) before and "
            "after it; do they have the same clock?"
        )
    wind_topic = None if options.lenient else wind_topic_of(bag, series.topic, wind_topic)
    wind, wind_remarks = np.zeros((len(read_at), 2)), []
    if wind_topic:
        wind, wind_remarks = _wind(source, wind_topic, read_at, motion)
    order = np.flatnonzero(known)[np.argsort(read_at[known], kind="stable")]
    there = np.isfinite(motion.way.place).all(axis=1)
    return RecordedRobot(
        robot_name(series.topic),
        motion.t[there],
        motion.way.place[there],
        motion.way.heading[there],
        read_at[order],
        motion.here.place[order, :2],
        series.values[order, 0],
        wind[order],
        f"gas of {gas.name} in {gas.units}, positions of {motion.text}, "
        + (f"wind of {wind_topic}" if wind_topic else "no wind")
        + ("" if known.all() else f"; {len(known) - known.sum()} of {len(known)} readings have no place"),
        motion.frame,
        (*remarks, *motion.remarks, *wind_remarks),
    )


def _without_gas(bag: Bag, options: BagOptions) -> list[RecordedRobot]:
    """Return robots with the trajectories of the pose topics, and without readings."""
    first = chosen(bag, options.pose, POSES, "poses", "--pose")
    if not options.pose:
        first = [
            topic for n, topic in enumerate(first) if robot_name(topic) not in map(robot_name, first[:n])
        ]
    alone, none, robots = len(first) == 1, np.zeros((0, 2)), []
    for topic in first:
        series = bag.series(topic, _pose_of(bag, topic))
        frames = Frames(bag, series.is_stamped, topics_for(bag, topic))
        source = _Source(bag, options, frames, series.is_stamped, alone, {topic: series})
        motion = _by_topics(source, topic, none[:, 0], topic if options.pose else None)
        there = np.isfinite(motion.way.place).all(axis=1)
        t, place, heading = motion.t[there], motion.way.place[there], motion.way.heading[there]
        row = (none[:, 0], none, none[:, 0], none, f"positions of {motion.text}")
        remarks = tuple(motion.remarks)
        robots.append(RecordedRobot(robot_name(topic), t, place, heading, *row, motion.frame, remarks))
    return robots


# ---------------------------------------------------------------- positions


def _motion(source: _Source, gas: Series, read_at: np.ndarray, pose_topic: str | None) -> _Motion:
    """Return the motion of the robot with this gas topic, see the module. Raises BagError."""
    bag, frames, target = source.bag, source.frames, source.target
    if pose_topic:
        return _by_topics(source, gas.topic, read_at, pose_topic)
    bag.require_one_frame(gas, "; choose the robot's positions with --pose")
    if gas.frame and frames.chain(gas.frame, target):
        return _by_frames(source, gas.frame, target, read_at)
    topics = pose_topics(bag, gas.topic, source.alone)
    if not _leading(source, topics) and not source.options.frame and gas.frame:
        root = frames.root(gas.frame)
        chain = frames.chain(gas.frame, root)
        if chain and (frames.carrier(chain) or not topics):
            motion = _by_frames(source, gas.frame, root, read_at)
            return motion._replace(remarks=[_no_frame(source, root)])
    motion = _by_topics(source, gas.topic, read_at, None)
    if not gas.frame or gas.frame == motion.frame:
        return motion
    body = frames.root(gas.frame)
    chain = frames.chain(gas.frame, body)
    if not chain or frames.carrier(chain):
        motion.remarks.append(
            f"no frame leads to {gas.frame}: its readings are taken at the robot's position"
        )
        return motion
    ahead, left, up = frames.pose(chain, read_at[:1]).place[
        0
    ]  # mounted on the body, whose poses are those of the topic
    place, heading = motion.here
    c, s = np.cos(heading), np.sin(heading)
    offset = np.stack([ahead * c - left * s, ahead * s + left * c, np.full(len(c), up)], axis=-1)
    motion.remarks.append(
        f"the poses of {motion.text} are assumed to be those of {body}, on which {gas.frame} is mounted"
    )
    return motion._replace(here=Pose(place + offset, heading))


def _no_frame(source: _Source, frame: str) -> str:
    return (
        f"positions are in frame {frame}: nothing leads from there to frame {source.target} (--frame chooses)"
    )


def _leading(source: _Source, topics: list[str]) -> list[str]:
    """Return those of the pose topics that are in the target frame, or else in a frame connected to it, or in none."""
    named = {topic: plain_name(source.bag.first(topic).header.frame_id) for topic in topics}
    there = [topic for topic, frame in named.items() if frame == source.target]
    led = there or [
        topic for topic, frame in named.items() if frame and source.frames.chain(frame, source.target)
    ]
    return led or [topic for topic, frame in named.items() if not frame]


def _by_frames(source: _Source, frame: str, fixed: str, read_at: np.ndarray) -> _Motion:
    """Return the motion of a frame, that of a sensor, in a frame that /tf connects to it."""
    frames = source.frames
    chain = frames.chain(frame, fixed) or []
    carrier = frames.carrier(chain)
    t = frames.links[carrier].t if carrier else np.unique(read_at[np.isfinite(read_at)])
    way = frames.pose(chain[chain.index(carrier) :] if carrier else chain, t)
    return _Motion(t, way, frames.pose(chain, read_at), fixed, f"{frame} in frame {fixed}", [])


def _by_topics(source: _Source, gas: str, read_at: np.ndarray, pose_topic: str | None) -> _Motion:
    """Return the motion by a pose topic: that given, or else the best for a gas topic. Raises BagError."""
    bag, frames, target = source.bag, source.frames, source.target
    if pose_topic:
        bag.require(pose_topic, POSES)
        topics = [pose_topic]
    else:
        topics = pose_topics(bag, gas, source.alone)
    leading = _leading(source, topics)
    if source.options.frame and not leading:
        known = {plain_name(bag.first(topic).header.frame_id) for topic in bag.of_kind(*POSES)} | frames.names
        what = f"no pose leads from {gas} to frame" if target in known else "has no frame"
        if known:
            raise BagError(f"{bag.path}: {what} '{target}'; it has {listed(sorted(known))}")
    if not topics:
        raise BagError(
            f"{bag.path}: has no poses for {gas}: neither frames that lead to it nor a topic of them"
        )
    topic = best_pose_topic(bag, gas, leading or topics)
    if topic not in source.poses:
        source.poses[topic] = bag.series(topic, _pose_of(bag, topic))
    series = source.poses[topic]
    bag.require_one_frame(series)
    t, way = _way(series, source.stamped)
    frame, text, remarks = series.frame or target, f"{topic} in frame {series.frame or target}", []
    if source.stamped and not series.is_stamped:
        remarks.append(f"times of {topic} are those of recording, as its messages have no stamp")
    if len(t) < len(series.values):
        remarks.append(
            f"{len(series.values) - len(t)} of {len(series.values)} poses of {topic} repeat a time or are no numbers"
        )
    if not series.frame:
        remarks.append(f"messages of {topic} name no frame: frame {target} is assumed")
    chain = frames.chain(frame, target)
    if chain:
        way = frames.pose(chain, t, way)
        there = np.isfinite(way.place).all(axis=1)
        t, way, frame = t[there], Pose(way.place[there], way.heading[there]), target
        text += f", by /tf in {target}"
    elif frame != target:
        remarks.append(_no_frame(source, frame))
    return _Motion(t, way, _between(t, way, read_at), frame, text, remarks)


# ---------------------------------------------------------------- messages


def _gas_of(bag: Bag, topic: str, options: BagOptions) -> _Gas:
    """Return the readings of a gas topic. Raises BagError."""
    kind, where = bag.kinds[topic], f"{bag.path}: {topic}"
    used: dict[str, None] = {}

    def ppm(raw: float, units: str, sensor: ros.Message) -> list[float]:
        used[units] = None
        try:
            return [raw, _ppm(where, raw, units, sensor, options)]
        except BagError:
            if not options.lenient:
                raise
            return [raw, np.nan]

    named = options.units or _unit_in(topic)

    def plain(message: ros.Message) -> Sample:
        return Sample(0.0, "", ppm(float(message.data), named or "ppm", None))

    def sensor(message: ros.Message) -> Sample:
        units = {code: name for name, code in ros.UNITS.items()}.get(int(message.raw_units), "unknown")
        value = ppm(float(message.raw), options.units or units, message)
        return Sample(stamp_of(message.header), message.header.frame_id, value)

    def array(message: ros.Message) -> Sample:
        n, count = options.sensor, len(message.sensors)
        if n is None and count != 1 and not (options.lenient and count):
            raise BagError(f"{where} has {count} sensors in a message; choose with --sensor N, from 0 on")
        if (n or 0) >= count:
            raise BagError(f"{where} has {count} sensors in a message, and none of number {n}")
        stamp, frame, values = sensor(message.sensors[n or 0])
        return Sample(stamp or stamp_of(message.header), frame or message.header.frame_id, values)

    stated = {ros.GAS_SENSOR: sensor, ros.GAS_SENSOR_ARRAY: array}.get(kind)
    series = bag.series(topic, stated or plain)
    return _complete(topic, series, " and ".join(used), stated is None and not named)


def _unit_in(name: str) -> str | None:
    """Return the unit at the end of the name of a topic or field, such as h2s_ppb or ohm; None if there is none."""
    unit = re.split(r"[^a-z]", name.lower())[-1]
    return unit if unit in UNITS else None


def _numbers_of(bag: Bag, field: Field, options: BagOptions) -> _Gas:
    """Return the readings that are a number in the messages of any type. Raises BagError."""
    names = [step for step in field.steps if isinstance(step, str)]
    named = options.units or _unit_in(names[-1]) or _unit_in(field.topic)
    number, units = NumberReader(bag, field), named or "ppm"

    def get(message: ros.Message) -> Sample:
        stamp, frame, (raw,) = number(message)
        return Sample(stamp, frame, (raw, _ppm(number.where, raw, units, None, options)))

    series = bag.series(field.topic, get)
    number.require_some(series.values)
    return _complete(field.text, series, units, not named)


def _complete(name: str, series: Series, units: str, assumed: bool) -> _Gas:
    """Return readings with NaN for values that mean none. series: raw values and ppm (n, 2); assumed: the unit is."""
    raw, ppm = series.values.T
    missing = is_missing(raw)
    remarks = [f"unit of {name} is assumed to be {units} (--units gives another)"] if assumed else []
    if missing.any():
        kinds = listed(sorted({f"{value:.10g}" for value in raw[missing]}))
        remarks.append(f"{missing.sum()} of {len(raw)} values of {name} mean none ({kinds}) and are left out")
    return _Gas(name, replace(series, values=np.where(missing, np.nan, ppm)[:, None]), units, remarks)


def _ppm(where: str, raw: float, units: str, sensor: ros.Message, options: BagOptions) -> float:
    """Convert a raw gas reading to ppm. sensor: its GasSensor message or None. Raises BagError.

    Resistances follow the metal-oxide law of ros_messages: c = c0 ((R / R_air)^(1 / calib_b) - 1).
    """
    if units not in UNITS:
        raise BagError(f"{where}: the unit of gas is {units}, not ppm, ppb or ohm; give --units")
    if units != "ohm":
        return raw * UNITS[units]
    known = vars(sensor) if sensor else {}
    # in ROS 1 these names end in a capital
    a, b = (float(known.get(f"calib_{k}", known.get(f"calib_{k.upper()}", 0.0))) for k in "ab")
    air = options.air or float(known.get("raw_air", 0.0))
    if options.model:
        law = MOX_MODELS[options.model]
        c0, b = law.c0, -law.b
    elif a > 0.0 and b < 0.0:
        c0 = a ** (-1.0 / b)
    else:
        raise BagError(f"{where} has resistances without calib_a and calib_b; give --model")
    if not 0.0 < air < np.inf:
        raise BagError(f"{where} has resistances without raw_air, the resistance in clean air; give --air")
    if not raw > 0.0:
        return np.nan
    return max(0.0, c0 * float(np.expm1(np.log(raw / air) / b)))


def _pose_of(bag: Bag, topic: str) -> Callable[[ros.Message], Sample]:
    """Return a function that extracts stamp, frame and x, y, z [m], heading [rad] from a message of a pose topic."""
    nested = bag.kinds[topic] != POSES[-1]

    def get(message: ros.Message) -> Sample:
        pose = message.pose.pose if nested else message.pose
        at = pose.position
        place = (at.x, at.y, at.z if np.isfinite(at.z) else 0.0, ros.yaw(pose.orientation))
        return Sample(stamp_of(message.header), message.header.frame_id, place)

    return get


def _way(series: Series, stamped: bool) -> tuple[np.ndarray, Pose]:
    """Return a trajectory from a pose topic's values: sorted unique times [s], and the poses."""
    t, values = _in_order(series.times(stamped and series.is_stamped), series.values)
    return t, Pose(values[:, :3], values[:, 3])


def _in_order(t: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return sorted unique times [s] and the rows of `values` then, without rows that are not finite."""
    good = np.isfinite(values).all(axis=1)
    t, first = np.unique(t[good], return_index=True)
    return t, values[good][first]


def _between(t: np.ndarray, way: Pose, times: np.ndarray) -> Pose:
    """Interpolate poses `way` given at times t to other times [s]; NaN before the first and after the last."""
    if not len(t):
        return Pose(np.full((len(times), 3), np.nan), np.full(len(times), np.nan))
    columns = [*way.place.T, np.unwrap(way.heading)]
    x, y, z, heading = (np.interp(times, t, column, left=np.nan, right=np.nan) for column in columns)
    return Pose(np.stack([x, y, z], axis=-1), heading)


def _wind(source: _Source, topic: str, read_at: np.ndarray, motion: _Motion) -> tuple[np.ndarray, list[str]]:
    """Return the wind (m, 2) [m/s] along the axes of the motion's frame, interpolated to the times of gas readings,
    zero if unknown, and remarks.

    The robot's heading turns the wind if /tf does not connect the anemometer's frame.
    """
    bag, options, frames, stamped = source.bag, source.options, source.frames, source.stamped
    kind, remarks = bag.kinds[topic], []

    def get(message: ros.Message) -> Sample:
        if kind == ros.ANEMOMETER:
            to = message.wind_direction + (np.pi if options.upwind else 0.0)
            x, y = message.wind_speed * np.cos(to), message.wind_speed * np.sin(to)
        else:
            vector = message.vector if kind == WINDS[1] else message.twist.linear
            x, y = vector.x, vector.y
        return Sample(stamp_of(message.header), message.header.frame_id, (x, y))

    series = bag.series(topic, get)
    bag.require_one_frame(series)
    t = series.times(stamped and series.is_stamped)
    wind, frame = series.values, series.frame
    if not frame:
        remarks.append(f"messages of {topic} name no frame: wind along the axes of {motion.frame} is assumed")
    elif frame == source.target and frame != motion.frame:
        remarks.append(
            f"wind of {topic} is along the axes of {frame}, those of {motion.frame} are assumed to be the same"
        )
    elif frame != motion.frame:
        chain = frames.chain(frame, motion.frame)
        turned = frames.pose(chain, t) if chain else _between(motion.t, motion.way, t)
        c, s = np.cos(turned.heading), np.sin(turned.heading)
        wind = np.stack([c * wind[:, 0] - s * wind[:, 1], s * wind[:, 0] + c * wind[:, 1]], axis=-1)
        if not chain:
            remarks.append(
                f"no frame leads to the anemometer's, {frame}: its x axis is assumed to be the robot's"
            )
    t, wind = _in_order(t, wind)
    if not len(t):
        return np.zeros((len(read_at), 2)), remarks
    return np.stack([np.interp(read_at, t, axis, left=0.0, right=0.0) for axis in wind.T], axis=-1), remarks
