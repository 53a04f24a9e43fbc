"""Balls (in 2-D discs) that release something evenly over their volume: vapour sources and heaters on the grid."""

from collections.abc import Sequence
from math import ceil, prod
from typing import Any

import numpy as np
import taichi as ti

from taichi_plume.grid.grid import Grid, block_mean
from taichi_plume.grid.kernels import Template, double_field
from taichi_plume.grid.transfer import uploader
from taichi_plume.scenario.heat import Heater
from taichi_plume.scenario.sources import Source

SAMPLES = 4  # per axis and cell, to measure how much of a cell a ball covers


@ti.data_oriented
class Release:
    """Some balls on the grid. What each releases next is set by `amounts`; `add_to` gives it to the cells."""

    STATE = ()

    def __init__(self, name: str, balls: Sequence[Source | Heater], grid: Grid, room: np.ndarray):
        """name: of the balls in messages; room: share of each cell that stores, of grid.shape. To be begun by its
        owner.
        """
        self.name, self.grid, self.room = name, grid, room
        self._amounts: list[float] = []
        # those that the balls may touch
        self.cells = sum(
            prod(min(n, ceil(2.0 * ball.radius / grid.dx) + 1) for n in grid.shape) for ball in balls
        )
        self._cell = ti.Vector.field(grid.dim, ti.i32, self.cells)
        self._share = double_field((self.cells,))  # per volume that stores
        self._owner = ti.field(ti.i32, self.cells)
        self._count: Any = ti.field(ti.i32, ())  # of the cells
        self._amount = double_field((len(balls),))
        self._place = uploader(self._cell, self._share, self._owner, self._count)
        self._give = uploader(self._amount)

    def begin(self, balls: Sequence[Source | Heater]) -> None:
        """Place the balls, of the radii that they were made with. Raises ValueError for a ball that covers no air."""
        cell, share, owner = (np.zeros((*self._cell.shape, n)) for n in (self.grid.dim, 1, 1))
        count = 0
        for n, ball in enumerate(balls):
            where, part = self._cells_of(f"{self.name}[{n}]", ball)
            these = slice(count, count + len(where))
            cell[these] = where + self.grid.ghost
            share[these, 0] = part / (self.room[tuple(where.T)] * self.grid.cell_volume)
            owner[these] = n
            count += len(where)
        self._place(cell, share[:, 0], owner[:, 0], count)

    def _cells_of(self, path: str, ball: Source | Heater) -> tuple[np.ndarray, np.ndarray]:
        """Cells of a ball, shape (n, dim), and the share of its release that each receives."""
        dx = self.grid.dx
        sub = (np.arange(SAMPLES) + 0.5) / SAMPLES
        center = np.array(ball.position)
        first = np.maximum(np.floor((center - ball.radius) / dx).astype(int), 0)
        last = np.minimum(np.ceil((center + ball.radius) / dx).astype(int), self.grid.shape)
        axes = [(np.arange(a, b)[:, None] + sub).ravel() * dx for a, b in zip(first, last, strict=True)]
        squares = [(axis - c) ** 2 for axis, c in zip(axes, center, strict=True)]
        inside = sum(np.ix_(*squares), start=np.zeros(())) <= ball.radius**2
        block = tuple(slice(a, b) for a, b in zip(first, last, strict=True))
        share = block_mean(inside, SAMPLES) * self.room[block]
        home = np.minimum((center / dx).astype(int), np.array(self.grid.shape) - 1)
        if not share.any() and self.room[tuple(home)] > 0:  # smaller than a cell's samples
            share[tuple(home - first)] = 1.0
        if not share.any():
            raise ValueError(
                f"{path}.position: is not in the air: an obstacle fills its cell or seals it off; "
                "move it by a cell or lower domain.spacing"
            )
        where = np.argwhere(share > 0)
        return where + first, share[tuple(where.T)] / share.sum()

    def set_amounts(self, amounts: list[float]) -> None:
        """What each ball releases at the next `add_to`."""
        if amounts != self._amounts:
            self._amounts = amounts
            self._give(amounts)

    @ti.func
    def add_to(self, q: Template, rest: Template):
        """Raise q, an amount per volume, in the balls' cells; `rest` is what rounding has left out of it."""
        for _ in range(1):  # balls may share cells
            for n in range(self._count[None]):
                I = self._cell[n]
                held = ti.cast(q[I], ti.f64) + ti.cast(rest[I], ti.f64)
                held += self._amount[self._owner[n]] * self._share[n]
                q[I] = ti.cast(held, ti.f32)
                rest[I] = ti.cast(held - ti.cast(ti.cast(held, ti.f32), ti.f64), ti.f32)
