"""Choice of the pressure solver: the Poisson equation of the projection."""

from math import prod, sqrt
from typing import Protocol

import numpy as np

from taichi_plume.grid.grid import Grid
from taichi_plume.grid.kernels import Field, on_cpu
from taichi_plume.scenario.size import ENTRIES_PER_CELL, MOST_BESIDE
from taichi_plume.solvers.capacitance import Capacitance, Changes
from taichi_plume.solvers.direct import FastTransforms, SparseFactors
from taichi_plume.solvers.multigrid import Multigrid
from taichi_plume.solvers.poisson import Openness


class PressureSolver(Protocol):
    """Solves the equations of `poisson` again and again for the same faces."""

    iterations: int
    """Taken by the last solve."""

    def solve(self, b: Field, phi: Field, tolerance: float) -> None:
        """Set the inner cells of field phi to the solution for field b, to a largest residual below `tolerance`."""
        ...


def pressure_solver(faces: tuple[np.ndarray, ...], grid: Grid) -> PressureSolver:
    """The fastest for these faces (1 where open): fast transforms for an empty box, with a capacitance matrix where
    few cells lie beside obstacles, otherwise sparse factors for one layer of cells and multigrid; on a GPU multigrid
    always.
    """
    openness = Openness.of(faces, grid)
    if not on_cpu():
        return Multigrid(openness, grid)
    changes = Changes.of(openness, grid)
    if not len(changes.near):
        return FastTransforms(changes.kinds, grid)
    if len(changes.near) <= min(MOST_BESIDE, sqrt(ENTRIES_PER_CELL * prod(grid.shape))):
        return Capacitance(changes, grid)
    if sum(n > 1 for n in grid.shape) <= 2:
        return SparseFactors(openness, grid)
    return Multigrid(openness, grid)
