"""`maps.zarr`: gas maps and source posteriors (beliefs) at the end of a run, in a zarr group that xarray opens.

Map n of the scenario is the group "n". Attributes are kind and parameters of the map, the time `t_s` [s], and, as JSON,
`groups`: names of the robot groups whose readings made the map, their first trial and number of trials. Variables are
float32 in the order (trial, y, x), NaN where nothing is known:

    estimate    [ppm]   estimated concentration, as the truth above the background (attribute background_ppm)
    variance    [ppm²]  of the estimate; of maps that provide a variance
    weight      [1]     support of the estimate by readings, in the method's own measure
    truth       [ppm]   mean of the gas since the robots started, at the height of their sensors; equal in all trials
    measurable  1 where a robot could be; without trial

A map with layers has its variables, measurable too, in the order (trial, z, y, x). Its truth is the gas over the height
of each layer.

A map of the wind has estimate, variance and truth (the mean wind since the robots started, at the height of their
anemometers) in the order (trial, y, x, component), in m/s and m²/s²; component 0 is along x, 1 along y.

The k-th robot group that keeps a posterior of the source position is the group "belief_k", with the name of the robot
group and the kind of its algorithm as attributes:

    probability  [1]  that the source is in the cell, in the order (trial, robot, y, x); sums to 1 over the cells
    prior        [1]  the same before the first reading, in the order (y, x); with the key `prior` alone

To open a map: ``xarray.open_zarr("runs/arena-1/maps.zarr", group="0")``.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from taichi_plume.files import disk, manifest
from taichi_plume.files.run_folder import RunFolderError

if TYPE_CHECKING:
    import xarray

    from taichi_plume.files.zarr_groups import Group

Part = tuple[str, dict[str, object], dict[str, np.ndarray]]
"""Name of a group, its attributes and its variables."""
FORMAT = "taichi_plume maps 2"
PART = "maps.part"  # name while the file is written
WHOLE = ("trial", "y", "x")
LAYERS = ("trial", "z", "y", "x")
MEANING = {
    "trial": ("1", "number of the trial", ()),
    "z": ("m", "z of the cell centres", ()),
    "y": ("m", "y of the cell centres", ()),
    "x": ("m", "x of the cell centres", ()),
    "estimate": ("ppm", "estimated concentration", WHOLE),
    "variance": ("ppm2", "variance of the estimate", WHOLE),
    "weight": ("1", "support of the estimate by readings, in the method's own measure", WHOLE),
    "truth": ("ppm", "mean of the gas since the robots started", WHOLE),
    "measurable": ("1", "1 where a robot could be", WHOLE[1:]),
    "robot": ("1", "number of the robot in its team", ()),
    "component": ("1", "component of the wind: 0 along x, 1 along y", ()),
    "probability": ("1", "probability that the source is in the cell", ("trial", "robot", "y", "x")),
    "prior": ("1", "prior probability that the source is in the cell", WHOLE[1:]),
}
VECTORS = (*WHOLE, "component")
OF_WIND = MEANING | {
    "estimate": ("m s-1", "estimated wind", VECTORS),
    "variance": ("m2 s-2", "variance of the estimate", VECTORS),
    "truth": ("m s-1", "mean of the wind since the robots started", VECTORS),
}


def write(path: Path, facts: Mapping[str, object], parts: Sequence[Part]) -> None:
    """Write gas maps and source posteriors (beliefs), all or none. facts: root attributes. Raises OSError."""
    from taichi_plume.files import zarr_groups

    disk.require_room(path)
    part = path.with_name(PART)
    disk.discard(part)
    try:
        root = zarr_groups.create(part, {"format": FORMAT, **facts})
        for place, attributes, variables in parts:
            attributes = {"Conventions": zarr_groups.CONVENTIONS, **_of_netcdf(attributes)}
            group = root.create_group(place, attributes=attributes)
            meanings = OF_WIND if "component" in variables else MEANING
            for name, values in variables.items():
                units, meaning, dimensions = meanings[name]
                if "z" in variables and "y" in dimensions:
                    dimensions = tuple(each for each in LAYERS if each in (*dimensions, "z"))
                about = {"units": units, "long_name": meaning}
                about |= {"axis": name.upper()} if name in ("x", "y", "z") else {}
                zarr_groups.add(group, name, dimensions or (name,), values, about)
            zarr_groups.consolidate(part, place)
        zarr_groups.consolidate(part)
        part.rename(path)
    finally:
        disk.discard(part)


@contextmanager
def opened(path: Path, what: Literal["maps", "beliefs"] = "maps") -> Iterator["list[Group]"]:
    """Context that yields the zarr groups of a run's gas maps or beliefs, of which no chunk is missing.

    Raises RunFolderError if the file is foreign or incomplete, also for errors of zarr in the block.
    """
    from taichi_plume.files import zarr_groups

    manifest.require_unchanged(path, RunFolderError)
    name = "{}" if what == "maps" else "belief_{}"
    with zarr_groups.errors_as(RunFolderError, path):
        root = zarr_groups.Group(path).attributes
        if root.get("format") != FORMAT:
            raise RunFolderError(f"{path}: was made by another version (its format is not '{FORMAT}')")
        count = int(root["maps"] if what == "maps" else root.get(what, 0))
        groups = [zarr_groups.Group(path, name.format(n)) for n in range(count)]
        for group in groups:
            zarr_groups.require_memory({name: group[name] for name in group.names})
        yield groups


def _of_netcdf(attributes: Mapping[str, object]) -> dict[str, object]:
    """Return attributes that a NetCDF file can hold too: without nulls, lists and mappings as JSON."""
    return {
        name: value if isinstance(value, str | int | float) else json.dumps(value)
        for name, value in attributes.items()
        if value is not None
    }


def read(path: Path) -> "list[xarray.Dataset]":
    """Return a run's gas maps in memory. Raises RunFolderError if the file is foreign or incomplete."""
    with opened(path) as groups:
        maps = [_loaded(path, group) for group in groups]
        for n, gas_map in enumerate(maps):
            if gas_map["estimate"].dims not in (WHOLE, VECTORS, LAYERS):
                raise ValueError(f"map {n} has an estimate of {gas_map['estimate'].dims}")
    return maps


def _loaded(path: Path, group: "Group") -> "xarray.Dataset":
    from taichi_plume.files import zarr_groups

    return zarr_groups.open_dataset(path, group=group.name, consolidated=False).load()


def read_beliefs(path: Path) -> "list[xarray.Dataset]":
    """Return source posteriors per robot group. Raises RunFolderError if the file is foreign or incomplete."""
    with opened(path, "beliefs") as groups:
        return [_loaded(path, group) for group in groups]
