"""Posterior of source terms: likelihoods, the prior without data, a grid as reference, coverage, several sources."""

from typing import Any

import numpy as np
import pytest
from scipy import stats
from scipy.special import digamma

from taichi_plume.agents import source_posterior
from taichi_plume.agents.dispersion import Dispersion
from taichi_plume.agents.source_posterior import Rates, SourcePosterior, exceedance, log_likelihood

SHAPE, CELL, RATES = (24, 16), 0.2, Rates(1e-7, 1e-4)
FLOOR, PER_RATE = 1.0, 4e5  # ppm; ppm per kg/m³
M0 = source_posterior.MODEL_SHAPE


def law(mean, shape):
    """Ratio of a gamma and an inverse gamma variable whose geometric mean is 1."""
    return stats.betaprime(shape, M0, scale=mean * np.exp(digamma(M0)) / shape)


def wind_tunnel():
    wind = np.zeros((*SHAPE, 2))
    wind[..., 0] = 0.4
    return Dispersion(wind, CELL, diffusivity=0.02, depth=0.5)


def responses(places):
    model = wind_tunnel()
    return PER_RATE * model.adjoint(np.stack([model.at(place) for place in places]))[None]


def readings(places, sources, rng, shape=1.0):
    """Readings at points of sources (place, rate) by the law of the likelihood, and their responses."""
    response = responses(places)
    cells = [tuple((np.array(place) / CELL).astype(int)) for place, _ in sources]
    mean = sum(rate * response[0][:, *cell] for cell, (_, rate) in zip(cells, sources, strict=True)) + FLOOR
    return law(mean, shape).rvs(random_state=rng) - FLOOR, response


def posterior(seed=1, prior=None, rates=RATES, **keys: Any):
    prior = np.ones(SHAPE) if prior is None else prior
    usual: dict[str, Any] = {"floor": FLOOR, "correlation": 1e-3}
    return SourcePosterior(prior, np.zeros(2), CELL, rates, np.random.default_rng(seed), **(usual | keys))


@pytest.mark.parametrize("shape", [0.3, 1.0, 5.0])
def test_laws_of_readings_and_of_hits(shape):
    reading, mean = np.array([0.5, 3.0, 40.0]), np.array([2.0, 2.0, 20.0])
    known = law(mean, shape)
    assert log_likelihood(reading, mean, np.array(shape)) == pytest.approx(known.logpdf(reading))
    assert exceedance(3.0, mean, np.array(shape)) == pytest.approx(known.sf(3.0))


def test_particles_without_data_follow_the_prior():
    """Moves leave the prior as it is: numbers, places by the map, rates."""
    prior = np.zeros(SHAPE)
    prior[4:8, 3:9], prior[15:20, 3:9] = 1.0, 3.0
    believed = posterior(prior=prior, particles=4000, most=3)
    for _ in range(5):
        believed._move(np.zeros(0))
    number = np.bincount(believed.particles.number, minlength=4)[1:] / 4000
    assert number == pytest.approx([16 / 21, 4 / 21, 1 / 21], abs=0.04)
    p = believed.probability()
    assert p[15:20, 3:9].sum() == pytest.approx(90 / 114, abs=0.04)
    assert p[prior == 0.0].sum() == 0.0
    log_rate = believed.particles.log_rate[:, 0]
    assert stats.kstest(log_rate, stats.uniform(np.log(1e-7), np.log(1e3)).cdf).statistic < 0.05


def test_grid_of_places_and_rates_as_reference():
    """The marginal of the place and the mean log rate are those of a sum over a fine grid of all parameters."""
    rng = np.random.default_rng(4)
    places = rng.uniform((1.5, 0.2), (4.6, 3.0), (12, 2))
    reading, response = readings(places, [((0.9, 1.3), 2e-5)], rng)
    believed = posterior(particles=4000)
    believed.learn(places, reading, response)
    log_rate = np.linspace(np.log(1e-7), np.log(1e-4), 80)
    log_shape = np.linspace(-2.0, 2.0, 25)
    shape_weight = stats.norm(source_posterior.SHAPE_MEAN, source_posterior.SHAPE_SPREAD).logpdf(log_shape)
    mean = np.exp(log_rate)[:, None, None] * response[0].reshape(12, 1, -1).transpose(1, 0, 2) + FLOOR
    terms = [
        law(mean, np.exp(s)).logpdf((reading + FLOOR)[:, None]).sum(axis=1) + w
        for s, w in zip(log_shape, shape_weight, strict=True)
    ]
    density = np.exp(np.array(terms) - np.max(terms)).sum(axis=0)  # (rates, cells)
    density /= density.sum()
    expected = density.sum(axis=0).reshape(SHAPE)
    p = believed.probability()
    x, y = np.indices(SHAPE) * CELL
    for coordinate in (x, y, x**2, y**2):
        assert (p * coordinate).sum() == pytest.approx((expected * coordinate).sum(), abs=0.12)
    got = believed.particles.log_rate[:, 0].mean()
    assert got == pytest.approx((density.sum(axis=1) * log_rate).sum(), abs=0.12)


def test_intervals_cover_what_they_state():
    """Sources drawn from the prior lie in the intervals of 90 % as often (Cook, Gelman & Rubin 2006)."""
    covered = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        place, rate = rng.uniform((0, 0), np.array(SHAPE) * CELL), np.exp(rng.uniform(*np.log([1e-7, 1e-4])))
        at = rng.uniform((0.1, 0.1), (4.7, 3.1), (15, 2))
        reading, response = readings(
            at, [(place, rate)], rng, np.exp(rng.normal(0.0, source_posterior.SHAPE_SPREAD))
        )
        believed = posterior(seed, particles=400)
        believed.learn(at, reading, response)
        (best,) = believed.estimates()
        covered.append(best.low <= rate <= best.high)
    assert stats.binomtest(sum(covered), len(covered), 0.9).pvalue > 0.01


def test_two_sources_are_distinguished():
    rng = np.random.default_rng(6)
    sources = [((0.9, 0.7), 3e-5), ((1.5, 2.5), 2e-5)]
    at = rng.uniform((0.6, 0.1), (4.6, 3.1), (50, 2))
    reading, response = readings(at, sources, rng, 4.0)
    believed = posterior(rates=Rates(5e-6, 1e-4), particles=1000, most=3)
    for k in (5, 10, 20, 35, 50):
        believed.learn(at[:k], reading[:k], response[:, :k])
    estimates = believed.estimates()
    assert estimates[1].probability > 0.95  # of at least two sources
    for place, rate in sources:
        best = min(estimates, key=lambda each: np.linalg.norm(each.place - place))
        assert np.linalg.norm(best.place - place) < 2.0 * best.spread
        assert best.low < rate < best.high


@pytest.mark.parametrize("samples", [1, 10])
def test_hits_and_counts(samples):
    """Binomial counts of samples above a threshold find the source, too."""
    rng = np.random.default_rng(3)
    at = rng.uniform((0.6, 0.1), (4.6, 3.1), (60, 2))
    response = responses(at)
    mean = 3e-5 * response[0][:, 4, 6] + FLOOR
    counts = rng.binomial(samples, law(mean, 1.0).sf(5.0 + FLOOR))
    believed = posterior(threshold=5.0)
    believed.learn(at, counts, response, samples)
    assert believed.estimates()[0].place == pytest.approx([0.9, 1.3], abs=0.5)


def test_ruled_out_cells_hold_no_source():
    believed = posterior()
    there = np.zeros(SHAPE, bool)
    there[10:] = True
    believed.rule_out(there)
    at = np.array([[2.0, 1.0]])
    believed.learn(at, np.array([20.0]), responses(at))
    assert believed.probability()[there].sum() == 0.0
    believed.rule_out(~there)  # nothing would be left
    assert believed.prior.sum() == pytest.approx(1.0)


def test_measurements_at_the_same_point_count_as_one():
    believed = posterior(correlation=0.4)
    believed.at = np.array([[1.0, 1.0], [1.0, 1.0], [4.0, 1.0]])
    assert believed.weights() == pytest.approx([0.5, 0.5, 1.0])


def test_log_normal_rates():
    rates = Rates(0.0, np.inf, 1e-5, 3.0)
    drawn = rates.draw(np.random.default_rng(1), (4000,))
    assert stats.kstest(drawn, stats.norm(np.log(1e-5), np.log(3.0)).cdf).statistic < 0.03
    known = stats.norm(np.log(1e-5), np.log(3.0)).logpdf(drawn)
    assert np.ptp(rates.log_density(drawn) - known) < 1e-9
