"""Air that moves as it is told, for problems with known answers."""

from collections.abc import Callable

import numpy as np

from taichi_plume.grid.grid import Grid


class PrescribedWind:
    """A steady wind of known velocities; offers what carries gas on the grid (see `transport`). No obstacles."""

    nu = None  # no eddies
    area = None  # through obstacles
    viscosity = max_viscosity = 0.0
    schmidt = 1.0

    def __init__(self, velocity: Callable[[np.ndarray], np.ndarray], grid: Grid):
        """velocity: [m/s] at points (..., dim) [m]; taken at the middles of the faces, ghost layers included."""
        self.u = grid.faces_field()
        self.open = grid.faces_field()
        index = np.stack(np.meshgrid(*map(np.arange, grid.padded), indexing="ij"), axis=-1) - grid.ghost
        faces = []
        for d, field in enumerate(self.u):
            middle = np.where(np.arange(grid.dim) == d, 0.0, 0.5)
            u = velocity((index + middle) * grid.dx)[..., d]
            field.from_numpy(u.astype(np.float32))
            self.open[d].fill(1.0)
            faces.append(u[tuple(slice(a, b + (axis == d)) for axis, (a, b) in enumerate(grid.cells))])
        self.outflow_rate = grid.largest_outflow(faces)
