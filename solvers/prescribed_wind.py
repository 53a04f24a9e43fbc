"""Prescribed steady wind, for problems with exact solutions."""

from collections.abc import Callable

import numpy as np

from taichi_plume.grid.fields import Carrier
from taichi_plume.grid.grid import Grid

Velocities = Callable[[np.ndarray], np.ndarray]
"""Function from points (..., dim) [m] to velocities (..., dim) [m/s]."""


def padded_faces(grid: Grid, d: int) -> np.ndarray:
    """Return the centres of the lower faces across axis d of all cells, ghost layers included, (*padded, dim) [m]."""
    index = np.stack(np.meshgrid(*map(np.arange, grid.padded), indexing="ij"), axis=-1)
    return (index - grid.ghost + np.where(np.arange(grid.dim) == d, 0.0, 0.5)) * grid.dx


class PrescribedWind(Carrier):
    """Steady wind with a given velocity field, without eddies or obstacles."""

    def __init__(self, velocity: Velocities, grid: Grid):
        """velocity: evaluated at the centres of all faces."""
        self.grid, self.dim = grid, grid.dim
        u = [velocity(padded_faces(grid, d))[..., d] for d in range(grid.dim)]
        self.u = tuple(map(grid.filled, u))
        self.open = tuple(grid.filled(np.ones(grid.padded)) for _ in u)
        inner = [
            v[tuple(slice(a, b + (axis == d)) for axis, (a, b) in enumerate(grid.cells))]
            for d, v in enumerate(u)
        ]
        self.outflow_rate = grid.largest_outflow(inner)

    def advance(self, t: float, dt: float) -> None:
        """Do nothing: a prescribed wind is steady."""
