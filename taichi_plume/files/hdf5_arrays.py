"""Arrays in HDF5 files: NetCDF 4, MATLAB 7.3 and others.

A child process reads names, coordinates and attributes: in a damaged file HDF5 may never come to an end.
"""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from taichi_plume.files.conventions import text_of
from taichi_plume.files.stored_arrays import (
    ArrayFileError,
    Beside,
    StoredArray,
    Values,
    among,
    chosen,
    cubes,
    flat,
    groups_of,
    is_beside,
    plain,
)
from taichi_plume.guard.sandbox import MIB, ConfinedError, ConfinedProcess, Limits
from taichi_plume.guard.terminal import visible

FILTERS = {1, 2, 3}  # gzip (deflate), shuffle, fletcher32
SECONDS, MEMORY = 4.0, 1024 * MIB  # computing time and memory to read the names in a file
MOST_NODES = 10_000  # groups and arrays that are looked at
NO_VARIABLE = "This is a netCDF dimension but not a netCDF variable"  # attribute NAME of a filler


def open_hdf5(path: Path, variable: str | None, usual: Sequence[str], is_matlab: bool) -> StoredArray:
    """Open an array of an HDF5 file. A child process reads names and attributes: in a damaged file that may not end."""
    import h5py

    process = ConfinedProcess("h5py", __name__)
    try:
        limits = Limits(SECONDS, MEMORY, opens=True)
        name, stored = process.call(_layout, path, variable, tuple(usual), is_matlab, limits=limits)
    except ConfinedError as error:
        raise ArrayFileError(f"{path}: {error}; is it damaged?") from None
    finally:
        process.close()
    return replace(stored, values=h5py.File(path, "r")[name])


def _layout(
    path: Path, variable: str | None, usual: Sequence[str], is_matlab: bool
) -> tuple[str, StoredArray]:
    """Return the name of an array in an HDF5 file, and all of it but its values."""
    import h5py

    file = h5py.File(path, "r")
    arrays = dict(_datasets(file))
    given = (variable or "").strip("/") or None
    names = sorted(arrays) if given else cubes({name: array.shape for name, array in arrays.items()})
    array = arrays[chosen(path, names, given, usual)]
    name = array.name.strip("/")
    _require_plain(path, array)
    axes = tuple(_axis_of(array, n) for n in range(array.ndim))
    near = {own: arrays[whole] for own, whole in among(name, list(arrays)).items()}
    for axis in array.dims:
        near |= {scale.name.rpartition("/")[2]: scale for scale in axis.values()}
    beside = {}
    for own, other in near.items():
        is_filler = text_of(other.attrs.get("NAME", "")).startswith(NO_VARIABLE)
        if other.dtype.kind in "fiu" and is_beside(other.shape, array.shape, own in axes) and not is_filler:
            _require_plain(path, other)
            along = tuple(filter(None, (_axis_of(other, n) for n in range(other.ndim))))
            beside[own] = Beside(flat(other[...]), plain(dict(other.attrs)), along)
    form = "MATLAB" if is_matlab else "NetCDF" if "_NCProperties" in file.attrs or any(axes) else "HDF5"
    of_file = {}
    for group in groups_of(name):
        of_file |= plain(dict(file[group or "/"].attrs))
    chunks = array.chunks or (1, *array.shape[1:])
    attributes = plain(dict(array.attrs))
    return name, StoredArray(None, chunks, form, attributes, of_file, axes, beside, name)


def _datasets(group: Any, before: str = "") -> Iterator[tuple[str, Any]]:
    """Yield (path, array) of all arrays of an HDF5 group and below; links to elsewhere are not followed."""
    import h5py

    for n, name in enumerate(group):
        if n > MOST_NODES or before.count("/") > 20:
            return
        if not isinstance(group.get(name, getlink=True), h5py.HardLink) or str(name).startswith("#"):
            continue
        node = group[name]
        if isinstance(node, h5py.Dataset):
            yield f"{before}{name}", node
        elif isinstance(node, h5py.Group):
            yield from _datasets(node, f"{before}{name}/")


def _axis_of(array: Any, n: int) -> str:
    """Return the name of axis n of an HDF5 array, by its dimension scale or label; "" without one."""
    axis = array.dims[n]
    if len(axis):
        return axis[0].name.rpartition("/")[2]
    is_scale = array.is_scale and array.ndim == 1
    return str(axis.label or "") or (array.name.rpartition("/")[2] if is_scale else "")


def _require_plain(path: Path, array: Any) -> None:
    """Raise ArrayFileError if an HDF5 array lies in other files or is packed by a filter that is not read."""
    import h5py

    if array.is_virtual or array.external:
        raise ArrayFileError(f"{path}: {visible(array.name, 40)} lies in other files; copy it into one")
    plan = array.id.get_create_plist()
    filters = [plan.get_filter(n)[0] for n in range(plan.get_nfilters())]
    if set(filters) - FILTERS or filters.count(h5py.h5z.FILTER_DEFLATE) > 1:
        raise ArrayFileError(
            f"{path}: {visible(array.name, 40)} is packed; only gzip, once, and shuffle are read"
        )


def require_declared_size(array: Values, along: int, n: int) -> None:
    """Raise ValueError if a gzip chunk of an HDF5 array, at index n of axis `along`, is larger than it declares."""
    import h5py

    from taichi_plume.files.bounded_codecs import unpack  # imports zarr

    if not isinstance(array, h5py.Dataset) or array.compression != "gzip" or array.chunks is None:
        return
    most = math.prod(array.chunks) * array.dtype.itemsize + 4  # fletcher32
    starts = [range(0, length, size) for length, size in zip(array.shape, array.chunks, strict=True)]
    begin = n // array.chunks[along] * array.chunks[along]
    starts[along] = range(begin, begin + 1)
    for corner in itertools.product(*starts):
        try:
            skipped, packed = array.id.read_direct_chunk(corner)
        except (OSError, ValueError, RuntimeError):
            continue  # not stored
        if not skipped:  # no filter
            unpack("zlib", packed, most)
