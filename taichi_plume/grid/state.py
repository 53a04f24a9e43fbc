"""State of a run: each component names the attributes that change, for checkpoints and changes during a run.

A component has ``STATE``, the names of its attributes that change in a run: Taichi fields, tuples of fields, components
with a STATE of their own (also in lists, tuples and dicts), random generators, objects that save themselves with
``state()`` and ``restore(state)``, and plain Python data (numbers, arrays, lists, dicts). An attribute that each step
computes again before it is read is not part of the state.
"""

from collections.abc import Iterable, Iterator
from copy import deepcopy
from typing import Any, NamedTuple

import numpy as np

from taichi_plume.engine.fields import ArrayField, Field


def saves_itself(value: object) -> bool:
    """Return whether an object has the methods `state` and `restore`."""
    return callable(getattr(value, "state", None)) and callable(getattr(value, "restore", None))


class _Piece(NamedTuple):
    """Indivisible piece of a state: attribute `key` of its owner, or item `key` of a list, tuple or dict."""

    path: str
    owner: Any
    key: Any
    is_attribute: bool

    @property
    def value(self) -> Any:
        """Present value of this piece of the state."""
        return getattr(self.owner, self.key) if self.is_attribute else self.owner[self.key]

    def replace(self, value: object) -> None:
        """Set this piece of the state to `value`, in the object or collection that holds it."""
        if self.is_attribute:
            setattr(self.owner, self.key, value)
        else:
            self.owner[self.key] = value


def _pieces(component: Any, path: str) -> Iterator[_Piece]:
    for name in component.STATE:
        yield from _split(_Piece(f"{path}.{name}", component, name, True))


def _split(piece: _Piece) -> Iterator[_Piece]:
    value = piece.value
    if hasattr(value, "STATE"):
        yield from _pieces(value, piece.path)
    elif isinstance(value, list | tuple | dict) and _has_parts(value):
        for n in value if isinstance(value, dict) else range(len(value)):
            yield from _split(_Piece(f"{piece.path}[{n}]", value, n, False))
    else:
        yield piece


def _has_parts(values: Iterable[object]) -> bool:
    """Return whether a list, tuple or dict holds fields or components with a STATE, at any depth."""
    return any(
        isinstance(value, ArrayField)
        or hasattr(value, "STATE")
        or (isinstance(value, list | tuple | dict) and _has_parts(value))
        for value in (values.values() if isinstance(values, dict) else values)
    )


class State:
    """Complete state of a component and its parts."""

    def __init__(self, part: object):
        self.part = part
        fields: dict[int, tuple[str, Field]] = {}
        for piece in self._walk():
            if isinstance(piece.value, ArrayField):
                fields.setdefault(id(piece.value), (piece.path, piece.value))
        self.paths = [path for path, _ in fields.values()]
        self._fields = [field for _, field in fields.values()]

    def save(self) -> dict[str, Any]:
        """Return a copy of the state on the host, as a dict from the path of each piece to its value."""
        saved: dict[str, Any] = {
            path: field.to_numpy() for path, field in zip(self.paths, self._fields, strict=True)
        }
        for piece in self._on_host():
            value = piece.value
            if isinstance(value, np.random.Generator):
                value = value.bit_generator.state
            elif saves_itself(value):
                value = value.state()
            saved[piece.path] = deepcopy(value)
        return saved

    def unlike(self, saved: dict[str, Any]) -> str | None:
        """Return the reason why a saved state cannot be restored; None if it can."""
        other = sorted({*self.paths, *(piece.path for piece in self._on_host())} ^ saved.keys())
        if other:
            return f"{other[0]} exists in only one of the two states"
        for path, field in zip(self.paths, self._fields, strict=True):
            if tuple(np.shape(saved[path])[: len(field.shape)]) != tuple(field.shape):
                return f"{path} has the shape {np.shape(saved[path])}, not {tuple(field.shape)}"
        return None

    def restore(self, saved: dict[str, Any]) -> None:
        """Set the component to a state saved by `save`."""
        for path, field in zip(self.paths, self._fields, strict=True):
            field.from_numpy(saved[path])
        for piece in self._on_host():
            value, before = piece.value, deepcopy(saved[piece.path])
            if isinstance(value, np.random.Generator):
                value.bit_generator.state = before
            elif saves_itself(value):
                value.restore(before)
            else:
                piece.replace(before)

    def _walk(self) -> list[_Piece]:
        return list(_pieces(self.part, type(self.part).__name__))

    def _on_host(self) -> list[_Piece]:
        return [piece for piece in self._walk() if not isinstance(piece.value, ArrayField)]
