"""The numbers of robots that kernels read when they run: other values compile nothing."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import taichi as ti

from taichi_plume.agents.groups import GroupRange
from taichi_plume.agents.members import Members
from taichi_plume.grid.transfer import uploader

Numbers = Mapping[str, float | tuple[float, ...] | np.ndarray]
"""Of a group, by name: one for all of its robots, several for all (a tuple), or an array over them."""


class Parameters:
    """One field per number, an entry per robot: ``p = Parameters(members, numbers)``, ``p.threshold[n]``.

    numbers: gives those of a group, worked out in f64 and rounded once, to f32; whole ones and flags are i32. Of
    several the k-th is ``p.arms[n, k]``; groups that have fewer have zeros behind. streams: names of the random streams
    of each robot, their keys as u32 fields under the keywords. `begin` sets all to what the groups say now, in one
    launch.
    """

    def __init__(self, members: Members, numbers: Callable[[GroupRange], Numbers], **streams: str):
        self._members, self._numbers, self._streams = members, numbers, streams
        groups = [numbers(group) for group in members.groups]
        self._widths = {name: _width(group[name] for group in groups) for name in groups[0]}
        for name, width in self._widths.items():
            is_real = np.issubdtype(np.asarray(groups[0][name]).dtype, np.floating)
            shape = (members.size,) if width is None else (members.size, width)
            setattr(self, name, ti.field(ti.f32 if is_real else ti.i32, shape))
        for name in streams:
            setattr(self, name, ti.field(ti.u32, members.size))
        self._upload = uploader(*(getattr(self, name) for name in (*self._widths, *streams)))

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(name)

    def largest(self, name: str) -> float:
        """Of all groups, for what shapes depend on."""
        return max(float(np.max(self._numbers(group)[name])) for group in self._members.groups)

    def begin(self) -> None:
        """Set the numbers to those of the groups as they are now."""
        groups = [(group, self._numbers(group)) for group in self._members.groups]
        tables = []
        for name, width in self._widths.items():
            parts = [_rows(numbers[name], group.size, width) for group, numbers in groups]
            tables.append(np.concatenate(parts))
        self._upload(*tables, *map(self._members.streams, self._streams.values()))


def _width(values: Any) -> int | None:
    """Of several numbers, how many the group with the most has."""
    lengths = [len(value) if isinstance(value, tuple) else None for value in values]
    return None if lengths[0] is None else max(length or 0 for length in lengths)


def _rows(value: float | tuple[float, ...] | np.ndarray, size: int, width: int | None) -> np.ndarray:
    """Of each robot of a group, (size,) or (size, width)."""
    if width is None:
        return np.broadcast_to(np.asarray(value, float), (size,))
    row = np.zeros(width)
    row[: np.size(value)] = value
    return np.broadcast_to(row, (size, width))
