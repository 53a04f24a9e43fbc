"""Transfers between host and device: of few numbers, and of fields in shared memory.

Few numbers are arguments of a kernel: unlike an array, they reach a device without waiting.
"""

import numpy as np

from taichi_plume.engine import ti
from taichi_plume.engine.fields import Field

AT_ONCE = 12
"""Numbers per launch: whole vectors of 2 or 3 numbers."""


def upload(line: Field, values: np.ndarray) -> None:
    """Set the entries of a field over a line to `values`, (entries,) or (entries, n)."""
    step = AT_ONCE // max(1, line.n)
    for first in range(0, len(values), step):
        numbers = values[first : first + step].ravel().tolist()
        _put(line, first, len(values), [*numbers, *[0.0] * (AT_ONCE - len(numbers))])


@ti.kernel
def _put(line: ti.template(), first: ti.i32, count: ti.i32, numbers: ti.types.vector(AT_ONCE, ti.f64)):  # pyright: ignore
    for k in ti.static(range(AT_ONCE // max(1, line.n))):
        if first + k < count:
            if ti.static(line.n == 0):
                line[first + k] = numbers[k]
            else:
                for c in ti.static(range(line.n)):
                    line[first + k][c] = numbers[k * line.n + c]


@ti.kernel
def store(line: ti.template(), values: ti.types.ndarray()):  # pyright: ignore
    """Set a field over a line to `values`, (entries,) or (entries, n)."""
    for k in range(line.shape[0]):
        if ti.static(line.n == 0):
            line[k] = values[k]
        else:
            for c in ti.static(range(line.n)):
                line[k][c] = values[k, c]


@ti.kernel
def load(line: ti.template(), values: ti.types.ndarray()):  # pyright: ignore
    """Set `values`, (entries,) or (entries, n), to a field over a line."""
    for k in range(line.shape[0]):
        if ti.static(line.n == 0):
            values[k] = line[k]
        else:
            for c in ti.static(range(line.n)):
                values[k, c] = line[k][c]
