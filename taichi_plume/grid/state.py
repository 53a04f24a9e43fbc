"""What of a run changes while it runs: each component says it once, and saving, restoring and resetting follow from it.

A component has ``STATE``, the names of its attributes that change in a run: Taichi fields, tuples of them, components
with a STATE of their own (also in lists, tuples and dicts), random generators, objects that save themselves with
``state()`` and ``restore(state)``, and plain Python data (numbers, arrays, lists, dicts). What is merely worked out
anew in each step before it is read is no state.

A component also has ``begin(...)``, which sets its numbers and its state at the begin of a run; it finds the fields of
its state zero, as new ones are. Its constructor ends with it. What `begin` launches and uploads has therefore been
compiled when the component stands.
"""

from collections.abc import Callable, Iterator
from copy import deepcopy
from typing import Any

import numpy as np
import taichi as ti

from taichi_plume.grid.memory import views
from taichi_plume.grid.transfer import alike, reader, uploader


def saves_itself(value: Any) -> bool:
    """Whether an object has what it takes to be saved and restored."""
    return callable(getattr(value, "state", None)) and callable(getattr(value, "restore", None))


def _is_field(value: Any) -> bool:
    return isinstance(value, ti.Field)


def _walk(part: Any, path: str) -> Iterator[tuple[str, Any, str]]:
    """Path, owner and attribute of each piece of state that is not itself made of others."""
    for name in part.STATE:
        value = getattr(part, name)
        yield from _pieces(value, f"{path}.{name}", part, name)


def _pieces(value: Any, path: str, owner: Any, key: Any) -> Iterator[tuple[str, Any, Any]]:
    if hasattr(value, "STATE"):
        yield from _walk(value, path)
    elif isinstance(value, list | tuple | dict) and _has_parts(value):
        items = value.items() if isinstance(value, dict) else enumerate(value)
        for n, one in items:
            yield from _pieces(one, f"{path}[{n}]", value, n)
    else:
        yield path, owner, key


def _has_parts(values: Any) -> bool:
    """Whether a list, tuple or dict holds fields or components."""
    each = values.values() if isinstance(values, dict) else values
    return any(
        _is_field(one) or hasattr(one, "STATE") or (isinstance(one, list | tuple | dict) and _has_parts(one))
        for one in each
    )


def _value(owner: Any, key: Any) -> Any:
    return getattr(owner, key) if isinstance(key, str) and not isinstance(owner, dict) else owner[key]


class State:
    """The state of a component and of all that it is made of.

    Its kernels are compiled when it is made, over all fields at once.
    """

    def __init__(self, part: Any):
        self.part = part
        pieces = list(_walk(part, type(part).__name__))
        fields = {}
        for path, owner, key in pieces:
            value = _value(owner, key)
            if _is_field(value):
                fields.setdefault(id(value), (path, value))
        self.paths = [path for path, _ in fields.values()]
        self._fields = [field for _, field in fields.values()]
        self._clear = _clearer(self._fields)
        self._read: Callable[[], list[np.ndarray]] | None = None
        self._put: Callable[..., None] | None = None

    def clear(self) -> None:
        """Set every field to zero, as new ones are."""
        self._clear()

    def save(self) -> dict[str, Any]:
        """All of it, by the path of each piece, on the host."""
        if self._read is None:
            self._read = reader(*self._fields)
        saved: dict[str, Any] = dict(zip(self.paths, self._read(), strict=True))
        for path, owner, key in self._walked():
            value = _value(owner, key)
            if isinstance(value, np.random.Generator):
                saved[path] = deepcopy(value.bit_generator.state)
            elif saves_itself(value):
                saved[path] = deepcopy(value.state())
            elif not _is_field(value):
                saved[path] = deepcopy(value)
        return saved

    def unlike(self, saved: dict[str, Any]) -> str | None:
        """Why what was saved cannot be restored; None where it can."""
        paths = [
            *self.paths,
            *(path for path, owner, key in self._walked() if not _is_field(_value(owner, key))),
        ]
        other = sorted(set(paths) ^ saved.keys())
        if other:
            return f"{other[0]} is but in one of the two"
        for path, field in zip(self.paths, self._fields, strict=True):
            if tuple(np.shape(saved[path])[: len(field.shape)]) != tuple(field.shape):
                return f"{path} has the shape {np.shape(saved[path])}, not {tuple(field.shape)}"
        return None

    def _walked(self) -> list[tuple[str, Any, Any]]:
        return list(_walk(self.part, type(self.part).__name__))

    def restore(self, saved: dict[str, Any]) -> None:
        """Go back to what was saved."""
        if self._put is None:
            self._put = uploader(*self._fields)
        self._put(*(saved[path] for path in self.paths))
        for path, owner, key in self._walked():
            value = _value(owner, key)
            if isinstance(value, np.random.Generator):
                value.bit_generator.state = deepcopy(saved[path])
            elif _is_field(value):
                continue
            elif saves_itself(value):
                value.restore(deepcopy(saved[path]))
            elif isinstance(owner, dict):
                owner[key] = deepcopy(saved[path])
            elif isinstance(owner, list):
                owner[int(key)] = deepcopy(saved[path])
            else:
                setattr(owner, key, deepcopy(saved[path]))


def _clearer(fields: list[Any]) -> Callable[[], None]:
    """A function that zeroes the fields: in place, or by a kernel, compiled at once, those of one shape in one loop."""
    if views(fields) is not None:

        def zero() -> None:
            for place in views(fields) or ():  # asked again: they go where Taichi is reset
                place[...] = 0

        return zero

    @ti.kernel
    def clear(all: ti.i32):
        for same in ti.static(alike(fields)):
            for I in ti.grouped(fields[same[0]]):
                for f in ti.static(same):
                    fields[f][I] = ti.select(all == 0, fields[f][I], ti.zero(fields[f][I]))

    clear(0)
    return lambda: clear(1)
