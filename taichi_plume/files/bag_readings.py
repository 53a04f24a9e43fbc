"""Robots of a recorded bag: their ways, and what their gas sensors and anemometers read.

Each topic of gas is a robot, named by what stands before it ("/r1/gas" is of r1), or by all of it where a robot has
several. Where the frame of its messages hangs on the map in /tf, that is where it was; otherwise the topic of poses
that shares most of its name. Poses are interpolated to the times of the readings, and readings without a pose before
and after them are left out. Times are the stamps of the messages; those of recording, if one has none.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from taichi_plume.files import ros_messages as ros
from taichi_plume.files.bag_frames import Frames, Pose, topics_for
from taichi_plume.files.bag_topics import GAS, POSES, beside, chosen, robot_name, wind_topic_of
from taichi_plume.files.bags import Bag, BagError, Series, Told, confined, opened, stamp_of
from taichi_plume.files.tables import listed
from taichi_plume.scenario.metal_oxides import MOX_MODELS

UNITS = {"ppm": 1.0, "ppb": 1e-3, "ohm": 0.0}
"""In which gas may be told, and how much of a ppm each is; a resistance is turned into ppm by its sensor's law."""


@dataclass(frozen=True)
class Wanted:
    """What of a bag is read. gas, pose, wind: topics, pose and wind as many as gas; unless given, those that it has.

    frame: that places are in. sensor: which of a GasSensorArray. units: of gas, where messages do not tell or err.
    model: the metal oxide whose law turns resistances into ppm, air: its resistance in clean air [ohm]; unless given,
    as the messages tell. upwind: whether Anemometer messages tell where the wind comes from, and not where it goes.
    lenient: whether ways are what is wanted: readings that cannot be turned into ppm are NaN, and wind is left out.
    """

    gas: tuple[str, ...] = ()
    pose: tuple[str, ...] = ()
    wind: tuple[str, ...] = ()
    frame: str = "map"
    sensor: int | None = None
    units: str | None = None
    model: str | None = None
    air: float | None = None
    upwind: bool = False
    lenient: bool = False

    @property
    def said(self) -> bool:
        """Whether anything but the defaults is wanted."""
        return self != Wanted()


@dataclass(frozen=True)
class RecordedRobot:
    """A robot of a bag, in order of time.

    Its way: t (n,) [s], place (n, 3) [m], heading (n,) [rad]. Its readings: read_at (m,) [s], at (m, 2) [m] the places
    of the sensor, ppm (m,), wind (m, 2) [m/s], zero where it is not known. topics: what they are of.
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


def read(path: Path, wanted: Wanted | None = None) -> list[RecordedRobot]:
    """The robots of a bag; if lenient, of one without gas those that it has poses of. Raises BagError."""
    return confined(read_here, path, wanted or Wanted())


def read_here(path: Path, wanted: Wanted) -> list[RecordedRobot]:
    """Return the same, read in this process without limits. Raises BagError."""
    with opened(path) as bag:
        if wanted.lenient and not wanted.gas and not bag.of_kind(*GAS):
            return [_without_gas(bag, topic) for topic in chosen(bag, wanted.pose, POSES, "poses", "--pose")]
        gas = chosen(bag, wanted.gas, GAS, "gas", "--topic")
        if wanted.lenient and not wanted.gas:  # a robot goes one way, however many sensors it has
            gas = [one for n, one in enumerate(gas) if robot_name(one) not in map(robot_name, gas[:n])]
        for one, option in ((wanted.pose, "--pose"), (wanted.wind, "--wind")):
            if one and len(one) != len(gas):
                raise BagError(
                    f"{path}: {option} is given {len(one)} times for {len(gas)} topics of gas, {listed(gas)}; "
                    "give it once for each, in their order"
                )
        readings = [bag.series(topic, _gas_of(bag, topic, wanted)) for topic in gas]
        stamped = all(one.is_stamped for one in readings)
        poses: dict[str, Series] = {}
        robots = []
        trees: dict[tuple[str, ...], Frames] = {}
        for n, one in enumerate(readings):
            given = [topics[n] if topics else None for topics in (wanted.pose, wanted.wind)]
            told = tuple(topics_for(bag, one.topic))
            if told not in trees:
                trees[told] = Frames(bag, stamped, told)
            frames = trees[told]
            if wanted.frame != Wanted.frame and not given[0]:
                frames.require(wanted.frame)
            robots.append(_robot(bag, wanted, one, frames, stamped, given[0], given[1], poses))
        return _named_apart(robots, gas)


def _named_apart(robots: list[RecordedRobot], gas: Sequence[str]) -> list[RecordedRobot]:
    """The robots, of which those of one name are named by their topics of gas."""
    names = [one.name for one in robots]
    return [
        replace(one, name=topic.strip("/")) if names.count(one.name) > 1 else one
        for one, topic in zip(robots, gas, strict=True)
    ]


def _robot(
    bag: Bag,
    wanted: Wanted,
    gas: Series,
    frames: Frames,
    stamped: bool,
    pose_topic: str | None,
    wind_topic: str | None,
    poses: dict[str, Series],
) -> RecordedRobot:
    read_at = gas.times(stamped)
    chain = frames.chain(gas.frame, wanted.frame) if gas.frame and not pose_topic else None
    carrier = frames.carrier(chain) if chain else None
    if chain:
        here = frames.pose(chain, read_at)
        t = frames.links[carrier].t if carrier else np.unique(read_at[np.isfinite(read_at)])
        way = frames.pose(chain[chain.index(carrier) :] if carrier else chain, t)
        source = f"{gas.frame} in {wanted.frame}"
    else:
        topic = beside(bag, gas.topic, pose_topic, POSES, "poses", "--pose")
        if topic not in poses:
            poses[topic] = bag.series(topic, _pose_of(bag, topic))
        t, way = _way(poses[topic], stamped)
        here, source = _between(t, way, read_at), topic
    known = np.isfinite(here.place).all(axis=1) & np.isfinite(read_at)
    if not known.any() and not wanted.lenient:
        spans = [f"{one.min():.10g} to {one.max():.10g} s" if len(one) else "none" for one in (read_at, t)]
        raise BagError(
            f"{bag.path}: no reading of {gas.topic} ({spans[0]}) has a pose of {source} ({spans[1]}) before and "
            "after it; have they one clock?"
        )
    wind_topic = None if wanted.lenient else wind_topic_of(bag, gas.topic, wind_topic)
    wind = np.zeros((len(read_at), 2))
    if wind_topic:
        wind = _wind(bag, wind_topic, wanted, frames, stamped, read_at, lambda times: _between(t, way, times))
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
        f"gas of {gas.topic}, places of {source}, "
        + (f"wind of {wind_topic}" if wind_topic else "no wind")
        + ("" if known.all() else f"; {len(known) - known.sum()} of {len(known)} readings have no place"),
    )


def _without_gas(bag: Bag, topic: str) -> RecordedRobot:
    """A robot of which only poses are known."""
    series = bag.series(topic, _pose_of(bag, topic))
    t, way = _way(series, series.is_stamped)
    none = np.zeros((0, 2))
    return RecordedRobot(
        robot_name(topic), t, way.place, way.heading, none[:, 0], none, none[:, 0], none, topic
    )


# ---------------------------------------------------------------- messages


def _gas_of(bag: Bag, topic: str, wanted: Wanted) -> Callable[[Any], Told]:
    """How the messages of a topic tell ppm."""
    kind, where = bag.kinds[topic], f"{bag.path}: {topic}"

    def ppm(raw: float, units: str, told: Any) -> float:
        try:
            return _ppm(where, raw, units, told, wanted)
        except BagError:
            if not wanted.lenient:
                raise
            return np.nan

    def plain(message: Any) -> Told:
        return Told(0.0, "", [ppm(float(message.data), wanted.units or "ppm", None)])

    def sensor(one: Any) -> Told:
        told = {code: name for name, code in ros.UNITS.items()}.get(int(one.raw_units), "unknown")
        value = ppm(float(one.raw), wanted.units or told, one)
        return Told(stamp_of(one.header), one.header.frame_id, [value])

    def array(message: Any) -> Told:
        n, count = wanted.sensor, len(message.sensors)
        if n is None and count != 1 and not (wanted.lenient and count):
            raise BagError(f"{where} has {count} sensors in a message; choose with --sensor N, from 0 on")
        if (n or 0) >= count:
            raise BagError(f"{where} has {count} sensors in a message, and none of number {n}")
        one = sensor(message.sensors[n or 0])
        stamp = one.stamp or stamp_of(message.header)
        return Told(stamp, one.frame or message.header.frame_id, one.values)

    return {ros.GAS_SENSOR: sensor, ros.GAS_SENSOR_ARRAY: array}.get(kind, plain)


def _ppm(where: str, raw: float, units: str, told: Any, wanted: Wanted) -> float:
    """A reading [ppm]; told: the message that tells of its sensor, if one does. Raises BagError.

    A resistance as of the law of ros_messages: c = c0 ((R / R_air)^(1 / calib_b) - 1).
    """
    if units not in UNITS:
        raise BagError(
            f"{where} tells gas in units that are not ppm, ppb or ohm ({units}); choose with --units"
        )
    if units != "ohm":
        return raw * UNITS[units]
    a, b, air = (_of_sensor(told, name) for name in ("calib_a", "calib_b", "raw_air"))
    air = wanted.air or air
    if wanted.model:
        law = MOX_MODELS[wanted.model]
        c0, b = law.c0, -law.b
    elif a > 0.0 and b < 0.0:
        c0 = a ** (-1.0 / b)
    else:
        raise BagError(f"{where} tells resistances without calib_a and calib_b; choose with --model")
    if not 0.0 < air < np.inf:
        raise BagError(f"{where} tells resistances without that in clean air, raw_air; give it with --air")
    if not raw > 0.0:
        return np.nan
    return max(0.0, c0 * float(np.expm1(np.log(raw / air) / b)))


def _of_sensor(told: Any, name: str) -> float:
    """A number of a message; in ROS 1 they end in a capital."""
    return float(getattr(told, name, getattr(told, f"{name[:-1]}{name[-1].upper()}", 0.0)))


def _pose_of(bag: Bag, topic: str) -> Callable[[Any], Told]:
    """How the messages of a topic tell x, y, z [m] and heading [rad]."""
    deep = bag.kinds[topic] != POSES[-1]

    def get(message: Any) -> Told:
        pose = message.pose.pose if deep else message.pose
        at = pose.position
        place = (at.x, at.y, at.z if np.isfinite(at.z) else 0.0, ros.yaw(pose.orientation))
        return Told(stamp_of(message.header), message.header.frame_id, place)

    return get


def _way(series: Series, stamped: bool) -> tuple[np.ndarray, Pose]:
    """Times [s], each once and in order, and poses of a topic."""
    t = series.times(stamped and series.is_stamped)
    good = np.isfinite(series.values).all(axis=1)
    t, first = np.unique(t[good], return_index=True)
    values = series.values[good][first]
    return t, Pose(values[:, :3], values[:, 3])


def _between(t: np.ndarray, way: Pose, times: np.ndarray) -> Pose:
    """A way at other times; NaN before its begin and after its end."""
    if not len(t):
        return Pose(np.full((len(times), 3), np.nan), np.full(len(times), np.nan))
    columns = [*way.place.T, np.unwrap(way.heading)]
    x, y, z, heading = (np.interp(times, t, one, left=np.nan, right=np.nan) for one in columns)
    return Pose(np.stack([x, y, z], axis=-1), heading)


def _wind(
    bag: Bag,
    topic: str,
    wanted: Wanted,
    frames: Frames,
    stamped: bool,
    read_at: np.ndarray,
    body: Callable[[np.ndarray], Pose],
) -> np.ndarray:
    """The wind at the times of readings (m, 2) [m/s] in the map, zero where it is not known.

    body: the robot's way, whose heading counts where the frame of the messages is another than the map and not known.
    """

    def anemometer(one: Any) -> Told:
        to = one.wind_direction + (np.pi if wanted.upwind else 0.0)
        vector = (one.wind_speed * np.cos(to), one.wind_speed * np.sin(to))
        return Told(stamp_of(one.header), one.header.frame_id, vector)

    def vector(one: Any) -> Told:
        v = getattr(one, "vector", None) or one.twist.linear
        return Told(stamp_of(one.header), one.header.frame_id, (v.x, v.y))

    series = bag.series(topic, anemometer if bag.kinds[topic] == ros.ANEMOMETER else vector)
    t = series.times(stamped and series.is_stamped)
    wind = series.values
    if series.frame.lstrip("/") not in ("", wanted.frame):
        chain = frames.chain(series.frame, wanted.frame)
        heading = (frames.pose(chain, t) if chain else body(t)).heading
        c, s = np.cos(heading), np.sin(heading)
        wind = np.stack([c * wind[:, 0] - s * wind[:, 1], s * wind[:, 0] + c * wind[:, 1]], axis=-1)
    good = np.isfinite(wind).all(axis=1)
    t, first = np.unique(t[good], return_index=True)
    if not len(t):
        return np.zeros((len(read_at), 2))
    wind = wind[good][first]
    return np.stack([np.interp(read_at, t, one, left=0.0, right=0.0) for one in wind.T], axis=-1)
