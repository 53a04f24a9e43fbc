"""Physical quantities: numbers in SI units or texts such as ``"20 cm"``; parsing, limits and printing with units."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from math import ceil, floor, log10, sqrt
from typing import Annotated

from pydantic import AfterValidator, BeforeValidator, Field
from pydantic_core import PydanticCustomError

Number = float | str
"""Number in SI units, or a text with a unit such as "40 cm"."""

_NUMBER_AND_UNIT = re.compile(
    r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([A-Za-zµμ%°][\w/*^ µμ%°().·⋅-]{0,40})\s*"
)
_EXPONENT = re.compile(r"([A-Za-zµμ])(-?\d)(?!\d)")  # of UDUNITS: m s-1, m3
_PRODUCT = re.compile(r"[·⋅]|(?<=[A-Za-zµμ\d])\.(?=[A-Za-zµμ])")
_WORD = re.compile(r"[A-Za-zµμ%°]+")
LONGEST_UNIT = 40  # characters
FILE_UNITS = {  # pint's names of units that files write otherwise
    "ppmv": "ppm", "ppm_v": "ppm", "1e-6": "ppm", "ppbv": "ppb", "1e-9": "ppb", "pptv": "ppt", "vol%": "percent",
    "vol %": "percent", "vol.%": "percent", "% vol": "percent", "%vol": "percent", "v/v": "mol/mol", "sec": "s",
    "secs": "s", "mps": "m/s", "kmph": "km/h", "kph": "km/h", "mph": "mi/h", "fpm": "ft/min", "hrs": "h", "msec": "ms",
    "usec": "us", "unix": "s", "epoch": "s", "epoch s": "s", "unix s": "s", "posix": "s", "kn": "knot",
    "kt": "knot", "kts": "knot",     "litre": "L", "liter": "L", "l": "L", "ml": "mL",
}  # fmt: skip
_UNIT_WORD = re.compile(
    "[nuµμmcdk]?m|in|inch(es)?|ft|foot|feet|yd|mi|miles?|(milli|centi|kilo)?met(er|re)s?|[nuµμm]?s|(milli|micro)?seconds?|"
    "min|minutes?|hr?|hours?|d|days?|pp[mbt]|percent|%|[nuµμmk]?g|grams?|m?[lL]|[nuµμm]?mol|knots?|K|kelvin|degC|°C|Pa"
)
"""Units that files of this field state. pint knows more words, such as counts, px and dB, that are no such unit."""
_SHARE = re.compile("pp[mbt]|percent|%|[nuµμm]?mol|c?m|m?[lL]")
"""Units of the share of a gas in the volume of the air; a mass per mass is none."""
# pint computes powers: m**9**9**9 never ends
_TOWER = re.compile(r"(\^|\*\*)[^A-Za-zµμ]*(\^|\*\*)|\d\d")
# Units in nearly every scenario. The values equal those of pint, whose import takes 0.2 s.
USUAL = {
    ("cm", "m"): 1e-2,
    ("mm", "m"): 1e-3,
    ("cm/s", "m/s"): 1e-2,
    ("mm/s", "m/s"): 1e-3,
    ("mg/s", "kg/s"): 1e-6,
    ("g/s", "kg/s"): 1e-3,
    ("min", "s"): 60.0,
    ("ms", "s"): 1e-3,
}


@dataclass(frozen=True)
class Quantity:
    """Annotation of a numeric type: its unit, smallest and largest value; or_zero: 0 is allowed besides."""

    unit: str
    least: float
    most: float
    or_zero: bool = False


@cache
def _registry():
    import pint  # only for scenarios that write other units

    registry = pint.UnitRegistry(autoconvert_offset_to_baseunit=True)
    registry.define("ppb = 1e-9")
    registry.define("ppt = 1e-12")  # parts per trillion, as in gas analysis
    return registry


def fault(message: str, context: dict[str, object] | None = None) -> PydanticCustomError:
    """Return a pydantic validation error with this message; `context` fills the braces in the message."""
    return PydanticCustomError("fault", message, context)  # type: ignore[arg-type]


def parse(value: object, unit: str) -> float:
    """Return `value` as a float in `unit`: numbers pass, ``"1e-5"`` and ``"10 mg/s"`` are converted.

    Raises PydanticCustomError if the text is no quantity or its unit is of another kind.
    """
    no_quantity = PydanticCustomError(
        "quantity", "must be a number or a text with a unit of {unit}", {"unit": unit}
    )
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        raise no_quantity
    try:
        return float(value)  # PyYAML reads 1e-5 as a text
    except OverflowError:
        raise PydanticCustomError("quantity", "must be a finite number") from None
    except ValueError:
        pass
    match = _NUMBER_AND_UNIT.fullmatch(str(value))
    if not match or _TOWER.search(match[2]):
        raise no_quantity
    factor = 1.0 if match[2] == unit else USUAL.get((match[2], unit))
    if factor is not None:
        return as_written(float(match[1]) * factor)
    try:
        ureg = _registry()
        return as_written(
            float(ureg.Quantity(float(match[1]), ureg.parse_units(_powers(match[2]))).to(unit).magnitude)
        )
    except Exception:  # pint raises a dozen kinds of errors, tokenize others: all mean the same to the user
        raise PydanticCustomError(
            "quantity", "must have a unit that converts to {unit}", {"unit": unit}
        ) from None


def split(text: str) -> tuple[float, str] | None:
    """Return the number and the unit of a text such as "20 cm"; None if the text is no number with a unit."""
    match = _NUMBER_AND_UNIT.fullmatch(text)
    return (float(match[1]), match[2].strip()) if match and not _TOWER.search(match[2]) else None


@cache
def conversion(written: str, unit: str) -> tuple[float, float]:
    """Return (factor, offset) of a unit, as files write it: value in `unit` = factor * value + offset.

    Known are pint's units, also with the exponents of UDUNITS ("m s-1", "kg m-3"). Raises ValueError if `written` is no
    unit or of another kind.
    """
    text = _file_unit(written.strip())
    if text == unit:
        return 1.0, 0.0
    words = _WORD.findall(text)
    try:
        known = _SHARE if unit == "ppm" else _UNIT_WORD
        if (
            not words
            or not all(map(known.fullmatch, words))
            or len(text) > LONGEST_UNIT
            or _TOWER.search(text)
        ):
            raise ValueError
        first, second = (_registry().Quantity(value, text).to(unit).magnitude for value in (1.0, 2.0))
    except Exception:  # pint raises a dozen kinds of errors
        raise ValueError(f"'{written}' is no unit that converts to {unit}") from None
    factor = as_written(float(second) - float(first))
    offset = as_written(float(first) - factor)
    return factor, offset if abs(offset) > 1e-9 * abs(factor) else 0.0


def _file_unit(written: str) -> str:
    """Return a unit of a file in pint's words: known spellings, capitals ("MM", "PPM") and exponents of UDUNITS."""
    plain = " ".join(written.replace("·", " ").replace("⋅", " ").replace(" per ", "/").split())
    text = FILE_UNITS.get(plain.lower(), plain)
    if not all(map(_UNIT_WORD.fullmatch, _WORD.findall(text))):
        text = FILE_UNITS.get(plain.lower(), plain.lower().replace("ppmv", "ppm"))
    return _powers(text)


def _powers(text: str) -> str:
    """Return a unit with the products and powers of UDUNITS, such as "mg.s-1", in pint's form."""
    return _EXPONENT.sub(r"\1^\2", _PRODUCT.sub(" ", text))


def as_written(value: float) -> float:
    """Return a converted number without rounding error beyond 15 digits: 20 mg/s becomes exactly 2e-05 kg/s."""
    return float(f"{value:.15g}")


def quantity(
    unit: str,
    least: float,
    most: float,
    likely: str = "",
    or_zero: bool = False,
    reader: Callable[[object, str], float] = parse,
) -> tuple[object, ...]:
    """Return the annotations of a float key that takes a number in `unit` [SI] or a text such as "20 cm".

    Outside of `least` to `most` is an error that asks if the unit `likely` was meant. or_zero: 0 is allowed. reader:
    function that returns a value in `unit`.
    """

    def plausible(value: float) -> float:
        if not (least <= value <= most or (or_zero and value == 0.0)):
            meant = likely and least <= parse(f"{value!r} {likely}", unit) <= most
            hint = f"did you mean '{value:g} {likely}'? " if meant else ""
            bound = "at most" if value > most else "0, or at least" if or_zero else "at least"
            raise fault(f"got {value:g} {unit}; {hint}{bound} {most if value > most else least:g} {unit}")
        return value

    plain = Annotated[float, Field(ge=0.0 if or_zero else least, le=most)]  # for editors, which know no units
    return (
        Field(allow_inf_nan=False),
        AfterValidator(plausible),
        BeforeValidator(lambda value: reader(value, unit), json_schema_input_type=plain | str),
        Quantity(unit, least, most, or_zero),
    )


def number(least: float, most: float, unit: str = "") -> tuple[object, ...]:
    """Return the annotations of a float key that takes only a plain number between two limits; unit: its unit."""
    return Field(ge=least, le=most, allow_inf_nan=False), Quantity(unit, least, most)


def round_up(value: float) -> float:
    """Return `value` rounded up to two significant digits."""
    unit = 10.0 ** (floor(log10(value)) - 1)
    return ceil(value / unit - 1e-9) * unit


def ill_sized(key: str, cell: float, size: Sequence[float], most: int) -> str | None:
    """Return an error if square cells of this edge [m] are more than `most` or wider than a floor of this size [m].

    key: path of the edge.
    """
    area = size[0] * size[1]
    if area / cell > most * cell:
        return f"{key}: {cell:g} m makes more than {most} map cells; use {round_up(sqrt(area / most)):g} m or more"
    if cell > min(size[:2]):
        return f"{key}: {cell:g} m is wider than the floor, {min(size[:2]):g} m; use less"
    return None


# Units for messages by the SI unit of a key, each with its size in that unit; ascending.
SCALES: dict[str, dict[str, float]] = {
    "m": {"um": 1e-6, "mm": 1e-3, "cm": 1e-2, "m": 1.0, "km": 1e3},
    "s": {"us": 1e-6, "ms": 1e-3, "s": 1.0, "min": 60.0, "h": 3600.0},
    "m/s": {"um/s": 1e-6, "mm/s": 1e-3, "cm/s": 1e-2, "m/s": 1.0, "km/h": 1 / 3.6},
    "m/s^2": {"mm/s^2": 1e-3, "m/s^2": 1.0},
    "m^2/s": {"mm^2/s": 1e-6, "cm^2/s": 1e-4, "m^2/s": 1.0},
    "m^3/s": {"mL/s": 1e-6, "L/s": 1e-3, "m^3/h": 1 / 3600.0, "m^3/s": 1.0},
    "kg/s": {"ug/s": 1e-9, "mg/s": 1e-6, "g/s": 1e-3, "kg/s": 1.0, "g/h": 1e-3 / 3600.0},
    "kg": {"ug": 1e-9, "mg": 1e-6, "g": 1e-3, "kg": 1.0},
    "kg/mol": {"g/mol": 1e-3, "kg/mol": 1.0},
    "kg/m^3": {"mg/m^3": 1e-6, "g/m^3": 1e-3, "kg/m^3": 1.0},
    "Pa": {"mPa": 1e-3, "Pa": 1.0, "hPa": 1e2, "kPa": 1e3},
    "K": {"K": 1.0, "degC": 1.0},
    "W": {"mW": 1e-3, "W": 1.0, "kW": 1e3},
    "J/kg": {"J/kg": 1.0, "kJ/kg": 1e3, "MJ/kg": 1e6},
    "1/s": {"mHz": 1e-3, "Hz": 1.0, "kHz": 1e3},
    "ohm": {"ohm": 1.0, "kohm": 1e3, "Mohm": 1e6},
    "ppm": {"ppb": 1e-3, "ppm": 1.0, "%": 1e4},
}
_READ_ONLY = {"km/h", "m^3/h", "g/h", "degC", "km", "hPa", "cm^2/s", "%"}  # in messages, but never printed


def short(value: float) -> str:
    """Return a number as the shortest text with up to 15 digits, such as 2e-5 for 1.9999999999999998e-05."""
    text = f"{value:.15g}"
    return (
        repr(float(text)).removesuffix(".0")
        if "e" not in text
        else text.replace("e-0", "e-").replace("e+", "e")
    )


def with_unit(value: float, unit: str) -> str:
    """Return a number in `unit` as text with a handy unit, such as "20 mg/s" for 2e-5 kg/s; without unit, the number.

    The text reads back as the same value to 15 digits.
    """
    name = {"1/s": "Hz"}.get(unit, unit)
    if not name[:1].isalpha():  # such as 1/K, which no text can name
        return short(value)
    text = f"{short(value)} {name}"
    if value == 0 or 0.1 <= abs(value) < 1e4:
        return text
    scales = [(name, size) for name, size in SCALES.get(unit, {}).items() if name not in _READ_ONLY]
    texts = [
        f"{short(value / size)} {name}" for name, size in scales if abs(value) >= 0.1 * size * (1 - 1e-9)
    ]
    return min([*texts[-1:], text], key=len)


def units_like(unit: str) -> str:
    """Return the units that a key in `unit` accepts, as a list in words for messages."""
    volumes = ["sccm", "L/min", "mol/h"] if unit == "kg/s" else []  # see gas_amounts
    return ", ".join([*SCALES.get(unit, [unit]), *volumes])
