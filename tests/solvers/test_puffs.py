import hashlib
import subprocess
import sys

import numpy as np
import pytest
from rooms import TUNNEL, air_in, blocks, cfd, missing
from scipy.stats import chi2

from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.fields import concentration_at
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.state import State
from taichi_plume.scenario.gases import PuffGas
from taichi_plume.scenario.winds import SyntheticWind, UniformWind
from taichi_plume.solvers.flow import FlowSolver
from taichi_plume.solvers.puffs import PuffSolver, joint_update
from taichi_plume.solvers.synthetic_flow import SyntheticSolver
from taichi_plume.solvers.uniform_wind import UniformSolver

pytestmark = pytest.mark.usefixtures("taichi")

SOURCE = {"position": (0.3, 0.5, 0.5), "rate": 1e-5, "radius": 0.02}


def puffs_in(
    shape, velocity=0.0, solid=None, dx=0.05, periodic=(), source=None, seed=0, **keys
) -> PuffSolver:
    """Puffs in a uniform wind along x."""
    dim = len(shape)
    wind = UniformWind(kind="uniform", velocity=(velocity, 0.0, 0.0)[:dim])
    one = SOURCE | (source or {})
    one["position"] = one["position"][:dim]
    model = PuffGas.model_validate({"kind": "puffs", "sources": [one]} | keys)
    grid = Grid(shape, dx, depth=0.5, periodic=periodic)
    return PuffSolver(model, grid, UniformSolver(wind, grid), air_in(grid, solid), 0.0, seed)


def run(gas: PuffSolver, end: float, dt: float, begin: float = 0.0) -> PuffSolver:
    for n in range(round((end - begin) / dt)):
        gas.advance(begin + n * dt, dt)
    return gas


def state(gas: PuffSolver) -> np.ndarray:
    """Place, velocity, variance and mass, (puffs, 2 dim + 2)."""
    return gas.puffs.rows().astype(float)


def points(extent, spacing) -> np.ndarray:
    axes = [(np.arange(round(length / spacing)) + 0.5) * spacing for length in extent]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.slow
def test_the_sum_is_that_of_gaussians_and_their_images(dim):
    """All sizes at once in a closed box; the reference adds up every puff and every image, in NumPy."""
    gas = puffs_in((20, 16, 12)[:dim], release_rate=100, growth={"kind": "diffusive", "rate": 2e-3})
    run(gas, 3.0, 0.1)
    puffs, L = state(gas), np.array(gas.grid.extent)
    rng = np.random.default_rng(0)
    p = rng.random((300, dim)) * L
    p[:100] = puffs[rng.integers(len(puffs), size=100), :dim]
    variance, weight = puffs[:, 2 * dim], puffs[:, 2 * dim + 1] / (2 * np.pi * puffs[:, 2 * dim]) ** (dim / 2)
    weight = weight / chi2.cdf(3.5**2, dim) / (0.5 if dim == 2 else 1.0)
    expected = np.zeros(len(p))
    for image in np.ndindex(*(5,) * dim):
        m = np.array(image) - 2
        q = m * L + np.where(m % 2, L - p, p)
        square = ((q[:, None] - puffs[None, :, :dim]) ** 2).sum(-1)
        inside = square < 3.5**2 * variance
        expected += (inside * weight * np.exp(-0.5 * square / variance)).sum(axis=1)
    computed = concentration_at(gas, p, 3.0)
    np.testing.assert_allclose(computed, expected, rtol=2e-3, atol=1e-5 * expected.max())


@pytest.mark.slow
def test_gas_does_not_leak_through_a_thin_wall():
    solid = blocks((40, 20), 20)
    gas = puffs_in((40, 20), 0.0, solid, release_rate=200, source={"position": (0.8, 0.5)}, fluctuation=0.3)
    run(gas, 5.0, 0.1)
    c = concentration_at(gas, points(gas.grid.extent, 0.025), 5.0)
    assert c[38:40].mean() > 0.0
    assert c[42:].max() == 0.0


@pytest.mark.slow
def test_mass_is_accounted_for_in_a_turbulent_arena():
    shape = (20, 15, 5)
    grid = Grid(shape, 2.0 / shape[0], depth=0.5)
    solid = blocks(shape, np.s_[shape[0] // 3 : shape[0] // 3 + 3, shape[1] // 3 : shape[1] // 2])
    air = Air.of(solid, grid)
    flow = FlowSolver(cfd(TUNNEL), grid, air)
    source = {"position": (0.3, 0.65, 0.25), "rate": 2e-5}
    model = {"kind": "puffs", "sources": [source], "fluctuation": 0.1, "release_rate": 100}
    gas = PuffSolver(PuffGas.model_validate(model), grid, flow, air)
    t = 0.0
    while t < 4.0:
        dt = min(0.1, flow.stable_dt())
        flow.advance(t, dt)
        gas.advance(t, dt)
        t += dt
        x = state(gas)[:, : grid.dim]
        assert np.all((x >= 0.0) & (x <= grid.extent))
        cells = np.minimum((x / grid.dx).astype(int), np.array(shape) - 1)
        assert not solid[tuple(cells.T)].any()
    assert gas.is_finite()
    budget = gas.budget()
    assert budget["emitted_kg"] == pytest.approx(2e-5 * t, rel=1e-9)
    assert 0.1 < budget["outflow_kg"] / budget["emitted_kg"] < 0.9
    assert abs(missing(gas)) <= 1e-6


def test_a_closed_room_keeps_all_however_few_puffs_it_may_have():
    gas = run(puffs_in((20, 20), release_rate=50, most=200, fluctuation=0.1), 20.0, 0.1)
    assert gas.puffs.count <= 200
    assert gas.budget()["outflow_kg"] == 0.0
    assert abs(missing(gas)) <= 1e-6
    assert gas.portions[0].pending <= 0.1 * gas.emitted_kg  # there is room for more


@pytest.mark.parametrize("walled", [False, True])
def test_merging_keeps_mass_middle_and_spread(walled):
    solid = np.zeros((40, 20), bool)
    solid[20, 5:15] = walled
    gas = run(puffs_in((40, 20), 0.2, solid, release_rate=100, source={"position": (0.8, 0.5)}), 3.0, 0.1)

    def moments() -> np.ndarray:
        """Mass, centre and variance about the origin, summed over the axes."""
        puffs = state(gas)
        mass = puffs[:, -1]
        spread = (mass * ((puffs[:, :2] ** 2).sum(axis=1) + 2 * puffs[:, 4])).sum()
        return np.array([mass.sum(), *(mass @ puffs[:, :2]), spread])

    before, count = moments(), gas.puffs.count
    gas.puffs.merge()
    assert gas.puffs.count < 0.8 * count
    np.testing.assert_allclose(moments(), before, rtol=1e-5)
    assert gas.puffs.gone == 0.0


def test_puffs_go_on_from_where_they_were_saved():
    keys = {"release_rate": 400, "poisson": True, "initial_size": 0.02, "species": "acetone", "velocity": 0.3}
    keys |= {"source": {"position": (0.5, 0.4), "rate": 3e-6, "puffing": {"pulse": 0.3, "pause": 0.2}}}
    gas = run(puffs_in((20, 20), most=2000, seed=3, **keys), 1.0, 0.1)
    whole = State(gas)
    saved, at = whole.save(), np.array([[0.7, 0.4], [0.5, 0.5]])
    later, seen = state(run(gas, 2.0, 0.1, 1.0)), concentration_at(gas, at, 2.0)
    budget = gas.budget()
    run(gas, 2.5, 0.1, 2.0)
    whole.restore(saved)
    np.testing.assert_array_equal(state(run(gas, 2.0, 0.1, 1.0)), later)
    np.testing.assert_array_equal(concentration_at(gas, at, 2.0), seen)
    assert gas.budget() == budget
    assert seen.max() > 0.0


def test_puffs_hold_what_their_source_emits():
    puffing = {"pulse": 0.55, "pause": 0.75, "spread": 0.0}
    gas = run(puffs_in((40, 20), 0.1, release_rate=10, source={"puffing": puffing}), 2.6, 0.1)
    mass = np.sort(state(gas)[:, -1])
    assert gas.budget()["emitted_kg"] == pytest.approx(1e-5 * 1.1, rel=1e-6)  # 0.75 to 1.3, 2.05 to 2.6
    assert mass[:2] == pytest.approx(5e-7, rel=1e-3)
    assert mass[2:] == pytest.approx(1e-6, rel=1e-3)
    assert len(mass) == 12


@pytest.mark.parametrize("dt", [0.2, 0.05])
def test_puffs_grow_by_their_laws_whatever_the_step(dt):
    species = {"molar_mass": 0.05, "diffusivity": 2e-5}
    for growth, after in (
        ({"kind": "diffusive", "rate": 3e-4}, 0.01**2 + 3e-4 * 2.0 + 4e-5 * 2.0),
        ({"kind": "inertial", "dissipation": 0.012}, (0.01 ** (2 / 3) + 0.1 * 2.0) ** 3),
    ):
        source = {"stop": 0.2}
        here = species if growth["kind"] == "diffusive" else species | {"diffusivity": 0.0}
        gas = puffs_in((40, 20), 0.1, release_rate=5, growth=growth, species=here, source=source)
        run(gas, 2.2, dt)
        assert state(gas)[:, 4] == pytest.approx(after, rel=1e-5)


def test_two_half_steps_are_one_step():
    """Mean and covariance of u' and its integral: those of the whole step follow from those of two halves."""
    for dt in (1e-4, 0.02, 1.0, 20.0):

        def moments(h):
            a, b, c, d, e, _ = joint_update(np.array([h]), 0.7, 0.3)[0]
            noise = np.array([[b, 0.0], [d, e]])
            return np.array([[a, 0.0], [c, 1.0]]), noise @ noise.T

        step, covariance = moments(dt)
        half, half_covariance = moments(dt / 2)
        np.testing.assert_allclose(half @ half, step, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(half @ half_covariance @ half.T + half_covariance, covariance, rtol=2e-3)


def test_puffs_go_round_a_periodic_axis():
    gas = puffs_in((20, 20), 0.5, periodic=(True, False), release_rate=20, source={"stop": 0.5})
    run(gas, 4.0, 0.1)
    assert gas.budget()["outflow_kg"] == 0.0
    y = np.linspace(0.3, 0.7, 9)
    low, high = (concentration_at(gas, np.column_stack([np.full(9, x), y]), 4.0) for x in (0.0, 1.0))
    np.testing.assert_allclose(low, high, rtol=1e-3)
    c = concentration_at(gas, points((1.0, 1.0), 0.0125), 4.0)
    assert c.sum() * 0.0125**2 * 0.5 == pytest.approx(5e-6, rel=2e-3)


PROGRAM = """
import sys
from taichi_plume.engine import program
sys.path.insert(0, "tests/solvers")
program.start(threads=int(sys.argv[1]))
from test_puffs import digest
print(digest())
"""


def digest() -> str:
    solid = blocks((20, 20), np.s_[8:12, 6:14])
    gas = puffs_in((20, 20), 0.5, solid, release_rate=2000, poisson=True, fluctuation=0.3)
    run(gas, 2.0, 0.1)
    c = concentration_at(gas, points(gas.grid.extent, 0.025), 2.0)
    parts = [state(gas), c, np.array(list(gas.budget().values()))]
    assert gas.budget()["outflow_kg"] > 0.0
    assert gas.puffs.count > 1000  # on more than one thread
    return hashlib.sha256(b"".join(np.ascontiguousarray(part).tobytes() for part in parts)).hexdigest()


@pytest.mark.slow
def test_results_are_the_same_on_one_and_two_threads():
    outputs = [
        subprocess.run(
            [sys.executable, "-c", PROGRAM, str(threads)], capture_output=True, text=True, check=True
        ).stdout.split()[-1]
        for threads in (1, 2)
    ]
    assert outputs[0] == outputs[1]


@pytest.mark.slow
def test_heavy_puffs_sink_and_light_ones_rise():
    heights = []
    for molar_mass in (0.058, 0.002):
        species = {"molar_mass": molar_mass, "diffusivity": 1e-5}
        gas = puffs_in((30, 20, 20), 0.1, species=species, buoyancy=True, fluctuation=0.0)
        run(gas, 3.0, 0.1)
        puffs = state(gas)
        heights.append(np.average(puffs[:, 2], weights=puffs[:, -1]))
    assert heights[0] < 0.49
    assert heights[1] > 0.51


@pytest.mark.parametrize("shape", [(40, 30), (24, 16, 16)])
@pytest.mark.slow
def test_cells_hold_all_that_was_released(shape):
    """Close to a floor and to a box, in a closed room; no cell of the box has any."""
    solid = blocks(shape, np.s_[10:14, 4:9])
    gas = puffs_in(shape, 0.0, solid, source={"position": (0.4, 0.1, 0.1)}, release_rate=100, fluctuation=0.3)
    run(gas, 2.0, 0.1)
    c = gas.cells(2.0)
    inside = gas.budget()["in_domain_kg"] - gas.portions[0].pending
    assert c.astype(float).sum() * gas.grid.cell_volume == pytest.approx(inside, rel=1e-5)
    assert np.all(c[solid] == 0.0)
    assert np.all(c >= 0.0)


@pytest.mark.parametrize("periodic", [(), (False, True, False)])
@pytest.mark.slow
def test_cells_are_means_of_what_is_sampled(periodic):
    """Puffs of many sizes: 4 x 4 x 4 samples per cell; some air goes out at the end."""
    place = {"position": (0.3, 0.1, 0.4)}
    gas = puffs_in((24, 16, 16), 0.2, release_rate=50, initial_size=0.04, source=place, periodic=periodic)
    run(gas, 4.0, 0.1)
    sampled = concentration_at(gas, points(gas.grid.extent, 0.0125), 4.0)
    mean = sampled.reshape(24, 4, 16, 4, 16, 4).mean(axis=(1, 3, 5))
    # a sampled puff ends at 3.5 standard deviations and is 0.7 % denser within
    np.testing.assert_allclose(gas.cells(4.0), mean, atol=0.015 * mean.max())


@pytest.mark.slow
def test_puffs_that_the_air_carries_stay_uniform_beside_a_box():
    grid = Grid((12, 10, 8), 0.1)
    solid = np.zeros(grid.shape, bool)
    solid[4:7, 3:6, :4] = True
    wind = SyntheticSolver(SyntheticWind(kind="synthetic", speed=0.1, longest=0.6), grid, Air.of(solid, grid))
    wind.nu = None
    sources = [{"position": (0.15, 0.15, 0.15), "rate": 0.0}]
    model = PuffGas.model_validate({"kind": "puffs", "sources": sources})
    gas = PuffSolver(model, grid, wind, Air.of(solid, grid))
    x = np.random.default_rng(1).uniform(0.0, grid.extent, (40_000, 3))
    x = x[~solid[tuple((x / grid.dx).astype(int).T)]]
    gas.start_from(x, 1e-9)
    for k in range(300):
        wind.advance(0.1 * k, 0.1)
        gas.advance(0.1 * k, 0.1)
    edges = [np.arange(n + 1) * grid.dx for n in grid.shape]
    number = np.histogramdd(gas.puffs.rows()[:, :3].astype(float), edges)[0][~solid]
    square = ((number - number.mean()) ** 2).sum() / number.mean()
    assert square < chi2.ppf(0.999, number.size - 1)
