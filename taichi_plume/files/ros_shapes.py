"""Floors and clouds of points as messages of ROS."""

from typing import Any

import numpy as np

from taichi_plume.files import ros_messages as ros

GRID, POINTS = "nav_msgs/msg/OccupancyGrid", "sensor_msgs/msg/PointCloud2"
FLOAT32 = 7  # of sensor_msgs/PointField


def grid(percent: np.ndarray, cell: float, low: float, t: float, frame: str) -> Any:
    """An OccupancyGrid of cells (ny, nx), from (low, low) on [m]: percent from 0 to 100, -1 where nothing is known."""
    ny, nx = percent.shape
    info = {
        "map_load_time": ros.time(t),
        "resolution": cell,
        "width": nx,
        "height": ny,
        "origin": {"position": {"x": low, "y": low}, "orientation": ros.yawed(0.0)},
    }
    return ros.message(GRID, header=ros.header(t, frame), info=info, data=percent.astype(np.int8).ravel())


def cloud(columns: dict[str, np.ndarray], t: float, frame: str) -> Any:
    """A PointCloud2 of what is told of each point, (n,) each, x, y, z [m] among them."""
    rows = np.rec.fromarrays(list(columns.values()), dtype=[(name, "<f4") for name in columns])
    fields = [
        {"name": name, "offset": 4 * n, "datatype": FLOAT32, "count": 1} for n, name in enumerate(columns)
    ]
    return ros.message(
        POINTS,
        header=ros.header(t, frame),
        height=1,
        width=len(rows),
        fields=fields,
        point_step=rows.itemsize,
        row_step=rows.nbytes,
        data=np.frombuffer(rows.tobytes(), np.uint8),
        is_dense=True,
    )


def points_of(message: Any) -> dict[str, np.ndarray]:
    """The columns of a cloud of f32."""
    names = [one.name for one in message.fields]
    rows = np.frombuffer(message.data.tobytes(), np.dtype([(name, "<f4") for name in names]))
    return {name: rows[name] for name in names}
