"""Calibration of a movie: times of its frames, place of its pixels and unit of its values, by the file and the keys."""

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from taichi_plume.files.conventions import (
    SINCE,
    ConventionError,
    factor_of,
    in_si,
    split_unit,
    stated_unit,
    text_of,
    times_of,
    unit_of,
)
from taichi_plume.files.stored_arrays import StoredArray
from taichi_plume.guard.terminal import visible
from taichi_plume.quantities import split
from taichi_plume.scenario.playback import MovieGas

LENGTHS = (
    *("spatial", "length", "space", "pixel", "grid", "distance", "coord", "physical", "position"),
    *("xy", "x", "y", "dx", "dy"),
)
"""Words in names of attributes with a unit of lengths."""
GASES = ("concentration", "gas", "plume", "odor", "odour", "intensity")  # with a unit of values
RATES = ("fps", "frame_rate", "framerate", "frames_per_second")
PIXEL = "pixel_to_grid"
REGULAR = 0.01  # pixels or frames: tolerance of equal spacing
NUMBERS = {"pixel", "pixels", "px", "1", "-", "index", "cell", "cells", "count", "dimensionless"}
"""Units of numbers of pixels."""
RELATIVE = re.compile(r"\s*(\w+)\s+(?:since|after|from)\s+[^\d\s].*")  # seconds since start
SHARE = re.compile(r"(mole?|molar|volume|volumetric)[ _-]*(fraction|mixing[ _-]ratio|share)", re.IGNORECASE)


class Line(NamedTuple):
    """Centres of pixels along an axis: step [m], negative if they descend; centre of the lowest pixel [m].

    slack: rounding error of the step [m]. Without lengths, centre is NaN and the step only has a sign, or is 0.
    """

    step: float = 0.0
    centre: float = math.nan
    slack: float = 0.0


class Calibration:
    """Times of a movie's frames since `begin` [s], pixel edge [m], origin (x, y) [m] and factor of its values.

    flipped: axes whose rows or columns descend. unit: of the values, "" if none is known. factor: from stored values to
    the unit of the key ppm_per_unit. assumed: "m", "s" and "rows", as far as these are assumed. Raises ConventionError.
    """

    def __init__(self, stored: StoredArray, order: Sequence[int], model: MovieGas):
        """order: time, y and x as axes of the array."""
        self.stored, self.model = stored, model
        self.remarks: list[str] = []
        self.assumed: set[str] = set()
        self.known = {**stored.of_file, **stored.attributes}
        self.length_unit = self._length_unit()
        lines = {name: self._line(name, n) for name, n in zip("yx", order[1:], strict=True)}
        self.flipped = self._flipped(lines)
        self.pixel = self._pixel(lines)
        self.origin = self._origin(lines)
        self.begin, self.times = self._times(order[0])
        self.unit, self.factor = self._gas()

    # ------------------------------------------------------------ place

    def _length_unit(self) -> str:
        """Return the unit of lengths without a unit of their own, as the file states it; else ""."""
        stated = stated_unit(self.known, LENGTHS)
        if stated and stated.lower() not in NUMBERS:
            return stated
        whole = unit_of(self.stored.of_file)
        return whole if whole.lower() not in NUMBERS and factor_of(whole, "m") else ""

    def _line(self, name: str, n: int) -> Line:
        """Return the line of the coordinates along axis n. Raises ConventionError if they are not equally spaced."""
        along = self.stored.along(n)
        values, count = along.values, self.stored.shape[n]
        if count < 2 or not len(values):
            return Line()
        steps = np.diff(values)
        is_unit_step = not along.unit and bool((np.abs(steps) == 1).all())
        has_pixel = PIXEL in self.known or (self.model.pixel is not None and not self.length_unit)
        is_number = along.unit.lower() in NUMBERS or (is_unit_step and has_pixel)
        unit = "" if is_number else along.unit or self.length_unit
        values, resolution = (
            self._metres(part, unit, f"axis {self.stored.axes[n]}")
            for part in (values, np.float64(along.resolution))
        )
        steps, step = np.diff(values), float(values[-1] - values[0]) / (count - 1)
        tolerance = REGULAR * abs(step) + 2 * resolution
        if not np.isfinite(steps).all() or step == 0 or (np.abs(steps - step) > tolerance).any():
            raise ConventionError(f"its {name} is not equally spaced, as pixels are; resample the file")
        if is_number:
            if (first := min(values[0], values[-1])) not in (0, 0.5, 1):
                self.remarks.append(f"its {name} numbers pixels from {first:g} on; only the direction counts")
            return Line(math.copysign(1.0, step))
        if resolution > REGULAR * abs(step):
            self.remarks.append(f"its {name} is rounded to {resolution:.2g} m by its type")
        if not unit:
            self.assumed.add("m")
        centre = float(values.mean()) - abs(step) * (count - 1) / 2
        return Line(step, centre, float(resolution) / (count - 1))

    def _flipped(self, lines: Mapping[str, Line]) -> set[str]:
        """Return the axes that descend, by the coordinates, else by the key rows."""
        flipped = {name for name, line in lines.items() if line.step < 0}
        is_given, is_down = "rows" in self.model.model_fields_set, self.model.rows == "down"
        if not lines["y"].step:
            self.assumed |= set() if is_given else {"rows"}
            return flipped | ({"y"} if is_down else set())
        if is_given and is_down != ("y" in flipped):
            self.remarks.append(
                f"rows: {self.model.rows}, but y of the file states the order; the file counts"
            )
        return flipped

    def _pixel(self, lines: Mapping[str, Line]) -> float:
        """Return the edge of a pixel [m]. Raises ConventionError if pixels are no squares, or no edge is known."""
        given, stated = self.model.pixel, None
        long = sorted(
            (line for line in lines.values() if not math.isnan(line.centre)), key=lambda at: at.slack
        )
        if long:
            stated, other = abs(long[0].step), abs(long[-1].step)
            if abs(stated - other) > REGULAR * max(stated, other) + long[-1].slack:
                raise ConventionError(
                    f"its pixels are {max(stated, other):g} by {min(stated, other):g} m; resample to squares"
                )
        elif given is None or PIXEL in self.known:
            value, unit = self._number(PIXEL, "pixel")
            if not (unit or self.length_unit):
                self.assumed.add("m")
            stated = float(self._metres(np.float64(value), unit or self.length_unit, PIXEL))
        if given is not None and stated is not None and abs(given - stated) > REGULAR * stated:
            self.remarks.append(f"pixel: {given:g} m, but the file states {stated:g} m; the key counts")
        value = stated if given is None else given
        assert value is not None
        return value

    def _origin(self, lines: Mapping[str, Line]) -> tuple[float, float]:
        """Return the lower left corner (x, y) [m]: by the key, the coordinates, or the attribute `origin` (y, x)."""
        stated = self.known.get("origin")
        try:
            corner = [0.0, 0.0] if stated is None else [float(value) for value in np.ravel(stated)]
            if len(corner) != 2 or not all(abs(value) <= 1e7 for value in corner):
                raise ValueError
        except (TypeError, ValueError):
            text = visible(str(stated), 60)
            raise ConventionError(f"its attribute 'origin' is {text}, not y and x; give origin") from None
        y, x = (float(self._metres(np.float64(value), self.length_unit, "origin")) for value in corner)
        y, x = (
            low if math.isnan(lines[name].centre) else round(lines[name].centre - self.pixel / 2, 9)
            for name, low in (("y", y), ("x", x))
        )
        return self.model.origin or (x, y)

    def _metres(self, values: Any, unit: str, what: str) -> Any:
        try:
            return in_si(values, unit, "m")
        except ConventionError as error:
            raise ConventionError(f"its {what}: {error}") from None

    # ------------------------------------------------------------ time

    def _times(self, n: int) -> tuple[float, np.ndarray]:
        """Return the time of the first frame [s], a Unix time if it has a date, and all times since then [s]."""
        count, rate = self.stored.shape[n], self.model.frame_rate
        name = next((each for each in self.known if each.lower() in RATES), None)
        begin, stated = 0.0, self._stated_times(n, rate is not None or name is not None)
        if stated is not None:
            begin, stated = float(stated[0]), stated - stated[0]
        elif count > 1 and (rate is None or name is not None):
            value, unit = self._number(name or RATES[0], "frame_rate")
            stated = np.arange(count) / (value * (factor_of(unit, "Hz") or 1.0))
        if rate is None:
            return begin, np.zeros(1) if stated is None else stated
        times = np.arange(count) / rate
        if stated is not None and np.abs(times - stated).max() > REGULAR / rate:
            self.remarks.append(
                f"frame_rate: {rate:g} frames per second, but the file has its frames "
                f"{np.diff(stated).mean():.4g} s apart; the key counts"
            )
        return begin, times

    def _stated_times(self, n: int, has_rate: bool) -> np.ndarray | None:
        """Return the times of the coordinate [s], None without one. Raises ConventionError if a rate is needed."""
        try:
            along = self.stored.along(n)
            values, unit = along.values, along.unit
            if not len(values) or (has_rate and not unit and (np.diff(values) == 1).all()):
                return None
            calendar = text_of(along.attributes.get("calendar", "")).lower()
            match = RELATIVE.fullmatch(unit)
            if not match and calendar not in ("", "standard", "gregorian", "proleptic_gregorian"):
                match = SINCE.fullmatch(unit)
                if match:
                    self.remarks.append(
                        f"its times have the calendar '{visible(calendar, 20)}'; their date is lost"
                    )
            times = times_of(values, match[1] if match else unit)
            if not np.isfinite(times).all() or (np.diff(times) <= 0).any():
                raise ConventionError(f"are not {len(values)} ascending numbers")
        except ConventionError as error:
            fault = f"its times{'' if str(error).startswith('are not') else ':'} {error}"
            if not has_rate:
                raise ConventionError(f"{fault}; give frame_rate") from None
            self.remarks.append(f"{fault}; frame_rate counts")
            return None
        if not unit:
            self.assumed.add("s")
        return times

    # ------------------------------------------------------------ values

    def _gas(self) -> tuple[str, float]:
        """Return the unit of the values, "" if none is known, and the factor to the unit of the key ppm_per_unit."""
        about, given = self.stored.attributes, self.model.ppm_per_unit
        unit = unit_of(about) or stated_unit(self.stored.of_file, GASES)
        if not unit and (named := split_unit(self.stored.name.rpartition("/")[2])[1]) and self._ppm(named):
            unit = named
        names = [text_of(about.get(name, "")) for name in ("standard_name", "long_name")]
        is_share = any(SHARE.search(name) for name in (names if unit else names[:1]))
        stated = 1e6 if is_share and unit in ("1", "") else self._ppm(unit)
        counted = f"{given:g} ppm per unit counts" if given else "1 ppm per unit is assumed"
        if stated is None:
            if unit:
                self.remarks.append(f"its unit '{visible(unit, 40)}' is no concentration; {counted}")
            return "", 1.0
        if given and abs(given - stated) > 1e-6 * stated:
            self.remarks.append(
                f"ppm_per_unit: {given:g}, but the file states '{visible(unit, 40)}', which is {stated:.4g} ppm; "
                "the file counts"
            )
        return unit or "1", stated / (given or 1.0)

    def _ppm(self, unit: str) -> float | None:
        """Return a unit of concentration in ppm, by the gas's molar mass for kg/m3 and the like; None if it is none."""
        if SHARE.fullmatch(unit):
            return 1e6
        share = factor_of(unit, "ppm")
        density = factor_of(unit, "kg/m^3")
        return share or (density and density * self.model.vapour.ppm_per_density)

    # ------------------------------------------------------------ attributes

    def _number(self, name: str, key: str) -> tuple[float, str]:
        """Return attribute `name` as a positive float and its unit, "" without one; several values must be equal.

        key: scenario key, for errors.
        """
        if name not in self.known:
            raise ConventionError(f"has no attribute '{name}'; give {key}")
        found, unit = self.known[name], ""
        if with_unit := split(text_of(found)):
            found, unit = with_unit
        try:
            values = np.ravel(found).astype(float)
            good = len(values) > 0 and (values == values[0]).all() and 1e-6 <= values[0] <= 1e6
        except (TypeError, ValueError):
            good = False
        if not good:
            raise ConventionError(
                f"its attribute '{name}' is {visible(str(self.known[name]), 60)}, not a positive number; "
                f"give {key}"
            )
        return float(values[0]), unit
