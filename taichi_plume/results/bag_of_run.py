"""A run as a bag of ROS 2: ``python -m taichi_plume.export RUN --to mcap`` writes the folder RUN/bag.

One trial of it, with every message at its simulated time. Robot k of a group has

    /GROUP_k/gas    olfaction_msgs/GasSensor: a resistance [ohm] of metal oxides, ppm of others, ppm m of lasers; of
                    robots with several sensors that of the first, /GROUP_k/gas_1 of the next, and so on
    /GROUP_k/wind   olfaction_msgs/Anemometer, in its own frame
    /GROUP_k/odom   nav_msgs/Odometry: where it believes to be, and how it moves by that
    /GROUP_k/truth  geometry_msgs/PoseStamped: where it is

and there are /tf and /tf_static (map, GROUP_k/base_link, GROUP_k/gas_sensor, GROUP_k/anemometer), /clock and /map,
which is occupied where no robot can be; of a run with `fields` its gas as points, /plume/SPECIES, and of one with
`maps` each at the end, /gas_maps/map_N in percent of its peak and /gas_maps/map_N/cells as points.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from heapq import merge
from math import exp, log
from pathlib import Path
from typing import Any

import numpy as np

from taichi_plume import __version__
from taichi_plume.files import ros_messages as ros
from taichi_plume.files.bag_writer import BagWriter, NoBagError, new_bag
from taichi_plume.files.ros_robots import (
    BASE,
    GAS,
    MAP,
    TRANSFORMS,
    carried,
    numbered,
    sensor_fields,
    transform,
    wind_fields,
)
from taichi_plume.files.ros_shapes import GRID, POINTS
from taichi_plume.files.run_folder import RunFolderError
from taichi_plume.results.bag_of_fields import Said, clouds, floor, maps_at_end, maps_of, species
from taichi_plume.results.run import Run
from taichi_plume.scenario.gas_sensors import GasSensor
from taichi_plume.scenario.metal_oxides import MOX_MODELS, MoxSensor
from taichi_plume.scenario.robots import Group

COLUMNS = (
    "t", "group", "trial", "robot", "x", "y", "heading", "wind_x", "wind_y", "believed_x", "believed_y",
    "believed_heading",
)  # fmt: skip
ODOMETRY, POSE = "nav_msgs/msg/Odometry", "geometry_msgs/msg/PoseStamped"
CLOCK = "rosgraph_msgs/msg/Clock"
LATEST = 2**31 - 1  # s that a time of ROS can tell


@dataclass(frozen=True)
class Choice:
    """What of a run goes into its bag.

    begin: time of ROS at its begin [s]; points: the most of a cloud, for which cells are averaged; least: fewer ppm are
    no point; allow_outside: whether obstacles' files may lie outside the run's folder.
    """

    trial: int = 0
    begin: float = 0.0
    points: int = 20_000
    least: float = 0.1
    allow_outside: bool = False


def write(run: Run, out: Path, choice: Choice, force: bool = False) -> list[Path]:
    """Write a bag; returns its files.

    Raises RunFolderError where the run has nothing for it, or where it may not be written, and OSError.
    """
    robots = _robots(run, choice.trial)
    gases = [str(name) for name in run.fields.data_vars if str(name).endswith("_ppm")] if _filmed(run) else []
    if not robots and not gases:
        raise RunFolderError(f"{run.folder}: has neither robots nor fields, so there is nothing for a bag")
    end = choice.begin + float(run.scenario.duration)
    if not end < LATEST:
        raise RunFolderError(
            f"{run.folder}: ends at {end:g} s, which ROS cannot tell; give an earlier --begin"
        )
    told = {one.name: f"robot {one.number} of {one.group.name}" for one in robots}
    told |= {"name": run.scenario.name, "trial": str(choice.trial), "made_by": f"taichi_plume {__version__}"}
    try:
        with new_bag(out, told, force) as bag:
            _topics(bag, run, robots, gases, choice)
            streams: list[Iterator[Said]] = [_still(run, robots, choice.allow_outside)]
            times = [float(t) for t in robots[0].table["t"]] if robots else run.fields.time.values.tolist()
            streams += [((t, "/clock", None) for t in times if t >= 0), _moving(robots)]
            streams += [_readings(one) for one in robots]
            streams += [clouds(run, name, choice.points, choice.least) for name in gases]
            streams.append(maps_at_end(run, choice.trial))
            for t, topic, message in merge(*streams, key=lambda one: one[0]):
                now = choice.begin + t
                bag.write(topic, now, _stamped(message, now))
    except NoBagError as error:
        raise RunFolderError(str(error)) from None
    return sorted(out.iterdir())


def _stamped(message: Any, now: float) -> Any:
    """A message whose headers tell the time [s]."""
    if message is None:
        return ros.message(CLOCK, clock=ros.time(now))
    stamp = ros.message("builtin_interfaces/msg/Time", **ros.time(now))
    for one in [message, *getattr(message, "transforms", ())]:
        if hasattr(one, "header"):
            one.header.stamp = stamp
    if hasattr(message, "info"):
        message.info.map_load_time = stamp
    return message


def _filmed(run: Run) -> bool:
    return (run.folder / "fields.zarr").exists()


def _topics(bag: BagWriter, run: Run, robots: "list[Robot]", gases: list[str], choice: Choice) -> None:
    bag.topic("/clock", CLOCK)
    bag.topic("/map", GRID, latched=True)
    if robots:
        bag.topic("/tf", TRANSFORMS)
        bag.topic("/tf_static", TRANSFORMS, latched=True)
    for one in robots:
        noses = [(numbered("gas", k), ros.GAS_SENSOR) for k in range(len(one.group.sensors.noses))]
        for name, kind in (*noses, ("wind", ros.ANEMOMETER), ("odom", ODOMETRY), ("truth", POSE)):
            bag.topic(f"/{one.name}/{name}", kind)
    for name in gases:
        bag.topic(f"/plume/{species(name)}", POINTS)
    for name, _, _ in maps_of(run, choice.trial):
        bag.topic(name, GRID, latched=True)
        bag.topic(f"{name}/cells", POINTS, latched=True)


# ---------------------------------------------------------------- robots


@dataclass(frozen=True)
class Robot:
    """The robot of a number in its group, and the rows of its table. name: of its topics and frames."""

    name: str
    number: int
    group: Group
    table: dict[str, np.ndarray]

    def read(self, sensor: int, unit: str) -> np.ndarray:
        """What a gas sensor told in ppm or ohm."""
        return self.table[_column(sensor, unit)]


def _column(sensor: int, unit: str) -> str:
    """Where a table has what a gas sensor, from 0 on, told in ppm or ohm."""
    return f"{numbered({'ppm': 'reading', 'ohm': 'resistance'}[unit], sensor)}_{unit}"


def _robots(run: Run, trial: int) -> list[Robot]:
    """The robots of a trial. Raises RunFolderError where there is none."""
    if not run.scenario.robots:
        return []
    import pyarrow as pa
    import pyarrow.compute as pc

    from taichi_plume.files import table_parts

    path = run.folder / "robots.parquet"
    there: set[int] = set()
    kept = []
    noses = range(max(len(group.sensors.noses) for group in run.scenario.robots))
    sensed = [_column(k, unit) for k in noses for unit in ("ppm", "ohm")]
    flown = ["z"] if any(group.body.flies for group in run.scenario.robots) else []
    wanted = (*COLUMNS, *sensed, *flown)
    for batch in table_parts.batches(path, wanted):
        there.update(pc.unique(batch["trial"]).to_pylist())
        kept.append(batch.filter(pc.equal(batch["trial"], trial)))
    if trial not in there:
        last = max(there, default=-1)
        raise RunFolderError(
            f"{path}: has no trial {trial}; " + (f"the last is {last}" if last >= 0 else "it has no row")
        )
    table = pa.Table.from_batches(kept).unify_dictionaries()
    groups, numbers = np.array(table["group"].cast(pa.string()).to_pylist()), table["robot"].to_numpy()
    columns = {name: table[name].to_numpy() for name in wanted if name not in ("group", "trial", "robot")}
    columns.setdefault("z", np.zeros(len(numbers)))
    columns["z"] = np.nan_to_num(columns["z"])  # 0 on the floor
    robots: list[Robot] = []
    words = [ros.word(group.name) for group in run.scenario.robots]
    for n, group in enumerate(run.scenario.robots):
        called = words[n] if words.count(words[n]) == 1 else f"{words[n]}_{n}"
        for number in range(group.count):
            rows = np.flatnonzero((groups == group.name) & (numbers == number))
            rows = rows[np.argsort(columns["t"][rows], kind="stable")]
            if len(rows):
                its = {name: one[rows] for name, one in columns.items()}
                robots.append(Robot(f"{called}_{number}", number, group, its))
    return robots


def _still(run: Run, robots: list[Robot], allow_outside: bool) -> Iterator[Said]:
    """What does not change: the map, and where the sensors are on the robots."""
    yield 0.0, "/map", floor(run, allow_outside)
    flat = run.scenario.domain.dim == 2
    places = [each for one in robots for each in carried(one.name, one.group.sensors, flat)]
    if places:
        yield 0.0, "/tf_static", ros.message(TRANSFORMS, transforms=places)


def _believed(table: dict[str, np.ndarray], n: int) -> tuple[dict[str, float], float]:
    place = {
        "x": float(table["believed_x"][n]),
        "y": float(table["believed_y"][n]),
        "z": float(table["z"][n]),
    }
    return place, float(table["believed_heading"][n])


def _moving(robots: list[Robot]) -> Iterator[Said]:
    """Where the robots believe to be, those of a time in one message."""
    for n, t in enumerate(robots[0].table["t"] if robots else ()):
        now = [(one.name, *_believed(one.table, n)) for one in robots if n < len(one.table["t"])]
        moved = [transform(MAP, f"{name}/{BASE}", place, ros.yawed(heading)) for name, place, heading in now]
        yield float(t), "/tf", ros.message(TRANSFORMS, transforms=moved)


def _readings(one: Robot) -> Iterator[Said]:
    """What a robot measures, which begins after the run, and its poses."""
    table, name = one.table, one.name
    noses = [_gas_sensor(one, k, sensor) for k, sensor in enumerate(one.group.sensors.noses)]
    moving, turning = _speeds(table)
    for n, t in enumerate(table["t"].tolist()):
        place, heading = _believed(table, n)
        pose = {"position": place, "orientation": ros.yawed(heading)}
        twist = {
            "linear": dict(zip("xyz", moving[n].tolist(), strict=True)),
            "angular": {"z": float(turning[n])},
        }
        yield (
            t,
            f"/{name}/odom",
            ros.message(
                ODOMETRY,
                header=ros.header(0.0, MAP),
                child_frame_id=f"{name}/{BASE}",
                pose={"pose": pose},
                twist={"twist": twist},
            ),
        )
        there = place | {"x": float(table["x"][n]), "y": float(table["y"][n])}
        true = {"position": there, "orientation": ros.yawed(float(table["heading"][n]))}
        yield t, f"/{name}/truth", ros.message(POSE, header=ros.header(0.0, MAP), pose=true)
        if t > 0.0:
            for topic, told, raw in noses:
                yield t, topic, ros.message(ros.GAS_SENSOR, raw=float(raw[n]), **told)
            x, y = float(table["wind_x"][n]), float(table["wind_y"][n])
            yield t, f"/{name}/wind", ros.message(ros.ANEMOMETER, **wind_fields(name, x, y, heading))


def _wrapped(angle: Any) -> Any:
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


def _speeds(table: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """How the robot believes to have moved since the row before: forward, to the left and upward (n, 3) [m/s], and
    turning (n,) [rad/s].
    """
    dt = np.diff(table["t"])
    turn = _wrapped(np.diff(table["believed_heading"].astype(float)))
    course = table["believed_heading"][:-1] + 0.5 * turn
    x, y = np.diff(table["believed_x"]), np.diff(table["believed_y"])
    forward, left = x * np.cos(course) + y * np.sin(course), y * np.cos(course) - x * np.sin(course)
    moved = np.column_stack([forward, left, np.diff(table["z"])]) / dt[:, None]
    return np.vstack([np.zeros((1, 3)), moved]), np.append(0.0, turn / dt)


def _gas_sensor(one: Robot, k: int, sensor: GasSensor) -> tuple[str, dict[str, Any], np.ndarray]:
    """The topic of a robot's gas sensor, what is the same in all of its messages, and what it tells."""
    topic = f"/{one.name}/{numbered('gas', k)}"
    told = {"header": ros.header(0.0, f"{one.name}/{numbered(GAS, k)}")} | sensor_fields(sensor)
    if not isinstance(sensor, MoxSensor):
        return topic, told, one.read(k, "ppm")
    (c0, b), ohm = sensor.reading_curve, one.read(k, "ohm")
    told |= {
        "raw_units": ros.UNITS["ohm"],
        "raw_air": _in_clean_air(one.read(k, "ppm"), ohm, sensor),
        "calib_a": c0**b,
        "calib_b": -b,
    }
    return topic, told, ohm


def _in_clean_air(ppm: np.ndarray, ohm: np.ndarray, sensor: MoxSensor) -> float:
    """The resistance of a unit in clean air [ohm] that its readings were made with.

    The law tells it of any reading above zero. Where there is none, or a cubic made them: that of the model, or the
    largest of a unit that differs.
    """
    (c0, b), air = sensor.reading_curve, MOX_MODELS[sensor.model].air
    known = np.isfinite(ohm) & (ppm > 0.0)
    if sensor.calibration == "model" and known.any():
        n = np.argmax(np.where(known, ppm, -1.0))
        return float(ohm[n] * (1.0 + ppm[n] / c0) ** b)
    if sensor.spread and np.isfinite(ohm).any():
        return float(np.nanmax(ohm))
    return exp(0.5 * (log(air[0]) + log(air[1])))
