"""`maps.zarr`: the maps of a run as they were at its end, in a zarr group that xarray opens.

Map number n of the scenario is the group "n", with the kind and parameters of the map and its time `t_s` [s] as
attributes. `groups` of these says whose readings made it: names, the first of their trials, and how many there are.
Variables are float32 in the order (trial, y, x), NaN where nothing is known:

    estimate    [ppm]   what the map says
    variance    [ppm²]  of the estimate; of maps that tell it
    weight      [1]     what stands behind the estimate, in the method's own measure
    truth       [ppm]   mean of the gas since the robots started, at the height of their sensors; of all trials the same
    measurable  1 where a robot could be; without trial

What group k of those that believe in places of the source believes is the group "belief_k", with the name of the group
and the kind of its algorithm as attributes:

    probability  [1]  of the cell, in the order (trial, robot, y, x); over the cells it sums to 1

To look at one: ``xarray.open_zarr("runs/arena-1/maps.zarr", group="0")``.
"""

import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from taichi_plume.files import disk, manifest
from taichi_plume.files.run_folder import RunFolderError

if TYPE_CHECKING:
    import xarray

Part = tuple[str, dict[str, Any], dict[str, np.ndarray]]
"""Name of a group, its attributes and its variables."""
FORMAT = "taichi_plume maps 1"
PART = "maps.part"  # what is being written
WHOLE = ("trial", "y", "x")
MEANING = {
    "trial": ("1", "number of the trial", ()),
    "y": ("m", "y of the cells' middles", ()),
    "x": ("m", "x of the cells' middles", ()),
    "estimate": ("ppm", "gas as the map says", WHOLE),
    "variance": ("ppm2", "variance of the estimate", WHOLE),
    "weight": ("1", "what stands behind the estimate, in the method's own measure", WHOLE),
    "truth": ("ppm", "mean of the gas since the robots started", WHOLE),
    "measurable": ("1", "1 where a robot could be", WHOLE[1:]),
    "robot": ("1", "number of the robot in its team", ()),
    "probability": ("1", "that the source is in the cell", ("trial", "robot", "y", "x")),
}


def write(path: Path, facts: dict[str, Any], parts: Sequence[Part]) -> None:
    """Write maps and beliefs: attributes of the whole, and of each part its group, attributes and variables.

    All or none. Raises OSError when the disk is full.
    """
    from taichi_plume.files import zarr_groups

    disk.require_room(path)
    part = path.with_name(PART)
    shutil.rmtree(part, ignore_errors=True)
    try:
        root = zarr_groups.create(part, {"format": FORMAT, **facts})
        for place, attributes, variables in parts:
            attributes = {"Conventions": zarr_groups.CONVENTIONS, **attributes}
            group = root.create_group(place, attributes=attributes)
            for name, values in variables.items():
                units, meaning, dimensions = MEANING[name]
                of_variable = {"units": units, "long_name": meaning} | _axis(name)
                zarr_groups.add(group, name, dimensions or (name,), values, of_variable)
            zarr_groups.consolidate(part, place)
        zarr_groups.consolidate(part)
        part.rename(path)
    finally:
        shutil.rmtree(part, ignore_errors=True)


def _axis(name: str) -> dict[str, str]:
    return {"axis": name.upper()} if name in ("x", "y") else {}


@contextmanager
def opened(path: Path, what: Literal["maps", "beliefs"] = "maps") -> Iterator[list[Any]]:
    """The groups (`zarr_groups.Group`) of a run's maps, or of its beliefs, of which no chunk is missing.

    Raises RunFolderError where the file is none of ours or not whole, or what reads it finds that.
    """
    from taichi_plume.files import zarr_groups

    damage = manifest.changed(path)
    if damage:
        raise RunFolderError(damage)

    name = "{}" if what == "maps" else "belief_{}"
    try:
        root = zarr_groups.Group(path).attributes
        if root.get("format") != FORMAT:
            raise RunFolderError(f"{path}: was made by another version (its format is not '{FORMAT}')")
        groups = [
            zarr_groups.Group(path, name.format(n))
            for n in range(int(root["maps"] if what == "maps" else root.get(what, 0)))
        ]
        for group in groups:
            zarr_groups.require_memory({name: group[name] for name in group.names})
        yield groups
    except RunFolderError:
        raise
    except zarr_groups.GroupError as error:
        raise RunFolderError(str(error)) from None
    except zarr_groups.FAULTS as error:
        raise RunFolderError(f"{path}: is damaged: {zarr_groups.reason(error)}") from None


def read(path: Path) -> "list[xarray.Dataset]":
    """The maps of a run, in memory. Raises RunFolderError where the file is none of ours or not whole."""
    with opened(path) as groups:
        maps = [_loaded(path, group) for group in groups]
        for n, one in enumerate(maps):
            if tuple(one["estimate"].dims) != WHOLE:
                raise ValueError(f"map {n} has an estimate of {one['estimate'].dims}")
    return maps


def _loaded(path: Path, group: Any) -> "xarray.Dataset":
    from taichi_plume.files import zarr_groups

    return zarr_groups.open_dataset(path, group=group.name, consolidated=False).load()


def read_beliefs(path: Path) -> "list[xarray.Dataset]":
    """Read the beliefs of each group of a run. Raises RunFolderError if the file is foreign or incomplete."""
    with opened(path, "beliefs") as groups:
        return [_loaded(path, group) for group in groups]
