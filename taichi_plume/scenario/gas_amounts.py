"""Amounts of a gas as mass: volumes ("500 sccm", "2 L/min") and moles ("3 mmol/h") by the ideal gas law.

Standard volumes (sccm, slpm, NL/min) are at 0 °C and 1 atm, plain volumes at 25 °C and 1 atm, the state of every ppm in
the simulator. A mass flow controller that is calibrated at 20 °C or 25 °C must be given in L/min.
"""

import re
from collections.abc import Mapping
from typing import Any

from pydantic_core import PydanticCustomError

from taichi_plume.scenario.quantities import as_written, conversion, fault, parse, split
from taichi_plume.scenario.species import GAS_CONSTANT, PRESSURE, TEMPERATURE

STANDARD_TEMPERATURE = 273.15  # K
CONTROLLERS = {
    "sccm": "cm^3/min", "sccs": "cm^3/s", "scc/min": "cm^3/min", "scc/s": "cm^3/s", "slm": "L/min", "slpm": "L/min",
    "sl/min": "L/min", "sml/min": "mL/min", "sl/h": "L/h", "scc": "cm^3", "scm": "m^3", "scmh": "m^3/h",
    "sm3/h": "m^3/h", "sm^3/h": "m^3/h", "nlpm": "L/min", "ln/min": "L/min", "mln/min": "mL/min",
    "std cm3/min": "cm^3/min", "std l/min": "L/min",
}  # fmt: skip
"""Units of standard volumes per time in lower case, and pint's names of the volumes."""
PLAIN = {"lpm": "L/min", "ccm": "cm^3/min", "ccs": "cm^3/s", "cc/min": "cm^3/min", "cc": "cm^3"}
NORMAL = re.compile(r"N((?:m|c|d)?m\^?3|m?[lL])(/(?:s|min|h))?")
"""Standard volumes with a capital N: NL/min, NmL/min, Nm3/h."""
NANO = re.compile(r"n(?:[lL]|m\^?3|m[lL]).*")
"""The same with a small n, which might mean nano."""


def moles(value: object, per: str) -> float | None:
    """Return a text such as "500 sccm" or "3 mmol/h" in mol, or mol per time if `per` is "/s"; None for others."""
    parts = split(value) if isinstance(value, str) else None
    if parts is None:
        return None
    number, unit = parts
    normal, lower = NORMAL.fullmatch(unit), unit.lower()
    if NANO.fullmatch(unit) and lower not in CONTROLLERS:
        return None
    temperature = STANDARD_TEMPERATURE if normal or lower in CONTROLLERS else TEMPERATURE
    plain = normal[1] + (normal[2] or "") if normal else CONTROLLERS.get(lower, PLAIN.get(lower, unit))
    for kind, size in ((f"m^3{per}", PRESSURE / (GAS_CONSTANT * temperature)), (f"mol{per}", 1.0)):
        try:
            return number * conversion(plain, kind)[0] * size
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
