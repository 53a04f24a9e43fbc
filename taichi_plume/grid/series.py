"""Time series in a single array that grows by doubling, without a Python object per row."""

from collections.abc import Iterator
from typing import overload

import numpy as np

FIRST = 16  # rows of an empty series


class Series:
    """Time series: rows of `width` numbers with their times [s], read like a list of (time, numbers (width,))."""

    STATE = ("table", "count")

    def __init__(self, width: int):
        self.table = np.zeros((FIRST, 1 + width))  # the time, then the numbers
        self.count = 0

    def append(self, row: tuple[float, np.ndarray]) -> None:
        """Append a row: a time [s] and numbers (width,)."""
        if self.count == len(self.table):
            self.table = np.concatenate([self.table, np.zeros_like(self.table)])
        self.table[self.count, 0], self.table[self.count, 1:] = row
        self.count += 1

    @property
    def times(self) -> np.ndarray:
        """Times of all rows, (rows,) [s]."""
        return self.table[: self.count, 0]

    @property
    def values(self) -> np.ndarray:
        """Numbers of all rows, (rows, width)."""
        return self.table[: self.count, 1:]

    def __len__(self) -> int:
        return self.count

    def __iter__(self) -> Iterator[tuple[float, np.ndarray]]:
        return (self[n] for n in range(self.count))

    @overload
    def __getitem__(self, at: int) -> tuple[float, np.ndarray]: ...

    @overload
    def __getitem__(self, at: slice) -> list[tuple[float, np.ndarray]]: ...

    def __getitem__(self, at: int | slice) -> tuple[float, np.ndarray] | list[tuple[float, np.ndarray]]:
        rows = self.table[: self.count][at]
        if isinstance(at, slice):
            return [(float(row[0]), row[1:].copy()) for row in rows]
        return float(rows[0]), rows[1:].copy()
