"""Robots in ROS messages, live and in bags: coordinate frames (tf) and sensor descriptions.

map                     frame of the scenario's first map of ROS; without one, origin and axes of the domain
domain                  instead of map in a bag, if that map's file cannot be read: origin and axes of the domain
ROBOT/odom              the map as the robot believes it by its odometry, map itself at the start; live its transform
                        corrects the odometry, as an ideal localiser would; in bags map and odom stay one
ROBOT/base_link         centre of the body, in 3-D of its lower end; in ROBOT/odom the believed pose
ROBOT/gas_sensor        first gas sensor; gas_sensor_1 the next, and so on. Lasers point along x
ROBOT/anemometer
"""

from collections.abc import Iterable, Iterator, Mapping
from math import atan2, hypot, pi, radians
from typing import NamedTuple

import numpy as np

from taichi_plume.files import ros_messages as ros
from taichi_plume.grid.floor_plans import FloorPlan
from taichi_plume.scenario.gas_sensors import GasSensor, PidSensor, TdlasSensor
from taichi_plume.scenario.metal_oxides import MoxSensor
from taichi_plume.scenario.obstacles import WallMap
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.sensors import Sensors

BASE, GAS, WIND, ODOM = "base_link", "gas_sensor", "anemometer", "odom"
TRANSFORMS = "tf2_msgs/msg/TFMessage"
Fields = dict[str, object]
"""Fields of a message or of a part of one, by name."""


class MapFrame(NamedTuple):
    """Frame of published positions, with the domain's axes. corner: the domain's lower corner in it, x and y [m]."""

    name: str = "map"
    corner: tuple[float, float] = (0.0, 0.0)

    @classmethod
    def of(cls, scenario: Scenario, shapes: Iterable[object]) -> "MapFrame":
        """Return the frame of a scenario's first map of ROS, whose shape is in `shapes` unless its file is missing."""
        first = next((obstacle for obstacle in scenario.obstacles if isinstance(obstacle, WallMap)), None)
        if first is None:
            return cls()
        plans = (shape for shape in shapes if isinstance(shape, FloorPlan) and shape.model == first)
        origin = first.origin or next((plan.origin for plan in plans), None)
        return cls("domain") if origin is None else cls(corner=(float(origin[0]), float(origin[1])))

    def origin_of(self, frame: str | None) -> tuple[float, float]:
        """Return the position [m] in the domain of a frame's origin: of this frame its own, of others 0."""
        x, y = self.corner if frame == self.name else (0.0, 0.0)
        return 0.0 - x, 0.0 - y

    def point(self, x: float, y: float, z: float = 0.0) -> dict[str, float]:
        """Return a position in the domain [m] as the fields of a ROS Point in this frame."""
        return {"x": x + self.corner[0], "y": y + self.corner[1], "z": z}

    def grid(self, percent: np.ndarray, cell: float, low: float, t: float) -> ros.Message:
        """Return a ROS OccupancyGrid, see `ros_messages.grid`; low: its corner in the domain, x and y [m]."""
        x, y = self.corner
        return ros.grid(percent, cell, (x + low, y + low), t, self.name)

    def cloud(self, columns: Mapping[str, np.ndarray], t: float) -> ros.Message:
        """Return a ROS PointCloud2 of columns (n,) by name, with positions x, y, z in the domain [m]."""
        moved = {axis: columns[axis] + shift for axis, shift in zip("xy", self.corner, strict=True)}
        return ros.cloud({**columns, **moved}, t, self.name)


def numbered(name: str, slot: int) -> str:
    """Return the topic or frame name of gas sensor `slot`: `name` for slot 0, `name_1` for slot 1, and so on."""
    return f"{name}_{slot}" if slot else name


def transform(
    parent: str, child: str, place: dict[str, float], turn: dict[str, float], t: float = 0.0
) -> Fields:
    """Return the fields of a ROS TransformStamped: pose (position, quaternion) of frame `child` in `parent`."""
    pose = {"translation": place, "rotation": turn}
    return {"header": ros.header(t, parent), "child_frame_id": child, "transform": pose}


def carried(robot: str, sensors: Sensors, flat: bool) -> Iterator[Fields]:
    """Yield the transforms from a robot's base frame to each sensor's frame; flat: in 2-D, without heights."""
    base = f"{robot}/{BASE}"
    for k, gas in enumerate(sensors.noses):
        place = {"x": gas.ahead, "y": gas.left, "z": 0.0 if flat else gas.height}
        looks = (radians(gas.bearing_deg), radians(gas.tilt_deg)) if isinstance(gas, TdlasSensor) else (0, 0)
        yield transform(base, f"{robot}/{numbered(GAS, k)}", place, ros.yawed(*looks))
    place = {"z": 0.0 if flat else sensors.wind.height}
    yield transform(base, f"{robot}/{WIND}", place, ros.yawed(0.0))


def sensor_fields(sensor: GasSensor) -> Fields:
    """Return the constant fields of a gas sensor's ROS messages: technology, units and, if known, the part."""
    kind, unit = "unknown", "ppm"
    part: Fields = {}
    if isinstance(sensor, MoxSensor):
        kind = "mox"
        maker = "figaro" if sensor.model.startswith("tgs") else "sgx"
        part = {"manufacturer": ros.MAKERS[maker], "mpn": ros.PARTS.get(sensor.model.upper(), 0)}
    elif isinstance(sensor, PidSensor):
        kind = "pid"
    elif isinstance(sensor, TdlasSensor):
        kind = "tdlas"
        unit = "ppm m" if sensor.gives == "integral" else "ppm"
    return {"technology": ros.TECHNOLOGIES[kind], "raw_units": ros.UNITS[unit]} | part


def wind_fields(robot: str, u: float, v: float, heading: float, t: float = 0.0) -> Fields:
    """Return a wind (u, v) [m/s] in map axes as ROS Anemometer fields in the robot's frame; zero if unknown."""
    course = atan2(v, u) - heading if u or v else 0.0
    return {
        "header": ros.header(t, f"{robot}/{WIND}"),
        "sensor_label": f"{robot}/wind",
        "wind_speed": hypot(u, v),
        "wind_direction": (course + pi) % (2.0 * pi) - pi,
    }
