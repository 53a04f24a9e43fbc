"""Changes of the data of a scenario at paths of keys such as ``robots[0].count``, for overrides and studies."""

import re
from collections.abc import Mapping, Sequence
from math import isfinite
from pathlib import PurePath
from typing import Any

import numpy as np
from pydantic import BaseModel

from taichi_plume.guard.terminal import LONGEST_VALUE, visible
from taichi_plume.guard.yaml_text import DEEPEST, LONGEST_NUMBER, LineError, text_fault

LONGEST_GOT = 48  # characters of a value in a message
PLAIN = "a text, a finite number, true, false, null, a list, or a mapping whose keys are texts"
Steps = Sequence[int | str]
"""Keys on the path to a value, and indices of items."""
Data = dict[str, Any]
"""Keys and values as YAML has them: texts, numbers, lists and mappings."""


def steps_of(path: str) -> list[str]:
    """Return the keys along a path as texts; ``robots.0.count`` and ``robots[0].count`` both give three."""
    return re.sub(r"\[(\d+)\]", r".\1", str(path).strip()).split(".")


def path_of(steps: Sequence[int | str]) -> str:
    """Return the path of successive keys: ``wind.openings[0].speed`` for ["wind", "openings", 0, "speed"]."""
    text = ""
    for step in steps:
        if isinstance(step, int) or step.isdecimal():
            text += f"[{step}]"
        else:
            text += f".{step}" if text else step
    return text


def shown(value: object) -> str:
    """Return a value as a short text for error messages: its repr, cut to 48 characters, or "nothing" for None."""
    try:
        text = "nothing" if value is None else repr(value)
    except Exception:  # thousands of digits have no text; the __repr__ of a class may raise anything
        text = f"a value of type {type(value).__name__}"
    return text if len(text) <= LONGEST_GOT else text[: LONGEST_GOT - 3] + "..."


class ValueLineError(LineError):
    """Error: a value cannot be written to YAML and read back. steps: keys on the path to it; what: the reason."""

    def __init__(self, steps: Steps, what: str):
        super().__init__(f"{path_of(steps)}: {what}" if steps else what)
        self.steps, self.what = steps, what


def yaml_value(value: object, steps: Steps = (), exact: bool = False, above: int = 0) -> Any:
    """Return a Python value in the types of YAML, as it is read again from a file to which it was written.

    Tuples, ranges and arrays become lists, numbers of NumPy become Python's, file paths become texts. With `exact` none
    of these is converted, and all numbers have to be finite. The parameters of users' code are always exact.
    steps: keys on the path to the value; above: number of levels above these keys. Raises ValueLineError.
    """
    if above + len(steps) >= DEEPEST:
        raise ValueLineError(steps[:5], f"is nested deeper than {DEEPEST} levels")
    if not exact:
        value = _converted(value)
    if type(value) is dict:
        for key in value:
            if type(key) is not str:
                raise ValueLineError(steps, f"the key {shown(key)} must be a text")
            if fault := text_fault(key):
                raise ValueLineError(steps, f"the key {shown(key)} cannot be written: {fault}")
        return {key: _below(value, key, (*steps, key), exact, above) for key in value}
    if type(value) is list:
        return [yaml_value(part, (*steps, n), exact, above) for n, part in enumerate(value)]
    if type(value) is int and abs(value) >= 10**LONGEST_NUMBER:
        raise ValueLineError(
            steps, f"a whole number of more than {LONGEST_NUMBER:,} digits; use a smaller one"
        )
    if type(value) is str and (fault := text_fault(value)):
        raise ValueLineError(steps, f"got {shown(value)}: {fault}")
    if value is None or type(value) in (bool, int, str):
        return value
    if not exact and isinstance(value, float | BaseModel):  # checked with its section
        return value
    if type(value) is float and isfinite(value):
        return value
    kind = "" if type(value) is float else f" of type {type(value).__name__}"
    raise ValueLineError(steps, f"got {shown(value)}{kind}: must be {PLAIN}")


def _converted(value: object) -> object:
    """Return a value of a subclass, a tuple, range, array or file path as the type of YAML that stands for it."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Mapping):
        return dict(value)
    if isinstance(value, PurePath):
        return str(value)
    if value is None or isinstance(value, bool):
        return value
    for kind in (str, int, float):
        if isinstance(value, kind):
            return value if type(value) is kind else getattr(kind, f"__{kind.__name__}__")(value)
    return list(value) if isinstance(value, Sequence) and not isinstance(value, bytes | bytearray) else value


def _below(value: Data, key: str, steps: Steps, exact: bool, above: int) -> Any:
    """Return the value at a key of a mapping as `yaml_value` does; exact if it is a parameter of a user's algorithm.

    The values of a study's axis are exact if the axis varies such a parameter.
    """
    part = value[key]
    if exact or _is_parameter(steps) or (key == "parameters" and value.get("kind") == "own"):
        return yaml_value(part, steps, True, above)
    paths = [value.get("key"), *(value.get("keys") or ())] if key == "values" else []
    if any(isinstance(path, str) and _is_parameter([path]) for path in paths):
        part = part.tolist() if isinstance(part, np.ndarray) else part
        if isinstance(part, list | tuple):
            return [yaml_value(item, (*steps, n), True, above) for n, item in enumerate(part)]
    return yaml_value(part, steps, False, above)


def _is_parameter(steps: Steps) -> bool:
    """Return whether a path of keys leads to the parameters of a user's algorithm or law, or below."""
    return "parameters" in str(steps) and "parameters" in steps_of(path_of(steps))


def changed(data: Mapping[str, Any], changes: Mapping[str, object]) -> Data:
    """Return a copy of `data` with new values at the paths of `changes`. Unchanged sections are shared, not copied.

    Raises LineError if a path does not fit the data.
    """
    new: Data = dict(data)
    ours: dict[int, object] = {id(new): new}  # copies, which may be changed; kept alive, so that ids stay
    for path, value in changes.items():
        _put(new, steps_of(path), value, ours)
    return new


def _put(data: Data, parts: Sequence[str], value: object, ours: dict[int, object]) -> None:
    """Set the value at a path of keys in `data`. Sections on the way are copied unless their id is in `ours`."""
    if not all(parts):
        raise LineError("must be the path of a key, such as robots.0.count")
    if len(parts) > DEEPEST:
        raise LineError(f"has {len(parts)} levels; at most {DEEPEST} are allowed")
    place: Any = data
    for n, part in enumerate(parts):
        key: Any = part
        above = path_of(parts[:n]) or "the scenario"
        if isinstance(place, list):
            key = _index(place, part, above)
        elif not isinstance(place, dict):
            raise LineError(f"{above} is {shown(place)}: it has no key '{part}'")
        elif part.isdecimal() and part not in place:
            raise LineError(f"{above} is no list: it has no item {part}")
        if n == len(parts) - 1:
            place[key] = value
            return
        below = place[key] if isinstance(place, list) else place.get(key)
        if below is None and isinstance(place, dict):
            if parts[n + 1].isdecimal():
                raise LineError(_no_list(parts[: n + 1], key in place))
            below = {}  # a section left to its defaults
        if isinstance(below, dict | list) and id(below) not in ours:
            below = below.copy()
            ours[id(below)] = below
        place[key] = below
        place = below


def _no_list(parts: Sequence[str], empty: bool) -> str:
    """Return an error message about an item of a missing list; empty: whether the list's key exists without a value."""
    from taichi_plume.scenario.keys import misspelt  # all sections: slow, only for errors

    path, state = path_of(parts), "is empty" if empty else "is not in the file"
    return misspelt(parts) or f"{path} {state}: give all of it, such as {path}=[...]"


def _index(items: list, part: str, above: str) -> int:
    """Return a text as the index of an item of a list. Raises LineError if the text is no valid index."""
    if not part.isdecimal():
        last = f"from 0 to {len(items) - 1}" if len(items) > 1 else "0"
        raise LineError(f"{above} is a list: '{part}' must be the index of an item, {last}")
    if len(part) > len(str(len(items))) or int(part) >= len(items):  # thousands of digits are no int
        has = f"{len(items)} item{'s' * (len(items) != 1)}"
        raise LineError(f"{above} has {has}, the first is 0: there is no {visible(part, LONGEST_VALUE)}")
    return int(part)
