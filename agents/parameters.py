"""Parameters of robots that kernels read, by group or by robot."""

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

from taichi_plume.agents.groups import GroupRange
from taichi_plume.agents.members import Members, OfGroup
from taichi_plume.engine import ti
from taichi_plume.engine.fields import Field

Numbers = Mapping[str, float | tuple[float, ...] | np.ndarray]
"""Kernel parameters of a group by name: a scalar or a tuple shared by all robots, or an array over the robots."""


class Parameters:
    """Parameters of each robot in kernels: after ``p = Parameters(members, numbers)`` kernels read ``p.threshold[n]``.

    numbers: function that returns the parameters of a group, computed in f64 and rounded once to f32; integers and
    flags become i32. The k-th entry of a tuple is ``p.arms[n, k]``; shorter tuples are padded by zeros. An array has a
    value per robot; all other parameters are stored once per group. streams: names of random streams; the key of each
    stream is a parameter named by the keyword.
    """

    @ti.shared_memory()
    def __init__(self, members: Members, numbers: Callable[[GroupRange], Numbers], **streams: str):
        groups = [(group, numbers(group)) for group in members.groups]
        self._largest: dict[str, float] = {}
        for name, first in groups[0][1].items():
            values = [each[name] for _, each in groups]
            width, differ = _width(values), any(isinstance(value, np.ndarray) for value in values)
            rows = [
                _rows(value, group.size if differ else 1, width)
                for (group, _), value in zip(groups, values, strict=True)
            ]
            is_real = np.issubdtype(np.asarray(first).dtype, np.floating)
            self._put(name, ti.f32 if is_real else ti.i32, np.concatenate(rows), None if differ else members)
            self._largest[name] = max(float(np.max(value)) for value in values)
        for name, stream in streams.items():
            self._put(name, ti.u32, members.streams(stream), members)

    def _put(self, name: str, dtype: Any, table: np.ndarray, members: Members | None) -> None:
        """Store a table over the robots or, with `members`, over their groups as the parameter `name`."""
        field = ti.filled(table, dtype)
        setattr(self, name, field if members is None else OfGroup(field, members.row))

    def __getattr__(self, name: str) -> Field:
        raise AttributeError(name)

    def largest(self, name: str) -> float:
        """Return the largest value of the parameter `name` over all groups, for shapes that depend on it."""
        return self._largest[name]


def _width(values: Iterable[object]) -> int | None:
    """Return the length of the longest tuple among the groups' values of a parameter; None for scalars."""
    lengths = [len(value) if isinstance(value, tuple) else None for value in values]
    return None if lengths[0] is None else max(length or 0 for length in lengths)


def _rows(value: float | tuple[float, ...] | np.ndarray, size: int, width: int | None) -> np.ndarray:
    """Return a group's value of a parameter repeated for `size` rows: (size,), or (size, width) padded by zeros."""
    if width is None:
        return np.broadcast_to(np.asarray(value, float), (size,))
    row = np.zeros(width)
    row[: np.size(value)] = value
    return np.broadcast_to(row, (size, width))
