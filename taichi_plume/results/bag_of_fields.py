"""What of a run's fields goes into its bag (`bag_of_run`): the floor, the gas as points, the gas maps."""

from collections.abc import Iterator
from math import ceil
from typing import TYPE_CHECKING, Any

import numpy as np

from taichi_plume.files import ros_messages as ros
from taichi_plume.files.ros_robots import MAP
from taichi_plume.files.ros_shapes import cloud, grid
from taichi_plume.guard.terminal import say, visible
from taichi_plume.results.run import Run

if TYPE_CHECKING:
    import xarray

Said = tuple[float, str, Any]
"""When [s], on which topic, what."""


def species(name: str) -> str:
    """Of a variable's name, as topics may be called."""
    return ros.word(name.removesuffix("_ppm"))


def floor(run: Run, allow_outside: bool) -> Any:
    """Where no robot can be: obstacles that stand, what lies beyond the robots' arena, and a frame of a cell around.

    What of it cannot be told is said.
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
        say(visible(f"note: /map: {lack}"), error=True)
    for one in shapes:
        if one.model.motion is None:
            taken |= one.horizontal_distance(points, 0.0, tall) < 0.0
    return grid(np.where(taken, 100, 0), h, -h, 0.0, MAP)


def clouds(run: Run, name: str, most: int, least: float) -> Iterator[Said]:
    """A gas, frame by frame, as the points of at most so many cells or, where there are more, of blocks of them."""
    from taichi_plume.results.export import frames

    data = run.fields
    axes = [str(one) for one in data[name].dims if one != "time"]
    side = 1
    while np.prod([ceil(data.sizes[one] / side) for one in axes]) > most:
        side += 1
    read, share = frames(data, run.folder), data["air"].transpose(*axes)
    blocks = dict.fromkeys(axes, side)
    places = [data[one].coarsen({one: side}, boundary="pad").mean().values for one in axes]
    z, y, x = np.meshgrid(*([[0.0]] if len(axes) == 2 else []), *places, indexing="ij")
    air = share.coarsen(blocks, boundary="pad").sum()
    for n, t in enumerate(data["time"].values.tolist()):
        if t < 0.0:
            continue
        gas = share.copy(data=np.where(share.values > 0, read(name, n) * share.values, 0.0))
        mean = (gas.coarsen(blocks, boundary="pad").sum() / air.where(air > 0)).values.reshape(x.shape)
        there = mean >= least
        kept = {"x": x[there], "y": y[there], "z": z[there], "ppm": mean[there]}
        yield t, f"/plume/{species(name)}", cloud(kept, t, MAP)


def maps_of(run: Run, trial: int) -> Iterator[tuple[str, "xarray.Dataset", int]]:
    """The maps that a trial made: of each its topic, the map, and its row there. Rivals have maps of their own."""
    for n, one in enumerate(run.maps if (run.folder / "maps.zarr").exists() else ()):
        parts = one.attrs["groups"]
        for k, part in enumerate(parts):
            if trial < part["trials"]:
                name = f"/gas_maps/map_{n}" + (f"_{k}" if len(parts) > 1 else "")
                yield name, one, part["first_trial"] + trial


def maps_at_end(run: Run, trial: int) -> Iterator[Said]:
    """The gas maps as they are when the run ends."""
    for name, one, row in maps_of(run, trial):
        estimate = one["estimate"].values[row].astype(float)
        known = np.isfinite(estimate)
        peak = np.max(estimate, where=known, initial=0.0)
        share = np.clip(np.where(known, estimate, 0.0) / (peak or 1.0), 0.0, 1.0)
        t = float(one.attrs["t_s"])
        yield t, name, grid(np.where(known, np.round(100 * share), -1), float(one.attrs["cell"]), 0.0, t, MAP)
        x, y = np.meshgrid(one["x"].values, one["y"].values)
        cells = {"ppm": "estimate", "weight": "weight", "variance": "variance", "truth": "truth"}
        columns = {"x": x, "y": y, "z": np.zeros_like(x)}
        columns |= {called: one[key].values[row] for called, key in cells.items() if key in one}
        yield t, f"{name}/cells", cloud({name: values[known] for name, values in columns.items()}, t, MAP)
