"""Gas with exact solutions. Each function solves one at a resolution and returns its errors by norm."""

from math import pi

import numpy as np

from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.grid import Grid
from taichi_plume.scenario.gases import EulerianGas
from taichi_plume.scenario.winds import UniformWind
from taichi_plume.solvers.gas import EulerianSolver
from taichi_plume.solvers.uniform import UniformSolver
from taichi_plume.validation.flow_cases import Errors, rms


def gaussian_puff(n: int, dim: int = 2, speed: float = 0.0) -> Errors:
    """A puff of unit mass that spreads and drifts in a box 1 m wide, n cells per metre.

    c = (2 pi s²)^(-dim/2) exp(-|x - x0 - U t|²/(2 s²)), s² = s0² + 2 D t.
    """
    diffusivity, s0, end = 5e-4, 0.06, 4.0
    start = np.full(dim, 0.5) - speed * end / 2 * np.eye(dim)[0]

    def exact(x: np.ndarray, t: float) -> np.ndarray:
        variance = s0**2 + 2.0 * diffusivity * t
        offset = x - start - speed * t * np.eye(dim)[0]
        return np.exp(-(offset**2).sum(-1) / (2.0 * variance)) / (2.0 * pi * variance) ** (dim / 2)

    shape = (n,) * dim
    grid = Grid(shape, 1.0 / n)
    wind = UniformSolver(UniformWind(kind="uniform", velocity=(speed,) + (0.0,) * (dim - 1)), grid)
    model = EulerianGas.model_validate(
        {
            "kind": "eulerian",
            "species": {"molar_mass": 0.046, "diffusivity": diffusivity},
            "sources": [{"position": (0.5,) * dim, "rate": 0.0}],
        }
    )
    gas = EulerianSolver(model, grid, wind, Air.everywhere(grid))
    gas.start_from(lambda x: exact(x, 0.0))
    gas.advance(0.0, end)
    points, reference = grid.centers(), exact(grid.centers(), end)
    c = grid.inner(gas.c.to_numpy()).astype(float)
    mass = c.sum() * grid.cell_volume
    along = points[..., 0]
    mean = (c * along).sum() / c.sum()
    variance = (c * (along - mean) ** 2).sum() / c.sum()
    return {
        "c / c_max, rms": rms(c - reference) / float(reference.max()),
        "mass": float(abs(mass - 1.0)),
        "variance along x": float(abs(variance / (s0**2 + 2.0 * diffusivity * end) - 1.0)),
    }
