from math import nan

import numpy as np
import pytest
from scipy.special import stdtrit

from taichi_plume.validation.case import Curve
from taichi_plume.validation.experiment import (
    Condition,
    Experiment,
    Mean,
    Range,
    Row,
    deviation_over_airs,
    examine,
    over_airs,
    ratio_over_airs,
)

pytestmark = pytest.mark.usefixtures("idle")

LINE = Curve("x", "y", np.zeros(2), np.zeros(2), np.zeros(2))


@pytest.mark.parametrize(
    ("expected", "text", "met", "not_met"),
    [
        (Range(least=0.95), ">= 0.95", 0.95, 0.94),
        (Range(most=30.0), "<= 30", 29.0, 31.0),
        (Range(2.0, 3.0), "2 to 3", 2.5, 3.5),
        (Range(least=0.0), ">= 0", 0.0, nan),
        (Range(least=0.0), ">= 0", 0.0, None),
    ],
)
def test_the_verdict_is_of_the_mean(expected, text, met, not_met):
    verdicts = [Row("", "", Mean(mean, 0.0, 100.0, 10), "", expected).met for mean in (met, not_met)]
    assert (str(expected), verdicts) == (text, [True, False])


@pytest.mark.parametrize(
    ("low", "high", "refuted"),
    [(0.4, 0.96, False), (0.4, 0.94, True), (None, None, True), (nan, nan, False)],
)
def test_few_trials_refute_only_what_their_interval_leaves_out(low, high, refuted):
    assert Row("", "", Mean(0.7, low, high, 4), "", Range(least=0.95)).refuted is refuted
    assert Row("", "", Mean(0.7, low, high, 4), "", None).refuted is False


def of(**keys):
    reported = {"time [s]": Mean(30.0, 28.0, 32.0, 5), "ways": LINE}
    calls = []
    condition = Condition("calm", lambda n: calls.append(n) or reported, **keys)
    return Experiment("made_up", "", "", (condition,), evidence="measured"), calls


def test_every_quantity_of_a_condition_makes_a_row():
    experiment, calls = of(published={"time [s]": "29 s"}, expected={"time [s]": Range(most=31.0)})
    (row,), pictures = examine(experiment, 5)
    assert calls == [5]
    assert (row.condition, row.quantity, row.published, row.met) == ("calm", "time [s]", "29 s", True)
    assert pictures == {"ways": LINE}


@pytest.mark.parametrize("where", ["published", "expected"])
def test_what_is_expected_of_no_quantity_is_refused(where):
    experiment, _ = of(**{where: {"pace": Range() if where == "expected" else "1"}})
    with pytest.raises(KeyError, match="pace"):
        examine(experiment, 5)


def test_ratios_of_means_have_an_interval():
    rng = np.random.default_rng(0)
    a, b = rng.normal(30.0, 3.0, 400), rng.normal(10.0, 1.0, 400)
    found = ratio_over_airs(a, b)
    assert found.mean is not None
    assert found.mean == pytest.approx(a.mean() / b.mean())
    # the relative variances of the means add up
    half = 1.96 * found.mean * np.hypot(a.std() / a.mean(), b.std() / b.mean()) / 20.0
    assert found.low == pytest.approx(found.mean - half, rel=0.01)
    assert found.high == pytest.approx(found.mean + half, rel=0.01)


def test_ratios_of_pairs_know_that_they_are_pairs():
    reference = np.random.default_rng(3).uniform(1.0, 50.0, 12)
    found = ratio_over_airs(0.8 * reference, reference)
    assert (found.mean, found.low, found.high) == pytest.approx((0.8, 0.8, 0.8))
    assert ratio_over_airs(np.array([3.0]), np.array([2.0])) == Mean(1.5, None, None, 1, airs=1)


def test_trials_in_one_air_count_as_one():
    """Of airs that differ far more than their trials, the interval is that of the airs' means."""
    means = np.random.default_rng(5).normal(30.0, 4.0, 12)
    airs = np.repeat(np.arange(12), 20)
    values = means[airs] + np.random.default_rng(6).normal(0.0, 0.1, 240)
    found = over_airs(values, airs)
    assert (found.n, found.airs) == (240, 12)
    assert found.low is not None
    assert found.high is not None
    half = stdtrit(11, 0.975) * means.std(ddof=1) / np.sqrt(12)
    assert found.high - found.low == pytest.approx(2 * half, rel=0.15)
    assert over_airs(np.array([nan]), np.zeros(1)).mean is None


def test_ratios_over_airs_pair_them():
    """What airs have in common cancels: here the ratio is the same in all of them."""
    airs = np.repeat(np.arange(9), 10)
    level = np.random.default_rng(7).uniform(1.0, 20.0, 9)[airs]
    found = ratio_over_airs(1.5 * level, level[:50], airs, airs[:50])
    assert (found.mean, found.airs) == (pytest.approx(1.5), 5)
    assert (found.low, found.high) == pytest.approx((1.5, 1.5))
    assert ratio_over_airs(level[:20], level[:20], airs[:20], airs[:20]).low is None


def test_deviations_have_an_interval_over_airs():
    """Normal trials have the interval of chi-square; trials that are equal in an air have that of the airs."""
    rng = np.random.default_rng(2)
    values, airs = rng.normal(1e3, 3.0, 2000), np.arange(2000) % 200
    found = deviation_over_airs(values, airs)
    assert (found.mean, found.n, found.airs) == (pytest.approx(values.std(ddof=1)), 2000, 200)
    half = 1.96 * 3.0 / np.sqrt(2 * 2000)
    assert found.low == pytest.approx(found.mean - half, abs=0.3 * half)
    assert found.high == pytest.approx(found.mean + half, abs=0.3 * half)
    alike = deviation_over_airs(rng.normal(1e3, 3.0, 200)[airs], airs)
    assert alike.low is not None
    assert alike.high is not None
    assert alike.high - alike.low == pytest.approx(2 * half * np.sqrt(10), rel=0.3)


def test_deviations_of_few_airs_have_no_interval():
    assert deviation_over_airs(np.array([1.0, 3.0]), np.array([0, 1])) == Mean(np.sqrt(2.0), None, None, 2, 2)
    assert deviation_over_airs(np.array([1.0]), np.array([0])) == Mean(None, None, None, 1, 1)
