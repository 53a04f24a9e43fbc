"""Arrays in HDF5 files: NetCDF 4, MATLAB 7.3 and others.

A child process reads names, coordinates and attributes: in a damaged file HDF5 may never come to an end.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from taichi_plume.files.conventions import text_of
from taichi_plume.files.stored_arrays import ArrayFileError, StoredArray, stored_array
from taichi_plume.guard.sandbox import MIB, ConfinedError, ConfinedProcess, Limits
from taichi_plume.guard.terminal import visible

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

    def about(array: Any) -> tuple[tuple[str, ...], dict[str, Any]]:
        _require_within(path, array)
        axes = tuple(_axis_of(array, n) for n in range(array.ndim))
        return axes if any(axes) else (), dict(array.attrs)

    def scales(array: Any) -> dict[str, str]:
        known = [scale.name.strip("/") for axis in array.dims for scale in axis.values()]
        return {name.rpartition("/")[2]: name for name in known if name in opened}

    opened = {name: partial(file.__getitem__, name) for name in _datasets(file)}
    stored = stored_array(
        path, "", opened, about, lambda group: dict(file[group or "/"].attrs), variable, usual, scales
    )
    is_netcdf = "_NCProperties" in file.attrs or any(stored.axes)
    form = "MATLAB" if is_matlab else "NetCDF" if is_netcdf else "HDF5"
    return stored.name, replace(stored, values=None, form=form)


def _datasets(group: Any, before: str = "") -> Iterator[str]:
    """Yield the paths of all arrays of an HDF5 group and below; links to elsewhere are not followed."""
    import h5py

    for n, name in enumerate(group):
        if n > MOST_NODES or before.count("/") > 20:
            return
        if not isinstance(group.get(name, getlink=True), h5py.HardLink) or str(name).startswith("#"):
            continue
        node = group[name]
        if isinstance(node, h5py.Dataset):
            if not text_of(node.attrs.get("NAME", "")).startswith(NO_VARIABLE):
                yield f"{before}{name}"
        elif isinstance(node, h5py.Group):
            yield from _datasets(node, f"{before}{name}/")


def _axis_of(array: Any, n: int) -> str:
    """Return the name of axis n of an HDF5 array, by its dimension scale or label; "" without one."""
    axis = array.dims[n]
    if len(axis):
        return axis[0].name.rpartition("/")[2]
    is_scale = array.is_scale and array.ndim == 1
    return str(axis.label or "") or (array.name.rpartition("/")[2] if is_scale else "")


def _require_within(path: Path, array: Any) -> None:
    """Raise ArrayFileError if an HDF5 array lies in other files."""
    if array.is_virtual or array.external:
        raise ArrayFileError(f"{path}: {visible(array.name, 40)} lies in other files; copy it into one")
