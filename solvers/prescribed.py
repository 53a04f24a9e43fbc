"""Prescribed steady wind, for problems with exact solutions."""

from collections.abc import Callable

import numpy as np
import taichi as ti

from taichi_plume.grid.fields import Carrier
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.transfer import uploader

Velocities = Callable[[np.ndarray], np.ndarray]
"""Velocity [m/s] at points (..., dim) [m]."""


@ti.data_oriented
class PrescribedWind(Carrier):
    """A steady wind of known velocities. No eddies, no obstacles."""

    def __init__(self, velocity: Velocities, grid: Grid):
        """velocity: taken at the middles of the faces, ghost layers included."""
        self.grid, self.dim = grid, grid.dim
        self.u = grid.faces_field()
        self.open = grid.faces_field()
        uploader(*self.open)(*(1.0 for _ in self.open))
        self._put = uploader(*self.u)
        self.begin(velocity, 0.0, 0)

    def begin(self, model: Velocities, t: float, seed: int) -> None:
        grid = self.grid
        index = np.stack(np.meshgrid(*map(np.arange, grid.padded), indexing="ij"), axis=-1) - grid.ghost
        middles = [np.where(np.arange(grid.dim) == d, 0.0, 0.5) for d in range(grid.dim)]
        u = [model((index + middle) * grid.dx)[..., d] for d, middle in enumerate(middles)]
        self._put(*u)
        inner = [
            v[tuple(slice(a, b + (axis == d)) for axis, (a, b) in enumerate(grid.cells))]
            for d, v in enumerate(u)
        ]
        self.outflow_rate = grid.largest_outflow(inner)

    def advance(self, t: float, dt: float) -> None:
        """Nothing changes."""
