"""How much of a quantity has passed a surface, summed as the steps that move it are."""

from typing import Any

import taichi as ti

from taichi_plume.grid.kernels import double_field

FIRST, BETWEEN, LAST = 0.0, 1.0, 2.0
"""Which stage of a step."""


@ti.data_oriented
class Tally:
    """A total in f64 that every stage of a step sets anew: what it was before the step, and the step's length times the
    sum of the rates of all stages so far.
    """

    STATE = ("_total",)

    def __init__(self) -> None:
        self._total, self._before, self._rate = (double_field() for _ in range(3))

    @ti.func
    def begin(self, stage):
        """Before the first `add` of a stage."""
        if stage == FIRST:
            self._before[None] = self._total[None]
            self._rate[None] = 0.0

    @ti.func
    def add(self, rate):
        """What passes one place, per second."""
        self._rate[None] += ti.cast(rate, ti.f64)

    @ti.func
    def end(self, h):
        """After the last `add` of a stage; h: length [s] of which each stage has a share, see `transport`."""
        self._total[None] = self._before[None] + ti.cast(h, ti.f64) * self._rate[None]

    def read(self) -> float:
        """The total."""
        total: Any = self._total[None]
        return total
