"""What the service tells, and under which names.

    clock              rosgraph_msgs/Clock           simulated time
    tf                 tf2_msgs/TFMessage            where the robots of the first trial are, from `map`
    map, plume/...     see `view`
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

import re
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from taichi_plume.files import ros_messages as ros

MOST_ROBOTS = 64
MAP = "map"


class Message(NamedTuple):
    """A message to be sent: its topic, its type and its bytes."""

    topic: str
    name: str
    data: bytes


def word(name: str) -> str:
    """A group's name as a part of a topic's."""
    clean = re.sub(r"[^A-Za-z0-9_]", "_", name)
    return clean if clean[:1].isalpha() else f"g_{clean}"


def clock(t: float) -> Message:
    """Simulated time t [s]; the warm-up, before 0, is told as 0."""
    return _message("clock", "rosgraph_msgs/msg/Clock", clock=ros.time(max(0.0, t)))


def readings(group: str, t: float, tick: int, told: dict[str, np.ndarray], **more: np.ndarray) -> Message:
    """All that the robots of a group read; told: see `ExternalAlgorithm`; more: answered, lost."""
    place, wind = told["believed_position"], told["wind"]
    count = len(place)
    return _message(
        f"{group}/readings",
        ros.READINGS,
        t=t,
        tick=tick,
        robot=np.arange(count),
        x=place[:, 0],
        y=place[:, 1],
        z=np.zeros(count),
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
    return _message(f"{group}/readings", ros.READINGS, t=t, tick=tick, ended=1)


def of_each(group: str, t: float, told: dict[str, np.ndarray], sensor: dict[str, Any]) -> Iterator[Message]:
    """What each robot of a group reads, as messages of ROS; sensor: fields of its GasSensor messages."""
    for n, ((x, y), heading) in enumerate(
        zip(told["believed_position"].tolist(), told["believed_heading"].tolist(), strict=True)
    ):
        robot = f"{group}_{n}"
        pose = {"position": {"x": x, "y": y}, "orientation": ros.yawed(heading)}
        yield _message(
            f"{robot}/odom",
            "nav_msgs/msg/Odometry",
            header=ros.header(t, MAP),
            child_frame_id=robot,
            pose={"pose": pose},
        )
        gas = {"header": ros.header(t, robot)} | sensor
        ppm = float(told["reading"][n])
        yield _message(f"{robot}/gas", ros.GAS_SENSOR, raw=ppm, raw_units=ros.UNITS["ppm"], **gas)
        resistance = float(told["resistance"][n])
        if np.isfinite(resistance):
            yield _message(
                f"{robot}/gas_raw", ros.GAS_SENSOR, raw=resistance, raw_units=ros.UNITS["ohm"], **gas
            )
        u, v = told["wind"][n].tolist()
        yield _message(
            f"{robot}/wind",
            ros.ANEMOMETER,
            header=ros.header(t, robot),
            sensor_label=f"{robot}/wind",
            wind_speed=np.hypot(u, v),
            wind_direction=np.arctan2(v, u) - heading,
        )


def poses(t: float, names: list[str], position: np.ndarray, heading: np.ndarray) -> Message:
    """Where robots are: position (n, 2) [m], heading (n,) [rad]."""
    transforms = [
        {
            "header": ros.header(t, MAP),
            "child_frame_id": name,
            "transform": {"translation": {"x": x, "y": y}, "rotation": ros.yawed(angle)},
        }
        for name, (x, y), angle in zip(names, position.tolist(), heading.tolist(), strict=True)
    ]
    return _message("tf", "tf2_msgs/msg/TFMessage", transforms=transforms)


def encoded(topic: str, one: Any) -> Message:
    """A message on a topic."""
    return Message(topic, one.__msgtype__, ros.encode(one))


def _message(topic: str, name: str, /, **fields: Any) -> Message:
    return encoded(topic, ros.message(name, **fields))
