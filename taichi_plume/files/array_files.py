"""Opening of arrays in files of other programs by their content: Zarr, NetCDF, HDF5, MATLAB 7.3 and NumPy."""

from collections.abc import Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from taichi_plume.files.stored_arrays import ArrayFileError, StoredArray, plain, stored_array
from taichi_plume.files.zarr_groups import FAULTS, Group, GroupError
from taichi_plume.guard.safe_open import open_regular, unopenable

NPY, HDF5, MATLAB, NETCDF3 = b"\x93NUMPY", b"\x89HDF\r\n\x1a\n", b"MATLAB 7.3", b"CDF"
CODECS = frozenset(
    {
        *("blosc", "zstd", "zlib", "gzip", "lz4", "shuffle"),
        *("crc32", "crc32c", "adler32", "fletcher32"),
        *("bytes", "transpose", "sharding_indexed"),
    }
)
"""Codecs of Zarr 2 and 3 that are read. Pickle, for example, would execute code in the file."""
MOST_GROUPS = 1000  # of a Zarr store


def open_array(path: Path, variable: str | None, usual_names: Sequence[str] = ()) -> StoredArray:
    """Open an array by the path of its variable, by default one of the usual names, else the only one.

    Raises ArrayFileError, and errors of the libraries (FAULTS of `zarr_groups`).
    """
    if path.is_dir():
        return _zarr(path, variable, usual_names)
    try:
        with open_regular(path) as file:
            begin = file.read(16)
    except OSError as error:
        raise ArrayFileError(f"{path}: {unopenable(path) or error.strerror or error}") from None
    if begin.startswith(NPY):
        _require_unnamed(path, variable)
        array = np.lib.format.open_memmap(path, mode="r")
        return StoredArray(array, (1, *array.shape[1:]), "NumPy", axes=("",) * array.ndim)
    if begin.startswith((HDF5, MATLAB)):
        from taichi_plume.files.hdf5_arrays import open_hdf5

        return open_hdf5(path, variable, usual_names, begin.startswith(MATLAB))
    if begin.startswith(NETCDF3):
        return _netcdf3(path, variable, usual_names)
    raise ArrayFileError(f"{path}: is no array; Zarr, NetCDF, HDF5, MATLAB 7.3 and .npy files are read")


def _require_unnamed(path: Path, variable: str | None) -> None:
    if variable is not None:
        raise ArrayFileError(f"{path}: holds a single array, which has no name; remove variable")


def _zarr(path: Path, variable: str | None, usual: Sequence[str]) -> StoredArray:
    try:
        groups = _zarr_groups(path, (variable or "").strip("/") or None)
    except GroupError as error:
        raise ArrayFileError(str(error)) from None
    except FAULTS:
        raise ArrayFileError(f"{path}: is neither an array nor a group of Zarr that can be read") from None
    if groups[""].names == [""]:
        _require_unnamed(path, variable)
    names = [(place, own) for place, group in groups.items() for own in group.names]
    opened = {f"{place}/{own}".strip("/"): partial(groups[place].__getitem__, own) for place, own in names}
    return stored_array(
        path, "Zarr", opened, _zarr_about, lambda place: groups[place].attributes, variable, usual
    )


def _zarr_groups(path: Path, given: str | None) -> dict[str, Group]:
    """Return the groups of a Zarr store by their paths within it, the root "" first; only those that hold `given`.

    Raises errors of `Group`.
    """
    groups = {"": Group(path, formats=(2, 3), codecs=CODECS)}
    left = [""]
    while left and groups[""].names != [""]:
        place = left.pop(0)
        for child in sorted((path / place).iterdir()):
            inner = f"{place}/{child.name}".strip("/")
            is_group = (child / ".zgroup").is_file() or (child / "zarr.json").is_file()
            is_wanted = given is None or given.startswith(f"{inner}/")
            if is_group and is_wanted and child.name not in groups[place].names and len(groups) < MOST_GROUPS:
                with suppress(*FAULTS):  # a damaged group is none
                    groups[inner] = Group(path, inner, formats=(2, 3), codecs=CODECS)
                    left.append(inner)
    return groups


def _zarr_about(array: Any) -> tuple[tuple[str, ...], dict[str, Any]]:
    """Return the names of a Zarr array's axes, () without any, and its attributes with the fill value as of xarray."""
    known = plain(dict(array.attrs))
    listed = known.pop("_ARRAY_DIMENSIONS", None)
    names = getattr(array.metadata, "dimension_names", None) or (() if listed is None else listed)
    if isinstance(known.get("_FillValue"), str):  # base64 in Zarr 3
        from xarray.backends.zarr import FillValueCoder

        with suppress(*FAULTS):
            known["_FillValue"] = FillValueCoder.decode(known["_FillValue"], array.dtype)
    if array.metadata.zarr_format == 2 and array.fill_value:  # a 0 counts as 0 either way
        known.setdefault("_FillValue", array.fill_value)
    is_named = len(names) == array.ndim and any(names)
    return tuple(str(name or "") for name in names) if is_named else (), known


def _netcdf3(path: Path, variable: str | None, usual: Sequence[str]) -> StoredArray:
    from scipy.io import netcdf_file

    file = netcdf_file(path, "r", mmap=False, maskandscale=False)  # closing a map of memory warns
    names = {id(array.data): name for name, array in file.variables.items()}
    opened = {name: partial(getattr, array, "data") for name, array in file.variables.items()}

    def about(values: np.ndarray) -> tuple[tuple[str, ...], dict[str, Any]]:
        array = file.variables[names[id(values)]]
        return tuple(map(str, array.dimensions)), vars(array)["_attributes"]

    return stored_array(path, "NetCDF", opened, about, lambda _: vars(file)["_attributes"], variable, usual)
