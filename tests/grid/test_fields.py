import numpy as np
import pytest
import taichi as ti

from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.fields import Gas, Mixture, concentration_at, ppm_at, velocity_at
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.kernels import compiled
from taichi_plume.scenario.gases import EulerianGas
from taichi_plume.scenario.species import Species
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


@ti.data_oriented
class Even(Gas):
    """Uniform gas of 1 mg/m³."""

    def __init__(self, species: Species):
        self.species = species

    def begin(self, model, t: float, seed: int) -> None:
        pass

    def advance(self, t: float, dt: float) -> None:
        pass

    @ti.func
    def concentration(self, x, t):
        return 1e-6


def test_a_mixture_adds_up_what_is_of_one_species_and_takes_other_molar_masses():
    def vapour(name: str, molar_mass: float) -> Species:
        return Species(name, molar_mass, 1e-5)

    gases = [Even(vapour(name, 0.05)) for name in "aba"]
    mixture, point = Mixture(gases), np.zeros((1, 2))
    one = 1e-6 * vapour("a", 0.05).ppm_per_density
    np.testing.assert_allclose(ppm_at(mixture, point, 0.0), [[2.0 * one, one]], rtol=1e-6)
    before = compiled()
    gases[1].species = vapour("b", 0.1)
    mixture.begin()
    np.testing.assert_allclose(ppm_at(mixture, point, 0.0), [[2.0 * one, 0.5 * one]], rtol=1e-6)
    assert compiled() == before
    gases[1].species = vapour("a", 0.05)
    with pytest.raises(ValueError, match="species"):
        mixture.begin()
