import numpy as np
import pytest

from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.grid import Grid
from taichi_plume.scenario.winds import CfdWind
from taichi_plume.solvers.flow import FlowSolver

pytestmark = pytest.mark.usefixtures("taichi")


def eddy_viscosity(kind: str, gradient: np.ndarray, constant: float) -> float:
    """nu_t of a solver in the middle of a box with u_i = gradient[i, j] x_j."""
    dim = len(gradient)
    grid = Grid((8,) * dim, 0.1)
    openings = tuple({"kind": "outlet", "face": axis + side} for axis in "xyz"[:dim] for side in "-+")
    turbulence = {"kind": kind, "constant": constant}
    wind = CfdWind.model_validate(
        {"kind": "cfd", "viscosity": 1e-5, "turbulence": turbulence, "openings": openings}
    )
    flow = FlowSolver(wind, grid, Air.everywhere(grid))
    index = np.stack(np.meshgrid(*map(np.arange, grid.padded), indexing="ij"), axis=-1) - grid.ghost - 4
    for d, field in enumerate(flow.u):
        places = (index + np.where(np.arange(dim) == d, 0.0, 0.5)) * grid.dx
        field.from_numpy((places @ gradient.T)[..., d].astype(np.float32))
    flow._stage(0.0, 1.0)
    return float(flow.nu.to_numpy()[(grid.ghost + 4,) * dim]) - 1e-5


def traceless(dim: int) -> np.ndarray:
    gradient = np.random.default_rng(dim).standard_normal((dim, dim))
    return gradient - np.eye(dim) * np.trace(gradient) / dim


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.slow
def test_smagorinsky_is_the_strain_rate(dim):
    gradient = traceless(dim)
    strain = (gradient + gradient.T) / 2
    expected = (0.2 * 0.1) ** 2 * np.sqrt(2 * np.einsum("ij,ij", strain, strain))
    assert eddy_viscosity("smagorinsky", gradient, 0.2) == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.slow
def test_vreman_is_the_second_invariant(dim):
    """The sum of the 2 x 2 principal minors is the second coefficient of the characteristic polynomial."""
    gradient = traceless(dim)
    b = 0.1**2 * gradient @ gradient.T  # beta of a = gradient transposed
    expected = 0.07 * np.sqrt(np.poly(b)[2] / (gradient**2).sum())
    assert eddy_viscosity("vreman", gradient, 0.07) == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.slow
def test_vreman_leaves_laminar_shear_alone(dim):
    shear = np.zeros((dim, dim))
    shear[0, 1] = 3.0
    assert abs(eddy_viscosity("vreman", shear, 0.07)) < 1e-7
    assert eddy_viscosity("smagorinsky", shear, 0.15) > 1e-4
