"""Writer of NetCDF-4 files with CF metadata for the fields of a film or the pictures of a run, by h5netcdf."""

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import xarray

PACKED = {"compression": "gzip", "compression_opts": 1, "shuffle": True}
Reading = Callable[[str, int], np.ndarray]
"""Returns the values of a variable at a frame; of a variable without time all values."""


def write(fresh: Path, data: "xarray.Dataset", read: Reading) -> Iterator[int]:
    """Write a dataset to a NetCDF-4 file frame by frame; yields the number of bytes before each frame.

    data: variables whose first dimension is a time, such as time or time_wind; read: returns their values. Numbers
    over time are float32, NaN if missing. Raises OSError.
    """
    import h5netcdf

    with h5netcdf.File(fresh, "w") as file:
        file.dimensions = {str(name): size for name, size in data.sizes.items()}
        file.attrs.update(_plain(data.attrs))
        moving: dict[str, dict[str, Any]] = {str(dim): {} for dim in data.dims if str(dim).startswith("time")}
        for name, variable in ((str(name), variable) for name, variable in data.variables.items()):
            frames = variable.ndim > 1 and variable.dims[0] in moving
            options: dict[str, Any] = PACKED | {"chunks": (1, *variable.shape[1:])} if frames else {}
            kind = np.dtype(np.float32) if frames and variable.dtype.kind == "f" else variable.dtype
            if frames and kind.kind == "f":
                options["fillvalue"] = np.float32(np.nan)
            array = file.create_variable(name, variable.dims, kind, **options)
            array.attrs.update(_plain(variable.attrs))
            if frames:
                moving[str(variable.dims[0])][name] = array
            else:
                array[...] = read(name, 0)
        for dim, arrays in moving.items():
            for n in range(data.sizes[dim]):
                yield sum(int(np.prod(array.shape[1:])) * array.dtype.itemsize for array in arrays.values())
                for name, array in arrays.items():
                    array[n] = read(name, n)


def _plain(attributes: Mapping[Any, object]) -> dict[str, object]:
    """Convert attributes to types that NetCDF can hold: numbers, texts, number arrays; others become text."""
    plain: dict[str, object] = {}
    for key, value in attributes.items():
        if isinstance(value, bool | dict):
            plain[key] = str(value)
        elif isinstance(value, list | tuple):
            nested = not value or any(isinstance(entry, dict | list | bool) for entry in value)
            plain[key] = str(value) if nested else np.asarray(value)
        elif value is not None:
            plain[key] = value
    return plain
