"""Plume movies from other sources: gas concentrations over time, y and x, read frame by frame.

The array (see `array_files`) states what it can: names and coordinates of its axes, with their order and direction,
units, packing and missing values by the CF conventions, and plume-nav-sim's attributes fps, pixel_to_grid and origin
(y, x) of the array or its group, in metres or the unit of an attribute such as spatial_unit. Keys of the scenario say
the rest.
"""

import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from taichi_plume.files.array_files import open_array
from taichi_plume.files.conventions import (
    ConventionError,
    FileFacts,
    in_si,
    is_missing,
    role_of,
    span,
    stated_unit,
    times_of,
    unpacked,
    when,
)
from taichi_plume.files.film import FilmError
from taichi_plume.files.hdf5_arrays import require_declared_size
from taichi_plume.files.stored_arrays import ArrayFileError, StoredArray
from taichi_plume.files.zarr_groups import LARGEST_CHUNK, MOST_CHUNKS, errors_as
from taichi_plume.guard.terminal import visible
from taichi_plume.scenario.domain import Domain
from taichi_plume.scenario.playback import MovieGas
from taichi_plume.scenario.quantities import conversion

NAMES = ("concentration", "plume")  # default names of the variable, of plume-nav-sim and FlyGym
AXES, MATLAB_AXES = ("time", "y", "x"), ("y", "x", "time")
LENGTHS = ("spatial", "length", "space", "pixel", "grid", "distance")  # in names of attributes of a unit
RATES = ("fps", "frame_rate")
MOST_PIXELS = 100_000_000  # of a frame
MOST_FRAMES = 10_000_000
LARGEST = 1e12  # of a value: far beyond 1e6 ppm in any unit, and sums stay finite
REGULAR = 0.01  # pixels or frames: tolerance of equal spacing
GENERIC = re.compile(r"(phony_)?dim_?\d+", re.IGNORECASE)  # names of axes that say nothing
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
        self.remarks: list[str] = []
        with errors_as(FilmError, path, "cannot be read as a movie"):
            try:
                stored = open_array(path, model.variable, NAMES)
            except ArrayFileError as error:
                raise FilmError(str(error)) from None
            self.stored, self.array = stored, stored.values
            shape, kind = stored.shape, np.dtype(self.array.dtype)
        if len(shape) < 3 or kind.kind not in "fiub":
            raise FilmError(f"{path}: has the shape {shape} of {kind}; wanted numbers over (time, y, x)")
        try:
            usual = model.axes or (MATLAB_AXES if stored.form == "MATLAB" else AXES)
            self.roles, self.is_named = stored.roles(usual[::-1] if stored.form == "MATLAB" else usual)
        except ArrayFileError as error:
            raise FilmError(f"{path}: {error}") from None
        self.order = tuple(self.roles.index(role) for role in AXES)
        self._read_axes(stored, model)
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
        self.size = (self.shape[2] * self.pixel, self.shape[1] * self.pixel)
        self.factor = self._factor()
        self.edges = [
            (np.arange(n + 1) * domain.spacing - low) / self.pixel
            for n, low in zip(self.cells[:2], self.origin, strict=True)
        ]

    def _read_axes(self, stored: StoredArray, model: MovieGas) -> None:
        """Set times, pixel, origin and directions of axes by coordinates and attributes of the file and the keys."""
        known = {**stored.of_file, **stored.attributes}
        unit = stated_unit(known, LENGTHS)
        lengths = {name: self._coordinate(n, unit) for name, n in zip("yx", self.order[1:], strict=True)}
        steps = {name: self._step(name, values) for name, values in lengths.items() if len(values)}
        down = model.rows == "down"
        self.flipped = {"x": steps.get("x", 1.0) < 0, "y": steps["y"] < 0 if "y" in steps else down}
        edges = [abs(step) for step in steps.values()]
        if edges and max(edges) - min(edges) > REGULAR * max(edges):
            raise FilmError(
                f"{self.path}: its pixels are {max(edges):g} by {min(edges):g} m; resample to squares"
            )
        if not edges and (model.pixel is None or "pixel_to_grid" in known):
            pixel = self._number(known, "pixel_to_grid", "pixel")
            edges = [self._length(pixel, unit, "pixel_to_grid")]
        self.pixel = self._chosen("pixel", model.pixel, edges[0] if edges else None, "m")
        y, x = (self._length(value, unit, "origin") for value in self._corner(known.get("origin")))
        if len(steps) == 2:
            y, x = (float(values.min()) - self.pixel / 2 for values in lengths.values())
        self.origin = model.origin or (x, y)
        self.times = self._times(known, model)

    def _step(self, name: str, values: np.ndarray) -> float:
        """Return the step of equally spaced coordinates [m], negative if they descend. Raises FilmError."""
        steps = np.diff(values)
        mean = float(steps.mean())
        if not np.isfinite(steps).all() or mean == 0 or (np.abs(steps - mean) > REGULAR * abs(mean)).any():
            raise FilmError(
                f"{self.path}: its {name} is not equally spaced, as pixels are; resample the file"
            )
        return mean

    def _times(self, known: Mapping[str, Any], model: MovieGas) -> np.ndarray:
        """Return the times of the frames since the first [s], and set their date."""
        count, n = self.stored.shape[self.order[0]], self.order[0]
        self.begin, stated = 0.0, None
        values, about = self.stored.along(n)
        has_rate = model.frame_rate is not None or not {*RATES}.isdisjoint(known)
        is_number = has_rate and not about.get("units") and np.array_equal(values, np.arange(count))
        if len(values) and not is_number:
            try:
                times = times_of(values.astype(float), str(about.get("units", "")))
            except ConventionError as error:
                raise FilmError(f"{self.path}: its time: {error}; give frame_rate") from None
            if len(times) != count or not np.isfinite(times).all() or (np.diff(times) <= 0).any():
                raise FilmError(f"{self.path}: its times are not {count} ascending numbers")
            self.begin, stated = float(times[0]), times - times[0]
        if stated is None and count > 1 and (model.frame_rate is None or not {*RATES}.isdisjoint(known)):
            name = next((name for name in RATES if name in known), RATES[0])
            stated = np.arange(count) / self._number(known, name, "frame_rate")
        if model.frame_rate is None:
            return np.zeros(1) if stated is None else stated
        times = np.arange(count) / model.frame_rate
        if stated is not None and np.abs(times - stated).max() > REGULAR * times[1]:
            self.remarks.append(
                f"frame_rate: {model.frame_rate:g} frames per second, but the file has its frames "
                f"{np.diff(stated).mean():.4g} s apart; the key counts"
            )
        return times

    def _chosen(self, key: str, given: float | None, stated: float | None, unit: str) -> float:
        """Return the value of a key, or that which the file states; a remark says if they differ."""
        if given is not None and stated is not None and abs(given - stated) > REGULAR * stated:
            self.remarks.append(
                f"{key}: {given:g} {unit}, but the file states {stated:g} {unit}; the key counts"
            )
        value = stated if given is None else given
        assert value is not None
        return value

    def _coordinate(self, n: int, unit: str) -> np.ndarray:
        """Return the coordinates along axis n of the array [m]; empty if the file has none that is a length.

        unit: of lengths in the file without a unit of their own.
        """
        values, about = self.stored.along(n)
        if len(values) != self.stored.shape[n] or len(values) < 2:
            return np.empty(0)
        if not about.get("units") and np.array_equal(values, np.arange(len(values))) and self._has_pixel():
            return np.empty(0)  # numbers of pixels
        return self._length(
            values.astype(float), str(about.get("units", "")) or unit, f"axis {self.stored.axes[n]}"
        )

    def _has_pixel(self) -> bool:
        known = {**self.stored.of_file, **self.stored.attributes}
        return self.model.pixel is not None or "pixel_to_grid" in known

    def _length(self, value: Any, unit: str, what: str) -> Any:
        try:
            return in_si(value, unit, "m")
        except ConventionError as error:
            raise FilmError(f"{self.path}: its {what}: {error}") from None

    def _factor(self) -> float:
        """Return the factor from the file's values to the unit of the key ppm_per_unit, by the unit that it states."""
        unit = str(self.stored.attributes.get("units", "")).strip()
        per_unit = self.model.ppm_per_unit or 1.0
        name = str(self.stored.attributes.get("standard_name", ""))
        is_share = unit in ("1", "") and ("mole_fraction" in name or "volume_fraction" in name)
        self.unit = "1" if is_share else unit
        if not self.unit or (self.unit == "1" and not is_share):
            return 1.0
        try:
            stated = conversion(self.unit, "ppm")[0]
        except ValueError:
            try:
                stated = conversion(self.unit, "kg/m^3")[0] * self.model.vapour.ppm_per_density
            except ValueError:
                self.remarks.append(
                    f"its unit '{visible(unit, 40)}' is no concentration; ppm_per_unit counts"
                )
                self.unit = ""
                return 1.0
        if self.model.ppm_per_unit and abs(per_unit - stated) > 1e-6 * stated:
            self.remarks.append(
                f"ppm_per_unit: {per_unit:g}, but the file states '{visible(unit, 40)}', which is {stated:.4g} ppm; "
                "the file counts"
            )
        return stated / per_unit

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
        return np.maximum(np.nan_to_num(self._values(n)), 0.0)

    def _values(self, n: int) -> np.ndarray:
        """Return the pixels of frame n, axes (x, y), both ascending, as the file has them; NaN where missing."""
        time, y, x = self.order
        with errors_as(FilmError, self.path, f"frame {n} cannot be read"):
            require_declared_size(self.array, time, n)
            at: list[Any] = [slice(None) if role else 0 for role in self.roles]
            at[time] = n
            picture = np.asarray(self.array[tuple(at)])
            try:
                values = unpacked(picture, self.stored.attributes)
                values = np.where(is_missing(values) & ~np.isinf(values), np.nan, values) * self.factor
            except ConventionError as error:
                raise FilmError(f"{self.path}: {error}") from None
        if np.isinf(values).any() or np.nanmax(np.abs(values), initial=0.0) > LARGEST:
            raise FilmError(
                f"{self.path}: frame {n}: holds values beyond {LARGEST:g}, which is no concentration"
            )
        values = values if x < y else values.T
        return values[:: -1 if self.flipped["x"] else 1, :: -1 if self.flipped["y"] else 1]

    def facts(self) -> FileFacts:
        """Return what was read: times, place, axes, values and missing pixels of some frames, and what was assumed."""
        count = self.shape[0]
        looked = np.unique(np.linspace(0, count - 1, min(count, LOOKED_AT)).round().astype(int))
        frames = [self._values(int(n)) for n in looked]
        per_unit = self.model.ppm_per_unit or 1.0
        low, high = (
            per_unit * pick([pick(frame, initial=0.0) for frame in frames]) for pick in (np.nanmin, np.nanmax)
        )
        missing = sum(int(np.isnan(frame).sum()) for frame in frames)
        (x, y), (width, height) = self.origin, self.size
        order = ", ".join(role for role in self.roles if role)
        axes = f"axes {order}" + ("" if self.is_named else " (assumed)")
        direction = "descending" if self.flipped["y"] else "ascending"
        if not len(self.stored.along(self.order[1])[0]) and "rows" not in self.model.model_fields_set:
            direction += " (assumed)"
        some = "" if len(looked) == count else f" in {len(looked)} of the frames"
        text = [
            f"{self.stored.form}, {count} frames, {when(self.begin + self.times)}",
            f"{high:.4g} ppm at most{some}" + ("" if self.unit else f" (assumed: {per_unit:g} ppm per unit)"),
            span("x", x, x + width),
            f"{span('y', y, y + height)} {direction}",
            axes,
            f"{missing} pixels missing" if missing else "none missing",
        ]
        remarks = list(self.remarks)
        for name, role in zip(self.stored.axes, self.roles, strict=True):
            if name and role_of(name) is None and not GENERIC.fullmatch(name) and not self.is_named:
                remarks.append(f"its axis '{visible(name, 40)}' counts as {role}")
        if low < 0:
            remarks.append(f"values down to {low:.4g} ppm, of {high:.4g} at most, count as 0")
        if missing:
            remarks.append(f"{missing} missing pixels{some} count as 0")
        return FileFacts(", ".join(text), tuple(remarks))

    def _number(self, known: Mapping[str, Any], name: str, key: str) -> float:
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
        """Return y and x of the attribute `origin`, 0 without one. Raises FilmError."""
        try:
            y, x = (0.0, 0.0) if origin is None else (float(value) for value in np.ravel(origin))
        except (TypeError, ValueError):
            x = y = np.nan
        if not (abs(x) <= 1e7 and abs(y) <= 1e7):
            raise FilmError(
                f"{self.path}: its attribute 'origin' is {visible(origin, 60)}, not y and x; give origin"
            )
        return y, x


def means(values: np.ndarray, edges: np.ndarray, axis: int) -> np.ndarray:
    """Return means along an axis over intervals between `edges` [axis steps]; values outside count as zero."""
    values = np.moveaxis(values, axis, 0)
    total = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])
    at = np.clip(edges, 0, len(values))
    whole = np.minimum(at.astype(int), len(values) - 1)
    upto = total[whole] + (at - whole)[:, None] * values[whole]
    mean = np.diff(upto, axis=0) / np.diff(edges)[:, None]
    return np.moveaxis(np.maximum(mean, 0.0), 0, axis)  # rounding
