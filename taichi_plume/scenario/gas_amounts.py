"""Amounts of a gas as mass: volumes ("500 sccm", "2 L/min") and moles ("3 mmol/h") by the ideal gas law.

Standard volumes (sccm, slpm, NL/min) are at 0 °C and 1 atm, plain volumes at 25 °C and 1 atm, the state of every ppm in
the simulator. A mass flow controller that is calibrated at 20 °C or 25 °C must be given in L/min.
"""

import re
from collections.abc import Mapping
from typing import Any

from pydantic_core import PydanticCustomError

from taichi_plume.quantities import as_written, conversion, fault, parse, split
from taichi_plume.scenario.species import GAS_CONSTANT, PRESSURE, TEMPERATURE

STANDARD_TEMPERATURE = 273.15  # K
VOLUME = re.compile(
    r"(?P<mark>standard |std\.? ?|[sn])?(?P<volume>cc|cf|(?<=s)cm|[mcd]?m\^?3|ft\^?3|m?l)(?P<suffix>n)?"
    r"(?:(?P<per>(?P<p>p)?[smh])|/(?P<time>s|sec|min|hr?))?"
)
"""Volume, also per time, in lower case: sccm, slpm, scfh, scmm, nl/min, ln/min, std cm3/min; cc/min, lpm, cfm."""
LETTERS = {"cc": "cm^3", "cf": "ft^3", "cm": "m^3", "l": "L", "ml": "mL"}
TIMES = {"s": "s", "m": "min", "h": "h"}

MASS = re.compile(r"[nuµμmk]?g([/*^ .].*)?$")
"""Units of a mass, or a mass per time."""


def moles(value: object, per: str) -> float | None:
    """Return a text such as "500 sccm" or "3 mmol/h" in mol, or mol per time if `per` is "/s"; None for others."""
    parts = split(value) if isinstance(value, str) else None
    if parts is None:
        return None
    number, unit = parts
    if MASS.match(unit):  # pint is not needed
        return None
    temperature = TEMPERATURE
    if found := VOLUME.fullmatch(unit.lower()):
        mark, volume = found["mark"] or found["suffix"], found["volume"]
        if mark == "n" and unit[0] == "n" and not (found["per"] or found["suffix"]):
            return None  # normal or nano?
        if found["per"] and not (mark or found["p"] or volume in ("cc", "cf")):
            return None  # such as ls
        temperature = STANDARD_TEMPERATURE if mark else TEMPERATURE
        time = TIMES[found["per"][-1]] if found["per"] else found["time"]
        unit = LETTERS.get(volume, volume) + (f"/{time}" if time else "")
    for kind, size in ((f"m^3{per}", PRESSURE / (GAS_CONSTANT * temperature)), (f"mol{per}", 1.0)):
        try:
            return number * conversion(unit, kind)[0] * size
        except ValueError:
            continue
    return None


def mass(value: object, unit: str) -> float:
    """Return a mass, or mass per time, in `unit`, "kg" or "kg/s"; as `quantities.parse`. Raises PydanticCustomError.

    Volumes and moles need a species: a gas converts those of its sources beforehand, see `converted`.
    """
    try:
        return parse(value, unit)
    except PydanticCustomError:
        if moles(value, unit.removeprefix("kg")) is None:
            raise
    raise fault(
        f"got '{str(value).strip()}': volumes and moles need a gas whose species is known; or give {unit}"
    )


def converted(sources: object, molar_mass: float) -> object:
    """Return sources as in YAML, with volumes and moles of the keys `rate` and `mass` as kg/s and kg.

    molar_mass [kg/mol]: of their species. Other values stay as they are.
    """
    if not isinstance(sources, list | tuple):
        return sources
    return [_converted(source, molar_mass) if isinstance(source, Mapping) else source for source in sources]


def _converted(source: Mapping[Any, Any], molar_mass: float) -> dict[Any, Any]:
    result = dict(source)
    for key, per in (("rate", "/s"), ("mass", "")):
        amount = moles(source.get(key), per)
        if amount is not None:
            result[key] = as_written(amount * molar_mass)
    return result
