"""How the iterations of the pressure grow with the number of cells: cubes with obstacles, solved alone."""

import time
from dataclasses import dataclass
from math import prod

import numpy as np
import taichi as ti

from taichi_plume.grid import kernels
from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.grid import Grid
from taichi_plume.scenario.winds import CfdWind
from taichi_plume.solvers.flow import FlowSolver

SIDES = (64, 96, 128)  # N of the cubes whose pressure is solved


@dataclass(frozen=True)
class Solved:
    """One solve of the pressure in a closed room with obstacles."""

    N: int
    cells: int
    right_side: str
    solver: str
    tolerance: float
    iterations: int
    residual: float
    """Largest of any cell, over the largest entry of the right side, reckoned anew from the solution.

    That of a smooth right side stays above the tolerance: phi is then of size N², and so is its rounding.
    """
    ms: float
    Mcell_per_s: float

    def __str__(self) -> str:
        return (
            f"{self.N:4}³ {self.right_side:7} {self.solver:12} {self.iterations:3} iterations to "
            f"{self.residual:.1e}  {self.ms:8.1f} ms  {self.Mcell_per_s:6.2f} Mcells/s"
        )


def cluttered(n: int) -> tuple[Grid, np.ndarray]:
    """A cube of 1 m with two boxes and a pillar, n cells along each edge."""
    grid = Grid((n, n, n), 1.0 / n)
    x = grid.centers()
    solid = (np.abs(x - (0.3, 0.35, 0.2)) < (0.12, 0.1, 0.2)).all(axis=-1)
    solid |= (np.abs(x - (0.65, 0.7, 0.6)) < (0.15, 0.06, 0.1)).all(axis=-1)
    solid |= np.hypot(x[..., 0] - 0.7, x[..., 1] - 0.25) < 0.08
    return grid, solid


def right_sides(grid: Grid, air: np.ndarray) -> dict[str, np.ndarray]:
    """Of largest entry 1: the divergence of random velocities, which is rough, a smooth field, and their sum."""
    rng = np.random.default_rng(0)
    rough = np.zeros(grid.shape)
    for d in range(grid.dim):
        faces = rng.standard_normal(grid.shape) * air * np.roll(air, 1, axis=d)
        np.moveaxis(faces, d, 0)[0] = 0.0
        rough += faces - np.roll(faces, -1, axis=d)
    smooth = np.prod(np.cos(np.pi * grid.centers()), axis=-1)
    smooth = np.where(air, smooth - smooth[air].mean(), 0.0)
    rough, smooth = (b / np.abs(b).max() for b in (rough, smooth))
    both = rough + smooth
    return {"random": rough, "smooth": smooth, "both": both / np.abs(both).max()}


def solve(n: int, arch: str, tolerance: float = 1e-4) -> list[Solved]:
    """Solve the pressure in a cube of n³ cells for each right side, down to `tolerance` of its largest entry."""
    kernels.start(arch)
    grid, solid = cluttered(n)
    flow = FlowSolver(CfdWind.model_validate({"kind": "cfd"}), grid, Air.of(solid, grid))
    b, phi = grid.field(), grid.field()
    openness = [grid.inner(field.to_numpy()) > 0 for field in flow.open]
    rows = []
    for name, values in right_sides(grid, ~solid).items():
        grid.write(b, values)
        seconds = []
        for _ in range(3):
            begin = time.perf_counter()
            flow.solver.solve(b, phi, tolerance)
            ti.sync()
            seconds.append(time.perf_counter() - begin)
        solution, applied = grid.read(phi).astype(float), np.zeros(grid.shape)
        for d, is_open in enumerate(openness):
            flux = (solution - np.roll(solution, 1, axis=d)) * is_open
            applied += flux - np.roll(flux, -1, axis=d)
        residual = float(np.abs(applied - values).max())
        cells, best = prod(grid.shape), min(seconds)
        solver = type(flow.solver).__name__
        rows.append(
            Solved(
                n,
                cells,
                name,
                solver,
                tolerance,
                flow.solver.iterations,
                residual,
                1e3 * best,
                cells / best / 1e6,
            )
        )
    return rows
