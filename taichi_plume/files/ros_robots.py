"""Robots in messages of ROS, live and in bags alike: their frames, and what is told of their sensors.

map                     of the domain, origin and axes
ROBOT/base_link         the middle of the body, in 3-D of its lower end
ROBOT/gas_sensor        of the first gas sensor; gas_sensor_1 of the next one, and so on. Lasers look along its x
ROBOT/anemometer
"""

from collections.abc import Iterator
from math import atan2, hypot, pi, radians
from typing import Any

from taichi_plume.files import ros_messages as ros
from taichi_plume.scenario.gas_sensors import GasSensor, PidSensor, TdlasSensor
from taichi_plume.scenario.metal_oxides import MoxSensor
from taichi_plume.scenario.sensors import Sensors

MAP, BASE, GAS, WIND = "map", "base_link", "gas_sensor", "anemometer"
TRANSFORMS = "tf2_msgs/msg/TFMessage"


def numbered(name: str, nose: int) -> str:
    """The name of a topic or frame of a gas sensor, from 0 on."""
    return f"{name}_{nose}" if nose else name


def transform(
    parent: str, child: str, place: dict[str, float], turn: dict[str, float], t: float = 0.0
) -> dict[str, Any]:
    """A frame in its parent, as fields of geometry_msgs/TransformStamped at time t [s]."""
    return {
        "header": ros.header(t, parent),
        "child_frame_id": child,
        "transform": {"translation": place, "rotation": turn},
    }


def carried(robot: str, sensors: Sensors, flat: bool) -> Iterator[dict[str, Any]]:
    """Where a robot's sensors are on it, as `transform`; flat: whether heights count not, in 2-D."""
    base = f"{robot}/{BASE}"
    for k, one in enumerate(sensors.noses):
        place = {"x": one.ahead, "y": one.left, "z": 0.0 if flat else one.height}
        looks = (radians(one.bearing_deg), radians(one.tilt_deg)) if isinstance(one, TdlasSensor) else (0, 0)
        yield transform(base, f"{robot}/{numbered(GAS, k)}", place, ros.yawed(*looks))
    place = {"z": 0.0 if flat else sensors.wind.height}
    yield transform(base, f"{robot}/{WIND}", place, ros.yawed(0.0))


def sensor_fields(sensor: GasSensor) -> dict[str, Any]:
    """What GasSensor messages tell of a sensor, whatever it reads; units are those of its readings in gas."""
    kind = "unknown"
    unit = "ppm"
    told: dict[str, Any] = {}
    if isinstance(sensor, MoxSensor):
        kind = "mox"
        maker = "figaro" if sensor.model.startswith("tgs") else "sgx"
        told = {"manufacturer": ros.MAKERS[maker], "mpn": ros.PARTS.get(sensor.model.upper(), 0)}
    elif isinstance(sensor, PidSensor):
        kind = "pid"
    elif isinstance(sensor, TdlasSensor):
        kind = "tdlas"
        unit = "ppm m" if sensor.gives == "integral" else "ppm"
    return {"technology": ros.TECHNOLOGIES[kind], "raw_units": ros.UNITS[unit]} | told


def wind_fields(robot: str, u: float, v: float, heading: float, t: float = 0.0) -> dict[str, Any]:
    """A wind [m/s] along x and y of the map as fields of an Anemometer message of a robot; zero: none is known."""
    course = atan2(v, u) - heading if u or v else 0.0
    return {
        "header": ros.header(t, f"{robot}/{WIND}"),
        "sensor_label": f"{robot}/wind",
        "wind_speed": hypot(u, v),
        "wind_direction": (course + pi) % (2.0 * pi) - pi,
    }
