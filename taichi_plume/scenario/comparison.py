"""Comparison of scenarios: differences that cannot apply during a run, and scenarios that differ in numbers alone."""

from collections.abc import Iterator

from taichi_plume.scenario.vocabulary import AT_START, INPUT_FILE, SHAPE, Model, marked

STARTING = AT_START, SHAPE, INPUT_FILE
"""Marks of keys that cannot change during a run."""
LONGEST_VALUE = 48  # characters shown of a value


def differences_at_start(old: object, new: object, path: str = "", at_start: bool = False) -> Iterator[str]:
    """Yield a line for each difference that acts at the start of a run alone: marked keys, kinds, lengths of lists.

    path: of the two values; at_start: whether they are part of a marked key, see STARTING.
    """
    if isinstance(old, Model) and type(old) is type(new):
        for key in type(old).model_fields:
            pair = vars(old)[key], vars(new)[key]
            starts = at_start or any(marked(type(old), key, mark) for mark in STARTING)
            yield from differences_at_start(*pair, f"{path}.{key}", starts)
    elif isinstance(old, tuple) and isinstance(new, tuple) and len(old) == len(new):
        for n, pair in enumerate(zip(old, new, strict=True)):
            yield from differences_at_start(*pair, f"{path}[{n}]", at_start)
    elif old != new and (at_start or _differ_in_kind(old, new)):
        yield _line(path.lstrip("."), old, new)


def _differ_in_kind(old: object, new: object) -> bool:
    """Return whether two values are sections of different kinds, or lists of different lengths."""
    return all(isinstance(value, Model) for value in (old, new)) or (
        all(isinstance(value, tuple) for value in (old, new))
    )


def structure(value: object) -> object:
    """Return nested lists that are equal for two scenarios if and only if these differ in floats alone."""
    if isinstance(value, float):
        return "float"
    if isinstance(value, Model):
        name = f"{type(value).__module__}.{type(value).__qualname__}"
        return [name, *(structure(vars(value)[key]) for key in type(value).model_fields)]
    if isinstance(value, list | tuple):
        return [*map(structure, value)]
    if isinstance(value, dict):
        return [[repr(key), structure(item)] for key, item in value.items()]
    return f"{type(value).__name__} {value!r}"


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
