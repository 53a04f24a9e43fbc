"""What the service tells, and under which names.

    clock              rosgraph_msgs/Clock           simulated time
    tf                 tf2_msgs/TFMessage            where the robots of the first trial are, from `map`
    map, plume/..., tf_static    see `view`
    GROUP/readings     taichi_plume_msgs/Readings    all that the robots of an external group read
    GROUP/commands     taichi_plume_msgs/Commands    what they are told: comes in
    ROBOT/cmd_vel      geometry_msgs/Twist           the same of one robot, where the group takes velocities: comes in
    ROBOT/pose         geometry_msgs/PoseStamped     where it takes poses: comes in
    ROBOT/odom         nav_msgs/Odometry             where it is
    ROBOT/gas          olfaction_msgs/GasSensor      ppm, or ppm m of lasers
    ROBOT/gas_raw      olfaction_msgs/GasSensor      ohm, of metal oxides
    ROBOT/wind         olfaction_msgs/Anemometer     in the frame of the robot

ROBOT is GROUP_n, n from 0 on through all trials. Groups of more than MOST_ROBOTS have no topics of each. Where robots
have several gas sensors, gas and gas_raw are of the first, gas_1 and gas_raw_1 of the next, and so on.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from taichi_plume.files import ros_messages as ros
from taichi_plume.files.ros_robots import BASE, GAS, MAP, TRANSFORMS, numbered, transform, wind_fields

MOST_ROBOTS = 64


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
        noses=told["reading"].shape[1],
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


def of_each(
    group: str, t: float, told: dict[str, np.ndarray], noses: Sequence[dict[str, Any]]
) -> Iterator[Message]:
    """What each robot of a group reads, as messages of ROS; noses: fields of the GasSensor messages of each."""
    has_resistance = np.isfinite(told["resistance"])
    ohm = {"raw_units": ros.UNITS["ohm"]}
    for n in range(len(has_resistance)):
        robot = f"{group}_{n}"
        yield _message(f"{robot}/odom", "nav_msgs/msg/Odometry", _odometry, robot, t, told, n)
        for k, sensor in enumerate(noses):
            gas = {"header": ros.header(t, f"{robot}/{numbered(GAS, k)}")} | sensor
            topic = f"{robot}/{numbered('gas', k)}"
            yield _message(topic, ros.GAS_SENSOR, _gas, gas, told["reading"], n, k)
            if has_resistance[n, k]:
                topic = f"{robot}/{numbered('gas_raw', k)}"
                yield _message(topic, ros.GAS_SENSOR, _gas, gas | ohm, told["resistance"], n, k)
        yield _message(f"{robot}/wind", ros.ANEMOMETER, _wind, robot, t, told, n)


def _odometry(robot: str, t: float, told: dict[str, np.ndarray], n: int) -> dict[str, Any]:
    x, y = told["believed_position"][n].tolist()
    pose = {
        "position": {"x": x, "y": y, "z": float(told["altitude"][n])},
        "orientation": ros.yawed(float(told["believed_heading"][n])),
    }
    return {"header": ros.header(t, MAP), "child_frame_id": f"{robot}/{BASE}", "pose": {"pose": pose}}


def _gas(about: dict[str, Any], values: np.ndarray, n: int, k: int) -> dict[str, Any]:
    return about | {"raw": float(values[n, k])}


def _wind(robot: str, t: float, told: dict[str, np.ndarray], n: int) -> dict[str, Any]:
    u, v = told["wind"][n].tolist()
    return wind_fields(robot, u, v, float(told["believed_heading"][n]), t)


def poses(
    t: float, names: list[str], position: np.ndarray, heading: np.ndarray, altitude: np.ndarray
) -> Message:
    """Where robots are: position (n, 2) [m], heading (n,) [rad], altitude (n,) [m]."""
    places = np.column_stack([position, altitude])
    return _message("tf", TRANSFORMS, _transforms, t, names, places, heading)


def _transforms(t: float, names: list[str], places: np.ndarray, heading: np.ndarray) -> dict[str, Any]:
    return {
        "transforms": [
            transform(MAP, f"{name}/{BASE}", dict(zip("xyz", place, strict=True)), ros.yawed(angle), t)
            for name, place, angle in zip(names, places.tolist(), heading.tolist(), strict=True)
        ]
    }


def _message(
    topic: str, name: str, make: Callable[..., dict[str, Any]], /, *args: Any, **fields: Any
) -> Message:
    """One whose fields `make` gives, when they are wanted."""
    return Message(topic, name, lambda: ros.message(name, **make(*args, **fields)))
