"""Upload of few numbers to a device, as arguments of a kernel: unlike an array, they reach a device without waiting."""

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
