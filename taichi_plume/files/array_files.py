"""Opening of arrays in files of other programs by their content: Zarr, NetCDF, HDF5, MATLAB 7.3 and NumPy."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from taichi_plume.files.stored_arrays import MOST_ALONG, ArrayFileError, StoredArray, chosen, cubes, plain
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
        return StoredArray(array, (1, *array.shape[1:]), "NumPy", {}, {}, ("",) * array.ndim, {})
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
    parent, _, name = (variable or "").rpartition("/")
    try:
        group = Group(path, parent, formats=(2, 3), codecs=CODECS)
    except GroupError as error:
        raise ArrayFileError(str(error)) from None
    except FAULTS:
        raise ArrayFileError(f"{path}: is neither an array nor a group of Zarr that can be read") from None
    if group.names == [""]:
        _require_unnamed(path, variable)
    else:
        names = group.names if variable else cubes({each: _shape(group, each) for each in group.names})
        name = chosen(path, names, name or None, usual)
    array = group[name]
    attributes = plain(dict(array.attrs))
    if isinstance(attributes.get("_FillValue"), str):  # xarray's form in Zarr 3
        from xarray.backends.zarr import FillValueCoder

        attributes["_FillValue"] = FillValueCoder.decode(attributes["_FillValue"], array.dtype)
    if (
        array.metadata.zarr_format == 2 and array.fill_value
    ):  # as xarray writes it; a 0 counts as 0 either way
        attributes.setdefault("_FillValue", array.fill_value)
    axes = getattr(array.metadata, "dimension_names", None) or attributes.pop("_ARRAY_DIMENSIONS", None)
    axes = tuple(str(axis or "") for axis in axes or [""] * array.ndim)
    coordinates = {}
    for axis in {*axes} & {*group.names} - {name}:
        values = group[axis]
        if values.ndim == 1 and values.shape[0] <= MOST_ALONG:
            coordinates[axis] = (np.asarray(values[...]), plain(dict(values.attrs)))
    return StoredArray(array, array.chunks, "Zarr", attributes, plain(group.attributes), axes, coordinates)


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
    array = arrays[chosen(path, names, variable, usual)]
    axes = tuple(str(name) for name in array.dimensions)
    beside = {
        name: (np.array(arrays[name].data, float), plain(vars(arrays[name])["_attributes"]))
        for name in axes
        if name in arrays and arrays[name].data.ndim == 1 and len(arrays[name].data) <= MOST_ALONG
    }
    values = array.data
    attributes = plain(vars(array)["_attributes"])
    return StoredArray(
        values, (1, *values.shape[1:]), "NetCDF", attributes, plain(vars(file)["_attributes"]), axes, beside
    )
