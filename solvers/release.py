"""Balls (in 2-D discs) that release something evenly over their volume: vapour sources and heaters on the grid."""

from collections.abc import Sequence

import numpy as np
import taichi as ti

from taichi_plume.grid.grid import Grid, block_mean
from taichi_plume.grid.kernels import Template, double_field
from taichi_plume.scenario.heat import Heater
from taichi_plume.scenario.sources import Source

SAMPLES = 4  # per axis and cell, to measure how much of a cell a ball covers


@ti.data_oriented
class Release:
    """Some balls on the grid. What each releases next is set by `amounts`; `add_to` gives it to the cells."""

    def __init__(self, name: str, balls: Sequence[Source | Heater], grid: Grid, room: np.ndarray):
        """name: of the balls in messages; room: share of each cell that stores, of grid.shape.

        Raises ValueError for a ball that covers no air.
        """
        self.grid = grid
        self._amounts: list[float] = []
        cells, shares, owner = [], [], []
        for n, ball in enumerate(balls):
            where, share = self._cells_of(f"{name}[{n}]", ball, room)
            cells.append(where + grid.ghost)
            shares.append(share / (room[tuple(where.T)] * grid.cell_volume))
            owner.append(np.full(len(where), n))
        count = sum(len(c) for c in cells)
        self._cell = ti.Vector.field(grid.dim, ti.i32, count)
        self._share = double_field((count,))  # per volume that stores
        self._owner = ti.field(ti.i32, count)
        self._amount = double_field((len(balls),))
        self._cell.from_numpy(np.concatenate(cells).astype(np.int32))
        self._share.from_numpy(np.concatenate(shares))
        self._owner.from_numpy(np.concatenate(owner).astype(np.int32))

    def _cells_of(self, path: str, ball: Source | Heater, room: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
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
        share = block_mean(inside, SAMPLES) * room[block]
        home = np.minimum((center / dx).astype(int), np.array(self.grid.shape) - 1)
        if not share.any() and room[tuple(home)] > 0:  # smaller than a cell's samples
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
            self._amount.from_numpy(np.array(amounts, float))

    @ti.func
    def add_to(self, q: Template, rest: Template):
        """Raise q, an amount per volume, in the balls' cells; `rest` is what rounding has left out of it."""
        for _ in range(1):  # balls may share cells
            for n in range(self._owner.shape[0]):
                I = self._cell[n]
                held = ti.cast(q[I], ti.f64) + ti.cast(rest[I], ti.f64)
                held += self._amount[self._owner[n]] * self._share[n]
                q[I] = ti.cast(held, ti.f32)
                rest[I] = ti.cast(held - ti.cast(ti.cast(held, ti.f32), ti.f64), ti.f32)
