"""Movies of plumes that others made: numbers over (time, y, x), read frame by frame.

A Zarr array, or a group with one (plume-nav-sim: `concentration`, attributes fps, pixel_to_grid in metres per pixel and
origin (y, x) of the array or its group), a .npy file, or an HDF5 file (attributes likewise).
"""

import itertools
import math
from pathlib import Path
from typing import Any

import numpy as np

from taichi_plume.files.bounded_codecs import unpack
from taichi_plume.files.film import FilmError
from taichi_plume.files.zarr_groups import FAULTS, LARGEST_CHUNK, MOST_CHUNKS, Group, GroupError, reason
from taichi_plume.guard.opening import open_regular, unopenable
from taichi_plume.guard.terminal import visible
from taichi_plume.scenario.played import MovieGas

NAMES = ("concentration", "plume")  # of the variable, unless told: plume-nav-sim's, FlyGym's
NPY, HDF5 = b"\x93NUMPY", b"\x89HDF\r\n\x1a\n"
HDF5_FILTERS = {1, 2, 3}  # gzip (deflate), shuffle, fletcher32
MOST_PIXELS = 100_000_000  # of a frame
MOST_FRAMES = 10_000_000
LARGEST = 1e12  # of a value: far beyond 1e6 ppm in any unit, and its sums stay numbers
CODECS = frozenset(
    {
        *("blosc", "zstd", "zlib", "gzip", "lz4", "shuffle"),
        *("crc32", "crc32c", "adler32", "fletcher32"),
        *("bytes", "transpose", "sharding_indexed"),
    }
)
"""Codecs whose decoded size is bounded, of Zarr 2 and 3. Another one, pickle, would execute what it reads."""


class Movie:
    """A movie on disk, and where it lies: times [s] of its frames, origin (x, y) [m], pixel [m], size (x, y) [m].

    Raises FilmError, in a line, where it is none or does not tell what the scenario leaves out.
    """

    def __init__(self, path: Path, model: MovieGas):
        self.path = path
        try:
            self.array, known = _opened(path, model.variable)
            shape, kind = tuple(self.array.shape), np.dtype(self.array.dtype).kind
        except FilmError:
            raise
        except FAULTS as error:
            raise FilmError(f"{path}: cannot be read as a movie: {visible(reason(error), 200)}") from None
        if len(shape) != 3 or kind not in "fiub":
            raise FilmError(
                f"{path}: has the shape {shape} of {self.array.dtype}; wanted numbers over (time, y, x)"
            )
        if not min(shape) or shape[0] > MOST_FRAMES or shape[1] * shape[2] > MOST_PIXELS:
            raise FilmError(
                f"{path}: has the shape {shape}; wanted at least one frame and pixel, at most {MOST_FRAMES} frames "
                f"of {MOST_PIXELS} pixels"
            )
        chunks = getattr(self.array, "chunks", None)
        pieces = (
            math.prod(-(-size // one) for size, one in zip(shape[1:], chunks[1:], strict=True))
            if chunks
            else 1
        )
        if pieces > MOST_CHUNKS:
            raise FilmError(f"{path}: has {pieces} chunks in a frame; at most {MOST_CHUNKS}")
        if chunks and np.prod(chunks, dtype=float) * np.dtype(self.array.dtype).itemsize > LARGEST_CHUNK:
            raise FilmError(
                f"{path}: has chunks of {chunks}, over {LARGEST_CHUNK >> 30} GiB; make them smaller"
            )
        self.shape = shape
        rate = model.frame_rate or self._told(known, "fps", "frame_rate")
        self.pixel = model.pixel or self._told(known, "pixel_to_grid", "pixel")
        self.origin = model.origin or self._corner(known.get("origin"))
        self.size = (shape[2] * self.pixel, shape[1] * self.pixel)
        self.times = np.arange(shape[0]) / rate
        self.down = model.rows == "down"

    def frame(self, n: int) -> np.ndarray:
        """Picture n, axes (x, y), y upwards, in the file's unit. Raises FilmError where it is damaged."""
        try:
            if hasattr(self.array, "id"):
                _require_declared_size(self.array, n)
            picture = np.asarray(self.array[n], dtype=np.float64)
        except FAULTS as error:
            raise FilmError(f"{self.path}: frame {n} cannot be read: {visible(reason(error), 200)}") from None
        if not np.isfinite(picture).all():
            raise FilmError(f"{self.path}: frame {n}: not all of its values are numbers")
        low, high = float(picture.min()), float(picture.max())
        if low < 0 or high > LARGEST:
            raise FilmError(
                f"{self.path}: frame {n}: holds {low if low < 0 else high:g}; must be within 0 and {LARGEST:g}"
            )
        return (picture[::-1] if self.down else picture).T

    def _told(self, known: dict[str, Any], name: str, key: str) -> float:
        """A positive number of the attributes, of which several have to be equal."""
        if name not in known:
            raise FilmError(f"{self.path}: has no attribute '{name}'; give {key}")
        try:
            values = np.ravel(known[name]).astype(float)
            good = len(values) > 0 and (values == values[0]).all() and 1e-6 <= values[0] <= 1e6
        except (TypeError, ValueError):
            good = False
        if not good:
            raise FilmError(
                f"{self.path}: its attribute '{name}' is {visible(str(known[name]), 60)}, not a positive number; "
                f"give {key}"
            )
        return float(values[0])

    def _corner(self, told: Any) -> tuple[float, float]:
        try:
            y, x = (0.0, 0.0) if told is None else (float(value) for value in np.ravel(told))
        except (TypeError, ValueError):
            x = y = np.nan
        if not (abs(x) <= 1e7 and abs(y) <= 1e7):
            raise FilmError(
                f"{self.path}: its attribute 'origin' is {visible(str(told), 60)}, not y and x; give origin"
            )
        return x, y


def _opened(path: Path, variable: str | None) -> tuple[Any, dict[str, Any]]:
    """The array of a file, not read yet, and the attributes. Raises FilmError, or one of FAULTS."""
    if path.is_dir():
        return _zarr(path, variable)
    try:
        with open_regular(path) as file:
            begin = file.read(8)
    except OSError as error:
        raise FilmError(f"{path}: {unopenable(path) or error.strerror or error}") from None
    if begin.startswith(NPY):
        _require_unnamed(path, variable)
        return np.lib.format.open_memmap(path, mode="r"), {}
    if begin == HDF5:
        return _hdf5(path, variable)
    raise FilmError(f"{path}: is no movie; wanted a folder of Zarr, a .npy or an HDF5 file over (time, y, x)")


def _require_unnamed(path: Path, variable: str | None) -> None:
    if variable is not None:
        raise FilmError(f"{path}: holds a single array, which has no name; remove variable")


def _zarr(path: Path, variable: str | None) -> tuple[Any, dict[str, Any]]:
    try:
        group = Group(path, formats=(2, 3), codecs=CODECS)
    except GroupError as error:
        raise FilmError(str(error)) from None
    except FAULTS:
        raise FilmError(f"{path}: is neither an array nor a group of Zarr that can be read") from None
    if group.names == [""]:
        _require_unnamed(path, variable)
        name = ""
    else:
        name = _chosen(path, group.names, variable)
    try:
        array = group[name]
    except GroupError as error:
        raise FilmError(str(error)) from None
    return array, group.attributes | dict(array.attrs)


def _hdf5(path: Path, variable: str | None) -> tuple[Any, dict[str, Any]]:
    import h5py

    file: Any = h5py.File(path, "r")
    own = [name for name in file if isinstance(file.get(name, getlink=True), h5py.HardLink)]
    names = sorted(name for name in own if isinstance(file[name], h5py.Dataset))
    array: Any = file[_chosen(path, names, variable)]
    if array.is_virtual or array.external:
        raise FilmError(f"{path}: {visible(array.name, 40)} lies in other files; copy it into one")
    plan = array.id.get_create_plist()
    filters = [plan.get_filter(n)[0] for n in range(plan.get_nfilters())]
    if set(filters) - HDF5_FILTERS or filters.count(h5py.h5z.FILTER_DEFLATE) > 1:
        raise FilmError(f"{path}: {visible(array.name, 40)} is packed; only gzip, once, and shuffle are read")
    return array, dict(file.attrs) | dict(array.attrs)


def _require_declared_size(array: Any, n: int) -> None:
    """Raise ValueError if a chunk of frame n unpacks to more than its size: HDF5 would unpack all of it."""
    if array.compression != "gzip":
        return
    t, *sizes = array.chunks
    most = math.prod(array.chunks) * array.dtype.itemsize + 4  # fletcher32
    starts = [range(0, length, size) for length, size in zip(array.shape[1:], sizes, strict=True)]
    for y, x in itertools.product(*starts):
        try:
            skipped, packed = array.id.read_direct_chunk((n // t * t, y, x))
        except (OSError, ValueError, RuntimeError):
            continue  # not stored
        if not skipped:  # no filter
            unpack("zlib", packed, most)


def _chosen(path: Path, names: list[str], variable: str | None) -> str:
    """The variable's name. Raises FilmError where it is not there, or not told and not known."""
    usual = [name for name in NAMES if name in names]
    if variable is None and (usual or len(names) == 1):
        return (usual or names)[0]
    if variable in names:
        return variable
    held = visible(", ".join(names[:10]) or "nothing", 200)
    wanted = f"no '{visible(variable, 40)}'" if variable else "neither 'concentration' nor 'plume'"
    raise FilmError(f"{path}: holds {wanted}, only {held}; give the variable's name")
