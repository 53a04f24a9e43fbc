"""NetCDF-4 files that follow CF, of a film's or a recording's variables, written by h5netcdf."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import xarray

PACKED = {"compression": "gzip", "compression_opts": 1, "shuffle": True}
Reading = Callable[[str, int], np.ndarray]
"""The values of a variable at the frame of that number; of one without time, all of it."""


def write(path: Path, data: "xarray.Dataset", read: Reading) -> Iterator[int]:
    """Write a new file, frame by frame; yields the number of bytes that come next, before each frame.

    data: the variables, time the first of their dimensions; read: how to get their values. Raises OSError.
    """
    import h5netcdf

    with h5netcdf.File(path, "w") as file:
        file.dimensions = {str(name): size for name, size in data.sizes.items()}
        file.attrs.update({name: _plain(one) for name, one in data.attrs.items() if one is not None})
        moving = {}
        for name, one in data.variables.items():
            name = str(name)
            frames = one.dims[:1] == ("time",) and one.ndim > 1
            options: dict[str, Any] = PACKED | {"chunks": (1, *one.shape[1:])} if frames else {}
            array = file.create_variable(name, one.dims, one.dtype, **options)
            array.attrs.update({key: _plain(value) for key, value in one.attrs.items() if value is not None})
            if frames:
                moving[name] = array
            else:
                array[...] = read(name, 0)
        for n in range(data.sizes.get("time", 0)):
            yield sum(int(np.prod(one.shape[1:])) * one.dtype.itemsize for one in moving.values())
            for name, array in moving.items():
                array[n] = read(name, n)


def _plain(value: Any) -> Any:
    """What NetCDF can hold as an attribute."""
    if isinstance(value, bool | dict):
        return str(value)
    if isinstance(value, list | tuple):
        return (
            np.asarray(value)
            if value and not any(isinstance(one, dict | list | bool) for one in value)
            else str(value)
        )
    return value
