"""Walls and obstacles that exchange a quantity q of the air with the cells beside them.

    dq/dt = v A/V (q_s - q)

v [m/s]: transfer velocity, across the film of air at the surface; q_s: q of the surface; A/V [1/m]: its area over the
volume of air of a cell. What is not named exchanges nothing.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import taichi as ti

from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.kernels import Pass, Template
from taichi_plume.grid.transfer import uploader
from taichi_plume.scenario.windows import Region
from taichi_plume.solvers.patches import Patch
from taichi_plume.solvers.tally import Tally


@ti.data_oriented
class SurfaceExchange:
    """Some walls and obstacles and the cells that touch them. fastest [1/s]: what they take at most, over q."""

    STATE = ("_given",)

    def __init__(
        self, grid: Grid, air: Air, walls: Sequence[Region], obstacles: Sequence[int], vents: Sequence[Patch]
    ):
        """obstacles: their numbers; vents: openings, where there is no wall. To be begun by its owner. Raises
        ValueError for what touches no air.
        """
        self.grid, self.room = grid, air.room
        self.fastest = 0.0
        self._given = Tally()
        self._touched = [*self._of_walls(walls, air, vents), *self._of_obstacles(obstacles, air)]
        touched = np.zeros(grid.shape, bool)
        for cells, _ in self._touched:
            touched[cells] = True
        self._where = np.nonzero(touched)
        self.cells = len(self._where[0])
        self._cell = ti.Vector.field(grid.dim, ti.i32, self.cells)
        self._stores, self._rate, self._gain = (ti.field(ti.f32, self.cells) for _ in range(3))
        uploader(self._cell, self._stores)(np.argwhere(touched) + grid.ghost, self.room[self._where])
        self._set = uploader(self._rate, self._gain)

    def _of_walls(
        self, walls: Sequence[Region], air: Air, vents: Sequence[Patch]
    ) -> Iterator[tuple[Any, Any]]:
        """Of each the cells that touch it, and its area in each of them over a face's."""
        for n, wall in enumerate(walls):
            patch = Patch(wall, self.grid, ~air.solid)
            for vent in vents:
                if (vent.axis, vent.side) == (wall.axis, wall.side):
                    patch.covered &= ~vent.covered
            if not patch.covered.any():
                raise ValueError(
                    f"walls[{n}]: touches no air, an obstacle or an opening covers it; move one of them"
                )
            yield patch.cells(), 1.0

    def _of_obstacles(self, obstacles: Sequence[int], air: Air) -> Iterator[tuple[Any, Any]]:
        surface = np.linalg.norm(air.surface(), axis=-1) * ~air.solid
        for n, number in enumerate(obstacles):
            cells = (air.body == number) & (surface > 0.0)
            if not cells.any():
                raise ValueError(
                    f"obstacles[{n}]: touches no air; obstacles[{number}] is smaller than a cell"
                )
            yield cells, surface[cells]

    def begin(self, transfer: Sequence[float], held: Sequence[float]) -> None:
        """transfer [m/s] and held, q at the surface, of each wall and then of each obstacle."""
        rate, gain = np.zeros(self.grid.shape), np.zeros(self.grid.shape)
        for (cells, size), velocity, q in zip(self._touched, transfer, held, strict=True):
            exchange = velocity / self.grid.dx * size / self.room[cells]
            rate[cells] += exchange
            gain[cells] += exchange * q
        self.fastest = float(rate.max())
        self._set(rate[self._where], gain[self._where])

    def into(self, rate: Template, q: Template) -> Pass:
        """A pass that adds to the rate [1/s] of q what the surfaces give, and counts it."""

        @ti.func
        def exchange(h, stage):
            self._given.begin(stage)
            for n in range(self._rate.shape[0]):
                I = self._cell[n]
                given = self._gain[n] - self._rate[n] * q[I]
                rate[I] += given
                self._given.add(given * self._stores[n])
            self._given.end(h)

        return Pass(exchange, self.cells)

    def given(self) -> float:
        """What the surfaces have given so far, q times a volume."""
        return self._given.read() * self.grid.cell_volume
