"""Arrays in files of other programs, opened but not read: Zarr, NetCDF, HDF5, MATLAB 7.3 and NumPy.

Each array comes with the names of its axes, the coordinates along them and its attributes, if the file has them. Axes
without names get those of coordinates beside the array, if their lengths fit in only one order. MATLAB's files have the
axes of an array in reverse.
"""

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from taichi_plume.files.bounded_codecs import unpack
from taichi_plume.files.conventions import role_of
from taichi_plume.files.zarr_groups import FAULTS, Group, GroupError
from taichi_plume.guard.safe_open import open_regular, unopenable
from taichi_plume.guard.terminal import visible

Values = Any
"""An array of zarr, h5py, SciPy or NumPy."""
Coordinate = tuple[np.ndarray, Mapping[str, Any]]
"""Values (n,) along an axis, and attributes."""
NPY, HDF5, MATLAB, NETCDF3 = b"\x93NUMPY", b"\x89HDF\r\n\x1a\n", b"MATLAB 7.3", b"CDF"
HDF5_FILTERS = {1, 2, 3}  # HDF5 filters: gzip (deflate), shuffle, fletcher32
MOST_ALONG = 10_000_000  # values of a coordinate
MOST_NODES = 10_000  # groups and arrays of an HDF5 file that are looked at
CODECS = frozenset(
    {
        *("blosc", "zstd", "zlib", "gzip", "lz4", "shuffle"),
        *("crc32", "crc32c", "adler32", "fletcher32"),
        *("bytes", "transpose", "sharding_indexed"),
    }
)
"""Codecs of Zarr 2 and 3 whose decoded size is bounded. Pickle, for example, would execute code in the file."""
NOT_A_VARIABLE = "This is a netCDF dimension but not a netCDF variable"


class ArrayFileError(ValueError):
    """Error: a file holds no array that can be read; the message is one line and begins with the path."""


@dataclass(frozen=True)
class StoredArray:
    """Array that is not read yet. chunks: shape of a chunk; a whole frame for arrays without chunks.

    attributes: of the array; of_file: of its group and file. axes: name of each axis, "" where the file has none.
    coordinates: values (n,) along an axis and their attributes, by the name of the axis. form: name of the format.
    """

    values: Values
    chunks: tuple[int, ...]
    form: str
    attributes: Mapping[str, Any]
    of_file: Mapping[str, Any]
    axes: tuple[str, ...]
    coordinates: Mapping[str, Coordinate]

    @property
    def shape(self) -> tuple[int, ...]:
        """Lengths of the axes."""
        return tuple(self.values.shape)

    def along(self, n: int) -> Coordinate:
        """Return the coordinate of axis n; empty without one."""
        return self.coordinates.get(self.axes[n], (np.empty(0), {}))

    def roles(self, usual: Sequence[str]) -> tuple[tuple[str, ...], bool]:
        """Return the role ("time", "y", "x") of each axis, "" for further ones of length 1, and whether it is stated.

        usual: roles, in the order that is assumed for axes without a known name. Raises ArrayFileError, without the
        path, if the axes do not have each role once.
        """
        known = [
            role_of(name, self.coordinates.get(name, (None, {}))[1]) if name else None for name in self.axes
        ]
        single = [n for n, length in enumerate(self.shape) if length == 1 and known[n] not in usual]
        single.sort(key=lambda n: known[n] is None)
        left = iter([role for role in usual if role not in known])
        roles = [role or "" for role in known]
        dropped = single[: max(0, len(known) - len(usual))]
        for n, role in enumerate(known):
            roles[n] = "" if n in dropped else role or next(left, "?")
        if sorted(role for role in roles if role) != sorted(usual):
            named = ", ".join(f"{name or '?'}: {n}" for name, n in zip(self.axes, self.shape, strict=True))
            raise ArrayFileError(f"has the axes ({visible(named, 80)}); {', '.join(usual)} are wanted")
        return tuple(roles), None not in [known[n] for n in range(len(known)) if n not in dropped]


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
        return _hdf5(path, variable, usual_names, begin.startswith(MATLAB))
    if begin.startswith(NETCDF3):
        return _netcdf3(path, variable, usual_names)
    raise ArrayFileError(f"{path}: is no array; Zarr, NetCDF, HDF5, MATLAB 7.3 and .npy files are read")


def _require_unnamed(path: Path, variable: str | None) -> None:
    if variable is not None:
        raise ArrayFileError(f"{path}: holds a single array, which has no name; remove variable")


def _chosen(path: Path, names: list[str], variable: str | None, usual: Sequence[str]) -> str:
    """Return the variable to read among `names`: the given or the usual one. Raises ArrayFileError if there is none."""
    here = [name for each in usual for name in names if name.rpartition("/")[2] == each]
    if variable is None and (len(here) == 1 or len(names) == 1):
        return (here or names)[0]
    if variable is None and here and "/" not in here[0]:
        return here[0]
    if variable in names:
        return variable
    held = f"its variables: {visible(', '.join(names[:10]), 200)}" if names else "it has no variable"
    names_of = " nor ".join(f"'{name}'" for name in usual) or "'array'"
    missing = f"no '{visible(variable, 40)}'" if variable else f"neither {names_of}"
    raise ArrayFileError(f"{path}: has {missing}; {held}; give the name of one")


def _cubes(shapes: Mapping[str, tuple[int, ...]]) -> list[str]:
    """Return the names of the arrays with three axes or more, or else of all."""
    return sorted(name for name, shape in shapes.items() if len(shape) > 2) or sorted(shapes)


def _among(name: str, names: Sequence[str]) -> dict[str, str]:
    """Return the arrays in the group of array `name` by their own names, other than it."""
    group = name.rpartition("/")[0]
    return {
        each.rpartition("/")[2]: each for each in names if each.rpartition("/")[0] == group and each != name
    }


def _with_beside(
    axes: Sequence[str],
    shape: Sequence[int],
    usual: Sequence[str],
    beside: Mapping[str, Coordinate],
) -> tuple[str, ...]:
    """Return the names of axes; those without a name get that of a coordinate beside, if only one order fits."""
    if any(axes) or len(shape) != len(usual):
        return tuple(axes)
    by_role: dict[str, str] = {}
    for name, (_, attributes) in beside.items():
        role = role_of(name, attributes)
        if role is not None and role in usual:
            by_role.setdefault(role, name)

    def fits(order: Sequence[str]) -> bool:
        pairs = zip(order, shape, strict=True)
        return all(role not in by_role or len(beside[by_role[role]][0]) == n for role, n in pairs)

    orders = [usual] if fits(usual) else [order for order in itertools.permutations(usual) if fits(order)]
    return (
        tuple(by_role.get(role, role) for role in orders[0]) if by_role and len(orders) == 1 else tuple(axes)
    )


# ---------------------------------------------------------------- Zarr


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
        names = group.names if variable else _cubes({each: _shape(group, each) for each in group.names})
        name = _chosen(path, names, name or None, usual)
    array = group[name]
    attributes = _plain(dict(array.attrs))
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
            coordinates[axis] = (np.asarray(values[...]), _plain(dict(values.attrs)))
    return StoredArray(array, array.chunks, "Zarr", attributes, _plain(group.attributes), axes, coordinates)


def _shape(group: Group, name: str) -> tuple[int, ...]:
    try:
        return tuple(group[name].shape)
    except FAULTS:  # reported if this array is chosen
        return ()


# ---------------------------------------------------------------- HDF5, NetCDF 4, MATLAB 7.3


def _hdf5(path: Path, variable: str | None, usual: Sequence[str], is_matlab: bool) -> StoredArray:
    import h5py

    file = h5py.File(path, "r")
    arrays = dict(_datasets(file))
    plain = (variable or "").strip("/") or None
    names = sorted(arrays) if plain else _cubes({name: array.shape for name, array in arrays.items()})
    array = arrays[_chosen(path, names, plain, usual)]
    name = array.name.strip("/")
    _require_plain(path, array)
    beside = {}
    for own, whole in _among(name, list(arrays)).items():
        other = arrays[whole]
        if (
            other.size == max(other.shape, default=0)
            and 1 < other.size <= MOST_ALONG
            and other.dtype.kind in "fiu"
        ):
            _require_plain(path, other)
            beside[own] = (np.ravel(other[...]), _plain(dict(other.attrs)))
    axes = tuple(_axis_of(array, n) for n in range(array.ndim))
    order = ("time", "x", "y") if is_matlab else ("time", "y", "x")
    axes = _with_beside(axes, array.shape, order, beside)
    form = "MATLAB" if is_matlab else "NetCDF" if "_NCProperties" in file.attrs or any(axes) else "HDF5"
    of_file = _plain(dict(file.attrs)) | _plain(dict(array.parent.attrs))
    chunks = array.chunks or (1, *array.shape[1:])
    return StoredArray(array, chunks, form, _plain(dict(array.attrs)), of_file, axes, beside)


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
    return axis[0].name.rpartition("/")[2] if len(axis) else str(axis.label or "")


def _require_plain(path: Path, array: Any) -> None:
    """Raise ArrayFileError if an HDF5 array lies in other files or is packed by a filter that is not read."""
    import h5py

    if array.is_virtual or array.external:
        raise ArrayFileError(f"{path}: {visible(array.name, 40)} lies in other files; copy it into one")
    plan = array.id.get_create_plist()
    filters = [plan.get_filter(n)[0] for n in range(plan.get_nfilters())]
    if set(filters) - HDF5_FILTERS or filters.count(h5py.h5z.FILTER_DEFLATE) > 1:
        raise ArrayFileError(
            f"{path}: {visible(array.name, 40)} is packed; only gzip, once, and shuffle are read"
        )


def require_declared_size(array: Values, along: int, n: int) -> None:
    """Raise ValueError if a gzip chunk of an HDF5 array, at index n of axis `along`, is larger than it declares."""
    import h5py

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


# ---------------------------------------------------------------- NetCDF 3


def _netcdf3(path: Path, variable: str | None, usual: Sequence[str]) -> StoredArray:
    from scipy.io import netcdf_file

    file = netcdf_file(path, "r", mmap=False, maskandscale=False)  # closing a map of memory warns
    arrays = file.variables
    names = sorted(arrays) if variable else _cubes({name: of.data.shape for name, of in arrays.items()})
    array = arrays[_chosen(path, names, variable, usual)]
    axes = tuple(str(name) for name in array.dimensions)
    beside = {
        name: (np.array(arrays[name].data, float), _plain(vars(arrays[name])["_attributes"]))
        for name in axes
        if name in arrays and arrays[name].data.ndim == 1 and len(arrays[name].data) <= MOST_ALONG
    }
    values = array.data
    attributes = _plain(vars(array)["_attributes"])
    return StoredArray(
        values, (1, *values.shape[1:]), "NetCDF", attributes, _plain(vars(file)["_attributes"]), axes, beside
    )


def _plain(attributes: Mapping[str, Any]) -> dict[str, Any]:
    """Return attributes with bytes as texts, and without references of HDF5."""
    known = {}
    for key, value in attributes.items():
        if isinstance(value, bytes):
            value = value.decode("utf-8", "replace")
        if isinstance(value, np.ndarray) and value.dtype.kind == "S":
            value = value.astype("U")
        if not (isinstance(value, np.ndarray) and value.dtype.kind == "O") and key != "DIMENSION_LIST":
            known[key] = value
    return known
