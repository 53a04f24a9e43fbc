"""Writer of VTKHDF files (ImageData over time) for ParaView and pyvista, by h5py in VTK's documented layout.

Values belong to cells: each array over (time, z, y, x), vectors with three components last. Constant arrays are stored
once, and the offsets of all steps refer to them. A flat grid becomes one layer of the thickness `depth`. The mass of a
species is the sum of gas_NAME x air x volume of the cell over all cells.

Layout: VTK file formats, "VTKHDF", version 2.0 and later.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from taichi_plume.files.netcdf import PACKED, Reading

if TYPE_CHECKING:
    import h5py
    import xarray

VERSION = (2, 0)
WIND = ("u", "v", "w")


def write(fresh: Path, data: "xarray.Dataset", read: Reading) -> Iterator[int]:
    """Write a film's fields to a VTKHDF file frame by frame; yields the number of bytes before each frame.

    data: variables of a film at the cell centres, with the attribute `depth`; read: returns their values (z, y, x) or
    (y, x). Raises OSError.
    """
    import h5py

    shape = [data.sizes.get(axis, 1) for axis in "zyx"]
    names = [name for name in map(str, data.data_vars) if name not in WIND]
    wind = [name for name in WIND if name in data]
    steps = data.sizes["time"]
    with h5py.File(fresh, "w") as file:
        root = file.create_group("VTKHDF", track_order=True)
        _grid(root, data, shape)
        cells, offsets = root.create_group("CellData"), {}
        for name in [*names, *(["wind"] if wind else [])]:
            size = (*shape, 3) if name == "wind" else tuple(shape)
            moving = name == "wind" or "time" in data[name].dims
            offsets[name] = np.arange(steps) if moving else np.zeros(steps, int)
            count = steps if moving else 1
            array = cells.create_dataset(name, (count, *size), np.float32, chunks=(1, *size), **PACKED)
            about = data["u" if name == "wind" else name].attrs
            array.attrs["units"] = about.get("units", "1")
            meaning = "velocity of the air" if name == "wind" else about.get("long_name", name)
            array.attrs["long_name"] = meaning
            if not moving:
                array[0] = read(name, 0).reshape(size)
        _steps(root, data["time"].values, offsets)
        for n in range(steps):
            yield sum(4 * int(np.prod(cells[name].shape[1:])) for name in cells)
            for name in names:
                if "time" in data[name].dims:
                    cells[name][n] = read(name, n).reshape(shape)
            if wind:
                vector = np.zeros((*shape, 3), np.float32)
                for d, name in enumerate(wind):
                    vector[..., d] = read(name, n).reshape(shape)
                cells["wind"][n] = vector


def _grid(root: "h5py.Group", data: "xarray.Dataset", shape: list[int]) -> None:
    """Write the grid's attributes (extent, origin, spacing) to a VTKHDF file; shape: cells along z, y, x."""
    import h5py

    dx = float(data.attrs["spacing"])
    layer = dx if "z" in data.sizes else float(data.attrs["depth"])
    root.attrs["Version"] = np.array(VERSION, np.int64)
    root.attrs.create("Type", b"ImageData", dtype=h5py.string_dtype("ascii", len("ImageData")))
    root.attrs["WholeExtent"] = np.array([0, shape[2], 0, shape[1], 0, shape[0]], np.int64)
    root.attrs["Origin"] = np.zeros(3)
    root.attrs["Spacing"] = np.array([dx, dx, layer])
    root.attrs["Direction"] = np.eye(3).ravel()
    for name in ("title", "source", "history"):
        root.attrs[name] = str(data.attrs.get(name, ""))


def _steps(root: "h5py.Group", times: np.ndarray, offsets: dict[str, np.ndarray]) -> None:
    group = root.create_group("Steps")
    group.attrs["NSteps"] = len(times)
    group["Values"] = np.asarray(times, float)
    of_cells = group.create_group("CellDataOffsets")
    for name, values in offsets.items():
        of_cells[name] = values
