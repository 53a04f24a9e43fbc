"""A quantity of the air on the grid: what `Transport` carries, and what makes the air rise or sink."""

from typing import Any

from taichi_plume.grid.grid import Grid


class Scalar:
    """A quantity per volume of air in the cells of a grid.

    Fields: q; rest, what rounding to f32 has left out of q.
    """

    STATE = ("q", "rest")

    def __init__(self, grid: Grid):
        self.q: Any = grid.field()
        self.rest: Any = grid.field()
