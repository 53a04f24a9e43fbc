"""Parameters of robots that kernels read at run time, so that new values need no compilation."""

from collections.abc import Callable, Iterable, Mapping

import numpy as np

from taichi_plume.agents.groups import GroupRange
from taichi_plume.agents.members import Members, OfGroup
from taichi_plume.engine import ti
from taichi_plume.engine.fields import Field
from taichi_plume.grid.transfer import uploader

Numbers = Mapping[str, float | tuple[float, ...] | np.ndarray]
"""Kernel parameters of a group by name: a scalar or a tuple shared by all robots, or an array over the robots."""


class Parameters:
    """Parameters of each robot in kernels: after ``p = Parameters(members, numbers)`` kernels read ``p.threshold[n]``.

    numbers: function that returns the parameters of a group, computed in f64 and rounded once to f32; integers and
    flags become i32. The k-th entry of a tuple is ``p.arms[n, k]``; shorter tuples are padded by zeros. An array has a
    value per robot; all other parameters are stored once per group. streams: names of random streams; the key of each
    stream is a parameter named by the keyword. `begin` uploads the current values of all groups in a single launch.
    """

    def __init__(self, members: Members, numbers: Callable[[GroupRange], Numbers], **streams: str):
        self._members, self._numbers, self._streams = members, numbers, streams
        groups = [numbers(group) for group in members.groups]
        self._widths = {name: _width(group[name] for group in groups) for name in groups[0]}
        self._differ = {
            name for name in groups[0] if any(isinstance(group[name], np.ndarray) for group in groups)
        }
        fields = []
        for name, width in self._widths.items():
            is_real = np.issubdtype(np.asarray(groups[0][name]).dtype, np.floating)
            rows = members.size if name in self._differ else len(groups)
            fields.append(
                ti.field(ti.f32 if is_real else ti.i32, (rows,) if width is None else (rows, width))
            )
        fields += [ti.field(ti.u32, len(groups)) for _ in streams]
        for name, field in zip((*self._widths, *streams), fields, strict=True):
            setattr(self, name, field if name in self._differ else OfGroup(field, members.row))
        self._upload = uploader(*fields)

    def __getattr__(self, name: str) -> Field:
        raise AttributeError(name)

    def largest(self, name: str) -> float:
        """Return the largest value of the parameter `name` over all groups, for shapes that depend on it."""
        return max(float(np.max(self._numbers(group)[name])) for group in self._members.groups)

    def begin(self) -> None:
        """Upload the current parameters of all groups."""
        groups = [(group, self._numbers(group)) for group in self._members.groups]
        tables = []
        for name, width in self._widths.items():
            parts = [
                _rows(numbers[name], group.size if name in self._differ else 1, width)
                for group, numbers in groups
            ]
            tables.append(np.concatenate(parts))
        self._upload(*tables, *map(self._members.streams, self._streams.values()))


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
