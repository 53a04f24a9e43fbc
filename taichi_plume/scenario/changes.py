"""Changes of the data of a scenario at paths of keys such as ``robots[0].count``, for overrides and studies."""

import re
from collections.abc import Mapping, Sequence
from pathlib import PurePath
from typing import Any

import numpy as np

from taichi_plume.guard.terminal import LONGEST_VALUE, visible
from taichi_plume.guard.yaml_text import DEEPEST, LineError

LONGEST_GOT = 48  # characters of a value in a message
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
    text = "nothing" if value is None else repr(value)
    return text if len(text) <= LONGEST_GOT else text[: LONGEST_GOT - 3] + "..."


def yaml_value(value: object, depth: int = 0) -> Any:
    """Return a Python value in the types of YAML: tuples and arrays become lists, file paths become texts.

    Raises LineError if the value is nested too deeply.
    """
    if depth > DEEPEST:
        raise LineError(f"is nested deeper than {DEEPEST} levels")
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {key: yaml_value(part, depth + 1) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [yaml_value(part, depth + 1) for part in value]
    return str(value) if isinstance(value, PurePath) else value


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
