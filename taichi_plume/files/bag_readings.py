"""Robots of a recorded ROS bag: trajectories and readings of gas sensors and anemometers.

Each gas topic is a robot, named by the topic's namespace ("/r1/gas" is of r1), or by the whole topic if a robot has
several. The position is that of the messages' frame if /tf connects the frame to the map; otherwise that of the pose
topic whose name shares most with the gas topic. Poses are interpolated to the times of the readings; readings without
a pose before and after are left out. Times are the stamps of the messages, or the times of recording if a message has
no stamp.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from taichi_plume.files import ros_messages as ros
from taichi_plume.files.bag_frames import Frames, Pose, topics_for
from taichi_plume.files.bag_topics import GAS, POSES, WINDS, chosen, pose_topic_of, robot_name, wind_topic_of
from taichi_plume.files.bags import Bag, BagError, Sample, Series, confined, opened, stamp_of
from taichi_plume.files.tables import listed
from taichi_plume.scenario import si
from taichi_plume.scenario.metal_oxides import MOX_MODELS, MoxName

UNITS = {"ppm": 1.0, "ppb": 1e-3, "ohm": 0.0}
"""Units of gas in ppm; a resistance is converted by the law of its sensor."""


@dataclass(frozen=True)
class BagOptions:
    """Options of reading a ROS bag. gas, pose, wind: topics, pose and wind one per gas topic; by default all.

    frame: frame of positions. sensor: index in a GasSensorArray. units: of gas, if messages give none or wrong units.
    model: metal oxide whose law converts resistances to ppm, air: resistance in clean air [ohm]; by default those of
    the messages. upwind: Anemometer messages give the direction where the wind comes from. lenient: for trajectories
    alone: readings that cannot be converted to ppm are NaN, and wind is left out.
    """

    gas: tuple[str, ...] = ()
    pose: tuple[str, ...] = ()
    wind: tuple[str, ...] = ()
    frame: str = "map"
    sensor: int | None = None
    units: Literal["ppm", "ppb", "ohm"] | None = None
    model: MoxName | None = None
    air: si.Resistance | None = None
    upwind: bool = False
    lenient: bool = False


@dataclass(frozen=True)
class RecordedRobot:
    """A robot of a ROS bag, with trajectory and readings in order of time.

    Trajectory: t (n,) [s], place (n, 3) [m], heading (n,) [rad]. Readings: read_at (m,) [s], at (m, 2) [m] positions
    of the sensor, ppm (m,), wind (m, 2) [m/s], zero if unknown. topics: description of the topics used.
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


def read(path: Path, options: BagOptions | None = None) -> list[RecordedRobot]:
    """Return the robots in a ROS bag, read in a child process with limits on memory and time. Raises BagError."""
    return confined(read_here, path, options or BagOptions())


def read_here(path: Path, options: BagOptions) -> list[RecordedRobot]:
    """Return the robots in a ROS bag, read in this process. Raises BagError."""
    with opened(path) as bag:
        if options.lenient and not options.gas and not bag.of_kind(*GAS):
            return [_without_gas(bag, topic) for topic in chosen(bag, options.pose, POSES, "poses", "--pose")]
        gas = chosen(bag, options.gas, GAS, "gas", "--topic")
        if options.lenient and not options.gas:  # one trajectory per robot, however many sensors
            gas = [topic for n, topic in enumerate(gas) if robot_name(topic) not in map(robot_name, gas[:n])]
        for topics, option in ((options.pose, "--pose"), (options.wind, "--wind")):
            if topics and len(topics) != len(gas):
                raise BagError(
                    f"{path}: {option} is given {len(topics)} times for {len(gas)} topics of gas, {listed(gas)}; "
                    "give it once for each, in their order"
                )
        readings = [bag.series(topic, _gas_of(bag, topic, options)) for topic in gas]
        stamped = all(series.is_stamped for series in readings)
        poses: dict[str, Series] = {}
        trees: dict[tuple[str, ...], Frames] = {}
        robots = []
        for n, series in enumerate(readings):
            pose_topic = options.pose[n] if options.pose else None
            wind_topic = options.wind[n] if options.wind else None
            of_frames = tuple(topics_for(bag, series.topic))
            if of_frames not in trees:
                trees[of_frames] = Frames(bag, stamped, of_frames)
            source = _Source(bag, options, trees[of_frames], stamped)
            if options.frame != BagOptions.frame and not pose_topic:
                source.frames.require(options.frame)
            robots.append(_robot(source, series, pose_topic, wind_topic, poses))
        names = [robot.name for robot in robots]
        return [
            replace(robot, name=topic.strip("/")) if names.count(robot.name) > 1 else robot
            for robot, topic in zip(robots, gas, strict=True)
        ]


class _Source(NamedTuple):
    """An open bag, its reading options, a robot's transform tree, and whether times are header stamps."""

    bag: Bag
    options: BagOptions
    frames: Frames
    stamped: bool


def _robot(
    source: _Source, gas: Series, pose_topic: str | None, wind_topic: str | None, poses: dict[str, Series]
) -> RecordedRobot:
    bag, options, frames, stamped = source
    read_at = gas.times(stamped)
    chain = frames.chain(gas.frame, options.frame) if gas.frame and not pose_topic else None
    carrier = frames.carrier(chain) if chain else None
    if chain:
        here = frames.pose(chain, read_at)
        t = frames.links[carrier].t if carrier else np.unique(read_at[np.isfinite(read_at)])
        way = frames.pose(chain[chain.index(carrier) :] if carrier else chain, t)
        places = f"{gas.frame} in {options.frame}"
    else:
        places = pose_topic_of(bag, gas.topic, pose_topic)
        if places not in poses:
            poses[places] = bag.series(places, _pose_of(bag, places))
        t, way = _way(poses[places], stamped)
        here = _between(t, way, read_at)
    known = np.isfinite(here.place).all(axis=1) & np.isfinite(read_at)
    if not known.any() and not options.lenient:
        spans = [f"{x.min():.10g} to {x.max():.10g} s" if len(x) else "none" for x in (read_at, t)]
        raise BagError(
            f"{bag.path}: no reading of {gas.topic} ({spans[0]}) has a pose of {places} ({spans[1]}) before and "
            "after it; do they have the same clock?"
        )
    wind_topic = None if options.lenient else wind_topic_of(bag, gas.topic, wind_topic)
    wind = np.zeros((len(read_at), 2))
    if wind_topic:
        wind = _wind(source, wind_topic, read_at, lambda times: _between(t, way, times))
    order = np.flatnonzero(known)[np.argsort(read_at[known], kind="stable")]
    there = np.isfinite(way.place).all(axis=1)
    return RecordedRobot(
        robot_name(gas.topic),
        t[there],
        way.place[there],
        way.heading[there],
        read_at[order],
        here.place[order, :2],
        gas.values[order, 0],
        wind[order],
        f"gas of {gas.topic}, places of {places}, "
        + (f"wind of {wind_topic}" if wind_topic else "no wind")
        + ("" if known.all() else f"; {len(known) - known.sum()} of {len(known)} readings have no place"),
    )


def _without_gas(bag: Bag, topic: str) -> RecordedRobot:
    """Return a recorded robot with the trajectory of a pose topic, and without readings."""
    series = bag.series(topic, _pose_of(bag, topic))
    t, way = _way(series, series.is_stamped)
    none = np.zeros((0, 2))
    return RecordedRobot(
        robot_name(topic), t, way.place, way.heading, none[:, 0], none, none[:, 0], none, topic
    )


# ---------------------------------------------------------------- messages


def _gas_of(bag: Bag, topic: str, options: BagOptions) -> Callable[[ros.Message], Sample]:
    """Return a function that extracts stamp, frame and concentration [ppm] from a message of a gas topic."""
    kind, where = bag.kinds[topic], f"{bag.path}: {topic}"

    def ppm(raw: float, units: str, sensor: ros.Message) -> float:
        try:
            return _ppm(where, raw, units, sensor, options)
        except BagError:
            if not options.lenient:
                raise
            return np.nan

    def plain(message: ros.Message) -> Sample:
        return Sample(0.0, "", [ppm(float(message.data), options.units or "ppm", None)])

    def sensor(message: ros.Message) -> Sample:
        units = {code: name for name, code in ros.UNITS.items()}.get(int(message.raw_units), "unknown")
        value = ppm(float(message.raw), options.units or units, message)
        return Sample(stamp_of(message.header), message.header.frame_id, [value])

    def array(message: ros.Message) -> Sample:
        n, count = options.sensor, len(message.sensors)
        if n is None and count != 1 and not (options.lenient and count):
            raise BagError(f"{where} has {count} sensors in a message; choose with --sensor N, from 0 on")
        if (n or 0) >= count:
            raise BagError(f"{where} has {count} sensors in a message, and none of number {n}")
        stamp, frame, values = sensor(message.sensors[n or 0])
        return Sample(stamp or stamp_of(message.header), frame or message.header.frame_id, values)

    return {ros.GAS_SENSOR: sensor, ros.GAS_SENSOR_ARRAY: array}.get(kind, plain)


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


def _wind(source: _Source, topic: str, read_at: np.ndarray, body: Callable[[np.ndarray], Pose]) -> np.ndarray:
    """Return the wind (m, 2) [m/s] in map axes, interpolated to the times of gas readings; zero if unknown.

    body: function of times that returns the robot's poses, used if /tf does not connect the anemometer to the map.
    """
    bag, options, frames, stamped = source
    kind = bag.kinds[topic]

    def get(message: ros.Message) -> Sample:
        if kind == ros.ANEMOMETER:
            to = message.wind_direction + (np.pi if options.upwind else 0.0)
            x, y = message.wind_speed * np.cos(to), message.wind_speed * np.sin(to)
        else:
            vector = message.vector if kind == WINDS[1] else message.twist.linear
            x, y = vector.x, vector.y
        return Sample(stamp_of(message.header), message.header.frame_id, (x, y))

    series = bag.series(topic, get)
    t = series.times(stamped and series.is_stamped)
    wind = series.values
    if series.frame.lstrip("/") not in ("", options.frame):
        chain = frames.chain(series.frame, options.frame)
        heading = (frames.pose(chain, t) if chain else body(t)).heading
        c, s = np.cos(heading), np.sin(heading)
        wind = np.stack([c * wind[:, 0] - s * wind[:, 1], s * wind[:, 0] + c * wind[:, 1]], axis=-1)
    t, wind = _in_order(t, wind)
    if not len(t):
        return np.zeros((len(read_at), 2))
    return np.stack([np.interp(read_at, t, axis, left=0.0, right=0.0) for axis in wind.T], axis=-1)
