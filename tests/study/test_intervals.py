import numpy as np
import pytest
import scipy.stats

from taichi_plume.studies import intervals
from taichi_plume.studies.intervals import Estimate, estimates, words

WITHIN_AIRS = 0.3  # correlation of searches in one air


def searches(seed: int, studies: int, airs: int, each: int, rate: float) -> np.ndarray:
    """Success of searches, (studies, airs, each), beta-binomial."""
    rng = np.random.default_rng(seed)
    spread = (1 - WITHIN_AIRS) / WITHIN_AIRS
    chance = rng.beta(rate * spread, (1 - rate) * spread, (studies, airs))
    return (rng.random((studies, airs, each)) < chance[..., None]).astype(float)


def estimated(
    values: np.ndarray, share: bool = True, by_chance: bool = True, limits=(-np.inf, np.inf)
) -> list[Estimate]:
    """Of values (studies, airs, each)."""
    studies, airs, each = values.shape
    keys = np.repeat(np.arange(studies), airs * each)
    air = np.tile(np.repeat(np.arange(airs), each), studies)
    reported = estimates(values.ravel(), keys, air, np.full(values.size, by_chance), share, limits)
    return [reported[key] for key in range(studies)]


def covered(made: list[Estimate], truth: float) -> float:
    return float(np.mean([one.low <= truth <= one.high for one in made]))


@pytest.mark.slow
@pytest.mark.parametrize("each", [1, 5, 20])
@pytest.mark.parametrize("airs", [3, 5, 10, 30])
def test_intervals_cover_the_truth_as_often_as_they_say(airs, each):
    """Where an interval that takes searches for independent does not."""
    rates = (0.1, 0.3, 0.5, 0.7, 0.9)
    shares, means, naive = [], [], []
    for n, rate in enumerate(rates):
        found = searches(n, 400, airs, each, rate)
        shares.append(covered(estimated(found), rate))
        k = found.sum(axis=(1, 2)).astype(int)
        wilson = [scipy.stats.binomtest(one, airs * each).proportion_ci(method="wilson") for one in k]
        naive.append(np.mean([low <= rate <= high for low, high in wilson]))
        rng = np.random.default_rng(n)
        times = np.where(
            found > 0, rng.gamma(4.0, 5.0, found.shape), 60.0
        )  # s: failures count as the whole run
        reported = estimated(times, share=False, limits=(0.0, 60.0))
        means.append(covered([one for one in reported if np.isfinite(one.low)], 20 * rate + 60 * (1 - rate)))
    few = airs < intervals.FEWEST
    assert 0.90 <= np.mean(shares) <= (1.0 if few else 0.975)
    assert 0.88 <= np.mean(means) <= 0.985
    assert min(shares) > 0.84
    if each >= 5:
        assert np.mean(naive) < (0.88 if each == 5 else 0.62)


def test_a_point_is_bootstrapped_as_scipy_does_it():
    """With sums and counts given in pairs, at the level that Student's t asks for."""
    found = searches(0, 1, 12, 7, 0.4)
    found[0, 3, 2:] = np.nan  # runs that failed: airs of unequal weight
    (one,) = estimated(found)
    sums, counts = np.nansum(found[0], axis=1), np.isfinite(found[0]).sum(axis=1)
    reported = scipy.stats.bootstrap(
        (sums, counts), lambda s, c, axis=-1: s.sum(axis=axis) / c.sum(axis=axis), paired=True,
        confidence_level=intervals.confidence(12), n_resamples=30_000, method="BCa", rng=1,
    ).confidence_interval  # fmt: skip
    assert one.mean == sums.sum() / counts.sum()
    assert (one.n, one.airs, one.over) == (79, 12, "airs")
    assert (one.low, one.high) == pytest.approx(reported, abs=0.02)


def test_many_points_at_once_are_each_by_itself():
    found = searches(3, 40, 8, 3, 0.5)
    together = estimated(found)
    for n in (0, 7, 39):
        assert together[n] == estimated(found[n : n + 1])[0]
    values, keys = found.reshape(40, 24).T.ravel(), np.tile(np.arange(40), 24)  # searches in any order
    mixed = estimates(
        values, keys, np.repeat(np.repeat(np.arange(8), 3), 40), np.full(values.size, True), True
    )
    assert [mixed[n] for n in range(40)] == together


def test_many_airs_are_quick():
    (one,) = estimated(searches(5, 1, 4000, 2, 0.3))
    assert 0.02 < one.high - one.low < 0.03
    assert one.low < one.mean < one.high


def test_the_level_is_that_of_students_t():
    """A mean of few normal values is covered as often as said: their own percentiles would do so far less often."""
    rng = np.random.default_rng(0)
    values = rng.normal(3.0, 1.0, (1500, 6, 1))
    assert covered(estimated(values, share=False), 3.0) == pytest.approx(0.95, abs=0.03)
    assert intervals.confidence(100_000) == pytest.approx(0.95, abs=1e-4)


def test_where_airs_cannot_be_resampled():
    ones = np.ones((1, 10, 4))
    (alike,) = estimated(ones)
    assert (alike.mean, alike.high, alike.n, alike.over) == (1.0, 1.0, 40, "alike")
    assert alike.low == pytest.approx(scipy.stats.binomtest(10, 10).proportion_ci(method="wilson").low)
    (few,) = estimated(searches(1, 1, 3, 20, 0.5))
    assert few.over == "few"
    assert few.high - few.low > 0.5
    (single,) = estimated(np.array([[[1.0], [0.0], [1.0], [1.0], [0.0], [1.0]]]))
    assert (single.low, single.high) == pytest.approx(
        scipy.stats.binomtest(4, 6).proportion_ci(method="wilson")
    )
    for airs in (1, 2):
        for share in (True, False):
            (air,) = estimated(searches(1, 1, airs, 20, 0.5), share)
            assert (np.isnan(air.low), np.isnan(air.high), air.over) == (True, True, "too few airs")
    (same,) = estimated(np.full((1, 6, 4), 60.0), share=False)
    assert (same.over, same.mean, np.isnan(same.low)) == ("same", 60.0, True)
    (still,) = estimated(searches(2, 1, 1, 20, 0.5), by_chance=False)
    k = round(20 * still.mean)
    assert (still.low, still.high) == pytest.approx(
        scipy.stats.binomtest(k, 20).proportion_ci(method="wilson")
    )
    assert estimates([np.nan], ["a"], ["x"], [True], True) == {}


def test_searches_in_the_same_airs_are_compared_in_pairs():
    """What the air does to both of them cancels: the difference is known far better than either mean."""
    rng = np.random.default_rng(4)
    air = rng.uniform(0.2, 0.8, 12)
    count = np.full(12, 50.0)
    first, second = 50 * (air - 0.1), 50 * (air + 0.1) + rng.normal(0, 0.3, 12)
    apart = intervals.differences((first, count), (second, count))
    assert apart.mean == pytest.approx(0.2, abs=0.01)
    assert 0.18 < apart.low < 0.2 < apart.high < 0.22
    low, high = (end[0] for end in intervals.resampled(first[None], count[None]))
    assert high - low > 0.2
    reported = scipy.stats.bootstrap(
        (second / 50 - first / 50,), np.mean, confidence_level=intervals.confidence(12), n_resamples=20_000,
        rng=1,
    ).confidence_interval  # fmt: skip
    assert (apart.low, apart.high) == pytest.approx(reported, abs=2e-3)
    assert intervals.differences((first, count), (first, count)).over == "same"
    assert intervals.differences((first[:3], count[:3]), (second[:3], count[:3])).over == "few"
    assert intervals.differences((first[:2], count[:2]), (second[:2], count[:2])).over == "too few airs"
    assert intervals.differences((first[:0], count[:0]), (first[:0], count[:0])).over == "none"


TIMES = {
    "exponential": (lambda rng, shape: rng.exponential(40.0, shape), 40.0),
    "gamma": (lambda rng, shape: rng.gamma(4.0, 10.0, shape), 40.0),
    "normal": (lambda rng, shape: rng.normal(40.0, 5.0, shape), 40.0),
}


@pytest.mark.parametrize("airs", [3, 4])
@pytest.mark.parametrize("law", TIMES)
def test_intervals_of_few_airs_cover_the_truth_and_are_positive(law, airs):
    """Student's interval of the means themselves covers 88 % of exponential times, and reaches below 0 s."""
    draw, truth = TIMES[law]
    of_airs = draw(np.random.default_rng(airs), (2000, airs, 1))
    made = estimated(of_airs, share=False, limits=(0.0, np.inf))
    assert covered(made, truth) == pytest.approx(0.95, abs=0.02)
    assert min(one.low for one in made) > 0.0


@pytest.mark.parametrize("airs", [3, 4])
def test_intervals_of_few_airs_end_with_the_run(airs):
    """Most searches fail and count with the whole run: 60 s."""
    times = 60.0 * np.random.default_rng(airs).beta(5.0, 1.0, (2000, airs, 1))
    made = estimated(times, share=False, limits=(0.0, 60.0))
    assert covered(made, 50.0) == pytest.approx(0.95, abs=0.015)
    assert max(one.high for one in made) < 60.0
    assert max(one.high for one in estimated(times, share=False)) > 60.0


def test_the_interval_of_few_positive_values_is_that_of_a_gamma_regression():
    """Intercept of a generalised linear model with log link, fitted by Fisher scoring, Pearson's dispersion."""
    values = np.array([12.0, 55.0, 31.0, 90.0])
    intercept = 0.0
    for _ in range(50):
        expected = np.exp(intercept)
        intercept += np.mean((values - expected) / expected)
    dispersion = np.sum((values / np.exp(intercept) - 1.0) ** 2) / 3
    ends = scipy.stats.t(3, intercept, np.sqrt(dispersion / 4)).interval(0.95)
    (one,) = estimated(values[None, :, None], share=False, limits=(0.0, np.inf))
    assert (one.low, one.high) == pytest.approx(np.exp(ends), rel=1e-6)


def test_the_interval_within_two_limits_is_the_logarithmic_one_far_from_the_other_limit():
    (near,) = estimated(np.array([[[1.0], [2.0], [4.0]]]), share=False, limits=(0.0, 1e9))
    (free,) = estimated(np.array([[[1.0], [2.0], [4.0]]]), share=False, limits=(0.0, np.inf))
    assert near[:3] == pytest.approx(free[:3], rel=1e-6)
    (high,) = estimated(10.0 - np.array([[[1.0], [2.0], [4.0]]]), share=False, limits=(0.0, 10.0))
    (low,) = estimated(np.array([[[1.0], [2.0], [4.0]]]), share=False, limits=(0.0, 10.0))
    assert (10.0 - high.high, 10.0 - high.low) == pytest.approx((low.low, low.high))


def test_few_airs_of_unequal_weight_have_the_error_of_a_ratio():
    """Its error by the jackknife, which needs no linearisation, agrees to second order."""
    rng = np.random.default_rng(3)
    counts = np.array([40.0, 44.0, 36.0, 50.0])
    sums = counts * rng.normal(100.0, 1.0, 4)
    values = np.concatenate([np.full(int(c), s / c) for s, c in zip(sums, counts, strict=True)])
    air = np.repeat(np.arange(4), counts.astype(int))
    (one,) = estimates(values, np.zeros(len(values)), air, np.full(len(values), True), False).values()
    left_out = (sums.sum() - sums) / (counts.sum() - counts)
    error = np.sqrt(3 / 4 * np.sum((left_out - left_out.mean()) ** 2))
    assert one.high - one.mean == pytest.approx(scipy.stats.t(3).ppf(0.975) * error, rel=0.1)


def test_a_value_beyond_the_limits_takes_them_away():
    (one,) = estimated(np.array([[[-1.0], [2.0], [9.0]]]), share=False, limits=(0.0, 5.0))
    expected = scipy.stats.ttest_1samp([-1.0, 2.0, 9.0], 0.0).confidence_interval()
    assert (one.low, one.high) == pytest.approx(expected)


def test_differences_of_few_shares_are_within_one():
    counts = np.full(3, 20.0)
    one = intervals.differences(
        (np.array([1.0, 0.0, 2.0]), counts), (np.array([19.0, 12.0, 20.0]), counts), 1.0
    )
    assert (one.mean, one.over) == (pytest.approx(0.8), "few")
    assert -1.0 < one.low < 0.8 < one.high < 1.0


ONE = Estimate(0.68, 0.512, 0.816, 40, 10, "airs")


@pytest.mark.parametrize(
    ("one", "unit", "sentence"),
    [
        (ONE, "", "68 % of 40 searches, 95 % interval 51-82 % over 10 airs"),
        (ONE._replace(over="few", airs=3), "", "51-82 % over 3 airs; more airs would narrow it"),
        (
            ONE._replace(over="too few airs", airs=2),
            "",
            "68 % of 40 searches, no interval: it takes at least 3 airs, there are 2",
        ),
        (
            ONE._replace(over="too few searches", n=1),
            "",
            "no interval: it takes at least 3 searches, there is 1",
        ),
        (ONE._replace(over="searches", airs=1), "", "over the searches, as all have the same air"),
        (Estimate(0.999, 0.9968, 0.9999, 900, 90, "airs"), "", "interval 99.7-100.0 %"),
        (
            Estimate(-1.5, -2.25, 0.5, 1, 6, "airs"),
            "s",
            "-1.5 s, mean of 1 search, 95 % interval -2.25 to 0.5 s",
        ),
        (
            Estimate(60.0, np.nan, np.nan, 24, 6, "same"),
            "s",
            "60 s, mean of 24 searches, no interval: all 6 airs",
        ),
        (None, "", "no data"),
    ],
)
def test_words(one, unit, sentence):
    assert sentence in words(one, unit, share=not unit)
