"""Puffs that become gas on the grid: nothing is lost, seen twice, widened or on the wrong side of a wall."""

import numpy as np
import pytest
from rooms import TUNNEL, blocks, cfd, march, missing

from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.fields import concentration_at
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.state import State
from taichi_plume.scenario.gases import PuffGas
from taichi_plume.scenario.winds import UniformWind
from taichi_plume.solvers.flow import FlowSolver
from taichi_plume.solvers.prescribed_wind import PrescribedWind
from taichi_plume.solvers.puffs import PuffSolver
from taichi_plume.solvers.uniform_wind import UniformSolver

pytestmark = [pytest.mark.usefixtures("taichi"), pytest.mark.slow]

STILL = {"diffusivity": 0.0, "molar_mass": 0.05}


def model(**keys) -> PuffGas:
    source = {"position": (0.5, 0.5, 0.4)[: keys.pop("dim", 3)], "rate": 0.0}
    still = {"fluctuation": 0.0, "growth": {"kind": "diffusive", "rate": 0.0}, "species": STILL}
    return PuffGas.model_validate({"kind": "puffs", "sources": [source], "most": 2000} | still | keys)


def moments(gas: PuffSolver, spacing: float) -> tuple[float, np.ndarray, float]:
    """Mass, centre and variance along x of the concentration that sensors meet."""
    axes = [(np.arange(round(length / spacing)) + 0.5) * spacing for length in gas.grid.extent]
    x = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    c = concentration_at(gas, x, 0.0).astype(float)
    volume = spacing**gas.dim * (gas.grid.depth if gas.dim == 2 else 1.0)
    centre = (c[..., None] * x).reshape(-1, gas.dim).sum(axis=0) / c.sum()
    return c.sum() * volume, centre, float((c * (x[..., 0] - centre[0]) ** 2).sum() / c.sum())


@pytest.mark.parametrize("dim", [2, pytest.param(3, marks=pytest.mark.slow)])
def test_a_puff_reads_the_same_before_and_after(dim):
    grid = Grid((24, 20, 16)[:dim], 0.05)
    wind = UniformSolver(UniformWind(kind="uniform", velocity=(0.0,) * dim), grid)
    place, size = np.array([[0.63, 0.51, 0.42]])[:, :dim], 0.06
    keys = {"dim": dim, "initial_size": size, "cutoff": 5}
    puffs = PuffSolver(model(handover=False, **keys), grid, wind, Air.everywhere(grid))
    taken = PuffSolver(model(handover=True, **keys), grid, wind, Air.everywhere(grid))
    for gas in (puffs, taken):
        gas.start_from(place, 1e-6)
        gas.advance(0.0, 1e-3)
    assert (puffs.puffs.count, taken.puffs.count) == (1, 0)
    for gas in (puffs, taken):
        mass, centre, variance = moments(gas, 0.0125)
        assert mass == pytest.approx(1e-6, rel=2e-3)
        assert centre == pytest.approx(place[0], abs=2e-4)
        assert variance == pytest.approx(size**2, rel=2e-2)
    assert taken.budget()["in_domain_kg"] == pytest.approx(1e-6, rel=1e-6)
    np.testing.assert_allclose(taken.cells(0.0).sum() * grid.cell_volume, 1e-6, rtol=1e-6)
    peaks = [float(concentration_at(gas, place, 0.0)[0]) for gas in (puffs, taken)]
    assert peaks[1] == pytest.approx(peaks[0], rel=0.08)


@pytest.mark.parametrize("dim", [2, pytest.param(3, marks=pytest.mark.slow)])
def test_no_gas_gets_behind_walls(dim):
    """Still air; a wall of one cell with a gap, and puffs close to it that reach far beyond."""
    grid = Grid((24, 20, 16)[:dim], 0.05, depth=0.5)
    solid = blocks(grid.shape, np.s_[12, :14])
    air = Air.of(solid, grid)
    wind = PrescribedWind(np.zeros_like, grid)
    gas = PuffSolver(model(dim=dim, initial_size=0.08, handover=True), grid, wind, air)
    rng = np.random.default_rng(0)
    x = rng.random((100, dim)) * (0.2, 0.3, 0.8)[:dim] + (0.38, 0.05, 0.0)[:dim]
    gas.start_from(x, 1e-8)
    gas.advance(0.0, 1e-6)
    assert gas.puffs.count == 0
    assert gas.budget()["outflow_kg"] == 0.0
    assert gas.budget()["in_domain_kg"] == pytest.approx(1e-6, rel=1e-6)
    c = gas.cells(0.0)
    assert np.all(c >= 0.0)
    assert c[solid].max() == 0.0
    assert c[13:, :8].max() < 1e-6 * c.max()  # not to be seen through the gap
    assert c[4:12, :8].min() > 0.0


def test_budget_and_state_of_gas_that_goes_out_through_an_outlet():
    """Emitted is what puffs hold, what the grid holds and what has left by either; a saved run goes on to the bit."""
    grid = Grid((24, 16), 0.05, depth=0.5)
    air = Air.everywhere(grid)
    wind = cfd([TUNNEL[0] | {"speed": 0.5, "turbulence_intensity": 0.2}, TUNNEL[1]])
    source = {"position": (0.2, 0.4), "rate": 1e-5, "radius": 0.02}
    gas_model = model(dim=2).model_copy(
        update={"sources": (type(model().sources[0]).model_validate(source),), "initial_size": 0.06}
    )
    flow = FlowSolver(wind, grid, air)
    gas = PuffSolver(gas_model, grid, flow, air)
    whole, of_flow = State(gas), State(flow)

    def run(begin: int, end: int) -> None:
        march((begin, end), 0.05, flow, gas)

    run(0, 60)
    budget, held = gas.budget(), gas.handover.transport.inside()
    assert budget["emitted_kg"] == pytest.approx(3e-5)
    assert 0.02 < held / budget["in_domain_kg"] < 0.98
    assert budget["outflow_kg"] > 0.2 * budget["emitted_kg"]
    assert abs(missing(gas)) <= 1e-6
    saved = whole.save(), of_flow.save()
    run(60, 80)
    later = gas.cells(4.0), gas.puffs.rows(), gas.budget()
    run(80, 90)
    whole.restore(saved[0])
    of_flow.restore(saved[1])
    run(60, 80)
    np.testing.assert_array_equal(gas.cells(4.0), later[0])
    np.testing.assert_array_equal(gas.puffs.rows(), later[1])
    assert gas.budget() == later[2]


def kolmogorov(dissipation: float, x: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A velocity field at points (..., 3) of waves with E(k) = 1.5 epsilon^(2/3) k^(-5/3), divergence-free, down to a
    length of 0.2 m.
    """
    edges = np.geomspace(1.0, 2.0 * np.pi / 0.2, 121)
    k, width = np.sqrt(edges[1:] * edges[:-1]), np.diff(edges)
    direction = rng.standard_normal((len(k), 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    across = np.cross(direction, rng.standard_normal((len(k), 3)))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    energy = 1.5 * dissipation ** (2 / 3) * k ** (-5 / 3) * width  # of each shell, half the mean square
    phase = x @ (direction * k[:, None]).T + rng.random(len(k)) * 2.0 * np.pi
    return (2.0 * np.sqrt(energy) * np.cos(phase)) @ across


def test_puffs_grow_by_the_dissipation_of_the_turbulence_about_them():
    """Richardson's law in fields of Kolmogorov's spectrum; the mean over fields and places."""
    dissipation, dt, size = 2e-3, 1e-3, 0.01
    grid = Grid((12, 12, 12), 0.05)
    rng, rates = np.random.default_rng(1), []
    for n in range(30):
        wind = PrescribedWind(lambda x, n=n: kolmogorov(dissipation, x, np.random.default_rng(n)), grid)
        wind.nu = grid.field()  # it has eddies, of no viscosity
        puffs = model(initial_size=size, handover=False, growth=None)
        gas = PuffSolver(puffs, grid, wind, Air.everywhere(grid))
        gas.start_from(0.15 + 0.3 * rng.random((50, 3)), 1e-9)
        gas.advance(0.0, dt)
        rates.append((gas.puffs.rows()[:, 6].astype(float) ** (1 / 3) - size ** (2 / 3)).mean() / dt)
    expected = (0.5 * dissipation / 6.0) ** (1 / 3)
    error = np.std(rates) / np.sqrt(len(rates))
    assert error < 0.04 * expected
    assert np.mean(rates) == pytest.approx(expected, rel=0.12)
