"""The particle filter: its weights against a posterior on a grid in f64, and a search in a room with a steady plume."""

import numpy as np
import pytest
from arena import TICK, Run, Script
from hunt import SOURCE, Hunt

from taichi_plume.agents.casting import IN_PLUME, SIDESTEP
from taichi_plume.agents.particle_filter import GO
from taichi_plume.engine import ti
from taichi_plume.grid.kernels import Template
from taichi_plume.scenario.belief_algorithms import ParticleFilter

pytestmark = pytest.mark.usefixtures("taichi")

MODEL = ParticleFilter(
    kind="particle_filter", particles=2000, memory=8.0, roughening=0.0, peak_fraction=0.0, estimates=3
)
PLACES = ((2.2, 1.0), (2.3, 1.2))
SIZE = (3.0, 2.1)
WIND = np.array([0.25, 0.05])
GASES = (1, 1, 0, 1, 0, 0)  # of the updates


class Windy(Script):
    """Gas by the script in an even wind."""

    @ti.func
    def velocity(self, x, t):
        return ti.Vector([WIND[0], WIND[1]])


@pytest.fixture(scope="module")
def run(taichi):
    """Two robots in 30 trials, alike but for their places and random numbers."""
    return Run(MODEL, Windy([0.0], 1.0), positions=PLACES, trials=30, size=SIZE, found="declared")


def likelihood(model, x, places, periods):
    """Of a detection at x for sources at `places` (..., 2), as the docstring has it."""
    missed = np.ones(places.shape[:-1])
    for age in range(periods + 1):
        variance = model.patch**2 + 2 * model.diffusivity * age * model.period
        square = ((x - places - age * model.period * WIND) ** 2).sum(-1)
        density = np.exp(-square / (2 * variance)) / (2 * np.pi * variance)
        missed *= 1 - np.minimum(1, np.pi * model.notice**2 * density)
    return model.false_alarm + (1 - model.false_alarm) * model.detection * (1 - missed)


class Told:
    """Lets each robot stand where it is and smell what is given, update by update."""

    def __init__(self, run):
        self.algorithm, self.swarm = run.algorithm, run.swarm

    def update(self, tick, gas, state=IN_PLUME):
        a = self.algorithm
        for k in range(a.between):
            self.swarm.wind.from_numpy(WIND)
            self.swarm.wind_known.fill(1)
            self.swarm.reading.fill(100.0 if gas else 0.0)
            self.swarm.state.fill(state)
            a._sense(k == a.between - 1, TICK)
        a._weigh(tick)
        a._conclude(tick)


def test_posterior_is_that_of_a_grid(run):
    """Mean and spread of many filters scatter around those of the posterior in closed form, on a grid of 1 cm."""
    run.begin(MODEL)
    reported = Told(run)
    axes = [(np.arange(round(length / 0.01)) + 0.5) * 0.01 for length in SIZE]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), -1)
    posterior = [np.ones(grid.shape[:2]) for _ in PLACES]
    for k, gas in enumerate(GASES, 1):
        reported.update(10 * k, gas)
        for one, x in zip(posterior, PLACES, strict=True):
            hit = likelihood(MODEL, np.array(x), grid, min(k, 8))
            one *= hit if gas else 1 - hit
    mean, spread = reported.algorithm.mean.to_numpy(), reported.algorithm.spread.to_numpy()
    for robot, one in enumerate(posterior):
        one /= one.sum()
        expected = (one[..., None] * grid).sum((0, 1))
        wide = np.sqrt((one * ((grid - expected) ** 2).sum(-1)).sum())
        means, spreads = mean[robot::2], spread[robot::2]
        assert means.mean(0) == pytest.approx(expected, abs=0.02)
        assert np.abs(means - expected).max() < 0.1 < wide, "each of them, of 2,000 particles"
        assert spreads.mean() == pytest.approx(wide, rel=0.04)
    maps = reported.algorithm.beliefs()
    assert maps.sum((1, 2)) == pytest.approx(1.0)
    cells = posterior[0][:, : 10 * maps.shape[2]].reshape(maps.shape[1], 10, maps.shape[2], 10).sum((1, 3))
    assert np.abs(maps[::2].mean(0) - cells).sum() < 0.15


def test_gas_is_gas_beside_what_blocks_the_way_too(run):
    spreads = []
    for state in (IN_PLUME, SIDESTEP):
        run.begin(MODEL)
        reported = Told(run)
        for k in range(1, 4):
            reported.update(10 * k, 1, state)
            assert reported.algorithm.smelt.to_numpy().all()
        spreads.append(reported.algorithm.spread.to_numpy())
    assert (spreads[0] == spreads[1]).all()


def test_before_gas_is_smelt_every_place_is_as_likely(run):
    run.begin(MODEL)
    reported = Told(run)
    reported.update(10, 0)
    maps = reported.algorithm.beliefs()
    np.testing.assert_allclose(maps, 1.0 / maps[0].size)


@ti.kernel
def resample(algorithm: Template, tick: int):
    for _ in range(1):
        algorithm._resample(0, tick)


def test_resampling_is_systematic_and_unbiased(run):
    """Each particle is taken its expected number of times, rounded up or down, and on average exactly so often."""
    run.begin(MODEL)
    algorithm, count = run.algorithm, MODEL.particles
    rng = np.random.default_rng(3)
    weights = rng.random(count).astype(np.float32) ** 4
    weights /= weights.sum()
    places = rng.random((count, 2)).astype(np.float32)
    taken, draws = np.zeros(count), 100
    for tick in range(draws):
        algorithm.particle.from_numpy(places)
        algorithm.weight.from_numpy(weights)
        resample(algorithm, tick)
        order = np.argsort(places[:, 0])
        found = order[np.searchsorted(places[order, 0], algorithm.particle.to_numpy()[0, :, 0])]
        times = np.bincount(found, minlength=count)
        assert (np.abs(times - count * weights) < 1.01).all()
        taken += times
        np.testing.assert_allclose(algorithm.weight.to_numpy()[0], 1.0 / count)
    # a number rounded by chance has a variance of at most 1/4
    assert np.abs(taken / draws - count * weights).max() < 4.5 * 0.5 / np.sqrt(draws)


def test_filters_of_robots_are_their_own(run):
    """Alike robots draw other particles; the same run draws the same."""
    seen = []
    for _ in range(2):
        run.begin(MODEL)
        reported = Told(run)
        reported.update(10, 1)
        reported.update(20, 1)
        seen.append(reported.algorithm.particle.to_numpy())
    np.testing.assert_array_equal(*seen)
    assert (seen[0][0] != seen[0][2]).any()


def test_a_search_that_is_over_learns_no_more(run):
    """Every other robot has had its word; the others go on."""
    run.gas.tell([100.0], 1.0)
    run.begin(MODEL)
    run.go(2)
    before, belief = run.swarm.hits.to_numpy(), run.algorithm.beliefs()
    over = np.arange(run.swarm.count) % 2
    run.swarm.declarations.from_numpy(over)
    run.go(3)
    hits, now = run.swarm.hits.to_numpy(), run.algorithm.beliefs()
    np.testing.assert_array_equal(hits[over == 1], before[over == 1])
    np.testing.assert_array_equal(now[over == 1], belief[over == 1])
    assert (before > 0).all()
    assert (hits > before)[over == 0].all()


@pytest.mark.slow
def test_it_finds_and_declares_the_source_of_a_steady_plume():
    """Beside the casting that it is built on: it reaches as many sources, and says of most where they are."""
    hunt = Hunt("particle_filter")
    (run,) = hunt.search(200.0, 60)
    assert run.found.mean() >= 0.9
    hunt.keys["found"] = "declared"
    (run,) = hunt.search(200.0, 180)
    now = hunt.swarm.snapshot()
    assert (run.states == GO).any()
    assert (now["declarations"] > 0).mean() >= 0.7
    error = np.linalg.norm(now["declared_position"] - SOURCE, axis=-1)
    assert np.nanmedian(error) < 0.3
