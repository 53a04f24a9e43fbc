"""Bouts of a signal: pulses whose number is known, noise, ramps, invariants, and the recursion in plain NumPy."""

import numpy as np
import pytest

from taichi_plume.fluctuations.bouts import (
    HALF_LIFE,
    SMOOTHING,
    amplitudes,
    bouts,
    noise_threshold,
    signal,
    smoothed_derivative,
)
from taichi_plume.scenario.sensors import MoxSensor

STEP = 0.05


def pulses(count, gap=10.0, height=1.0, rise=0.5, decay=2.0, step=STEP, before=5.0):
    """Responses that rise and fall exponentially, `gap` [s] apart."""
    t = np.arange(round((before + count * gap) / step)) * step
    starts = before + gap * np.arange(count)
    age = np.maximum(t[:, None] - starts, 0.0)
    return height * (np.exp(-age / decay) - np.exp(-age / rise)).sum(axis=1)


def test_pulses_are_counted():
    minutes = (5.0 + 12 * 10.0) / 60.0
    found = bouts(STEP, np.stack([pulses(12), pulses(12, rise=0.2), 0.0 * pulses(12)], axis=1))
    np.testing.assert_allclose(found.per_min, [12 / minutes, 12 / minutes, 0.0])
    np.testing.assert_allclose(found.deviation[:1], pulses(12).std())
    assert found.amplitude[1] > found.amplitude[0] > 0.0
    assert np.isnan(found.amplitude[2])


@pytest.mark.parametrize("step", [0.01, 0.05, 0.1, 0.2])
def test_count_and_amplitude_hardly_depend_on_the_step(step):
    (fine,), (here,) = (amplitudes(s, pulses(6, step=s)[:, None]) for s in (0.01, step))
    assert len(here) == 6
    assert here.mean() == pytest.approx(fine.mean(), rel=0.08)


def test_a_constant_and_a_ramp_have_none():
    t = np.arange(2000) * STEP
    flat = np.stack([np.full(2000, 3.7), 0.01 * t, -0.02 * t + 1.0, np.log1p(t)], axis=1)
    assert bouts(STEP, flat).per_min.tolist() == [0.0] * 4


def test_a_cut_bout_does_not_count():
    series = pulses(4, before=5.0)
    begin = round(5.4 / STEP)  # within the first rise
    (found,) = amplitudes(STEP, series[begin:, None])
    assert len(found) == 3


def test_smoothed_derivative_is_that_of_a_plain_recursion():
    rng = np.random.default_rng(2)
    series = rng.normal(size=(300, 2)).cumsum(axis=0)
    width = SMOOTHING / STEP
    reach = int(4.0 * width + 0.5)
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / width) ** 2)
    padded = np.pad(series, ((reach, reach), (0, 0)), mode="edge")
    smooth = np.stack([np.convolve(row, kernel / kernel.sum(), "valid") for row in padded.T], axis=1)
    slope = (smooth[1:] - smooth[:-1]) / STEP
    expected = [slope[0]]
    for value in slope[1:]:
        expected.append(expected[-1] + (1.0 - 2.0 ** (-STEP / HALF_LIFE)) * (value - expected[-1]))
    np.testing.assert_allclose(smoothed_derivative(STEP, series), expected, rtol=1e-10, atol=1e-12)


def test_amplitudes_are_rises_between_extrema():
    rng = np.random.default_rng(5)
    series = rng.normal(size=(400, 1)).cumsum(axis=0)
    slope = smoothed_derivative(STEP, series)[:, 0]
    expected, lowest = [], None
    for k in range(1, len(slope) - 1):
        if slope[k - 1] > slope[k] < slope[k + 1]:
            lowest = slope[k]
        if slope[k - 1] < slope[k] > slope[k + 1] and lowest is not None:
            expected.append(slope[k] - lowest)
    np.testing.assert_allclose(amplitudes(STEP, series)[0], expected)


def test_a_step_response_rises_by_its_closed_form():
    """A step of height h has a derivative h g(t), g the Gaussian; the average of g has a known largest value."""
    fine = 1e-3
    t = np.arange(-3.0, 6.0, fine)
    gauss = np.exp(-0.5 * (t / SMOOTHING) ** 2) / (SMOOTHING * np.sqrt(2.0 * np.pi))
    rate = np.log(2.0) / HALF_LIFE
    age = np.arange(0.0, 6.0, fine)
    largest = np.convolve(gauss, rate * np.exp(-rate * age) * fine).max()
    (found,) = amplitudes(0.01, np.where(np.arange(2000) < 1000, 0.0, 2.5)[:, None])
    assert found == pytest.approx([2.5 * largest], rel=0.01)


def test_time_shift_and_scale():
    rng = np.random.default_rng(3)
    series = np.concatenate([np.zeros(200), rng.normal(size=600).cumsum(), np.zeros(400)])[:, None]
    (found,), (late,) = amplitudes(STEP, series), amplitudes(STEP, np.roll(series, 150, axis=0))
    np.testing.assert_allclose(late, found, rtol=1e-9)
    np.testing.assert_allclose(amplitudes(STEP, 1e4 * series + 17.0)[0], 1e4 * found, rtol=1e-6)
    above = bouts(STEP, 3.0 * series, 3.0 * np.median(found))
    assert above.per_min[0] * len(series) * STEP / 60.0 == pytest.approx((found > np.median(found)).sum())


def test_noise_stays_below_its_threshold():
    """Amplitudes are proportional to the noise; few bouts of another record exceed the threshold."""
    assert noise_threshold(STEP, 0.006) == pytest.approx(2.0 * noise_threshold(STEP, 0.003), rel=1e-9)
    assert noise_threshold(STEP, 0.003, 0.2) > noise_threshold(STEP, 0.003)
    assert noise_threshold(STEP, 0.0) == 0.0
    noise = np.random.default_rng(9).normal(0.0, 0.003, (20_000, 4))
    every, above = bouts(STEP, noise), bouts(STEP, noise, noise_threshold(STEP, 0.003))
    assert (every.per_min > 10.0).all()
    assert (above.per_min < 0.02 * every.per_min).all()


def test_signal_is_the_logarithm_of_the_resistance():
    sensor = MoxSensor(kind="mox", model="mics5524")
    np.testing.assert_allclose(signal(sensor, np.array([0.0, 1.6, 160.0])), 0.644 * np.log([1.0, 2.0, 101.0]))
