"""Topics of a run's ROS 2 bag (`bag_of_run`) for fields: floor plan, scalars as point clouds, gas maps."""

import json
from collections.abc import Iterator
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from taichi_plume.files import pictures_file, point_clouds
from taichi_plume.files import ros_messages as ros
from taichi_plume.files.ros_robots import MapFrame
from taichi_plume.guard.terminal import say
from taichi_plume.results.run import Run

if TYPE_CHECKING:
    import xarray

NO_CLOUDS = ("m s-1", "kg m-3")
"""Units of film variables that are not shown: the wind, and gases that the film has in ppm too."""
Stamped = tuple[float, str, ros.Message]
"""Time [s], topic and message."""


def floor(run: Run, allow_outside: bool) -> tuple[ros.Message, MapFrame]:
    """Return a run's ROS occupancy grid and the frame of all positions.

    Occupied are static obstacles, cells beyond the arena, and a border.
    Prints a note on each obstacle that cannot be read.
    """
    from taichi_plume.results.obstacles import shapes_of

    scenario = run.scenario
    h, extent, floor = scenario.domain.spacing, scenario.domain.extent, scenario.floor
    nx, ny = (ceil(length / h - 1e-6) + 2 for length in extent[:2])
    x, y = ((np.arange(n) - 0.5) * h for n in (nx, ny))
    points = np.stack(np.meshgrid(x, y, indexing="xy"), axis=-1)
    low = np.array(floor.low)
    taken = ~((points > low) & (points < low + floor.size)).all(axis=-1)
    tall = max((group.body.height for group in scenario.robots), default=h)
    shapes, lacks = shapes_of(run.folder, scenario, allow_outside)
    for lack in lacks:
        say(f"note: /map: {lack}", error=True)
    for shape in shapes:
        if shape.model.motion is None:
            taken |= shape.horizontal_distance(points, 0.0, tall) < 0.0
    frame = MapFrame.of(scenario, shapes)
    return frame.grid(np.where(taken, 100, 0), h, -h, 0.0), frame


def scalars(run: Run) -> "tuple[xarray.Dataset, list[str]]":
    """Return a run's film, or without a film the pictures of its recording, and the names of the scalars to be shown.

    Of pictures these are those in the first horizontal slice. A run without both has none.
    """
    if run.has("fields.zarr"):
        names = [
            name
            for name, of in run.fields.data_vars.items()
            if "time" in of.dims and of.attrs.get("units") not in NO_CLOUDS
        ]
        return run.fields, [str(name) for name in names]
    if run.has(pictures_file.NAME):
        pictures = run.pictures.data_vars.items()
        return run.pictures, [str(name) for name, of in pictures if of.attrs["view"] == "slice"]
    import xarray

    return xarray.Dataset(), []


def cloud_topic(data: "xarray.Dataset", name: str) -> str:
    """Return the topic of a scalar's clouds, such as /plume/ethanol."""
    return f"/{point_clouds.topic(data[name].attrs.get('species', name.removesuffix('_slice')))}"


def clouds(
    data: "xarray.Dataset", folder: Path, name: str, most: int, least: float, frame: MapFrame
) -> Iterator[Stamped]:
    """Yield the instants of a scalar as (time, topic, point cloud), from t = 0 on; see `point_clouds.columns`.

    data: of `scalars`, of the run in a folder. Raises RunFolderError if values are damaged.
    """
    from taichi_plume.results.export import frames

    read, of, called = frames(data, folder), data[name], cloud_topic(data, name)
    axes = [str(axis) for axis in of.dims if axis != "time"]
    places = [data[axis].values for axis in axes]
    air = data["air"].transpose(*axes).values if "air" in data else None
    for n, t in enumerate(data["time"].values.tolist()):
        if t >= 0.0:
            level = of.attrs.get("level", 0.0)
            columns = point_clouds.columns(
                read(name, n), places, of.attrs.get("units", ""), level, air, most, least
            )
            yield t, called, frame.cloud(columns, t)


def maps_of(run: Run, trial: int) -> Iterator[tuple[str, "xarray.Dataset", int]]:
    """Yield (topic, gas map, row) for each final gas map of a trial; row: index of the trial's estimate in the map."""
    for n, gas_map in enumerate(run.maps if run.has("maps.zarr") else ()):
        if "component" in gas_map:
            continue  # a map of the wind
        parts = json.loads(gas_map.attrs["groups"])
        for k, part in enumerate(parts):
            if trial < part["trials"]:
                name = f"/gas_maps/map_{n}" + (f"_{k}" if len(parts) > 1 else "")
                yield name, gas_map, part["first_trial"] + trial


def maps_at_end(run: Run, trial: int, frame: MapFrame) -> Iterator[Stamped]:
    """Yield each final gas map of a trial as ROS messages: an occupancy grid in percent of the peak, of a map with
    layers its largest value over the height, and a point cloud.
    """
    for name, gas_map, row in maps_of(run, trial):
        estimate = gas_map["estimate"].values[row].astype(float)
        known = np.isfinite(estimate)
        peak = np.max(estimate, where=known, initial=0.0)
        share = np.round(100 * np.clip(np.where(known, estimate, 0.0) / (peak or 1.0), 0.0, 1.0))
        t, cell = float(gas_map.attrs["t_s"]), float(gas_map.attrs["cell"])
        seen = np.where(known, share, -1)
        yield t, name, frame.grid(seen.max(axis=0) if "z" in gas_map else seen, cell, 0.0, t)
        heights = gas_map["z"].values if "z" in gas_map else [0.0]
        z, y, x = np.meshgrid(heights, gas_map["y"].values, gas_map["x"].values, indexing="ij")
        cells = {"ppm": "estimate", "weight": "weight", "variance": "variance", "truth": "truth"}
        columns = {"x": x, "y": y, "z": z}
        columns = {axis: values.reshape(known.shape) for axis, values in columns.items()}
        columns |= {column: gas_map[key].values[row] for column, key in cells.items() if key in gas_map}
        yield t, f"{name}/cells", frame.cloud({key: values[known] for key, values in columns.items()}, t)
