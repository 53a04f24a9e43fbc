"""Choice of the pressure solver: Poisson equation of the pressure projection."""

from math import prod, sqrt
from typing import Protocol

import numpy as np

from taichi_plume.engine.fields import Field, on_cpu
from taichi_plume.grid.geometry_cache import geometry_cached
from taichi_plume.grid.grid import Grid
from taichi_plume.scenario.size import ENTRIES_PER_CELL, MOST_BESIDE
from taichi_plume.solvers.capacitance import Capacitance, Changes
from taichi_plume.solvers.direct import FastTransforms, SparseFactors
from taichi_plume.solvers.multigrid import Multigrid
from taichi_plume.solvers.poisson import OpenFractions


class PressureSolver(Protocol):
    """Protocol of solvers of the Poisson equation, for repeated use with the same open faces."""

    iterations: int
    """Number of iterations of the last call of `solve`."""

    def solve(self, b: Field, phi: Field, tolerance: float) -> None:
        """Solve for the right side b into the inner cells of phi, to a largest residual below `tolerance`."""
        ...


def pressure_solver(faces: tuple[np.ndarray, ...], grid: Grid) -> PressureSolver:
    """Return the fastest Poisson solver for these faces (1 where open): fast transforms for an empty box, with a
    capacitance matrix if few cells lie beside obstacles, otherwise sparse factors for one layer of cells or multigrid.
    On a GPU always multigrid.
    """
    if on_cpu():
        return _direct_solver(faces, grid) or Multigrid(OpenFractions.of(faces, grid), grid)
    return Multigrid(OpenFractions.of(faces, grid), grid)


@geometry_cached
def _direct_solver(faces: tuple[np.ndarray, ...], grid: Grid) -> PressureSolver | None:
    """Return a solver with factors; None if multigrid is faster. Simulations may share it, as each call of `solve`
    overwrites its arrays.
    """
    fractions = OpenFractions.of(faces, grid)
    changes = Changes.of(fractions, grid)
    if not len(changes.near):
        return FastTransforms(changes.kinds, grid)
    if len(changes.near) <= min(MOST_BESIDE, sqrt(ENTRIES_PER_CELL * prod(grid.shape))):
        return Capacitance(changes, grid)
    if sum(n > 1 for n in grid.shape) <= 2:
        return SparseFactors(fractions, grid)
    return None
