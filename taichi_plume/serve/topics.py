"""What the service tells, and under which names.

    clock              rosgraph_msgs/Clock           simulated time
    tf                 tf2_msgs/TFMessage            where the robots of the first trial are, from `map`
    map, plume/..., tf_static    see `view`
    GROUP/readings     taichi_plume_msgs/Readings    all that the robots of an external group read
    GROUP/commands     taichi_plume_msgs/Commands    what they are told: comes in
    ROBOT/cmd_vel      geometry_msgs/Twist           the same of one robot, where the group takes velocities: comes in
    ROBOT/pose         geometry_msgs/PoseStamped     where it takes poses: comes in
    ROBOT/odom         nav_msgs/Odometry             where it is
    ROBOT/gas          olfaction_msgs/GasSensor      ppm
    ROBOT/gas_raw      olfaction_msgs/GasSensor      ohm, of metal oxides
    ROBOT/wind         olfaction_msgs/Anemometer     in the frame of the robot

ROBOT is GROUP_n, n from 0 on through all trials. Groups of more than MOST_ROBOTS have no topics of each.
"""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from taichi_plume.files import ros_messages as ros

MOST_ROBOTS = 64
MAP, BASE, GAS, WIND = "map", "base_link", "gas_sensor", "anemometer"  # frames


class Message(NamedTuple):
    """What may be sent on a topic: its type, and what makes it where somebody wants it."""

    topic: str
    name: str
    make: Callable[[], Any]

    def data(self) -> bytes:
        """Its bytes."""
        return ros.encode(self.make())


def clock(t: float) -> Message:
    """Simulated time t [s]; the warm-up, before 0, is told as 0."""
    return _message("clock", "rosgraph_msgs/msg/Clock", dict, clock=ros.time(max(0.0, t)))


def readings(group: str, t: float, tick: int, told: dict[str, np.ndarray], **more: np.ndarray) -> Message:
    """All that the robots of a group read; told: see `ExternalAlgorithm`; more: answered, lost."""
    place, wind = told["believed_position"], told["wind"]
    count = len(place)
    return _message(
        f"{group}/readings",
        ros.READINGS,
        dict,
        t=t,
        tick=tick,
        robot=np.arange(count),
        x=place[:, 0],
        y=place[:, 1],
        z=told["altitude"],
        heading=told["believed_heading"],
        gas=told["reading"],
        resistance=told["resistance"],
        wind_x=wind[:, 0],
        wind_y=wind[:, 1],
        wind_known=told["wind_known"],
        blocked=told["blocked"],
        over=told["over"],
        **more,
    )


def ended(group: str, t: float, tick: int) -> Message:
    """The run is over."""
    return _message(f"{group}/readings", ros.READINGS, dict, t=t, tick=tick, ended=1)


def of_each(group: str, t: float, told: dict[str, np.ndarray], sensor: dict[str, Any]) -> Iterator[Message]:
    """What each robot of a group reads, as messages of ROS; sensor: fields of its GasSensor messages."""
    has_resistance = np.isfinite(told["resistance"])
    for n in range(len(has_resistance)):
        robot = f"{group}_{n}"
        yield _message(f"{robot}/odom", "nav_msgs/msg/Odometry", _odometry, robot, t, told, n)
        gas = {"header": ros.header(t, f"{robot}/{GAS}")} | sensor
        yield _message(f"{robot}/gas", ros.GAS_SENSOR, _gas, gas, "ppm", told["reading"], n)
        if has_resistance[n]:
            yield _message(f"{robot}/gas_raw", ros.GAS_SENSOR, _gas, gas, "ohm", told["resistance"], n)
        yield _message(f"{robot}/wind", ros.ANEMOMETER, _wind, robot, t, told, n)


def _odometry(robot: str, t: float, told: dict[str, np.ndarray], n: int) -> dict[str, Any]:
    x, y = told["believed_position"][n].tolist()
    pose = {
        "position": {"x": x, "y": y, "z": float(told["altitude"][n])},
        "orientation": ros.yawed(float(told["believed_heading"][n])),
    }
    return {"header": ros.header(t, MAP), "child_frame_id": f"{robot}/{BASE}", "pose": {"pose": pose}}


def _gas(about: dict[str, Any], unit: str, values: np.ndarray, n: int) -> dict[str, Any]:
    return about | {"raw": float(values[n]), "raw_units": ros.UNITS[unit]}


def _wind(robot: str, t: float, told: dict[str, np.ndarray], n: int) -> dict[str, Any]:
    u, v = told["wind"][n].tolist()
    course = np.arctan2(v, u) - told["believed_heading"][n]
    return {
        "header": ros.header(t, f"{robot}/{WIND}"),
        "sensor_label": f"{robot}/wind",
        "wind_speed": np.hypot(u, v),
        "wind_direction": np.arctan2(np.sin(course), np.cos(course)),
    }


def poses(t: float, names: list[str], position: np.ndarray, heading: np.ndarray) -> Message:
    """Where robots are: position (n, 2) [m], heading (n,) [rad]."""
    return _message("tf", "tf2_msgs/msg/TFMessage", _transforms, t, names, position, heading)


def _transforms(t: float, names: list[str], position: np.ndarray, heading: np.ndarray) -> dict[str, Any]:
    return {
        "transforms": [
            {
                "header": ros.header(t, MAP),
                "child_frame_id": f"{name}/{BASE}",
                "transform": {"translation": {"x": x, "y": y}, "rotation": ros.yawed(angle)},
            }
            for name, (x, y), angle in zip(names, position.tolist(), heading.tolist(), strict=True)
        ]
    }


def _message(
    topic: str, name: str, make: Callable[..., dict[str, Any]], /, *args: Any, **fields: Any
) -> Message:
    """One whose fields `make` gives, when they are wanted."""
    return Message(topic, name, lambda: ros.message(name, **make(*args, **fields)))
