"""What of a scenario a reset cannot change: all that fields, tables and kernels have been built from."""

from collections.abc import Iterator
from typing import Any

from taichi_plume.scenario.vocabulary import Compiled, Free, Model, marked

LONGEST_VALUE = 48  # characters shown of a value
Path = tuple[str, ...]
"""Its parts as they are written, such as (".wind", ".openings", "[0]")."""
Kept = tuple[str, Any]
"""What of a value has to stay, and the value itself."""


def differences(old: Model, new: Model) -> list[str]:
    """What of `new` a simulation that was assembled from `old` cannot take: a line each, by its path.

    Floats may differ unless they are marked COMPILED, and whatever is marked FREE; all else has to be equal: kinds,
    names, whole numbers, what is given and what is left out, and lengths of lists.
    """
    others = dict(_kept(new, ()))
    lines: list[str] = []
    told: Path | None = None
    for path, (stays, value) in _kept(old, ()):
        if told is not None and path[: len(told)] == told:
            continue  # below a section or list that is another one
        its, other = others[path]
        if its != stays:
            lines.append(_line("".join(path).lstrip("."), value, other))
            told = path
    return lines


def structure(scenario: Model) -> str:
    """A text that two scenarios have in common if there are no `differences` between them, and only then."""
    return repr(sorted((path, stays) for path, (stays, _) in _kept(scenario, ())))


def _kept(value: Any, path: Path, compiled: bool = False) -> Iterator[tuple[Path, Kept]]:
    """All that has to stay, by path: a section or list before what is in it."""
    if isinstance(value, Model):
        model = type(value)
        yield path, (f"{model.__module__}.{model.__qualname__}", value)
        for key in model.model_fields:
            if not marked(model, key, Free):
                fixed = compiled or marked(model, key, Compiled)
                yield from _kept(vars(value)[key], (*path, f".{key}"), fixed)
    elif isinstance(value, list | tuple):
        yield path, (f"list of {len(value)}", value)
        for n, one in enumerate(value):
            yield from _kept(one, (*path, f"[{n}]"), compiled)
    elif isinstance(value, dict):
        yield path, (f"mapping of {sorted(map(repr, value))}", value)
        for key, one in value.items():
            yield from _kept(one, (*path, f".{key}"), compiled)
    elif isinstance(value, float):
        yield path, (f"float {value + 0.0!r}" if compiled else "float", value)  # -0.0 is 0.0
    else:
        yield path, (f"{type(value).__name__} {value!r}", value)


def _line(path: str, old: Any, new: Any) -> str:
    if isinstance(old, Model) and isinstance(new, Model):
        path = f"{path}.kind" if path else "kind"
        return f"{path}: was {_kind(old)}, is {_kind(new)}"
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
