"""Units, axes, times and missing values that files of others state: one mechanism for all readers.

Names of columns and attributes of arrays decide; keys of the scenario decide where a file says nothing. What a reader
took from a file, and what it assumed, is a `FileFacts`, which ``--check`` prints.

CF conventions 1.11: `units`, `scale_factor`, `add_offset`, `_FillValue`, `missing_value`, `axis`, `standard_name`.
"""

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from taichi_plume.quantities import conversion

SENTINELS = (
    -999.0, -9999.0, -99999.0, -999999.0, -9999999.0, -999.25, -999.9, -9999.9,
    1e20, 9.969209968386869e36,
)  # fmt: skip
"""Values that loggers and models write for "no value"; the last are those of NetCDF and of climate models."""
UNIT_AT_END = re.compile(r"^(.*?)\s*[\[({]\s*([^\[\](){}]*?)\s*[\])}]$")  # X (mm), u [ m s^-1 ]
BEFORE_UNIT = re.compile(r"_|\s+in\s+|\s*[,/]\s*|\s+")  # x_mm, x in mm, x/mm, "x, mm", x mm
SPELLINGS = {
    unit.replace("/", "_"): unit for unit in ("m/s", "cm/s", "mm/s", "km/h", "mg/m3", "ug/m3")
}  # u_m_s
SUFFIXES = {"m", "cm", "mm", "km", "in", "ft", "s", "sec", "ms", "us", "min", "h", "ppm", "ppb", "ppt", "m/s", "cm/s",
            "mm/s", "km/h", "mps"}  # fmt: skip
"""Units behind a name without brackets."""
DAY = 86400.0  # s
ZONE = re.compile(r"\s*(UTC|GMT)$")
AMBIGUOUS = re.compile(
    r"[A-Za-z]{2,}\s*[+-]\d"
)  # GMT+1: one hour before or behind Greenwich, by who writes it
EARLIEST_DATE = 1e8  # s: larger times are those since 1970
SINCE = re.compile(
    r"\s*(\w+)\s+(?:since|after|from|ref|@)\s+([+-]?\d{1,4})(-\d{1,2}-\d{1,2}.*)", re.IGNORECASE
)
ROLES = {
    role: tuple(names.split())
    for role, names in {
        "time": "time times t tt nt tau frame frames nframes step timestep time_step valid_time time_counter",
        "z": "z zz nz zc height altitude elevation lev level levels depth bottom_top",
        "y": "y yy ny yc row rows nrows northing lat latitude south_north crosswind spanwise projection_y_coordinate",
        "x": "x xx nx xc col cols column columns ncols easting lon longitude west_east downwind streamwise width "
        "projection_x_coordinate",
    }.items()
}
"""Names and standard names of axes."""
BESIDE_NAMES = re.compile(  # words beside the name of an axis: x_position, grid_latitude, "position in x"
    "(?:axis|axes|positions?|pos|coordinates?|coords?|dimensions?|dim|directions?|dir|index|idx|indices|number|numbers|"
    "values?|grid|pixels?|distance|projection|local|cartesian|system|cell|edges?|bounds|bnds|cent(?:er|re)s?|labels?|"
    "along|of|in|the)"
)
GLUED = re.compile(
    r"(?:pos|coord|dim|idx)?([xyzt])(?:pos|coords?|dim|idx|axis|edges?|cent(?:er|re)s?)?"
)  # xpos


class ConventionError(ValueError):
    """Error: a unit or an axis that a file states cannot be used; the message is one line, without the path."""


@dataclass(frozen=True)
class FileFacts:
    """Facts on a file that was read. text: a line such as "0.35 m/s at most, x 0 to 4 m"; remarks: what was assumed."""

    text: str
    remarks: tuple[str, ...] = ()


def span(what: str, low: float, high: float, unit: str = "m") -> str:
    """Return a range as text, such as "x 0 to 4 m", to a micrometre and seven digits."""
    low, high = (round(float(end), 6) + 0.0 for end in (low, high))
    return f"{what} {low:.7g} to {high:.7g} {unit}"


def spans(low: ArrayLike, high: ArrayLike) -> str:
    """Return the box between two corners [m] as text, such as "x 0 to 4 m, y 0 to 2.5 m"."""
    return ", ".join(
        span(axis, *ends) for axis, *ends in zip("xyz", np.ravel(low), np.ravel(high), strict=False)
    )


def when(times: np.ndarray) -> str:
    """Return sorted times [s] as text: "10 s from 0 s on, 0.5 s apart", with a date if they are Unix times."""
    if not len(times):
        return "no times"
    start, last = float(times[0]), float(times[-1])
    is_date = start >= EARLIEST_DATE
    begin = f"{datetime.fromtimestamp(start, UTC):%Y-%m-%d %H:%M:%S} UTC" if is_date else f"{start:.6g} s"
    steps = np.diff(np.unique(times))
    if not len(steps):
        return f"at {begin}"
    low, high = float(steps.min()), float(steps.max())
    apart = f"{low:.4g} s" if high - low <= 1e-3 * high else f"{low:.4g} to {high:.4g} s"
    return f"{last - start:.6g} s from {begin} on, {apart} apart"


# ---------------------------------------------------------------- units


def split_unit(name: str, suffixes: Collection[str] = SUFFIXES) -> tuple[str, str]:
    """Return a column's name in lower case and its unit, "" without one: "X (mm)" -> ("x", "mm").

    suffixes: units that may stand behind a name without brackets.
    """
    plain = " ".join(name.strip("'\"\ufeff ").split())
    match = UNIT_AT_END.match(plain)
    if match and match[1]:
        return match[1].lower(), match[2]
    lower = plain.lower()
    for unit, spelling in SPELLINGS.items():
        if lower.endswith(f"_{unit}"):
            return lower.removesuffix(f"_{unit}"), spelling
    for match in BEFORE_UNIT.finditer(lower, 1):
        if lower[match.end() :] in suffixes:
            return lower[: match.start()], lower[match.end() :]
    return lower, ""


def in_si(values: np.ndarray, written: str, unit: str) -> np.ndarray:
    """Convert values from a unit as files write it to `unit`; "" is `unit` itself. Raises ConventionError."""
    if not written:
        return values
    try:
        factor, offset = conversion(written, unit)
    except ValueError as error:
        raise ConventionError(str(error)) from None
    return values if (factor, offset) == (1.0, 0.0) else factor * values + offset


def factor_of(written: str, unit: str) -> float | None:
    """Return a unit as a multiple of `unit`; None if it does not convert."""
    try:
        return conversion(written, unit)[0]
    except ValueError:
        return None


def times_of(values: np.ndarray, written: str) -> np.ndarray:
    """Return times [s]; written: unit such as "ms", or "hours since 2026-01-01", which gives Unix times.

    Raises ConventionError.
    """
    match = SINCE.fullmatch(written)
    if not match:
        return in_si(values, written, "s")
    import pandas

    try:
        if AMBIGUOUS.search(match[3]):
            raise ValueError
        start = pandas.Timestamp(f"{int(match[2]):04d}{match[3]}")
    except ValueError:
        raise ConventionError(f"'{written}' gives no date such as 2026-01-01 00:00:00") from None
    start = start if start.tzinfo else start.tz_localize("UTC")
    unit = match[1].lower() if len(match[1]) > 3 else match[1]  # Days
    return in_si(values, unit, "s") + start.timestamp()


def iso_times(texts: Sequence[str | None]) -> np.ndarray:
    """Return Unix times [s] of dates such as 2026-01-01T10:00:00.5, or seconds of times of day; NaN if a text is none.

    Dates without a zone are UTC. Times of day go on over midnight.
    """
    import pandas

    plain = pandas.Series(
        [ZONE.sub("", str(text or "").strip()).replace(",", ".") for text in texts], dtype="string"
    )
    if plain.str.fullmatch(r"\d{1,2}:\d\d:.*").all():
        of_day = pandas.to_timedelta(plain, errors="coerce").dt.total_seconds().to_numpy(float)
        return of_day + DAY * np.cumsum(np.diff(of_day, prepend=of_day[:1]) < -DAY / 2)
    dates = pandas.to_datetime(plain, utc=True, errors="coerce", format="ISO8601")
    since = dates - pandas.Timestamp(0, tz="UTC")
    return since.dt.total_seconds().to_numpy(float, na_value=np.nan)


# ---------------------------------------------------------------- missing and packed values


def is_missing(values: np.ndarray, others: Sequence[float] = ()) -> np.ndarray:
    """Return a mask of values that mean none: NaN, infinity, the SENTINELS, and these `others`."""
    return ~np.isfinite(values) | np.isin(values, [*SENTINELS, *others])


def unpacked(values: np.ndarray, attributes: Mapping[str, Any]) -> np.ndarray:
    """Return an array's values as floats, unpacked by its attributes as CF says; missing values are NaN.

    Numbers in attributes may be texts. Raises ConventionError if an attribute is no number.
    """
    raw = stored = np.asarray(values)
    sign = {"true": "iu", "false": "ui"}.get(text_of(attributes.get("_Unsigned", "")).lower(), "")
    if sign[:1] == raw.dtype.kind:
        stored = raw.view(raw.dtype.str.replace(sign[0], sign[1]))
    limits = _numbers(attributes, "valid_range", (-np.inf, np.inf))
    if len(limits) != 2:
        raise ConventionError(f"its valid_range has {len(limits)} values, not 2")
    low, high = (_numbers(attributes, f"valid_{end}", limits[n:])[0] for n, end in enumerate(("min", "max")))
    none = (stored < low) | (stored > high)
    for name in ("_FillValue", "missing_value"):
        known = _numbers(attributes, name, ())
        known = known.astype(raw.dtype) if raw.dtype.kind == "f" else known
        none |= np.isin(raw, known) | np.isin(stored, known)
    scale, offset = (
        _numbers(attributes, *each)[0] for each in (("scale_factor", [1.0]), ("add_offset", [0.0]))
    )
    return np.where(none, np.nan, scale * stored.astype(float) + offset)


def _numbers(attributes: Mapping[str, Any], name: str, usual: ArrayLike) -> np.ndarray:
    """Return the numbers (n,) of an attribute, which may be texts, or the usual ones. Raises ConventionError."""
    stated = attributes.get(name, ())
    try:
        return np.ravel(stated if np.size(stated) else usual).astype(float)
    except (TypeError, ValueError):
        raise ConventionError(f"its {name} is '{text_of(stated)[:40]}', which is no number") from None


def text_of(value: Any) -> str:
    """Return an attribute that is a text, bytes, a number or an array of one of these as a text; else ""."""
    flat = np.ravel(value)
    text = flat[0] if len(flat) == 1 else ""
    return (text.decode("utf-8", "replace") if isinstance(text, bytes) else str(text)).strip()


def unit_of(attributes: Mapping[str, Any]) -> str:
    """Return the unit in the attribute `units` or `unit`, in any case, of an array; "" without one."""
    stated = {name.lower(): text_of(value) for name, value in attributes.items()}
    return stated.get("units") or stated.get("unit", "")


def stated_unit(attributes: Mapping[str, Any], of: Sequence[str]) -> str:
    """Return the unit in an attribute whose name has "unit" and one of these words, such as spatial_unit; else "".

    Words of one or two letters stand alone in the name, such as x_unit.
    """
    for name, value in attributes.items():
        plain = name.lower()
        parts = re.split(r"[^a-z]+", plain)
        if "unit" in plain and any(word in (parts if len(word) < 3 else plain) for word in of):
            return text_of(value)
    return ""


# ---------------------------------------------------------------- axes


def role_of(name: str, attributes: Mapping[str, Any] | None = None) -> str | None:
    """Return "time", "z", "y" or "x" for an axis; None if unknown.

    CF's `axis` and `standard_name` decide, then the name without its unit, as in x_position or "x [mm]", then
    `long_name`. attributes: of the coordinate of this name.
    """
    known = attributes or {}
    letter = text_of(known.get("axis", "")).upper()
    if letter in ("T", "Z", "Y", "X"):
        return {"T": "time"}.get(letter, letter.lower())
    for text in (text_of(known.get("standard_name", "")), name, text_of(known.get("long_name", ""))):
        plain = text.lower().rpartition("/")[2]
        words = re.split(r"[\W_]+", split_unit(plain)[0])
        bare = "_".join(word for word in words if word and not BESIDE_NAMES.fullmatch(word))
        glued = GLUED.fullmatch(bare)
        for role, names in ROLES.items():
            if plain in names or bare in names or (glued and glued[1] in names):
                return role
    return None
