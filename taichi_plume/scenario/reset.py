"""Differences between two scenarios that a reset of a simulation, or a change during a run, cannot apply.

Fields and kernels depend on what a reset cannot change. What acts at the start alone cannot change during a run.
"""

from collections.abc import Iterator
from functools import cache

from taichi_plume.scenario.vocabulary import AT_START, COMPILED, FREE, Model, marked

LONGEST_VALUE = 48  # characters shown of a value
Path = tuple[str, ...]
"""Parts of a path as they are written, such as (".wind", ".openings", "[0]")."""
Fixed = tuple[str, object]
"""Part of a value that must not change, as text, and the value itself."""


def differences(old: Model, new: Model) -> list[str]:
    """Return a line for each difference of `new` that a simulation assembled from `old` cannot take by a reset.

    Floats may differ unless they are marked COMPILED, and so may all keys marked FREE. All else has to be equal: kinds,
    names, whole numbers, lengths of lists, and which keys are given.
    """
    others = dict(_fixed(new))
    lines: list[str] = []
    last: Path | None = None
    for path, (fixed, value) in _fixed(old):
        if last is not None and path[: len(last)] == last:
            continue  # below a section or list that differs
        other_fixed, other = others[path]
        if other_fixed != fixed:
            lines.append(_line("".join(path).lstrip("."), value, other))
            last = path
    return lines


def differences_at_start(old: object, new: object, path: str = "", at_start: bool = False) -> Iterator[str]:
    """Yield a line for each differing key that acts at the start of a run alone, or lies in such a section.

    Differences of the structure are left out, see `differences`. path: of the two sections; at_start: whether they are
    part of such a key.
    """
    if isinstance(old, Model) and type(old) is type(new):
        for key in type(old).model_fields:
            pair = vars(old)[key], vars(new)[key]
            yield from differences_at_start(
                *pair, f"{path}.{key}", at_start or marked(type(old), key, AT_START)
            )
    elif isinstance(old, tuple) and isinstance(new, tuple) and len(old) == len(new):
        for n, pair in enumerate(zip(old, new, strict=True)):
            yield from differences_at_start(*pair, f"{path}[{n}]", at_start)
    elif at_start and old != new:
        yield _line(path.lstrip("."), old, new)


def structure(scenario: Model) -> str:
    """Return a text that is equal for two scenarios if and only if a reset can change one into the other."""
    return repr(sorted((path, fixed) for path, (fixed, _) in _fixed(scenario)))


@cache
def _keys(model: type[Model]) -> tuple[str, list[tuple[str, str, bool]]]:
    """Return the name of a section's class, and each key that is not FREE with its path and whether it is COMPILED."""
    keys = [key for key in model.model_fields if not marked(model, key, FREE)]
    return f"{model.__module__}.{model.__qualname__}", [
        (key, f".{key}", marked(model, key, COMPILED)) for key in keys
    ]


def _fixed(value: object) -> list[tuple[Path, Fixed]]:
    """Return (path, (text of what a reset cannot change, value)) of each part, a section or list before its content."""
    found: list[tuple[Path, Fixed]] = []
    _add(found, value, (), False)
    return found


def _add(found: list[tuple[Path, Fixed]], value: object, path: Path, compiled: bool) -> None:
    """Add a value at `path` and all below to those found; compiled: whether floats there must not change."""
    if isinstance(value, float):
        text = f"float {value + 0.0!r}" if compiled else "float"  # -0.0 is 0.0
        found.append((path, (text, value)))
    elif isinstance(value, Model):
        name, keys = _keys(type(value))
        found.append((path, (name, value)))
        for key, step, fixed in keys:
            _add(found, vars(value)[key], (*path, step), compiled or fixed)
    elif isinstance(value, list | tuple):
        found.append((path, (f"list of {len(value)}", value)))
        for n, item in enumerate(value):
            _add(found, item, (*path, f"[{n}]"), compiled)
    elif isinstance(value, dict):
        found.append((path, (f"mapping of {sorted(map(repr, value))}", value)))
        for key, item in value.items():
            _add(found, item, (*path, f".{key}"), compiled)
    else:
        found.append((path, (f"{type(value).__name__} {value!r}", value)))


def _line(path: str, old: object, new: object) -> str:
    """Return a message about the key at `path`, whose old and new value differ."""
    if isinstance(old, Model) and isinstance(new, Model):
        path = f"{path}.kind" if path else "kind"
        return f"{path}: was {_kind(old)}, is {_kind(new)}"
    return f"{path}: was {_shown(old)}, is {_shown(new)}"


def _kind(model: Model) -> str:
    """Return the value of the key `kind` of a section, or the name of its class."""
    return vars(model).get("kind", type(model).__name__)


def _shown(value: object) -> str:
    """Return a value in a few words for messages: for a list its length, for a section its kind."""
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
