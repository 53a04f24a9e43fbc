"""Bags of robots whose ways and readings are known, written by rosbags."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

from rosbags.rosbag2 import StoragePlugin, Writer

from taichi_plume.files import ros_messages as ros
from taichi_plume.files.ros_robots import transform

ODOMETRY, POSE = "nav_msgs/msg/Odometry", "geometry_msgs/msg/PoseStamped"
TF = "tf2_msgs/msg/TFMessage"
Message = tuple[float, str, Any]
"""When it was recorded [s], on which topic, what."""


def write(
    folder: Path, messages: Sequence[Message], storage: str = "mcap", version: Literal[8, 9] = 8
) -> Path:
    """Write a bag; returns its folder."""
    with Writer(folder, version=version, storage_plugin=StoragePlugin[storage.upper()]) as writer:
        topics: dict[str, Any] = {}
        for t, topic, message in messages:
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, message.__msgtype__, typestore=ros.store())
            writer.write(topics[topic], round(t * 1e9), ros.encode(message))
    return folder


def pose(t: float, x: float, y: float, heading: float, kind: str = ODOMETRY, frame: str = "odom") -> Any:
    """A message with a pose."""
    reported = {"position": {"x": x, "y": y}, "orientation": ros.yawed(heading)}
    whole = {"pose": reported} if kind != POSE else reported
    return ros.message(kind, header=ros.header(t, frame), pose=whole)


def gas(t: float, raw: float, units: str = "ppm", frame: str = "", **more: Any) -> Any:
    """A message of a gas sensor."""
    head = ros.header(t, frame)
    return ros.message(ros.GAS_SENSOR, header=head, raw=raw, raw_units=ros.UNITS[units], **more)


def wind(t: float, speed: float, to: float, frame: str = "") -> Any:
    """A message of an anemometer."""
    return ros.message(ros.ANEMOMETER, header=ros.header(t, frame), wind_speed=speed, wind_direction=to)


def transforms(t: float, *links: tuple[str, str, float, float, float]) -> Any:
    """Frames: parent, child, x, y [m] and heading [rad]."""
    return ros.message(
        TF,
        transforms=[
            transform(parent, child, {"x": x, "y": y}, ros.yawed(heading), t)
            for parent, child, x, y, heading in links
        ],
    )
