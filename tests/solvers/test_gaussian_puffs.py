"""Puffs and continuous sources against other forms of the same solutions.

Sources and puffs in still air, along the axes and between walls are cases of validation/plume_cases.py.
"""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rooms import air_in, eulerian
from scipy import integrate
from scipy.special import k0e

from taichi_plume.grid.fields import concentration_at
from taichi_plume.grid.grid import Grid
from taichi_plume.scenario.closed_forms import ContinuousGas, GaussianPuffGas
from taichi_plume.scenario.winds import UniformWind
from taichi_plume.solvers.gas import EulerianSolver
from taichi_plume.solvers.gaussian_puffs import ContinuousPuffs, GaussianPuffs
from taichi_plume.solvers.uniform_wind import UniformSolver

pytestmark = pytest.mark.usefixtures("taichi")

Q, D, POINT = 2e-5, 0.01, 1e-5  # kg/s, m²/s, m: a radius that is as good as none


def wind_of(velocity, **keys):
    return UniformWind.model_validate({"kind": "uniform", "velocity": velocity} | keys)


def calm(velocity, shape=None, **keys):
    grid = Grid(shape or (40, 30, 20)[: len(velocity)], 0.1, depth=0.5)
    return grid, UniformSolver(wind_of(velocity, **keys), grid, 0.0, 5)


def model_of(kind, diffusivity: Any = D, walls=(), **keys):
    models = {"continuous": ContinuousGas, "gaussian_puff": GaussianPuffGas}
    data = {"kind": kind, "diffusivity": diffusivity, "walls": walls} | keys
    return models[kind].model_validate(data)


@pytest.fixture(scope="module")
def air_with(taichi):
    """A wind and a gas in it."""
    kinds = {"continuous": ContinuousPuffs, "gaussian_puff": GaussianPuffs}

    def make(velocity, gas, **keys):
        grid, wind = calm(velocity, **keys)
        return SimpleNamespace(wind=wind, gas=kinds[gas.kind](gas, grid, wind))

    return make


@pytest.fixture
def continuous(air_with):
    """What a source has emitted up to some time."""

    def make(velocity, position, t=0.0, diffusivity: Any = D, walls=(), radius=POINT, **source):
        source = {"position": position, "rate": Q, "radius": radius} | source
        gas = air_with(velocity, model_of("continuous", diffusivity, walls, sources=[source])).gas
        gas.advance(0.0, t)
        return gas

    return make


@pytest.fixture
def puffs(air_with):
    """A wind and puffs in it, some time after."""

    def make(releases, velocity=(0.0, 0.0), t=0.0, diffusivity: Any = D, walls=(), **wind):
        gas = model_of("gaussian_puff", diffusivity, walls, releases=releases)
        air = air_with(velocity, gas, **wind)
        for n in range(10):
            air.wind.advance(n * t / 10, t / 10)
            air.gas.advance(n * t / 10, t / 10)
        return air.wind, air.gas

    return make


def points(dim, n=500):
    return np.random.default_rng(0).uniform(0.0, (4.0, 3.0, 2.0)[:dim], (n, dim)).astype(np.float32)


def assert_close(gas, x, reference):
    """Where there is any gas to speak of, at places in 32 bits."""
    seen = reference > 1e-6 * reference.max()
    assert seen.sum() > 20
    np.testing.assert_allclose(concentration_at(gas, x, 0.0)[seen], reference[seen], rtol=1e-4)


def test_steady_line_source_in_a_wind_askew_to_the_axes(continuous):
    U, depth, source, direction = 0.5, 0.5, np.array([1.7, 1.2]), 2.2
    along = np.array([np.cos(direction), np.sin(direction)])
    x = points(2)
    dx = x.astype(float) - source
    r = np.linalg.norm(dx, axis=1)
    reference = Q / depth / (2 * np.pi * D) * k0e(U * r / (2 * D)) * np.exp(U * (dx @ along - r) / (2 * D))
    assert_close(continuous(tuple(U * along), tuple(source)), x, reference)


def test_the_ground_and_anisotropy_are_changes_of_coordinates(continuous):
    """With x_k/sqrt(D_k) for x_k diffusion is isotropic; the ground adds the source below it."""
    U, source, K = 0.4, np.array([1.0, 1.5, 0.3]), np.array([0.02, 0.01, 0.004])
    x = points(3)
    reference = 0.0
    for z in (source[2], -source[2]):
        dx = (x.astype(float) - [*source[:2], z]) / np.sqrt(K)
        r, speed = np.linalg.norm(dx, axis=1), U / np.sqrt(K[0])
        reference += Q / np.sqrt(K.prod()) / (4 * np.pi * r) * np.exp(-speed * (r - dx[:, 0]) / 2)
    assert_close(continuous((U, 0.0, 0.0), tuple(source), diffusivity=K.tolist(), walls=["z-"]), x, reference)


def test_a_source_of_some_size(continuous):
    """Quadrature of puffs that start with the source's radius, from the source's side to far away."""
    U, s0, source = 0.3, 0.08, np.array([1.0, 1.5])
    x = np.array([[1.0, 1.5], [1.05, 1.6], [0.9, 1.5], [2.0, 1.5], [3.5, 1.9]], np.float32)
    reference = []
    for point in x.astype(float):
        dx = point - source

        def puff(a, dx=dx):
            v = s0**2 + 2 * D * a
            return np.exp(-((dx[0] - U * a) ** 2 + dx[1] ** 2) / (2 * v)) / (2 * np.pi * v)

        reference.append(Q / 0.5 * integrate.quad(puff, 0.0, 60.0, points=[dx[0] / U], limit=200)[0])
    gas = continuous((U, 0.0), tuple(source), radius=s0)
    np.testing.assert_allclose(concentration_at(gas, x, 0.0), reference, rtol=1e-4)


def test_puffs_go_with_the_gusts(puffs):
    """A puff's mass, centre and variance, measured: what was released later has gone with later gusts alone."""
    first = {"position": (0.6, 1.2), "mass": 2e-6, "radius": 0.08}
    later = first | {"time": 1.3}
    assert not concentration_at(puffs([later], t=1.0)[1], points(2), 0.0).any()  # nothing before the release
    for release in (first, later):
        wind, gas = puffs(
            [release],
            velocity=(0.4, 0.3),
            t=3.0,
            diffusivity=[0.004, 0.002],
            gusts={"intensity": 0.3, "time": 1.0},
        )
        age = 3.0 - release.get("time", 0.0)
        dx = 0.02
        x = np.stack(np.meshgrid(*(np.arange(-0.5, 4.0, dx),) * 2, indexing="ij"), axis=-1)
        c = concentration_at(gas, x, 3.0).astype(float)
        assert c.sum() * dx**2 * 0.5 == pytest.approx(2e-6, rel=1e-4)
        mean = (c[..., None] * x).sum((0, 1)) / c.sum()
        carried = wind.displacement(3.0) - wind.displacement(3.0 - age)
        assert np.abs(carried).max() > 0.02
        np.testing.assert_allclose(mean, (0.6, 1.2) + np.array(wind.mean) * age + carried, atol=2e-4)
        variance = (c[..., None] * (x - mean) ** 2).sum((0, 1)) / c.sum()
        np.testing.assert_allclose(variance, 0.08**2 + 2 * np.array([0.004, 0.002]) * age, rtol=1e-3)


def test_gas_on_the_grid_goes_with_the_same_gusts():
    """A puff on the grid and one that a formula tells stay together, in steps longer than the gusts."""
    grid, wind = calm((0.4, 0.0), (120, 90), gusts={"intensity": 0.5, "time": 0.2})
    species = {"molar_mass": 0.046, "diffusivity": 2e-3}
    release = {"position": (2.0, 4.5), "mass": 1.0, "radius": 0.5}
    data = {"kind": "gaussian_puff", "species": species, "releases": [release]}
    puff = GaussianPuffs(GaussianPuffGas.model_validate(data), grid, wind)
    gas = EulerianSolver(eulerian((2.0, 4.5), species=species), grid, wind, air_in(grid))
    gas.start_from(lambda x: concentration_at(puff, x, 0.0))
    for n in range(20):
        for part in (wind, puff, gas):
            part.advance(0.3 * n, 0.3)
    x = grid.centers()
    c, reference = (concentration_at(one, x, 6.0).astype(float) for one in (gas, puff))
    centres = [(one[..., None] * x).sum((0, 1)) / one.sum() for one in (c, reference)]
    assert abs(wind.displacement(6.0)[1] - wind.displacement(0.0)[1]) > 0.05
    np.testing.assert_allclose(centres[0], centres[1], atol=2e-3)  # a fiftieth of a cell
