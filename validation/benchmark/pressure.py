"""Iterations of the pressure solvers (Poisson, multigrid) against the number of cells: cubes with obstacles."""

import time
from dataclasses import dataclass
from math import prod

import numpy as np

from taichi_plume.engine import program, ti
from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.grid import Grid
from taichi_plume.solvers.multigrid import Multigrid
from taichi_plume.solvers.poisson import OpenFractions
from taichi_plume.solvers.pressure import pressure_solver

SIDES = (64, 96, 128)  # N of the cubes whose pressure is solved


@dataclass(frozen=True)
class Solved:
    """Figures of a solution of the pressure equation in a closed room with obstacles."""

    N: int
    cells: int
    right_side: str
    solver: str
    tolerance: float
    iterations: int
    residual: float
    """Largest residual over the largest entry of the right side, recomputed from the solution.

    For a smooth right side the residual stays above the tolerance, as phi and its rounding error are of size N².
    """
    ms: float
    Mcell_per_s: float

    def __str__(self) -> str:
        return (
            f"{self.N:4}³ {self.right_side:7} {self.solver:12} {self.iterations:3} iterations to "
            f"{self.residual:.1e}  {self.ms:8.1f} ms  {self.Mcell_per_s:6.2f} Mcells/s"
        )


def cluttered(n: int) -> tuple[Grid, np.ndarray]:
    """Return the grid and the solid cells of a 1 m cube with two boxes and a pillar, n cells along each edge."""
    grid = Grid((n, n, n), 1.0 / n)
    x = grid.centers()
    solid = (np.abs(x - (0.3, 0.35, 0.2)) < (0.12, 0.1, 0.2)).all(axis=-1)
    solid |= (np.abs(x - (0.65, 0.7, 0.6)) < (0.15, 0.06, 0.1)).all(axis=-1)
    solid |= np.hypot(x[..., 0] - 0.7, x[..., 1] - 0.25) < 0.08
    return grid, solid


def right_sides(grid: Grid, air: np.ndarray) -> dict[str, np.ndarray]:
    """Return right sides with largest entry 1, by name: divergence of random velocities, a smooth field, their sum."""
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
    """Solve the pressure in a cube of n³ cells for each right side, down to `tolerance` of its largest entry.

    Solvers: the default of the flow solver, and multigrid. Return a row per right side and solver.
    """
    program.start(arch)
    grid, solid = cluttered(n)
    faces = []
    for d, area in enumerate(Air.of(solid, grid).area):
        np.moveaxis(area, d, 0)[[0, -1]] = 0.0  # walls
        faces.append(grid.pad_faces(area, d))
    chosen = pressure_solver(tuple(faces), grid)
    solvers = (
        [chosen]
        if isinstance(chosen, Multigrid)
        else [chosen, Multigrid(OpenFractions.of(tuple(faces), grid), grid)]
    )
    b, phi = grid.field(), grid.field()
    rows = []
    for name, values in right_sides(grid, ~solid).items():
        grid.write(b, values)
        for solver in solvers:
            seconds = []
            for _ in range(3):
                begin = time.perf_counter()
                solver.solve(b, phi, tolerance)
                ti.sync()
                seconds.append(time.perf_counter() - begin)
            residual = float(np.abs(_applied(faces, grid.read(phi).astype(float), grid) - values).max())
            cells, ms = prod(grid.shape), 1e3 * min(seconds)
            columns = n, cells, name, type(solver).__name__, tolerance, solver.iterations, residual
            rows.append(Solved(*columns, ms, cells / ms / 1e3))
    return rows


def _applied(faces: list[np.ndarray], phi: np.ndarray, grid: Grid) -> np.ndarray:
    """Return the discrete Laplace operator applied to phi; faces: open fractions per axis."""
    result = np.zeros(grid.shape)
    for d, is_open in enumerate(faces):
        flux = (phi - np.roll(phi, 1, axis=d)) * grid.inner(is_open)
        result += flux - np.roll(flux, -1, axis=d)
    return result
