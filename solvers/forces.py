"""Forces of the air on obstacles: drag and lift."""

import numpy as np

from taichi_plume.grid.cut_cells import Air
from taichi_plume.scenario.species import AIR_DENSITY
from taichi_plume.solvers.flow import FlowSolver


class Forces:
    """Callable that returns the force [N] of the air on each of `count` obstacles, (count, dim), at the flow's present
    time.

    In 2-D the force is that over the slab's depth; NaN for an obstacle that covers no cell of `air`. The force is the
    pressure on the surfaces in the cells plus the momentum that friction takes from the air beside them.
    """

    def __init__(self, flow: FlowSolver, air: Air, count: int):
        grid = flow.grid
        self.flow, self.count = flow, count
        self._cells = np.nonzero(air.body >= 0)
        self._bodies = air.body[self._cells]
        self._surface = air.surface()[self._cells]
        self._faces, self._owners = [], []
        for d in range(grid.dim):
            owner = np.where(air.body >= 0, air.body, np.roll(air.body, 1, axis=d))
            if not grid.periodic[d]:  # without the friction on the domain's walls
                np.moveaxis(owner, d, 0)[0] = -1
            self._faces.append(np.nonzero(owner >= 0))
            self._owners.append(owner[self._faces[d]])
        self._none = np.bincount(self._bodies, minlength=count) == 0

    def __call__(self) -> np.ndarray:
        """Return the present forces on the obstacles, (count, dim) [N]."""
        grid = self.flow.grid
        pressure = grid.read(self.flow.p)[self._cells]
        loss = self.flow.momentum_loss()
        result = np.zeros((self.count, grid.dim))
        for d in range(grid.dim):
            lost = loss[d][self._faces[d]] * grid.dx
            on_faces = np.bincount(self._owners[d], lost, minlength=self.count)
            on_cells = np.bincount(self._bodies, pressure * self._surface[:, d], minlength=self.count)
            result[:, d] = (on_faces + on_cells) * AIR_DENSITY * grid.cell_volume / grid.dx
        result[self._none] = np.nan
        return result
