"""Spelling of numbers in a text: an edited length stays in the unit in which it was written, rounded to millimetres."""

from collections.abc import Iterator, Mapping
from typing import Any

from pydantic_core import PydanticCustomError

from taichi_plume.quantities import parse

ROUNDED = 1e-3  # m, degrees, s
_UNIT = "m"


def number(value: float) -> float | int:
    """Return a number rounded to millimetres (or thousandths), whole numbers as int."""
    rounded = round(float(value) / ROUNDED) * ROUNDED
    return int(rounded) if rounded == int(rounded) else float(f"{rounded:.12g}")


def spelled(old: object, new: float) -> Any:
    """Return a length [m] spelled as an old value was: in the old one's unit, if the old one is a text such as "4 m".

    Raises ValueError if `new` is no finite number.
    """
    if isinstance(old, str):
        try:
            unit = old.strip().lstrip("+-0123456789.eE").strip()
            factor = parse(f"1 {unit}", _UNIT)
            return f"{number(new) / factor:.10g} {unit}"
        except PydanticCustomError:
            pass
    return number(new)


def metres(value: object) -> float:
    """Return a coordinate of a text in metres. Raises ValueError if the value is none."""
    try:
        return parse(value, _UNIT)
    except PydanticCustomError as error:
        raise ValueError(str(error)) from None


def differences(path: str, old: object, new: object) -> Iterator[tuple[str, object]]:
    """Yield (path, value) of each number that differs between an old and a new value, spelled as the old one."""
    if isinstance(new, list | tuple) and isinstance(old, list) and len(old) == len(new):
        for n, (was, becomes) in enumerate(zip(old, new, strict=True)):
            yield from differences(f"{path}[{n}]", was, becomes)
    elif isinstance(new, float):
        try:
            if abs(metres(old) - new) < ROUNDED / 2:
                return
        except ValueError:
            pass
        yield path, spelled(old, new)
    elif new != old:
        yield path, plain(new)


def plain(value: Any) -> Any:
    """Return a value of a model in the types of YAML, with rounded numbers."""
    if isinstance(value, Mapping):
        return {key: plain(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [plain(part) for part in value]
    return number(value) if isinstance(value, float) else value
