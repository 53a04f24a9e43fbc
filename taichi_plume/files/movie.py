"""Plume movies from other sources: gas concentrations over (time, y, x), read frame by frame.

A Zarr array, or a group with one (plume-nav-sim: `concentration`, attributes fps, pixel_to_grid in metres per pixel
and origin (y, x) of the array or its group), a .npy file, or an HDF5 file (attributes likewise).
"""

import itertools
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

import numpy as np

from taichi_plume.files.bounded_codecs import unpack
from taichi_plume.files.film import FilmError
from taichi_plume.files.zarr_groups import FAULTS, LARGEST_CHUNK, MOST_CHUNKS, Group, GroupError, errors_as
from taichi_plume.guard.safe_open import open_regular, unopenable
from taichi_plume.guard.terminal import visible
from taichi_plume.scenario.domain import Domain
from taichi_plume.scenario.playback import MovieGas

Pixels = Any
"""An array of zarr, h5py or NumPy over (time, y, x)."""
NAMES = ("concentration", "plume")  # default names of the variable, of plume-nav-sim and FlyGym
NPY, HDF5 = b"\x93NUMPY", b"\x89HDF\r\n\x1a\n"
HDF5_FILTERS = {1, 2, 3}  # HDF5 filters: gzip (deflate), shuffle, fletcher32
MOST_PIXELS = 100_000_000  # of a frame
MOST_FRAMES = 10_000_000
LARGEST = 1e12  # of a value: far beyond 1e6 ppm in any unit, and sums stay finite
CODECS = frozenset(
    {
        *("blosc", "zstd", "zlib", "gzip", "lz4", "shuffle"),
        *("crc32", "crc32c", "adler32", "fletcher32"),
        *("bytes", "transpose", "sharding_indexed"),
    }
)
"""Codecs of Zarr 2 and 3 whose decoded size is bounded. Pickle, for example, would execute code in the file."""


class Movie:
    """Plume movie on disk: times [s] of the frames, origin (x, y) [m], pixel edge [m], size (x, y) [m].

    Pixels are squares of constant value, 0 beyond the picture. A cell of the domain has the mean over its area: the
    sum over cells equals the sum over the part of the picture in the domain, whether cells or pixels are larger.
    Raises FilmError, in a line, if the file is no movie or lacks a number that the scenario leaves out.
    """

    def __init__(self, path: Path, model: MovieGas, domain: Domain):
        self.path, self.cells = path, domain.shape
        with errors_as(FilmError, path, "cannot be read as a movie"):
            self.array, known, chunks = _opened(path, model.variable)
            shape, kind = tuple(self.array.shape), np.dtype(self.array.dtype)
        if len(shape) != 3 or kind.kind not in "fiub":
            raise FilmError(f"{path}: has the shape {shape} of {kind}; wanted numbers over (time, y, x)")
        if not min(shape) or shape[0] > MOST_FRAMES or shape[1] * shape[2] > MOST_PIXELS:
            raise FilmError(
                f"{path}: has the shape {shape}; allowed are 1 to {MOST_FRAMES} frames "
                f"of 1 to {MOST_PIXELS} pixels"
            )
        pieces = math.prod(-(-size // chunk) for size, chunk in zip(shape[1:], chunks[1:], strict=True))
        if pieces > MOST_CHUNKS:
            raise FilmError(f"{path}: has {pieces} chunks in a frame; at most {MOST_CHUNKS}")
        if np.prod(chunks, dtype=float) * kind.itemsize > LARGEST_CHUNK:
            raise FilmError(f"{path}: has chunks of {chunks}, over {LARGEST_CHUNK >> 30} GiB; use smaller")
        self.shape = shape
        rate = model.frame_rate or self._positive(known, "fps", "frame_rate")
        self.pixel = model.pixel or self._positive(known, "pixel_to_grid", "pixel")
        self.origin = model.origin or self._corner(known.get("origin"))
        self.size = (shape[2] * self.pixel, shape[1] * self.pixel)
        self.times = np.arange(shape[0]) / rate
        self.down = model.rows == "down"
        self.edges = [
            (np.arange(n + 1) * domain.spacing - low) / self.pixel
            for n, low in zip(self.cells[:2], self.origin, strict=True)
        ]

    def gas_of(self, species: object) -> str:
        return "concentration"

    def still(self, name: str) -> np.ndarray:
        """Return the air fraction of the domain's cells: 1 everywhere, as a movie shows no obstacles."""
        return np.ones(self.cells)

    def frame(self, n: int, names: list[str]) -> dict[str, np.ndarray]:
        """Return frame n as means over the domain's cells, in the file's unit, axes (x, y, z), constant in height."""
        values = self.picture(n)
        for axis, edges in enumerate(self.edges):
            values = means(values, edges, axis)
        if len(self.cells) == 3:
            values = np.repeat(values[:, :, None], self.cells[2], axis=2)
        return dict.fromkeys(names, values)

    def picture(self, n: int) -> np.ndarray:
        """Return the movie's pixels in frame n, axes (x, y), y upwards, in the file's unit. Raises FilmError."""
        with errors_as(FilmError, self.path, f"frame {n} cannot be read"):
            _require_declared_size(self.array, n)
            picture = np.asarray(self.array[n], dtype=np.float64)
        if not np.isfinite(picture).all():
            raise FilmError(f"{self.path}: frame {n}: not all values are finite numbers")
        low, high = float(picture.min()), float(picture.max())
        if low < 0 or high > LARGEST:
            wrong = low if low < 0 else high
            raise FilmError(f"{self.path}: frame {n}: holds {wrong:g}; must be within 0 and {LARGEST:g}")
        return (picture[::-1] if self.down else picture).T

    def _positive(self, known: Mapping[str, Any], name: str, key: str) -> float:
        """Return attribute `name` as a positive float; several values must be equal. key: scenario key, for errors."""
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

    def _corner(self, origin: Any) -> tuple[float, float]:
        try:
            y, x = (0.0, 0.0) if origin is None else (float(value) for value in np.ravel(origin))
        except (TypeError, ValueError):
            x = y = np.nan
        if not (abs(x) <= 1e7 and abs(y) <= 1e7):
            raise FilmError(
                f"{self.path}: its attribute 'origin' is {visible(origin, 60)}, not y and x; give origin"
            )
        return x, y


def means(values: np.ndarray, edges: np.ndarray, axis: int) -> np.ndarray:
    """Return means along an axis over intervals between `edges` [axis steps]; values outside count as zero."""
    values = np.moveaxis(values, axis, 0)
    total = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])
    at = np.clip(edges, 0, len(values))
    whole = np.minimum(at.astype(int), len(values) - 1)
    upto = total[whole] + (at - whole)[:, None] * values[whole]
    mean = np.diff(upto, axis=0) / np.diff(edges)[:, None]
    return np.moveaxis(np.maximum(mean, 0.0), 0, axis)  # rounding


Opened = tuple[Pixels, dict[str, Any], tuple[int, ...]]
"""An array that is not read yet, attributes, and the shape of a chunk; a frame of arrays without chunks."""


def _opened(path: Path, variable: str | None) -> Opened:
    """Open a movie file; return the unread array, attributes, chunk shape. Raises FilmError or read errors (FAULTS)."""
    if path.is_dir():
        return _zarr(path, variable)
    try:
        with open_regular(path) as file:
            begin = file.read(8)
    except OSError as error:
        raise FilmError(f"{path}: {unopenable(path) or error.strerror or error}") from None
    if begin.startswith(NPY):
        _require_unnamed(path, variable)
        array = np.lib.format.open_memmap(path, mode="r")
        return array, {}, (1, *array.shape[1:])
    if begin == HDF5:
        return _hdf5(path, variable)
    raise FilmError(f"{path}: is no movie; wanted a folder of Zarr, a .npy or an HDF5 file over (time, y, x)")


def _require_unnamed(path: Path, variable: str | None) -> None:
    if variable is not None:
        raise FilmError(f"{path}: holds a single array, which has no name; remove variable")


def _zarr(path: Path, variable: str | None) -> Opened:
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
    array = group[name]
    return array, group.attributes | dict(array.attrs), array.chunks


def _hdf5(path: Path, variable: str | None) -> Opened:
    import h5py

    file = h5py.File(path, "r")
    own = [str(name) for name in file if isinstance(file.get(name, getlink=True), h5py.HardLink)]
    names = sorted(name for name in own if isinstance(file[name], h5py.Dataset))
    array = cast(Pixels, file[_chosen(path, names, variable)])
    if array.is_virtual or array.external:
        raise FilmError(f"{path}: {visible(array.name, 40)} lies in other files; copy it into one")
    plan = array.id.get_create_plist()
    filters = [plan.get_filter(n)[0] for n in range(plan.get_nfilters())]
    if set(filters) - HDF5_FILTERS or filters.count(h5py.h5z.FILTER_DEFLATE) > 1:
        raise FilmError(f"{path}: {visible(array.name, 40)} is packed; only gzip, once, and shuffle are read")
    return array, dict(file.attrs) | dict(array.attrs), array.chunks or (1, *array.shape[1:])


def _require_declared_size(array: Pixels, n: int) -> None:
    """Raise ValueError if a gzip chunk of frame n in an HDF5 file unpacks to more than its declared size."""
    import h5py

    if not isinstance(array, h5py.Dataset) or array.compression != "gzip" or array.chunks is None:
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
    """Return the variable to read among `names`: the given or the usual one. Raises FilmError if there is none."""
    usual = [name for name in NAMES if name in names]
    if variable is None and (usual or len(names) == 1):
        return (usual or names)[0]
    if variable in names:
        return variable
    held = f"its variables: {visible(', '.join(names[:10]), 200)}" if names else "it has no variable"
    missing = f"no '{visible(variable, 40)}'" if variable else "neither 'concentration' nor 'plume'"
    raise FilmError(f"{path}: has {missing}; {held}; give the name of one")
