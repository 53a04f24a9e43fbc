"""Robots of a recorded ROS bag: trajectories and readings of gas sensors and anemometers.

Each gas topic, or number named by `reading`, is a robot, named by the topic's namespace ("/r1/gas" is of r1), or by the
whole topic if a robot has several. Positions are those of `bag_poses`.

Poses are interpolated to the times of the readings; readings without a pose before and after are left out. Times are
the stamps of the messages, or the times of recording if a message has no stamp. Values that mean none (NaN, -9999) are
missing readings. What was assumed is a remark.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

import numpy as np
import pydantic

from taichi_plume.files import ros_messages as ros
from taichi_plume.files.bag_fields import Field, field_of, number_of
from taichi_plume.files.bag_frames import Frames, Pose, topics_for
from taichi_plume.files.bag_poses import GAP, Motion, Positions, between, gaps, in_order
from taichi_plume.files.bag_topics import GAS, WINDS, chosen, measured_poses, robot_name, wind_topic_of
from taichi_plume.files.bags import Bag, BagError, Sample, Series, opened, stamp_of
from taichi_plume.files.conventions import factor_of, is_missing, split_unit
from taichi_plume.files.tables import listed
from taichi_plume.quantities import SCALES
from taichi_plume.scenario import si
from taichi_plume.scenario.metal_oxides import MOX_MODELS, MoxName

Units = Literal["ppm", "ppb", "ohm"]
"""Units of gas that the user may give; a resistance is converted by the law of its sensor."""
NAMED_UNITS = {"ppm", "ppb", "ppt", "ppmv", "ppbv", "pptv", "percent", "ohm", "ohms", "kohm", "kohms", "v", "mv",
               "uv", "volt", "volts", "ma", "adc", "counts", "lel", "mg", "ug", "mg/m3", "ug/m3"}  # fmt: skip
"""Units at the end of the names of topics and fields, with those of other quantities than gas, which are refused."""
MAP = "map"
"""Frame of positions unless another is given."""


@dataclass(frozen=True)
class BagOptions:
    """Options of reading a ROS bag.

    gas: topic of gas; repeat it for several robots; by default all of the type. pose: pose of the robot, or a frame,
    for each topic of gas, by default that with poses around most readings. wind: topic of wind, for each topic of gas,
    by default its neighbour, if there is any. frame: frame of positions, by default map or, if the bag has none, that
    of the poses. sensor: index in a GasSensorArray, from 0 on. units: of gas, instead of the unit of the messages;
    plain numbers are ppm by default. model: metal oxide whose law converts resistances to ppm, by default as in the
    messages. air: resistance in clean air [ohm], by default as in the messages. upwind: Anemometer messages give the
    direction where the wind comes from. lenient: for trajectories alone, readings that cannot be converted to ppm are
    NaN, and wind is left out. reading: a number in messages of any type, such as /enose.data[0], after those of the
    topics of gas; may be repeated.
    """

    gas: Annotated[tuple[str, ...], "--topic TOPIC ..."] = ()
    pose: Annotated[tuple[str, ...], "--pose TOPIC ..."] = ()
    wind: Annotated[tuple[str, ...], "--wind TOPIC ..."] = ()
    frame: Annotated[str | None, "--frame NAME"] = None
    sensor: Annotated[Annotated[int, pydantic.Field(ge=0)] | None, "--sensor N"] = None
    units: Annotated[Units | None, "--units"] = None
    model: Annotated[MoxName | None, "--model"] = None
    air: Annotated[si.Resistance | None, "--air OHM"] = None
    upwind: Annotated[bool, "--upwind"] = False
    lenient: bool = False
    reading: Annotated[tuple[str, ...], "--reading FIELD ..."] = ()


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
    """Return the robots in a ROS bag. Raises BagError."""
    options = options or BagOptions()
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
            target = ros.plain_name(options.frame or MAP)
            positions = Positions(bag, options.frame, target, trees[of_frames], stamped, alone, poses)
            robots.append(_robot(positions, options, recorded, pose_topic, wind_topic))
        ids = [robot.name for robot in robots]
        return [
            replace(robot, name=name.strip("/")) if ids.count(robot.name) > 1 else robot
            for robot, name in zip(robots, names, strict=True)
        ]


class _Gas(NamedTuple):
    """Readings [ppm] of a gas topic, their name and unit in the bag, and what was assumed of the unit."""

    name: str
    series: Series
    units: str
    remarks: list[str]


def _robot(
    positions: Positions, options: BagOptions, gas: _Gas, pose_topic: str | None, wind_topic: str | None
) -> RecordedRobot:
    bag, stamped = positions.bag, positions.stamped
    series, read_at = gas.series, gas.series.times(stamped)
    remarks = list(gas.remarks)
    if not stamped:
        count = f"{np.count_nonzero(series.stamp > 0.0)} of {len(read_at)} messages have one"
        why = "other gas topics have none" if series.is_stamped else count
        remarks.append(f"times of {gas.name} are those of recording instead of stamps: {why}")
    motion = positions.motion(series, read_at, pose_topic)
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
        wind, wind_remarks = _wind(positions, options, wind_topic, read_at, motion)
    order = np.flatnonzero(known)[np.argsort(read_at[known], kind="stable")]
    if not known.all():
        count = f"{len(known) - known.sum()} of {len(known)}"
        remarks.append(f"{count} readings of {gas.name} have no pose before and after them and are left out")
    apart = gaps(motion.t, read_at[known])
    if (far := apart > GAP).any():
        count = f"{far.sum()} of {len(known)}"
        remarks.append(f"{count} readings of {gas.name} lie between poses up to {apart.max():.3g} s apart")
    return RecordedRobot(
        robot_name(series.topic),
        motion.t,
        *motion.way,
        read_at[order],
        motion.here.place[order, :2],
        series.values[order, 0],
        wind[order],
        f"gas of {gas.name} in {gas.units}, positions of {motion.text}, "
        + (f"wind of {wind_topic}" if wind_topic else "no wind"),
        motion.frame,
        (*remarks, *motion.remarks, *wind_remarks),
    )


def _without_gas(bag: Bag, options: BagOptions) -> list[RecordedRobot]:
    """Return robots with the trajectories of the pose topics, or of the frames, and without readings."""
    poses = measured_poses(bag)
    first = {robot_name(topic): topic for topic in poses[::-1] if bag.kinds[topic] == bag.kinds[poses[0]]}
    none, target, robots = np.zeros((0, 2)), ros.plain_name(options.frame or MAP), []
    for topic in options.pose or list(first.values())[::-1] or [""]:
        series = Series(topic, none[:, 0], none[:, 0], (), none)
        frames = Frames(bag, True, topics_for(bag, topic))
        positions = Positions(bag, options.frame, target, frames, True, len(first) < 2, {})
        motion = positions.motion(series, none[:, 0], topic if options.pose else None)
        name = robot_name(topic) if topic in bag.kinds else "robot"
        row = (none[:, 0], none, none[:, 0], none, f"positions of {motion.text}", motion.frame)
        robots.append(RecordedRobot(name, motion.t, *motion.way, *row, tuple(motion.remarks)))
    return robots


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

    named = options.units or _unit_in([topic])

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


def _unit_in(names: Iterable[str]) -> str | None:
    """Return the unit at the end of the first name of topics or fields with one, such as h2s_ppb or ohm; else None."""
    units = (split_unit(f"gas/{name.strip('/')}", NAMED_UNITS)[1] for name in names)
    return next(filter(None, units), None)


def _numbers_of(bag: Bag, field: Field, options: BagOptions) -> _Gas:
    """Return the readings that are a number in the messages of any type. Raises BagError."""
    names = [step for step in field.steps if isinstance(step, str)]
    named = options.units or _unit_in([*reversed(names), field.topic])
    where, units = f"{bag.path}: --reading {field.text}", named or "ppm"

    def get(message: ros.Message) -> Sample:
        stamp, frame, (raw,) = number_of(bag, field, message)
        return Sample(stamp, frame, (raw, _ppm(where, raw, units, None, options)))

    series = bag.series(field.topic, get)
    if np.isnan(series.values[:, 0]).all():
        raise BagError(f"{where}: no message has this number")
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
    resistance = SCALES["ohm"].get(units.removesuffix("s"))
    if resistance is None:
        if (factor := factor_of(units, "ppm")) is None:
            raise BagError(f"{where}: the unit of gas is {units}, not ppm, ppb or ohm; give --units")
        return raw * factor
    raw *= resistance
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


def _wind(
    positions: Positions, options: BagOptions, topic: str, read_at: np.ndarray, motion: Motion
) -> tuple[np.ndarray, list[str]]:
    """Return the wind (m, 2) [m/s] along the axes of the motion's frame, interpolated to the times of gas readings,
    zero if unknown, and remarks.

    The robot's heading turns the wind if /tf does not connect the anemometer's frame.
    """
    bag, frames, stamped = positions.bag, positions.frames, positions.stamped
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
    elif frame == positions.target and frame != motion.frame:
        remarks.append(f"wind of {topic} is along the axes of {frame}, assumed to be those of {motion.frame}")
    elif frame != motion.frame:
        chain = frames.chain(frame, motion.frame)
        turned = frames.pose(chain, t) if chain else between(motion.t, motion.way, t)
        c, s = np.cos(turned.heading), np.sin(turned.heading)
        wind = np.stack([c * wind[:, 0] - s * wind[:, 1], s * wind[:, 0] + c * wind[:, 1]], axis=-1)
        if not chain:
            remarks.append(
                f"no frame leads to the anemometer's, {frame}: its axes are assumed to be the robot's"
            )
    t, (wind, _) = in_order(t, Pose(wind, np.zeros(len(t))))
    if not len(t):
        return np.zeros((len(read_at), 2)), remarks
    return np.stack([np.interp(read_at, t, axis, left=0.0, right=0.0) for axis in wind.T], axis=-1), remarks
