"""Opening of arrays in files of other programs by their content: Zarr, NetCDF, HDF5, MATLAB 7.3 and NumPy."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from taichi_plume.files.stored_arrays import (
    ArrayFileError,
    Beside,
    StoredArray,
    chosen,
    cubes,
    flat,
    groups_of,
    is_beside,
    plain,
)
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
"""Codecs of Zarr 2 and 3 whose decoded size is bounded. Pickle, for example, would execute code in the file."""
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
    given, name = (variable or "").strip("/") or None, ""
    try:
        groups = _zarr_groups(path, given)
    except GroupError as error:
        raise ArrayFileError(str(error)) from None
    except FAULTS:
        raise ArrayFileError(f"{path}: is neither an array nor a group of Zarr that can be read") from None
    if groups[""].names == [""]:
        _require_unnamed(path, variable)
    else:
        names = [f"{place}/{each}".strip("/") for place, group in groups.items() for each in group.names]
        shapes = {each: _shape(*_within(groups, each)) for each in names}
        name = chosen(path, sorted(names) if given else cubes(shapes), given, usual)
    group, own = _within(groups, name)
    array = group[own]
    axes = _zarr_axes(array) or ("",) * array.ndim
    beside, of_file = {}, {}
    for place in groups_of(name):
        group = groups[place]
        of_file |= plain(group.attributes)
        for each in {*group.names} - {own, ""}:
            if is_beside(_shape(group, each), array.shape, each in axes):
                other = group[each]
                values = flat(np.asarray(other[...]))
                beside[each] = Beside(values, _zarr_attributes(other), _zarr_axes(other))
    return StoredArray(array, array.chunks, "Zarr", _zarr_attributes(array), of_file, axes, beside, name)


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


def _within(groups: Mapping[str, Group], name: str) -> tuple[Group, str]:
    place, _, own = name.rpartition("/")
    return groups[place], own


def _zarr_axes(array: Any) -> tuple[str, ...]:
    """Return the names of a Zarr array's axes, "" for one without; () without any."""
    names = getattr(array.metadata, "dimension_names", None) or array.attrs.get("_ARRAY_DIMENSIONS") or ()
    return tuple(str(name or "") for name in names) if len(names) == array.ndim and any(names) else ()


def _zarr_attributes(array: Any) -> dict[str, Any]:
    """Return the attributes of a Zarr array, with its fill value as xarray writes it."""
    known = plain(dict(array.attrs))
    known.pop("_ARRAY_DIMENSIONS", None)
    if isinstance(known.get("_FillValue"), str):  # base64 in Zarr 3
        from xarray.backends.zarr import FillValueCoder

        with suppress(*FAULTS):
            known["_FillValue"] = FillValueCoder.decode(known["_FillValue"], array.dtype)
    if array.metadata.zarr_format == 2 and array.fill_value:  # a 0 counts as 0 either way
        known.setdefault("_FillValue", array.fill_value)
    return known


def _shape(group: Group, name: str) -> tuple[int, ...]:
    try:
        return tuple(group[name].shape)
    except FAULTS:  # reported if this array is chosen
        return ()


def _netcdf3(path: Path, variable: str | None, usual: Sequence[str]) -> StoredArray:
    from scipy.io import netcdf_file

    file = netcdf_file(path, "r", mmap=False, maskandscale=False)  # closing a map of memory warns
    arrays = file.variables
    names = sorted(arrays) if variable else cubes({name: of.data.shape for name, of in arrays.items()})
    own = chosen(path, names, variable, usual)
    array = arrays[own]
    axes = tuple(str(name) for name in array.dimensions)
    beside = {
        name: Beside(
            flat(np.array(other.data)), _netcdf3_attributes(other), tuple(map(str, other.dimensions))
        )
        for name, other in arrays.items()
        if name != own
        and other.data.dtype.kind in "fiu"
        and is_beside(other.data.shape, array.data.shape, name in axes)
    }
    values, of_file = array.data, _netcdf3_attributes(file)
    chunks = (1, *values.shape[1:])
    return StoredArray(values, chunks, "NetCDF", _netcdf3_attributes(array), of_file, axes, beside, own)


def _netcdf3_attributes(item: Any) -> dict[str, Any]:
    return plain(vars(item)["_attributes"])
