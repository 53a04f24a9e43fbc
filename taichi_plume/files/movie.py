"""Plume movies from other sources: gas concentrations over time, y and x, read frame by frame.

The array (see `array_files`) states what it can: names and coordinates of its axes, with their order and direction,
units, packing and missing values by the CF conventions, and plume-nav-sim's attributes fps, pixel_to_grid and origin
(y, x) of the array or its group, in metres or the unit of an attribute such as spatial_unit. Keys of the scenario say
the rest.
"""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from taichi_plume.files.array_files import open_array
from taichi_plume.files.conventions import ConventionError, FileFacts, is_missing, span, unpacked, when
from taichi_plume.files.film import FilmError
from taichi_plume.files.movie_calibration import Calibration
from taichi_plume.files.stored_arrays import ArrayFileError
from taichi_plume.files.zarr_groups import errors_as
from taichi_plume.scenario.domain import Domain
from taichi_plume.scenario.playback import MovieGas

NAMES = ("concentration", "plume")  # default names of the variable, of plume-nav-sim and FlyGym
AXES, MATLAB_AXES = ("time", "y", "x"), ("y", "x", "time")
MOST_PIXELS = 100_000_000  # of a frame
MOST_FRAMES = 10_000_000
LARGEST_CHUNK = 1 << 30  # bytes
MOST_CHUNKS = 10_000  # of a frame
LARGEST = 1e12  # of a value: far beyond 1e6 ppm in any unit, and sums stay finite
LOOKED_AT = 25  # frames, spread over the movie, that facts are taken from


class Movie:
    """Plume movie on disk: times [s] of the frames, origin (x, y) [m], pixel edge [m], size (x, y) [m].

    Pixels are squares of constant value, 0 beyond the picture. A cell of the domain has the mean over its area: the
    sum over cells equals the sum over the part of the picture in the domain, whether cells or pixels are larger. Noise
    below 0 and missing pixels count as 0. Raises FilmError, in a line, if the file is no movie or lacks a number that
    the scenario leaves out.
    """

    def __init__(self, path: Path, model: MovieGas, domain: Domain):
        self.path, self.cells, self.model = path, domain.shape, model
        with errors_as(FilmError, path, "cannot be read as a movie"):
            try:
                stored = open_array(path, model.variable, NAMES)
            except ArrayFileError as error:
                raise FilmError(str(error)) from None
            self.array = stored.values
            shape, kind = stored.shape, np.dtype(self.array.dtype)
        if len(shape) < 3 or kind.kind not in "fiub":
            raise FilmError(f"{path}: has the shape {shape} of {kind}; wanted numbers over (time, y, x)")
        sign = -1 if stored.form == "MATLAB" else 1
        usual, given = (MATLAB_AXES if sign < 0 else AXES)[::sign], model.axes and model.axes[::sign]
        with self._named():
            self.stored, self.axes = stored.arranged(usual, given)
        self.order = tuple(self.axes.roles.index(role) for role in AXES)
        self.shape = tuple(shape[n] for n in self.order)
        if not min(shape) or self.shape[0] > MOST_FRAMES or self.shape[1] * self.shape[2] > MOST_PIXELS:
            raise FilmError(
                f"{path}: has the shape {shape}; allowed are 1 to {MOST_FRAMES} frames "
                f"of 1 to {MOST_PIXELS} pixels"
            )
        pieces = math.prod(-(-shape[n] // stored.chunks[n]) for n in self.order[1:])
        if pieces > MOST_CHUNKS:
            raise FilmError(f"{path}: has {pieces} chunks in a frame; at most {MOST_CHUNKS}")
        if np.prod(stored.chunks, dtype=float) * kind.itemsize > LARGEST_CHUNK:
            raise FilmError(
                f"{path}: has chunks of {stored.chunks}, over {LARGEST_CHUNK >> 30} GiB; use smaller"
            )
        with self._named():
            calibration = Calibration(self.stored, self.order, model)
        self.calibration, self.begin, self.times = calibration, calibration.begin, calibration.times
        self.pixel, self.origin = calibration.pixel, calibration.origin
        self.size = (self.shape[2] * self.pixel, self.shape[1] * self.pixel)
        self.edges = [
            (np.arange(n + 1) * domain.spacing - low) / self.pixel
            for n, low in zip(self.cells[:2], self.origin, strict=True)
        ]

    @contextmanager
    def _named(self) -> Iterator[None]:
        """Context that raises errors without a path as FilmError."""
        try:
            yield
        except (ArrayFileError, ConventionError) as error:
            raise FilmError(f"{self.path}: {error}") from None

    def gas_of(self, species: object) -> str:
        return "concentration"

    def still(self, name: str) -> np.ndarray:
        """Return the air fraction of the domain's cells: 1 everywhere, as a movie shows no obstacles."""
        return np.ones(self.cells)

    def frame(self, n: int, names: list[str]) -> dict[str, np.ndarray]:
        """Return frame n as means over the domain's cells, in the unit of ppm_per_unit, constant in height."""
        values = self.picture(n)
        for axis, edges in enumerate(self.edges):
            values = means(values, edges, axis)
        if len(self.cells) == 3:
            values = np.repeat(values[:, :, None], self.cells[2], axis=2)
        return dict.fromkeys(names, values)

    def picture(self, n: int) -> np.ndarray:
        """Return the movie's pixels in frame n, axes (x, y), both ascending, 0 or more. Raises FilmError."""
        return np.maximum(np.nan_to_num(self._values(n, self._stored(n))), 0.0)

    def _stored(self, n: int) -> np.ndarray:
        """Return the pixels of frame n as the file stores them."""
        with errors_as(FilmError, self.path, f"frame {n} cannot be read"):
            at: list[Any] = [slice(None) if role else 0 for role in self.axes.roles]
            at[self.order[0]] = n
            return np.asarray(self.array[tuple(at)])

    def _values(self, n: int, stored: np.ndarray) -> np.ndarray:
        """Return pixels as `picture` does, but unclipped; NaN where missing. stored: of frame n."""
        with errors_as(FilmError, self.path, f"frame {n} cannot be unpacked"), self._named():
            values = unpacked(stored, self.stored.attributes)
        values = np.where(is_missing(values) & ~np.isinf(values), np.nan, values) * self.calibration.factor
        if np.isinf(values).any() or np.nanmax(np.abs(values), initial=0.0) > LARGEST:
            raise FilmError(
                f"{self.path}: frame {n}: holds values beyond {LARGEST:g}, which is no concentration"
            )
        values = values if self.order[2] < self.order[1] else values.T
        x, y = (-1 if name in self.calibration.flipped else 1 for name in "xy")
        return values[::x, ::y]

    def facts(self) -> FileFacts:
        """Return what was read: times, place, axes, values and missing pixels of some frames, and what was assumed."""
        count, known, unit = self.shape[0], self.calibration, self.model.ppm_per_unit or 1.0
        looked = np.unique(np.linspace(0, count - 1, min(count, LOOKED_AT)).round().astype(int))
        low, high, missing, extreme = 0.0, 0.0, 0, {}
        for n in map(int, looked):
            stored = self._stored(n)
            frame = self._values(n, stored)
            low, high = (
                pick([each, unit * pick(frame, initial=0.0)])
                for pick, each in ((np.nanmin, low), (np.nanmax, high))
            )
            missing += int(np.isnan(frame).sum())
            for value, size in self._extremes(stored).items():
                extreme[value] = extreme.get(value, 0) + size
        (x, y), (width, height) = self.origin, self.size
        some = "" if len(looked) == count else f" in {len(looked)} of the frames"
        metres = "" if "m" not in known.assumed else " (assumed: m)"
        text = [
            f"{self.stored.form}, {count} frames, {when(self.begin + self.times)}"
            + (" (assumed: s)" if "s" in known.assumed else ""),
            f"{high:.4g} ppm at most{some}" + ("" if known.unit else f" (assumed: {unit:g} ppm per unit)"),
            f"{span('x', x, x + width)}{metres}",
            f"{span('y', y, y + height)}{metres} {'descending' if 'y' in known.flipped else 'ascending'}"
            + (" (assumed)" if "rows" in known.assumed else ""),
            "axes " + ", ".join(filter(None, self.axes.roles)) + ("" if self.axes.is_sure else " (assumed)"),
            f"{missing} pixels missing" if missing else "none missing",
        ]
        remarks = [*known.remarks, *self.axes.remarks]
        if low < 0:
            remarks.append(f"values down to {low:.4g} ppm, of {high:.4g} at most, count as 0")
        if missing:
            remarks.append(f"{missing} missing pixels{some} count as 0")
        for value, size in extreme.items():
            name = "largest" if value > 0 else "smallest"
            remarks.append(
                f"{size} pixels{some} are {value}, the {name} value of {self.array.dtype}; they count as values"
            )
        return FileFacts(", ".join(text), tuple(remarks))

    def _extremes(self, stored: np.ndarray) -> dict[int, int]:
        """Return how many stored pixels have the largest or smallest value of their integer type, if valid."""
        if stored.dtype.kind not in "iu":
            return {}
        limits = np.iinfo(stored.dtype)
        at = {value: stored == value for value in (limits.max, limits.min) if value}
        valid = unpacked(stored, self.stored.attributes)
        found = {value: int((mask & ~is_missing(valid)).sum()) for value, mask in at.items()}
        return {value: size for value, size in found.items() if size}


def means(values: np.ndarray, edges: np.ndarray, axis: int) -> np.ndarray:
    """Return means along an axis over intervals between `edges` [axis steps]; values outside count as zero."""
    values = np.moveaxis(values, axis, 0)
    total = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])
    at = np.clip(edges, 0, len(values))
    whole = np.minimum(at.astype(int), len(values) - 1)
    upto = total[whole] + (at - whole)[:, None] * values[whole]
    mean = np.diff(upto, axis=0) / np.diff(edges)[:, None]
    return np.moveaxis(np.maximum(mean, 0.0), 0, axis)  # rounding
