from collections.abc import Callable

import numpy as np
import pytest

from taichi_plume.engine import ti
from taichi_plume.grid.fields import (
    Carrier,
    Gas,
    GridGas,
    Mixture,
    Wind,
    concentration_at,
    ppm_at,
    velocity_at,
)
from taichi_plume.grid.grid import Grid
from taichi_plume.scenario.species import Species
from taichi_plume.solvers.prescribed_wind import PrescribedWind
from taichi_plume.solvers.synthetic_flow import curl

pytestmark = pytest.mark.usefixtures("taichi")


class Slope(GridGas):
    """Concentration on the grid that is a function of the position."""

    def __init__(self, grid: Grid, function: Callable[[np.ndarray], np.ndarray]):
        self.grid, self.air = grid, grid.filled(np.ones(grid.padded))
        index = np.stack(np.meshgrid(*map(np.arange, grid.padded), indexing="ij"), axis=-1)
        self.c = grid.filled(function((index - grid.ghost + 0.5) * grid.dx))


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


class Solenoidal(Wind):
    """Wind with the velocities of a gridded wind that are divergence-free between the faces."""

    def __init__(self, wind: Carrier):
        self.wind, self.dim = wind, wind.dim

    def advance(self, t: float, dt: float) -> None:
        pass

    @ti.func
    def velocity(self, x, t):
        return self.wind.solenoidal_velocity(x, t)


def random_flow(grid: Grid) -> PrescribedWind:
    """Return random velocities without flow into or out of any cell; closed faces around the domain and a block."""
    rng, axes = np.random.default_rng(1), (0, 1, 2) if grid.dim == 3 else (2,)
    potential = {}
    for m in axes:
        shape = tuple(n if a == m else n + 1 for a, n in enumerate(grid.shape))
        potential[m] = rng.standard_normal(shape)
        block = tuple(slice(3, 5) if a == m else slice(3, 6) for a in range(grid.dim))
        potential[m][block] = 0.0
        for a in set(range(grid.dim)) - {m}:
            np.moveaxis(potential[m], a, 0)[[0, -1]] = 0.0
    wind = PrescribedWind(lambda x: 0.0 * x, grid)
    for d, u in enumerate(curl(potential, grid.dx)):
        wind.u[d].from_numpy(grid.pad_faces(u, d))
    return wind


@pytest.mark.parametrize("dim", [2, 3])
def test_solenoidal_velocities_have_no_divergence_within_cells(dim):
    grid = Grid((9, 8, 7)[:dim], 0.1)
    wind = Solenoidal(random_flow(grid))
    rng = np.random.default_rng(2)
    cells = rng.integers(0, grid.shape, (300, dim))
    middle = (cells + rng.uniform(0.25, 0.75, (300, dim))) * grid.dx
    slopes = []
    for d in range(dim):
        step = 0.2 * grid.dx * np.eye(dim)[d]  # in a cell velocities are parabolas: the difference is exact
        low, high = (velocity_at(wind, middle + side * step, 0.0)[:, d] for side in (-1, 1))
        slopes.append((high - low) / (0.4 * grid.dx))
    assert np.abs(sum(slopes)).max() < 1e-5 * np.abs(slopes).max()


@pytest.mark.parametrize("dim", [2, 3])
def test_solenoidal_velocities_pass_faces_evenly_and_no_closed_ones(dim):
    grid, near = Grid((9, 8, 7)[:dim], 0.1), 1e-5
    wind = Solenoidal(random_flow(grid))
    rng = np.random.default_rng(3)
    fastest = np.abs(velocity_at(wind, rng.uniform(0.0, grid.extent, (300, dim)), 0.0)).max()
    for d in range(dim):
        x = rng.uniform(0.0, grid.extent, (300, dim))
        x[:, d] = rng.integers(1, grid.shape[d], 300) * grid.dx
        low, high = (velocity_at(wind, x + side * near * np.eye(dim)[d], 0.0)[:, d] for side in (-1, 1))
        assert np.abs(low - high).max() < 1e-2 * fastest
        beside = rng.uniform(0.31, 0.49, (300, dim))  # the block is from 0.3 to 0.5 m
        for plane, points in ((0.0, x), (grid.extent[d], x), (0.3, beside), (0.5, beside)):
            at = points.copy()
            at[:, d] = plane
            assert np.abs(velocity_at(wind, at, 0.0)[:, d]).max() < 1e-5 * fastest


def test_solenoidal_velocities_are_of_second_order():
    def vortices(x: np.ndarray) -> np.ndarray:
        a, b = 5.0 * x[..., 0] + 1.0, 4.0 * x[..., 1]
        return np.stack([4.0 * np.sin(a) * np.cos(b), -5.0 * np.cos(a) * np.sin(b)], axis=-1)

    points = np.random.default_rng(0).uniform(0.0, 1.0, (2000, 2))
    errors = []
    for n in (10, 20, 40):
        wind = Solenoidal(PrescribedWind(vortices, Grid((n, n), 1.0 / n)))
        errors.append(np.sqrt(((velocity_at(wind, points, 0.0) - vortices(points)) ** 2).mean()))
    assert np.log2(errors[0] / errors[1]) > 1.8
    assert np.log2(errors[1] / errors[2]) > 1.9


class Even(Gas):
    """Uniform gas of 1 mg/m³."""

    def __init__(self, species: Species):
        self.species = species

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
