from collections.abc import Callable

import numpy as np
import pytest
from rooms import cfd, flow_in

from taichi_plume.grid.grid import Grid
from taichi_plume.solvers.prescribed_wind import padded_faces

pytestmark = [pytest.mark.usefixtures("taichi"), pytest.mark.slow]


@pytest.fixture(scope="module")
def eddy_viscosity(taichi) -> Callable[[str, np.ndarray, float], float]:
    """nu_t of a solver in the middle of a box with u_i = gradient[i, j] x_j."""

    def of(kind: str, gradient: np.ndarray, constant: float) -> float:
        dim = len(gradient)
        openings = tuple({"kind": "outlet", "face": axis + side} for axis in "xyz"[:dim] for side in "-+")
        turbulence = {"kind": kind, "constant": constant}
        wind = cfd(openings, viscosity=1e-5, turbulence=turbulence)
        flow = flow_in(Grid((8,) * dim, 0.1), wind)
        middle = 4 * flow.grid.dx
        for d, field in enumerate(flow.u):
            field.from_numpy((padded_faces(flow.grid, d) - middle) @ gradient[d])
        flow._set_viscosity()
        return float(flow.grid.read(flow.nu)[(4,) * dim]) - 1e-5

    return of


def traceless(dim: int) -> np.ndarray:
    gradient = np.random.default_rng(dim).standard_normal((dim, dim))
    return gradient - np.eye(dim) * np.trace(gradient) / dim


@pytest.mark.parametrize("dim", [2, 3])
def test_smagorinsky_is_the_strain_rate(eddy_viscosity, dim):
    gradient = traceless(dim)
    strain = (gradient + gradient.T) / 2
    expected = (0.2 * 0.1) ** 2 * np.sqrt(2 * np.einsum("ij,ij", strain, strain))
    assert eddy_viscosity("smagorinsky", gradient, 0.2) == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("dim", [2, 3])
def test_vreman_is_the_second_invariant(eddy_viscosity, dim):
    """The sum of the 2 x 2 principal minors is the second coefficient of the characteristic polynomial."""
    gradient = traceless(dim)
    b = 0.1**2 * gradient @ gradient.T  # beta of a = gradient transposed
    expected = 0.07 * np.sqrt(np.poly(b)[2] / (gradient**2).sum())
    assert eddy_viscosity("vreman", gradient, 0.07) == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("dim", [2, 3])
def test_vreman_leaves_laminar_shear_alone(eddy_viscosity, dim):
    shear = np.zeros((dim, dim))
    shear[0, 1] = 3.0
    assert abs(eddy_viscosity("vreman", shear, 0.07)) < 1e-7
    assert eddy_viscosity("smagorinsky", shear, 0.15) > 1e-4
