"""Kernel DM+V and its kin against the papers' definitions, sample by sample in float64."""

import numpy as np
import pytest
from readers import EXTENT, TRIALS, Stock, centers, feed, same

from taichi_plume.agents.gas_map import Floor
from taichi_plume.agents.kernel_dm import KernelMap
from taichi_plume.scenario import maps as map_models

pytestmark = pytest.mark.usefixtures("taichi")

DT = 0.5
ONE = Floor(EXTENT, 1, 4, DT)  # trial


@pytest.fixture(scope="module")
def stock(taichi):
    return Stock()


def model(**keys):
    return map_models.KernelMap.model_validate({"kind": "kernel_dmv", **keys})


def gaussian(points, row, sigma, gamma):
    """The weight without age of a row's reading at points (n, 2), by the rotated covariance matrix."""
    d, wind = points - row[1:3], row[4:6]
    speed = np.hypot(*wind)
    a, b = sigma + gamma * speed, sigma / (1 + gamma * speed / sigma)
    angle = np.arctan2(wind[1], wind[0])
    R = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    q = np.einsum("ni,ij,nj->n", d, R @ np.diag([a**-2, b**-2]) @ R.T, d)
    return np.exp(-q / 2) * (q < 16)


def literal(rows, shape, cell, sigma=0.25, sigma_omega=5.0, memory=np.inf, gamma=0.0, frozen=()):
    """Mean, variance and confidence in every cell, (nx, ny) each, and all q, of which the first may be given."""
    age = np.exp(-(rows[:, 6].max() - rows[:, 6]) / memory)
    reading = rows[:, 3]
    K = np.array([gaussian(centers(shape, cell), row, sigma, gamma) for row in rows]).T * age
    total = K.sum(axis=1)
    trust = 1 - np.exp(-((total / sigma_omega) ** 2))
    r0 = (age * reading).sum() / age.sum()
    safe = np.where(total > 0, total, np.nan)
    mean = trust * (K @ reading) / safe + (1 - trust) * r0
    i, j = np.minimum(np.floor(rows[:, 1:3] / cell).astype(int), np.array(shape) - 1).T
    q = (reading - mean.reshape(shape)[i, j]) ** 2
    q[: len(frozen)] = frozen
    variance = trust * (K @ q) / safe + (1 - trust) * (age * q).sum() / age.sum()
    return mean.reshape(shape), variance.reshape(shape), trust.reshape(shape), q


@pytest.mark.parametrize(
    "keys",
    [{}, {"memory": 6.0}, {"wind_stretch": 0.25}, {"memory": 10.0, "wind_stretch": 0.4, "sigma_omega": 2.0}],
    ids=["DM+V", "TD", "W", "TD and W"],
)
def test_mean_variance_and_confidence_are_the_papers(stock, keys):
    gas_map = stock.map(KernelMap, model(cell=0.2, sigma=0.15, **keys))
    rows = feed(gas_map, stock.robots(3), 40, DT)
    keys = {("gamma" if name == "wind_stretch" else name): value for name, value in keys.items()}
    assert gas_map.estimate().shape == (TRIALS, 10, 8)
    for trial in range(TRIALS):
        mean, variance, trust, _ = literal(rows[rows[:, 0] == trial], (10, 8), 0.2, 0.15, **keys)
        same(gas_map.estimate()[trial], mean)
        same(gas_map.variance()[trial], variance)
        known = np.isfinite(mean)
        same(gas_map.weight()[trial][known], trust[known])
        assert (gas_map.weight()[trial][~known] == 0).all()


@pytest.mark.parametrize(("memory", "exact"), [(np.inf, 16), (8.0, 16), (8.0, 7)])
def test_readings_that_are_not_kept_have_the_deviation_of_their_last_tick(stock, memory, exact):
    """The definition in float64, with the deviations that readings had when they became older than the latest."""
    keys = {} if memory == np.inf else {"memory": memory}
    gas_map = stock.map(KernelMap, model(cell=0.2, exact=exact, **keys), ONE)
    robots = stock.robots(4, trials=1)
    rows, frozen = np.empty((0, 7)), []

    for tick in range(1, 16):
        robots.wander()
        new = robots.rows(tick * DT)
        if len(rows):
            q = literal(rows, (10, 8), 0.2, memory=memory)[-1]
            frozen += q[len(frozen) : max(len(frozen), len(rows) + len(new) - exact)].tolist()
        gas_map.update(robots, tick * DT, DT)
        rows = np.concatenate([rows, new])
    assert len(frozen) == 45 - exact
    same(gas_map.variance()[0], literal(rows, (10, 8), 0.2, memory=memory, frozen=frozen)[1])


def test_sums_of_a_long_run_are_exact(stock):
    """An hour and more of a steady reading: its mean stays what it is."""
    gas_map, robots = KernelMap(model(exact=10), ONE), stock.robots(5, trials=1, count=250)
    robots.show(robots.where, np.full(250, 12.3))
    for tick in range(1, 801):
        gas_map.update(robots, tick * DT, DT)
    same(gas_map.estimate(), np.full((1, 20, 15), np.float64(np.float32(12.3))), 1e-6)


def test_only_the_variance_knows_how_many_readings_are_kept(stock):
    """A short memory for single readings, and for less than a tick of them: means agree; the variance of readings that
    scatter about a settled mean does to some percent.
    """
    maps = [KernelMap(model(cell=0.25, exact=exact), ONE) for exact in (1000, 60, 2)]
    robots = stock.robots(5, trials=1)
    for tick in range(1, 200):
        robots.wander()
        for one in maps:
            one.update(robots, tick * DT, DT)
    whole, short, least = maps
    same(short.estimate(), whole.estimate())
    same(least.estimate(), whole.estimate())
    same(short.variance(), whole.variance(), 0.05)
    same(least.variance(), whole.variance(), 0.1)
    assert not np.allclose(short.variance(), whole.variance(), rtol=1e-5)
