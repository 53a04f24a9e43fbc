"""Problems with exact answers. Each runs a solver at a resolution and returns its error; tests run them coarse."""

from math import ceil, pi

import numpy as np

from taichi_plume.grid import Grid
from taichi_plume.scenario import CfdWind, EulerianGas, UniformWind
from taichi_plume.solvers.flow import FlowSolver
from taichi_plume.solvers.gas import EulerianSolver
from taichi_plume.solvers.uniform import UniformSolver


def advance(solver: FlowSolver, end: float) -> None:
    """Step a flow from 0 to `end` [s]."""
    t = 0.0
    while end - t > 1e-9 * end:
        dt = (end - t) / ceil((end - t) / solver.stable_dt())
        solver.advance(t, dt)
        t += dt


def taylor_green(n: int, dim: int = 2, viscosity: float = 0.01, end: float = 1.0) -> float:
    """Root-mean-square velocity error of the decaying Taylor-Green vortices in a 2 pi box of n² cells.

    u = sin x cos y F, v = -cos x sin y F, F = exp(-2 nu t); in 3-D extruded over a few cells (Taylor & Green 1937,
    doi:10.1098/rspa.1937.0036).
    """

    def exact(x: np.ndarray, t: float) -> np.ndarray:
        decay = np.exp(-2.0 * viscosity * t)
        u = np.zeros_like(x)
        u[..., 0] = np.sin(x[..., 0]) * np.cos(x[..., 1]) * decay
        u[..., 1] = -np.cos(x[..., 0]) * np.sin(x[..., 1]) * decay
        return u

    openings = tuple({"kind": "periodic", "axis": axis} for axis in "xyz"[:dim])
    wind = CfdWind.model_validate(
        {
            "kind": "cfd",
            "viscosity": viscosity,
            "turbulence": {"kind": "none"},
            "openings": openings,
            "courant": 0.5,
        }
    )
    shape = (n, n, 4)[:dim]
    grid = Grid(shape, 2.0 * pi / n, periodic=(True,) * dim)
    flow = FlowSolver(wind, grid, np.zeros(shape, bool))
    flow.start_from(lambda x: exact(x, 0.0))
    advance(flow, end)
    squares = 0.0
    for d in range(dim):
        faces = grid.centers()
        faces[..., d] -= 0.5 * grid.dx
        squares += np.mean((grid.inner(flow.u[d].to_numpy()) - exact(faces, end)[..., d]) ** 2)
    return float(np.sqrt(squares))


def gaussian_puff(n: int, dim: int = 2, speed: float = 0.0, end: float = 4.0) -> float:
    """Root-mean-square error over the peak of a puff of unit mass that spreads and drifts in a box 1 m wide.

    c = (2 pi s²)^(-dim/2) exp(-|x - x0 - U t|²/(2 s²)), s² = s0² + 2 D t; n cells per metre.
    """
    D, s0 = 5e-4, 0.06
    start = np.full(dim, 0.5) - speed * end / 2 * np.eye(dim)[0]

    def exact(x: np.ndarray, t: float) -> np.ndarray:
        variance = s0**2 + 2.0 * D * t
        offset = x - start - speed * t * np.eye(dim)[0]
        return np.exp(-(offset**2).sum(-1) / (2.0 * variance)) / (2.0 * pi * variance) ** (dim / 2)

    shape = (n,) * dim
    grid = Grid(shape, 1.0 / n)
    wind = UniformSolver(UniformWind(kind="uniform", velocity=(speed,) + (0.0,) * (dim - 1)), grid)
    gas = EulerianGas.model_validate(
        {
            "kind": "eulerian",
            "species": {"molar_mass": 0.046, "diffusivity": D},
            "sources": [{"position": (0.5,) * dim, "rate": 0.0}],
        }
    )
    solver = EulerianSolver(gas, grid, wind, np.zeros(shape, bool))
    solver.start_from(lambda x: exact(x, 0.0))
    solver.advance(0.0, end)
    reference = exact(grid.centers(), end)
    error = grid.inner(solver.c.to_numpy()) - reference
    return float(np.sqrt(np.mean(error**2)) / reference.max())


def observed_order(errors: list[float]) -> float:
    """Order of accuracy between the last two of errors at doubling resolution."""
    return float(np.log2(errors[-2] / errors[-1]))
