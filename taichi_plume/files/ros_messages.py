"""Messages of ROS 2 without ROS: their definitions, and to and from the bytes (CDR) that are sent and recorded.

Definitions of ROS's own messages come with rosbags; those of `olfaction_msgs` (MAPIRlab) and our own stand here. What
is said of a message is what its definition says, and in addition:

    Anemometer.wind_direction   yaw towards which the air moves, in the frame of the header, counter-clockwise from its
                                x axis as all angles of ROS (for older programs of the field: where it comes from)
    GasSensor.calib_a, calib_b  of a metal oxide in much gas raw / raw_air = calib_a ppm^calib_b, as of others; in any
                                (1 + ppm / c0)^calib_b, where c0 = calib_a^(-1 / calib_b)
"""

import re
from collections.abc import Mapping
from functools import cache
from math import cos, sin
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

LONGEST = 1 << 24  # entries of a sequence

GAS_SENSOR = "olfaction_msgs/msg/GasSensor"
GAS_SENSOR_ARRAY = "olfaction_msgs/msg/GasSensorArray"
ANEMOMETER = "olfaction_msgs/msg/Anemometer"
READINGS = "taichi_plume_msgs/msg/Readings"
COMMANDS = "taichi_plume_msgs/msg/Commands"

TECHNOLOGIES = {"unknown": 0, "mox": 1, "pid": 51, "tdlas": 53}
MAKERS = {"unknown": 0, "figaro": 1, "sgx": 3}
PARTS = {"UNKNOWN": 0, "TGS2620": 50, "TGS2600": 51, "TGS2611": 52, "TGS2610": 53, "TGS2612": 54}
UNITS = {"unknown": 0, "volt": 1, "amp": 2, "ppm": 3, "ppb": 4, "ohm": 5, "ppm m": 6}


def _constants(prefix: str, values: Mapping[str, int]) -> str:
    names = ((name.upper().replace(" M", "XM"), value) for name, value in values.items())
    return "".join(f"uint8 {prefix}_{name}={value}\n" for name, value in names)


DEFINITIONS = {
    GAS_SENSOR: _constants("TECH", TECHNOLOGIES)
    + _constants("MANU", MAKERS)
    + _constants("MPN", PARTS)
    + _constants("UNITS", UNITS)
    + "std_msgs/Header header\nuint8 technology\nuint8 manufacturer\nuint8 mpn\nfloat64 raw\nuint8 raw_units\n"
    "float64 raw_air\nfloat64 calib_a\nfloat64 calib_b\n",
    GAS_SENSOR_ARRAY: "std_msgs/Header header\nolfaction_msgs/GasSensor[] sensors\n",
    ANEMOMETER: "std_msgs/Header header\nstring sensor_label\nfloat32 wind_speed\nfloat32 wind_direction\n",
    READINGS: """\
float64 t              # simulated time [s]
uint32 tick
uint32[] robot         # numbers in the group, trial by trial
float32[] x            # where they believe to be [m]
float32[] y
float32[] z
float32[] heading      # [rad]
uint8 noses            # gas sensors of each robot
float32[] gas          # readings [ppm, or ppm m of a laser], of all sensors of a robot, then of the next
float32[] resistance   # likewise: of a metal oxide [ohm], NaN of others
float32[] wind_x       # [m/s], zero where it is not known
float32[] wind_y
uint8[] wind_known
uint8[] blocked        # the bumper
uint8[] over           # whether its search is over
uint64[] answered      # number of the last command that was taken
uint8[] lost           # whether it stands still, as nothing was heard for too long
uint8 ended            # 1: the run is over, and nothing else is told
""",
    COMMANDS: """\
uint64 number          # greater in each command; a client begins with its start [us since 1970]
uint32 tick            # of the readings that they answer
uint32[] robot         # numbers in the group, trial by trial
float32[] speed        # forward [m/s], or nothing
float32[] turn_rate    # [rad/s]
float32[] left         # of drones [m/s], or nothing
float32[] climb        # of drones [m/s], or nothing
float32[] x            # poses [m], or nothing
float32[] y
float32[] z
float32[] heading      # [rad]
float32[] declared_x   # where a source is [m], NaN: says nothing; or nothing
float32[] declared_y
""",
}


class RosError(ValueError):
    """Bytes that are not of the message that they should be; says which."""


@cache
def store() -> "Typestore":
    """All definitions. Raises ImportError without rosbags."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    made = get_typestore(Stores.ROS2_JAZZY)
    made.max_sequence_length = LONGEST
    for name, text in DEFINITIONS.items():
        made.register(get_types_from_msg(text, name))
    return made


def definition(name: str) -> str:
    """Of a message such as nav_msgs/msg/Odometry and all that it is made of, as MCAP and Foxglove want it (ros2msg)."""
    return store().generate_msgdef(name, ros_version=2)[0]


def message(name: str, /, **fields: Any) -> Any:
    """A message with these fields, others zero or empty; mappings are messages, lists of them sequences of such.

    Raises KeyError where the definition has no such field.
    """
    types = {one: kind for one, kind in store().fielddefs[name][1]}
    unknown = sorted(fields.keys() - types.keys())
    if unknown:
        raise KeyError(f"{name} has no field {unknown[0]}")
    return store().types[name](**{one: _value(kind, fields.get(one)) for one, kind in types.items()})


def _value(kind: tuple[Any, Any], given: Any) -> Any:
    """A field's value of what was given, or None."""
    from rosbags.interfaces import Nodetype

    node, about = kind
    if node == Nodetype.NAME:
        return given if hasattr(given, "__msgtype__") else message(about, **(given or {}))
    if node == Nodetype.BASE:
        if about[0] == "string":
            return str(given or "")
        return bool(given) if about[0] == "bool" else np.dtype(about[0]).type(given or 0).item()
    (inner, what), size = about
    if inner == Nodetype.NAME:
        return [_value((inner, what), one) for one in given or ([None] * size)]
    if what[0] == "string":
        return [str(one) for one in given or [""] * size]
    values = np.zeros(size) if given is None else given
    return np.ascontiguousarray(values, dtype=what[0]).ravel()


def encode(one: Any) -> bytes:
    """A message as CDR."""
    return bytes(store().serialize_cdr(one, one.__msgtype__))


def decode(name: str, data: bytes) -> Any:
    """The message of CDR bytes. Raises RosError."""
    try:
        return store().deserialize_cdr(data, name)
    except Exception as error:  # whatever it meets in bytes of others
        raise RosError(f"is no {name}: {error}") from None


def from_json(name: str, data: bytes) -> Any:
    """The message of a text in JSON. Raises RosError."""
    import json

    try:
        return decode(name, encode(message(name, **json.loads(data))))
    except Exception as error:  # whatever there is in texts of others
        raise RosError(f"is no {name}: {type(error).__name__}: {error}") from None


def word(name: str) -> str:
    """A name, such as that of a group, as a part of a topic."""
    clean = re.sub(r"[^A-Za-z0-9_]", "_", name)
    return clean if clean[:1].isalpha() else f"g_{clean}"


def time(seconds: float) -> dict[str, int]:
    """A time [s] as builtin_interfaces/msg/Time."""
    whole, nano = divmod(round(seconds * 1e9), 1_000_000_000)
    return {"sec": whole, "nanosec": nano}


def header(t: float, frame: str) -> dict[str, Any]:
    """Of a message at time t [s]."""
    return {"stamp": time(t), "frame_id": frame}


def yawed(angle: float, tilt: float = 0.0) -> dict[str, float]:
    """The quaternion of a heading and a tilt of x over the horizontal [rad]."""
    s, c, up, flat = sin(0.5 * angle), cos(0.5 * angle), sin(-0.5 * tilt), cos(0.5 * tilt)
    return {"x": -s * up, "y": c * up, "z": s * flat, "w": c * flat}


def yaw(q: Any) -> float:
    """The heading [rad] of a quaternion; NaN of one that is none."""
    norm = q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w
    if not 0.0 < norm < np.inf:
        return float("nan")
    return float(np.arctan2(2.0 * (q.w * q.z + q.x * q.y), norm - 2.0 * (q.y * q.y + q.z * q.z)))
