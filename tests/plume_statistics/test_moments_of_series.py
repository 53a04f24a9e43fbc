"""Moments, intermittency, fits, spectra and length scales against distributions and processes of closed form."""

import numpy as np
import pytest
from scipy import stats

from taichi_plume.fluctuations.fits import fits
from taichi_plume.fluctuations.moments import moments, quantiles, weights, wind
from taichi_plume.fluctuations.space import correlation, gaussian_fit
from taichi_plume.fluctuations.spectra import (
    autocorrelation,
    evenly,
    integral_time,
    is_even,
    spectrum,
    to_first_zero,
)


def clipped_gamma(share, shape, scale, size, seed=0):
    """Independent samples that are a gamma variable with a probability, zero otherwise."""
    rng = np.random.default_rng(seed)
    return np.where(rng.random(size) < share, rng.gamma(shape, scale, size), 0.0)


def process(step, tau, size, points=1, seed=0):
    """An Ornstein-Uhlenbeck process of unit variance, exact at its times."""
    rng = np.random.default_rng(seed)
    x, out, keep = rng.standard_normal(points), np.empty((size, points)), np.exp(-step / tau)
    for n in range(size):
        out[n] = x
        x = keep * x + np.sqrt(1 - keep**2) * rng.standard_normal(points)
    return out


def test_moments_of_a_clipped_gamma():
    share, shape, scale, size = 0.3, 1.4, 5.0, 200_000
    c = clipped_gamma(share, shape, scale, (size, 2))
    found = moments(np.arange(size) * 0.01, c, 1e-6)
    mean, square = share * shape * scale, share * shape * (shape + 1) * scale**2
    fourth = share * scale**4 * shape * (shape + 1) * (shape + 2) * (shape + 3)
    np.testing.assert_allclose(found["mean"], mean, atol=4 * np.sqrt((square - mean**2) / size))
    np.testing.assert_allclose(
        found["rms"] ** 2 + found["mean"] ** 2, square, atol=4 * np.sqrt((fourth - square**2) / size)
    )
    np.testing.assert_allclose(found["intermittency"], share, atol=4 * np.sqrt(share * (1 - share) / size))
    np.testing.assert_allclose(found["conditional_mean"], shape * scale, rtol=0.02)
    exact = stats.gamma.ppf(1 - 0.01 / share, shape, scale=scale)
    np.testing.assert_allclose(found["peak99"] * found["mean"], exact, rtol=0.03)
    assert (found["maximum"] == c.max(axis=0)).all()


def test_uneven_steps_count_for_the_time_that_they_last():
    """A record with a dense second half has the moments of the even one."""
    rng = np.random.default_rng(1)
    times = np.sort(np.concatenate([np.linspace(0, 50, 2001), 50 + 50 * rng.random(20_000), [100.0]]))
    c = (2 + np.sin(times))[:, None]
    found = moments(times, c, 2.0)
    assert found["mean"][0] == pytest.approx(2 + (1 - np.cos(100)) / 100, abs=1e-4)
    t = np.linspace(0, 100, 1_000_001)
    assert found["intermittency"][0] == pytest.approx((np.sin(t) > 0).mean(), abs=1e-3)
    assert weights(times).sum() == pytest.approx(1)
    assert quantiles(c, weights(times), (0.5,))[0, 0] == pytest.approx(np.median(2 + np.sin(t)), abs=0.01)


def test_nothing_smelt_has_no_ratios():
    found = moments(np.arange(10.0), np.zeros((10, 1)), 1.0)
    assert found["mean"][0] == found["rms"][0] == found["intermittency"][0] == 0
    assert np.isnan([found[name][0] for name in ("intensity", "conditional_mean", "peak")]).all()


def test_wind():
    rng = np.random.default_rng(0)
    u = np.stack([1.0 + 0.2 * rng.standard_normal(50_000), 0.1 * rng.standard_normal(50_000)], -1)[:, None]
    found = wind(np.arange(50_000) * 0.1, u)
    assert found["mean_u"][0] == pytest.approx(1, abs=0.005)
    assert found["rms_v"][0] == pytest.approx(0.1, rel=0.02)
    assert found["turbulence_intensity"][0] == pytest.approx(np.sqrt((0.04 + 0.01) / 2), rel=0.02)


def test_fits_tell_gamma_from_lognormal():
    rng = np.random.default_rng(0)
    gamma, lognormal = fits(rng.gamma(2.5, 3.0, 50_000))
    assert (gamma.kind, lognormal.kind) == ("gamma", "lognorm")
    assert gamma.shape == pytest.approx(2.5, rel=0.03)
    assert gamma.scale == pytest.approx(3.0, rel=0.03)
    assert gamma.distance < 0.01 < lognormal.distance
    gamma, lognormal = fits(np.exp(1.0 + 0.5 * rng.standard_normal(50_000)))
    assert lognormal.shape == pytest.approx(0.5, rel=0.02)
    assert lognormal.scale == pytest.approx(np.e, rel=0.02)
    assert lognormal.distance < 0.01 < gamma.distance
    steady = 1.0 + 1e-7 * rng.standard_normal(1000)
    assert fits(np.ones(1000)) == fits(np.arange(5.0)) == fits(steady) == []


def test_spectrum_and_integral_scale_of_an_ornstein_uhlenbeck_process():
    """S(f) = 4 tau / (1 + (2 pi f tau)²) of unit variance; its integral scale is tau."""
    step, tau = 0.02, 0.5
    x = process(step, tau, 100_000, points=8)
    f, s = spectrum(step, x)
    low = (f > 0.1 / tau / 6) & (f < 3.0)  # well below where samples fold
    np.testing.assert_allclose(
        np.log(s.mean(axis=1)[low] / (4 * tau / (1 + (2 * np.pi * f[low] * tau) ** 2))), 0, atol=0.45
    )
    ratio = (s.mean(axis=1)[low] / (4 * tau / (1 + (2 * np.pi * f[low] * tau) ** 2))).mean()
    assert ratio == pytest.approx(1, abs=0.03)
    assert s.mean(axis=1).sum() * f[0] == pytest.approx(1, abs=0.1)
    scales = [integral_time(step, one) for one in x.T]
    assert np.mean(scales) == pytest.approx(tau, rel=0.08)
    np.testing.assert_allclose(autocorrelation(x[:, 0])[:25], np.exp(-np.arange(25) * step / tau), atol=0.06)


def test_uneven_times_are_made_even():
    times = np.sort(np.random.default_rng(0).random(4001)) * 10
    step, x = evenly(times, np.stack([times, 3 - 2 * times], -1))
    assert not is_even(times)
    assert step == pytest.approx(np.ptp(times) / 4000)
    np.testing.assert_allclose(x[:, 0], times[0] + step * np.arange(4001), atol=1e-9)
    np.testing.assert_allclose(x[:, 1], 3 - 2 * x[:, 0], atol=1e-9)
    same = np.random.default_rng(0).random((50, 2))
    assert evenly(np.arange(50) * 0.1, same)[1] is same


def test_correlation_length_of_a_field_of_known_length():
    """Along a line a field with the correlation exp(-r/L) is an Ornstein-Uhlenbeck process in place of time."""
    spacing, length = 0.05, 0.3
    field = process(spacing, length, 120, points=6000).T  # (times, points)
    r = correlation(field)
    np.testing.assert_allclose(r[:12], np.exp(-np.arange(12) * spacing / length), atol=0.03)
    found, whole = to_first_zero(spacing, r)
    assert found == pytest.approx(length, rel=0.1)
    assert whole
    mean = 5 + np.linspace(0, 20, 120)  # a mean that differs from point to point counts for nothing
    assert to_first_zero(spacing, correlation(field * 3 + mean))[0] == pytest.approx(found)
    assert not len(correlation(np.ones((10, 5))))


def test_gaussian_profile():
    rng = np.random.default_rng(0)
    y = np.linspace(-1, 2, 61)
    exact = 7 * np.exp(-((y - 0.4) ** 2) / (2 * 0.25**2))
    found = gaussian_fit(y, exact + 0.05 * rng.standard_normal(61))
    assert found.centre == pytest.approx(0.4, abs=0.01)
    assert found.width == pytest.approx(0.25, rel=0.03)
    assert found.peak == pytest.approx(7, rel=0.03)
    assert found.share > 0.99
    assert gaussian_fit(y, np.zeros(61)) is None
    assert gaussian_fit(y, np.ones(61)) is None
