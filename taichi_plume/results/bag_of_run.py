"""Export of a run as a ROS 2 bag: ``python -m taichi_plume export RUN --to mcap`` writes the folder RUN/bag.

The bag holds one trial, with every message at its simulated time. Robot k of a group has

    /GROUP_k/gas    olfaction_msgs/GasSensor: a resistance [ohm] of metal oxides, ppm m of lasers, ppm of others;
                    of the first sensor, /GROUP_k/gas_1 of the next, and so on
    /GROUP_k/wind   olfaction_msgs/Anemometer, in the sensor's frame
    /GROUP_k/odom   nav_msgs/Odometry: believed pose, velocities from it, and covariances from row to row
    /GROUP_k/truth  geometry_msgs/PoseStamped: true pose

Common topics are /tf and /tf_static (map, GROUP_k/odom, GROUP_k/base_link, GROUP_k/gas_sensor, GROUP_k/anemometer),
/clock and /map, occupied where no robot can be. The frame GROUP_k/odom is map: readings stand at their believed
positions, as in the maps of the run. A run with `fields` has gas and temperature as points, /plume/SPECIES and
/plume/temperature. Without `fields` these are of the recording's first horizontal slice, and /plume/gas is the sum of
several species. A run with `maps` has the final gas maps, /gas_maps/map_N in percent of the peak and
/gas_maps/map_N/cells as points.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from heapq import merge
from math import exp, log
from pathlib import Path

import numpy as np

from taichi_plume.files import point_clouds
from taichi_plume.files import ros_messages as ros
from taichi_plume.files.bag_writer import BagWriter, NoBagError, new_bag
from taichi_plume.files.ros_odometry import ODOMETRY, DeadReckoning
from taichi_plume.files.ros_robots import (
    BASE,
    GAS,
    ODOM,
    TRANSFORMS,
    Fields,
    MapFrame,
    carried,
    numbered,
    sensor_fields,
    transform,
    wind_fields,
)
from taichi_plume.files.run_folder import RunFolderError
from taichi_plume.results.bag_of_fields import (
    Stamped,
    cloud_topic,
    clouds,
    floor,
    maps_at_end,
    maps_of,
    scalars,
)
from taichi_plume.results.run import Run
from taichi_plume.scenario.gas_sensors import GasSensor
from taichi_plume.scenario.metal_oxides import MOX_MODELS, MoxSensor
from taichi_plume.scenario.robots import Group
from taichi_plume.version import __version__

BELIEVED = ("believed_x", "believed_y", "z")  # m
COLUMNS = ("t", "x", "y", "heading", "wind_x", "wind_y", "believed_x", "believed_y", "believed_heading")
POSE, CLOCK = "geometry_msgs/msg/PoseStamped", "rosgraph_msgs/msg/Clock"
LATEST = 2**31 - 1  # s, the largest time of ROS


def write(
    run: Run,
    out: Path,
    force: bool = False,
    *,
    trial: int = 0,
    begin: float = 0.0,
    points: int = point_clouds.MOST_POINTS,
    least: float = point_clouds.LEAST,
    allow_outside: bool = False,
) -> list[Path]:
    """Write one trial of a run as a ROS 2 bag into folder `out`; return the files. force: replace an existing bag.

    begin: time of ROS at t = 0 [s]; points: largest size of a cloud, for which cells are averaged; least: ppm below
    which a point is left out; allow_outside: read obstacles' files outside the run's folder. Raises RunFolderError if
    the run has nothing for a bag or the bag may not be written, and OSError.
    """
    robots = _robots(run, trial)
    data, names = scalars(run)
    if not robots and not names:
        raise RunFolderError(f"{run.folder}: has neither robots nor fields nor pictures: nothing for a bag")
    end = begin + float(run.scenario.duration)
    if not end < LATEST:
        raise RunFolderError(f"{run.folder}: ends at {end:g} s; ROS takes under {LATEST} s: lower --begin")
    facts = {robot.name: f"robot {robot.number} of {robot.group.name}" for robot in robots}
    facts |= {"name": run.scenario.name, "trial": str(trial), "made_by": f"taichi_plume {__version__}"}
    try:
        with new_bag(out, facts, force) as bag:
            _topics(bag, run, robots, [cloud_topic(data, name) for name in names], trial)
            plan, frame = floor(run, allow_outside)
            streams: list[Iterator[Stamped]] = [_still(run, robots, plan, frame)]
            times = [float(t) for t in robots[0].table["t"]] if robots else data.time.values.tolist()
            streams += [((t, "/clock", None) for t in times if t >= 0), _moving(robots, frame)]
            streams += [_readings(robot, frame) for robot in robots]
            streams += [clouds(data, run.folder, name, points, least, frame) for name in names]
            streams.append(maps_at_end(run, trial, frame))
            for t, topic, message in merge(*streams, key=lambda stamped: stamped[0]):
                now = begin + t
                bag.write(topic, now, _stamped(message, now))
    except NoBagError as error:
        raise RunFolderError(str(error)) from None
    return sorted(out.iterdir())


def _stamped(message: ros.Message, now: float) -> ros.Message:
    """Set the time [s] in all headers of a ROS message and return it; None returns a /clock message."""
    if message is None:
        return ros.message(CLOCK, clock=ros.time(now))
    stamp = ros.message("builtin_interfaces/msg/Time", **ros.time(now))
    kind = message.__msgtype__
    for part in message.transforms if kind == TRANSFORMS else [message]:
        part.header.stamp = stamp
    if kind == ros.GRID:
        message.info.map_load_time = stamp
    return message


def _topics(bag: BagWriter, run: Run, robots: "list[Robot]", plumes: list[str], trial: int) -> None:
    bag.topic("/clock", CLOCK)
    bag.topic("/map", ros.GRID, latched=True)
    if robots:
        bag.topic("/tf", TRANSFORMS)
        bag.topic("/tf_static", TRANSFORMS, latched=True)
    for robot in robots:
        gas = [(numbered("gas", k), ros.GAS_SENSOR) for k in range(len(robot.group.sensors.noses))]
        for name, kind in (*gas, ("wind", ros.ANEMOMETER), ("odom", ODOMETRY), ("truth", POSE)):
            bag.topic(f"/{robot.name}/{name}", kind)
    for name in plumes:
        bag.topic(name, ros.POINTS)
    for name, _, _ in maps_of(run, trial):
        bag.topic(name, ros.GRID, latched=True)
        bag.topic(f"{name}/cells", ros.POINTS, latched=True)


# ---------------------------------------------------------------- robots


@dataclass(frozen=True)
class Robot:
    """A recorded robot: prefix of its topics and frames, its number in the group, and its table columns by name."""

    name: str
    number: int
    group: Group
    table: dict[str, np.ndarray]


def _column(sensor: int, unit: str) -> str:
    """Return the column name in robots.parquet of gas sensor number `sensor` (from 0) in ppm or ohm."""
    return f"{numbered({'ppm': 'reading', 'ohm': 'resistance'}[unit], sensor)}_{unit}"


def _robots(run: Run, trial: int) -> list[Robot]:
    """Return the recorded robots of a trial. Raises RunFolderError if robots.parquet has no such trial."""
    if not run.scenario.robots:
        return []
    from taichi_plume.files import run_tables

    path, groups = run.folder / "robots.parquet", run.scenario.robots
    slots = range(max(len(group.sensors.noses) for group in groups))
    sensed = [_column(k, unit) for k in slots for unit in ("ppm", "ohm")]
    tables, trials = run_tables.robots_of(path, (*COLUMNS, *sensed), trial)
    if trial not in trials:
        hint = f"the last is {max(trials)}" if trials else "it has no row"
        raise RunFolderError(f"{path}: has no trial {trial}; {hint}")
    robots: list[Robot] = []
    words = [ros.word(group.name) for group in groups]
    for n, group in enumerate(groups):
        called = words[n] if words.count(words[n]) == 1 else f"{words[n]}_{n}"
        robots += [
            Robot(f"{called}_{number}", number, group, tables[group.name, number])
            for number in range(group.count)
            if (group.name, number) in tables
        ]
    return robots


def _still(run: Run, robots: list[Robot], plan: ros.Message, frame: MapFrame) -> Iterator[Stamped]:
    """Yield the ROS messages that do not change: the floor plan, and the frames of odometry and sensors."""
    yield 0.0, "/map", plan
    flat = run.scenario.domain.dim == 2
    links = [transform(frame.name, f"{robot.name}/{ODOM}", {}, ros.yawed(0.0)) for robot in robots]
    links += [link for robot in robots for link in carried(robot.name, robot.group.sensors, flat)]
    if links:
        yield 0.0, "/tf_static", ros.message(TRANSFORMS, transforms=links)


def _moving(robots: list[Robot], frame: MapFrame) -> Iterator[Stamped]:
    """Yield a /tf message per time with the poses that the robots believe to have."""
    for n, t in enumerate(robots[0].table["t"] if robots else ()):
        moved: list[Fields] = []
        for name, table in ((robot.name, robot.table) for robot in robots if n < len(robot.table["t"])):
            place = frame.point(*(float(table[key][n]) for key in BELIEVED))
            turn = ros.yawed(float(table["believed_heading"][n]))
            moved.append(transform(f"{name}/{ODOM}", f"{name}/{BASE}", place, turn))
        yield float(t), "/tf", ros.message(TRANSFORMS, transforms=moved)


def _readings(robot: Robot, frame: MapFrame) -> Iterator[Stamped]:
    """Yield a robot's ROS messages: odometry, true pose and, after t = 0, gas and wind readings."""
    table, name = robot.table, robot.name
    gas_sensors = [_gas_sensor(robot, k, sensor) for k, sensor in enumerate(robot.group.sensors.noses)]
    reckoning = DeadReckoning(robot.group.localization, 1)
    places, headings = np.column_stack([table[key] for key in BELIEVED]), table["believed_heading"]
    for n, t in enumerate(table["t"].tolist()):
        reckoning.advance(t, places[n : n + 1], headings[n : n + 1])
        yield t, f"/{name}/{ODOM}", ros.message(ODOMETRY, **reckoning.fields(0, name, frame))
        there = frame.point(*(float(table[axis][n]) for axis in "xyz"))
        true = {"position": there, "orientation": ros.yawed(float(table["heading"][n]))}
        yield t, f"/{name}/truth", ros.message(POSE, header=ros.header(0.0, frame.name), pose=true)
        if t > 0.0:
            for topic, constant, raw in gas_sensors:
                yield t, topic, ros.message(ros.GAS_SENSOR, raw=float(raw[n]), **constant)
            x, y = float(table["wind_x"][n]), float(table["wind_y"][n])
            yield (
                t,
                f"/{name}/wind",
                ros.message(ros.ANEMOMETER, **wind_fields(name, x, y, float(headings[n]))),
            )


def _gas_sensor(robot: Robot, k: int, sensor: GasSensor) -> tuple[str, Fields, np.ndarray]:
    """Return topic of a robot's gas sensor k, the message fields that are constant, and the raw readings (n,)."""
    topic, ppm = f"/{robot.name}/{numbered('gas', k)}", robot.table[_column(k, "ppm")]
    constant = {"header": ros.header(0.0, f"{robot.name}/{numbered(GAS, k)}")} | sensor_fields(sensor)
    if not isinstance(sensor, MoxSensor):
        return topic, constant, ppm
    (c0, b), ohm = sensor.reading_curve, robot.table[_column(k, "ohm")]
    law = {"raw_air": _in_clean_air(ppm, ohm, sensor), "calib_a": c0**b, "calib_b": -b}
    return topic, constant | {"raw_units": ros.UNITS["ohm"]} | law, ohm


def _in_clean_air(ppm: np.ndarray, ohm: np.ndarray, sensor: MoxSensor) -> float:
    """Return the clean-air resistance [ohm] of the metal-oxide sensor that gave the readings, from ppm and ohm.

    The resistance follows from the largest reading above zero. Without such a reading, or with a cubic calibration, it
    is the model's nominal value or, if units of the model vary, the largest recorded resistance.
    """
    (c0, b), air = sensor.reading_curve, MOX_MODELS[sensor.model].air
    known = np.isfinite(ohm) & (ppm > 0.0)
    if sensor.calibration == "model" and known.any():
        n = np.argmax(np.where(known, ppm, -1.0))
        return float(ohm[n] * (1.0 + ppm[n] / c0) ** b)
    if sensor.spread and np.isfinite(ohm).any():
        return float(np.nanmax(ohm))
    return exp(0.5 * (log(air[0]) + log(air[1])))
