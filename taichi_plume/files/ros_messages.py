"""ROS 2 messages without ROS: definitions, serialisation to and from bytes (CDR), occupancy grids, point clouds.

Definitions of ROS's own messages come with rosbags; those of `olfaction_msgs` (MAPIRlab) and taichi_plume follow here.
In addition to the definitions:

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

Message = Any
"""An instance of a class that rosbags makes of a definition."""
LONGEST = 1 << 24  # entries of a sequence

GAS_SENSOR = "olfaction_msgs/msg/GasSensor"
GAS_SENSOR_ARRAY = "olfaction_msgs/msg/GasSensorArray"
ANEMOMETER = "olfaction_msgs/msg/Anemometer"
READINGS = "taichi_plume_msgs/msg/Readings"
COMMANDS = "taichi_plume_msgs/msg/Commands"
GRID, POINTS = "nav_msgs/msg/OccupancyGrid", "sensor_msgs/msg/PointCloud2"
FLOAT32 = 7  # of sensor_msgs/PointField

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
float32[] x            # estimated position [m]
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
uint8 ended            # 1: the run is over, this is the last message
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
float32[] declared_x   # position of a source [m], NaN: none declared; or nothing
float32[] declared_y
""",
}


class RosError(ValueError):
    """Error: bytes or JSON are not a ROS message of the expected type."""


@cache
def store() -> "Typestore":
    """Return rosbags' store of all ROS message definitions. Raises ImportError without rosbags."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    made = get_typestore(Stores.ROS2_JAZZY)
    made.max_sequence_length = LONGEST
    for name, text in DEFINITIONS.items():
        made.register(get_types_from_msg(text, name))
    return made


def definition(name: str) -> str:
    """Return the text definition of a ROS message with its parts, in MCAP's and Foxglove's format ros2msg."""
    return store().generate_msgdef(name, ros_version=2)[0]


def plain_name(frame: str) -> str:
    """Return the name of a coordinate frame without the leading slashes of ROS 1."""
    return frame.lstrip("/")


def message(name: str, /, **fields: object) -> Message:
    """Build a ROS message of type `name`. Missing fields are zero or empty; a mapping stands for a nested message.

    Raises KeyError if the definition has no such field.
    """
    types = dict(store().fielddefs[name][1])
    unknown = sorted(fields.keys() - types.keys())
    if unknown:
        raise KeyError(f"{name} has no field {unknown[0]}")
    return store().types[name](**{field: _value(kind, fields.get(field)) for field, kind in types.items()})


def _value(kind: tuple[Any, Any], given: Any) -> Any:
    """Convert a value to the type `kind` of a ROS message's field; None becomes zero or empty."""
    from rosbags.interfaces import Nodetype

    node, about = kind
    if node == Nodetype.NAME:
        return given if given and not isinstance(given, Mapping) else message(about, **(given or {}))
    if node == Nodetype.BASE:
        if about[0] == "string":
            return str(given or "")
        return bool(given) if about[0] == "bool" else np.dtype(about[0]).type(given or 0).item()
    (inner, what), size = about
    if inner == Nodetype.NAME:
        return [_value((inner, what), entry) for entry in given or ([None] * size)]
    if what[0] == "string":
        return [str(entry) for entry in given or [""] * size]
    values = np.zeros(size) if given is None else given
    return np.ascontiguousarray(values, dtype=what[0]).ravel()


def encode(message: Message) -> bytes:
    """Serialise a ROS message to bytes (CDR)."""
    return bytes(store().serialize_cdr(message, message.__msgtype__))


def decode(name: str, data: bytes) -> Message:
    """Return the ROS message of type `name` in CDR bytes. Raises RosError."""
    try:
        return store().deserialize_cdr(data, name)
    except Exception as error:  # foreign bytes cause any error
        raise RosError(f"is no {name}: {error}") from None


def from_json(name: str, data: bytes) -> Message:
    """Return the ROS message of type `name` in a JSON text. Raises RosError."""
    import json

    try:
        return decode(name, encode(message(name, **json.loads(data))))
    except Exception as error:  # foreign texts cause any error
        raise RosError(f"is no {name}: {type(error).__name__}: {error}") from None


def word(name: str) -> str:
    """Convert a name, such as that of a robot group, to a valid part of a ROS topic."""
    clean = re.sub(r"[^A-Za-z0-9_]", "_", name)
    return clean if clean[:1].isalpha() else f"g_{clean}"


def time(seconds: float) -> dict[str, int]:
    """Convert a time [s] to the fields sec and nanosec of a ROS time."""
    whole, nano = divmod(round(seconds * 1e9), 1_000_000_000)
    return {"sec": whole, "nanosec": nano}


def header(t: float, frame: str) -> dict[str, object]:
    """Return the header fields (stamp, frame_id) of a ROS message at time t [s] in a coordinate frame."""
    return {"stamp": time(t), "frame_id": frame}


def yawed(angle: float, tilt: float = 0.0) -> dict[str, float]:
    """Return the quaternion of a heading `angle` and an upward tilt of the x axis [rad], as a dict."""
    s, c, up, flat = sin(0.5 * angle), cos(0.5 * angle), sin(-0.5 * tilt), cos(0.5 * tilt)
    return {"x": -s * up, "y": c * up, "z": s * flat, "w": c * flat}


def yaw(q: Message) -> float:
    """Return the heading [rad] of a quaternion; NaN if the quaternion is invalid."""
    norm = q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w
    if not 0.0 < norm < np.inf:
        return float("nan")
    return float(np.arctan2(2.0 * (q.w * q.z + q.x * q.y), norm - 2.0 * (q.y * q.y + q.z * q.z)))


def grid(percent: np.ndarray, cell: float, low: tuple[float, float], t: float, frame: str) -> Message:
    """Build a ROS OccupancyGrid from (ny, nx) percents 0 to 100, -1 if unknown. cell [m]; low: lower corner [m]."""
    ny, nx = percent.shape
    origin = {"position": {"x": low[0], "y": low[1]}, "orientation": yawed(0.0)}
    info = {"map_load_time": time(t), "resolution": cell, "width": nx, "height": ny, "origin": origin}
    return message(GRID, header=header(t, frame), info=info, data=percent.astype(np.int8).ravel())


def cloud(columns: Mapping[str, np.ndarray], t: float, frame: str) -> Message:
    """Build a ROS PointCloud2 from columns (n,) by name, which include x, y, z [m], as float32."""
    rows = np.rec.fromarrays(list(columns.values()), dtype=[(name, "<f4") for name in columns])
    fields = [
        {"name": name, "offset": 4 * n, "datatype": FLOAT32, "count": 1} for n, name in enumerate(columns)
    ]
    size = {"height": 1, "width": len(rows), "point_step": rows.itemsize, "row_step": rows.nbytes}
    data = np.frombuffer(rows.tobytes(), np.uint8)
    return message(POINTS, header=header(t, frame), fields=fields, data=data, is_dense=True, **size)


def points_of(cloud: Message) -> dict[str, np.ndarray]:
    """Return the columns (n,) by name of a ROS PointCloud2 whose fields are all float32."""
    names = [field.name for field in cloud.fields]
    rows = np.frombuffer(cloud.data.tobytes(), np.dtype([(name, "<f4") for name in names]))
    return {name: rows[name] for name in names}
