"""Sampling of wind, gas and cell fields at given points, in a single launch."""

from collections.abc import Sequence

import numpy as np

from taichi_plume.engine import ti
from taichi_plume.engine.fields import Field
from taichi_plume.grid.fields import Mixture, Wind, sample_cells
from taichi_plume.grid.grid import Grid


class Sampler:
    """Sampler of wind [m/s], mole fraction of each gas species [ppm] and cell fields at fixed points (n, dim) [m].

    solid: mask of the cells that hold no air, of the grid's shape. excess: whether gas counts from its background on.
    """

    def __init__(
        self,
        points: np.ndarray,
        wind: Wind,
        gas: Mixture,
        cells: Sequence[Field],
        solid: np.ndarray,
        grid: Grid,
        excess: bool = False,
    ):
        self.excess = excess
        self.grid, self.dim = grid, grid.dim
        self.wind, self.gas, self.cells = wind, gas, tuple(cells)
        self.points = np.ascontiguousarray(points, np.float32)
        self.species = len(gas.species)
        self.width = self.dim + self.species + len(self.cells)
        self.air = grid.filled(grid.pad(~solid))

    def sample(self, t: float) -> np.ndarray:
        """Return the values at time t [s], (width, n): wind components, species, then cell fields."""
        out = np.empty((self.width, len(self.points)), np.float32)
        self._sample(self.points, t, out)
        return out

    @ti.kernel
    def _sample(
        self,
        points: ti.types.ndarray(),  # type: ignore[valid-type]
        t: float,
        out: ti.types.ndarray(),  # type: ignore[valid-type]
    ):
        for n in range(points.shape[0]):
            x = ti.Vector([points[n, d] for d in ti.static(range(self.dim))])
            u = self.wind.velocity(x, t)
            for d in ti.static(range(self.dim)):
                out[d, n] = u[d]
            ppm = self.gas.excess(x, t) if ti.static(self.excess) else self.gas.ppm(x, t)
            for s in ti.static(range(self.species)):
                out[self.dim + s, n] = ppm[s]
            for c in ti.static(range(len(self.cells))):
                value = sample_cells(
                    self.cells[c], self.air, x, self.grid.dx, self.grid.ghost, self.grid.padded
                )
                out[self.dim + self.species + c, n] = value
