"""Which solver makes the flow divergence-free."""

from typing import Any, Protocol

import numpy as np

from taichi_plume.grid.grid import Grid
from taichi_plume.grid.kernels import on_cpu
from taichi_plume.solvers.direct import FastTransforms, SparseFactors
from taichi_plume.solvers.multigrid import Multigrid
from taichi_plume.solvers.poisson import Openness


class PressureSolver(Protocol):
    """Solves the equations of `poisson` again and again for the same faces."""

    iterations: int
    """Taken by the last solve."""

    def solve(self, b: Any, phi: Any, tolerance: float) -> None:
        """Set the inner cells of field phi to the solution for field b, to a largest residual below `tolerance`."""
        ...


def pressure_solver(faces: tuple[np.ndarray, ...], grid: Grid) -> PressureSolver:
    """The fastest for these faces (1 where open): fast transforms for an empty box, sparse factors for one layer of
    cells, otherwise multigrid; on a GPU multigrid always.
    """
    openness = Openness.of(faces, grid)
    if not on_cpu():
        return Multigrid(openness, grid)
    if FastTransforms.fits(openness, grid):
        return FastTransforms(openness, grid)
    if sum(n > 1 for n in grid.shape) <= 2:
        return SparseFactors(openness, grid)
    return Multigrid(openness, grid)
