"""Whiffs and blanks of constructed records, and exponents of durations drawn from power laws."""

import numpy as np
import pytest

from taichi_plume.fluctuations.durations import (
    FEWEST,
    Spells,
    density,
    exponent,
    halfway,
    law,
    pooled,
    range_of,
    spells,
)


def drawn(a, low, high, count, seed=0):
    """Durations of the power law T^-a between two, by inversion, one after the other."""
    u = np.random.default_rng(seed).random(count)
    s = 1.0 - a
    lasted = low * (high / low) ** u if s == 0 else (low**s + u * (high**s - low**s)) ** (1 / s)
    return Spells(np.cumsum(lasted), lasted, 0)


def test_spells_of_a_record_that_is_cut_at_both_ends():
    times = np.arange(10) * 0.5
    present = np.array([1, 1, 0, 0, 0, 1, 1, 0, 1, 0], bool)
    whiffs, blanks = spells(times, present)
    assert whiffs.lasted.tolist() == [1.0, 0.5]
    assert whiffs.begin.tolist() == [2.25, 3.75]
    assert blanks.lasted.tolist() == [1.5, 0.5]
    assert (whiffs.cut, blanks.cut) == (1, 1)


@pytest.mark.parametrize("value", [True, False])
def test_a_record_without_a_change_holds_none(value):
    whiffs, blanks = spells(np.arange(5.0), np.full(5, value))
    assert not len(whiffs.lasted)
    assert not len(blanks.lasted)
    assert (whiffs.cut, blanks.cut) == (int(value), int(not value))


def test_time_in_whiffs_and_blanks_is_the_record_s_whatever_the_steps():
    rng = np.random.default_rng(3)
    times = np.cumsum(rng.uniform(0.01, 0.2, 5000))
    present = np.repeat(rng.random(500) < 0.4, 10)
    present[0], present[-1] = True, False  # both ends are cut
    whiffs, blanks = spells(times, present)
    first, last = np.argmin(present), len(present) - np.argmax(present[::-1])
    ends = 0.5 * (times[1:] + times[:-1])
    assert whiffs.lasted.sum() + blanks.lasted.sum() == pytest.approx(ends[last - 1] - ends[first - 1])


@pytest.mark.parametrize("a", [0.5, 1.0, 1.5, 2.2])
def test_exponent_of_a_power_law(a):
    """Its standard error, by the Fisher information of the law, is that of the mean logarithm."""
    low, high, count = 0.2, 20.0, 4000
    found = exponent(drawn(a, low, high, count), low * 0.999, high * 1.001)
    x = np.linspace(0, np.log(high / low), 20001)
    weight = np.exp((1 - a) * x)
    mean = (x * weight).sum() / weight.sum()
    error = 1 / np.sqrt(count * ((x - mean) ** 2 * weight).sum() / weight.sum())
    assert found.value == pytest.approx(a, abs=4 * error)
    assert found.high - found.low == pytest.approx(2 * 1.96 * error, rel=0.3)
    assert found.distance < 0.03
    assert found.decades == pytest.approx(2, abs=0.01)


def test_durations_that_are_no_power_law_are_known():
    lasted = np.random.default_rng(0).exponential(3.0, 3000)
    found = exponent(Spells(np.cumsum(lasted), lasted, 0), 0.3, 30.0)
    assert found is not None
    assert not found.is_law
    same = exponent(drawn(1.5, 0.3, 30.0, 3000), 0.2999, 30.01)
    assert same is not None
    assert same.is_law


def test_the_interval_holds_the_truth_as_often_as_it_says():
    inside = 0
    for seed in range(60):
        found = exponent(drawn(1.5, 1.0, 30.0, 300, seed), 1.0 - 1e-9, 30.0 + 1e-9)
        inside += found.low <= 1.5 <= found.high
    assert inside >= 50  # 57 are expected; of 1 - 2e-4


def test_the_law_is_the_integral_of_its_density():
    t = np.geomspace(0.5, 50, 20001)
    for a in (0.3, 1.0, 1.5, 3.0):
        p = t**-a
        whole = np.concatenate([[0], np.cumsum(0.5 * (p[1:] + p[:-1]) * np.diff(t))])
        np.testing.assert_allclose(law(a, 0.5, 50, t), whole / whole[-1], atol=1e-6)


def test_durations_in_steps_are_taken_for_what_they_stand_for():
    """Rounded to multiples of a step, the exponent stays; its range ends between what can occur."""
    step, a = 0.1, 1.5
    true = drawn(a, 0.04, 60.0, 200_000)
    steps = np.round(true.lasted / step) * step
    found = exponent(Spells(true.begin, steps, 0), halfway(0.5, step), halfway(20.0, step))
    assert found.value == pytest.approx(a, abs=0.02)


def test_the_range_begins_where_the_power_law_does():
    """Below 1 s exponential, above a power law: the range is in the power law."""
    tail = drawn(1.5, 1.0, 100.0, 6000, 1)
    short = np.random.default_rng(2).uniform(0.02, 1.0, 12000)
    lasted = np.concatenate([tail.lasted, short])
    found = Spells(np.arange(len(lasted), dtype=float), lasted, 0)
    chosen = range_of(found, 0.01, last=100.0)
    assert chosen is not None
    first, last = chosen
    assert 0.8 < first < 5
    assert last == pytest.approx(100, rel=0.02)
    assert exponent(found, first, last).value == pytest.approx(1.5, abs=0.1)


def test_too_few_durations_tell_nothing():
    few = drawn(1.5, 1.0, 10.0, FEWEST - 1)
    assert exponent(few, 0.5, 20.0) is None
    assert range_of(few, 0.01) is None
    assert range_of(Spells(np.arange(50.0), np.full(50, 0.3), 0), 0.1) is None
    assert len(pooled([]).lasted) == 0


def test_density_of_a_uniform_distribution():
    lasted = np.random.default_rng(0).uniform(1, 9, 200_000)
    t, p, count = density(lasted)
    assert count.sum() == len(lasted)
    np.testing.assert_allclose(p[5:-1], 1 / 8, rtol=0.06)
    t, p, count = density(np.round(lasted, 1), 0.1)
    assert count.sum() == len(lasted)
    np.testing.assert_allclose(p[2:-2], 1 / 8, rtol=0.06)
    assert (np.diff(t) > 0).all()
