from collections.abc import Callable

import numpy as np
import pytest
import taichi as ti

from taichi_plume.grid.fields import Gas, GridGas, Mixture, concentration_at, ppm_at, velocity_at
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.kernels import compiled
from taichi_plume.grid.transfer import uploader
from taichi_plume.scenario.species import Species
from taichi_plume.solvers.prescribed_wind import PrescribedWind

pytestmark = pytest.mark.usefixtures("taichi")


@ti.data_oriented
class Slope(GridGas):
    """Concentration on the grid that is a function of the position."""

    def __init__(self, grid: Grid, function: Callable[[np.ndarray], np.ndarray]):
        self.grid, self.c, self.air = grid, grid.field(), grid.field()
        index = np.stack(np.meshgrid(*map(np.arange, grid.padded), indexing="ij"), axis=-1)
        uploader(self.c, self.air)(function((index - grid.ghost + 0.5) * grid.dx), 1.0)


@pytest.mark.parametrize("dim", [2, 3])
def test_sampling_is_exact_for_linear_fields(dim):
    grid = Grid((12, 10, 8)[:dim], 0.1)
    slopes = np.array([0.3, -0.7, 0.4])[:dim]
    gradient = np.diag([1.0, -1.0, 0.0][:dim]) + 0.5 * np.eye(dim, k=1)
    points = np.random.default_rng(0).uniform(0.1, 0.7, (200, dim))
    gas = Slope(grid, lambda x: 2.0 + x @ slopes)  # pyright: ignore[reportAbstractUsage]  it is only read
    np.testing.assert_allclose(concentration_at(gas, points, 0.0), 2.0 + points @ slopes, rtol=1e-5)
    wind = PrescribedWind(lambda x: x @ gradient.T, grid)
    np.testing.assert_allclose(velocity_at(wind, points, 0.0), points @ gradient.T, atol=1e-5)


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
