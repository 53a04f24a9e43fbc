"""What of a scenario a reset cannot change: all that fields, tables and kernels have been built from."""

from collections.abc import Iterator
from typing import Any

from taichi_plume.scenario.vocabulary import Compiled, Free, Model, marked

LONGEST_VALUE = 48  # characters shown of a value


def differences(old: Model, new: Model) -> list[str]:
    """What of `new` a simulation that was assembled from `old` cannot take: a line each, by its path.

    Floats may differ unless they are marked COMPILED, and whatever is marked FREE; all else has to be equal: kinds,
    names, whole numbers, what is given and what is left out, and lengths of lists.
    """
    return list(_models(old, new, ""))


def _models(old: Model, new: Model, path: str, compiled: bool = False) -> Iterator[str]:
    if type(old) is not type(new):
        yield _line(f"{path}.kind" if path else "kind", _kind(old), _kind(new))
        return
    for key in type(old).model_fields:
        if not marked(type(old), key, Free):
            where = f"{path}.{key}" if path else key
            fixed = compiled or marked(type(old), key, Compiled)
            yield from _values(vars(old)[key], vars(new)[key], where, fixed)


def _values(old: Any, new: Any, path: str, compiled: bool) -> Iterator[str]:
    if isinstance(old, Model) and isinstance(new, Model):
        yield from _models(old, new, path, compiled)
    elif isinstance(old, list | tuple) and isinstance(new, list | tuple) and len(old) == len(new):
        for n, (one, other) in enumerate(zip(old, new, strict=True)):
            yield from _values(one, other, f"{path}[{n}]", compiled)
    elif isinstance(old, dict) and isinstance(new, dict) and old.keys() == new.keys():
        for key, one in old.items():
            yield from _values(one, new[key], f"{path}.{key}", compiled)
    elif type(old) is not type(new) or (old != new and (compiled or not isinstance(old, float))):
        yield _line(path, old, new)


def _line(path: str, old: Any, new: Any) -> str:
    return f"{path}: was {_shown(old)}, is {_shown(new)}"


def _kind(model: Model) -> str:
    return vars(model).get("kind", type(model).__name__)


def _shown(value: Any) -> str:
    """A value in a few words: of a list its length, of a section its kind."""
    if value is None:
        return "not given"
    if isinstance(value, Model):
        return f"given ({_kind(value)})"
    if isinstance(value, dict):
        return f"of {', '.join(map(str, value)) or 'nothing'}"
    if isinstance(value, list | tuple):
        return f"{len(value)} item{'s' * (len(value) != 1)}"
    text = f"{value:g}" if isinstance(value, float) else str(value)
    return text if len(text) <= LONGEST_VALUE else text[: LONGEST_VALUE - 3] + "..."
