"""Forces of the air on obstacles: drag and lift."""

import numpy as np

from taichi_plume.grid.cut_cells import Air
from taichi_plume.scenario.species import AIR_DENSITY
from taichi_plume.solvers.flow import FlowSolver


def forces(flow: FlowSolver, air: Air, count: int) -> np.ndarray:
    """Force [N] of the air on each of `count` obstacles, shape (count, dim); in 2-D on the slab's depth; nan where one
    is not part of `air`.

    The pressure on what surfaces the cells hold, and the momentum that friction takes from the air next to them: the
    sum over the obstacles is what the air loses.
    """
    grid = flow.grid
    result = np.zeros((count, grid.dim))
    pressure = grid.read(flow.p)[..., None] * air.surface()
    loss = flow.momentum_loss()
    for d in range(grid.dim):
        below = np.roll(air.body, 1, axis=d)
        owner = np.where(air.body >= 0, air.body, below)
        inside = np.ones(grid.shape, bool)
        if not grid.periodic[d]:  # the domain's own walls take what is theirs
            np.moveaxis(inside, d, 0)[0] = False
        face = (owner >= 0) & inside
        cell = air.body >= 0
        on_faces = np.bincount(owner[face], loss[d][face] * grid.dx, minlength=count)
        on_cells = np.bincount(air.body[cell], pressure[..., d][cell], minlength=count)
        result[:, d] = (on_faces + on_cells) * AIR_DENSITY * grid.cell_volume / grid.dx
    result[np.bincount(air.body[air.body >= 0], minlength=count) == 0] = np.nan
    return result
