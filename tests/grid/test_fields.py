import numpy as np
import pytest

from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.fields import concentration_at, velocity_at
from taichi_plume.grid.grid import Grid
from taichi_plume.scenario.gases import EulerianGas
from taichi_plume.scenario.winds import CfdWind, UniformWind
from taichi_plume.solvers.flow import FlowSolver
from taichi_plume.solvers.gas import EulerianSolver
from taichi_plume.solvers.uniform import UniformSolver

pytestmark = pytest.mark.usefixtures("taichi")


@pytest.mark.parametrize("dim", [2, 3])
def test_sampling_is_exact_for_linear_fields(dim):
    shape = (12, 10, 8)[:dim]
    grid = Grid(shape, 0.1)
    slopes = np.array([0.3, -0.7, 0.4])[:dim]
    points = np.random.default_rng(0).uniform(0.1, 0.7, (200, dim))

    wind = UniformSolver(UniformWind(kind="uniform", velocity=(0.2,) * dim), grid)
    model = EulerianGas.model_validate(
        {"kind": "eulerian", "sources": [{"position": (0.5,) * dim, "rate": 0.0}]}
    )
    gas = EulerianSolver(model, grid, wind, Air.everywhere(grid))
    gas.start_from(lambda x: 2.0 + x @ slopes)
    np.testing.assert_allclose(concentration_at(gas, points, 0.0), 2.0 + points @ slopes, rtol=1e-5)
    np.testing.assert_allclose(velocity_at(wind, points, 0.0), 0.2, rtol=1e-6)

    faces = tuple({"kind": "outlet", "face": axis + side} for axis in "xyz"[:dim] for side in "-+")
    flow = FlowSolver(CfdWind.model_validate({"kind": "cfd", "openings": faces}), grid, Air.everywhere(grid))
    gradient = np.diag([1.0, -1.0, 0.0][:dim]) + 0.5 * np.eye(dim, k=1)  # free of divergence

    def linear(x: np.ndarray) -> np.ndarray:
        return x @ gradient.T

    for d, field in enumerate(flow.u):
        index = np.stack(np.meshgrid(*map(np.arange, grid.padded), indexing="ij"), axis=-1) - grid.ghost
        places = (index + np.where(np.arange(dim) == d, 0.0, 0.5)) * grid.dx
        field.from_numpy(linear(places)[..., d].astype(np.float32))
    np.testing.assert_allclose(velocity_at(flow, points, 0.0), linear(points), atol=1e-5)
