"""95 % confidence intervals of means and shares over airs (cluster bootstrap), and the sentences that state them.

Searches in the same air (flow realisation) are correlated; as if independent, they give too narrow intervals. Therefore
whole airs are resampled with all their searches (cluster bootstrap; Davison & Hinkley 1997, section 3.8,
doi:10.1017/CBO9780511802843), and the statistic is the ratio of sums. The intervals are BCa intervals of
`scipy.stats.bootstrap`; for few airs Student's t raises the confidence level (Hesterberg 2015, section 5.3,
doi:10.1080/00031305.2015.1089789). A bootstrap of fewer than `FEWEST` airs cannot cover 95 %. Then shares have Wilson's
interval, in which each air counts once. Means have Student's interval on a scale without limits
(`scoring.trials.interval_within`). Their standard error is that of a ratio of sums over airs (Cochran 1977, Sampling
Techniques, section 6.4). So intervals keep to the range of their quantity. Below `LEAST_VALUES` airs there is none.

tests/study/test_intervals.py measures how often the intervals cover the true value.
"""

import warnings
from collections.abc import Hashable, Iterable
from math import inf, sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtr, stdtrit

from taichi_plume.scoring.trials import (
    LEAST_VALUES,
    interval_within,
    mean_with_interval,
    range_with,
    share_with_interval,
)

FEWEST = 5  # least number of airs for a bootstrap
MANY = 200  # airs beyond which percentile intervals are as good as BCa, and far quicker
RESAMPLES = 2999
AT_ONCE = 1 << 22  # resampled values in memory at a time
SEED = 20260
LEVEL = 0.95

OVER = {
    "airs": "over {airs} airs",
    "single": "over {airs} airs, one search in each",
    "few": "over {airs} airs; more airs would narrow it",
    "alike": "over {airs} airs with equal results",
    "searches": "over the searches, as all have the same air",
    "too few airs": "",
    "too few searches": "",
    "same": "",
    "none": "",
}
"""Phrases that state what an interval is over."""
WITHOUT = {
    "too few airs": "no interval: it takes at least {least} airs, there {are}",
    "too few searches": "no interval: it takes at least {least} searches, there {are}",
    "same": "no interval: all {airs} airs have the same result",
    "none": "no data",
}
"""Reasons why there is no interval."""


class Estimate(NamedTuple):
    """Mean or share with its interval (NaN if none). n, airs: numbers of searches and of airs; over: key of OVER."""

    mean: float
    low: float
    high: float
    n: int
    airs: int
    over: str


def estimates(
    values: ArrayLike,
    keys: Iterable[Hashable],
    airs: ArrayLike,
    by_chance: ArrayLike,
    share: bool,
    limits: tuple[float, float] = (-inf, inf),
) -> dict[Hashable, Estimate]:
    """Estimate mean and 95 % interval of the values of each key, from columns (n,) with a row per search.

    values: NaN if undefined; 0 or 1 for a share; airs: seed of the air; by_chance: whether the air depends on the seed.
    limits: least and largest possible value of a mean, which its interval keeps.
    """
    import pandas as pd

    table = pd.DataFrame({"value": np.asarray(values, float), "key": keys, "air": airs, "chance": by_chance})
    table = table[table["value"].notna()]
    limits = range_with(table["value"].to_numpy(), *limits) if len(table) else limits
    made = {
        key: _over_searches(part["value"].to_numpy(), share, limits)
        for key, part in table[~table["chance"].astype(bool)].groupby("key", sort=False)
    }
    cells = _cells(table[table["chance"].astype(bool)])
    waiting: dict[int, list[tuple[Hashable, np.ndarray, np.ndarray]]] = {}
    for key, sums, counts in cells:
        known = _without_resampling(sums, counts, share, limits)
        if known is None:
            waiting.setdefault(len(sums), []).append((key, sums, counts))
        else:
            made[key] = known
    for count, alike in waiting.items():
        sums = np.stack([cell[1] for cell in alike])
        counts = np.stack([cell[2] for cell in alike])
        low, high = resampled(sums, counts)
        for (key, s, c), l, h in zip(alike, low, high, strict=True):
            made[key] = Estimate(float(s.sum() / c.sum()), float(l), float(h), int(c.sum()), count, "airs")
    return made


def _cells(table: Any) -> list[tuple[Hashable, np.ndarray, np.ndarray]]:
    """Return (key, sums, counts) of each key: sum and number of values in each air, arrays (airs,)."""
    if not len(table):
        return []
    place, keys = table["key"].factorize()
    cells = table.assign(place=place).groupby(["place", "air"], sort=True)["value"].agg(["sum", "count"])
    of = cells.index.get_level_values("place").to_numpy()
    parts = np.split(cells.to_numpy(float), np.flatnonzero(np.diff(of)) + 1)
    return [(key, part[:, 0], part[:, 1]) for key, part in zip(keys, parts, strict=True)]


def _over_searches(values: np.ndarray, share: bool, limits: tuple[float, float]) -> Estimate:
    """Estimate a mean or share with its interval from values (n,) of independent searches in one deterministic air."""
    count = len(values)
    if count < LEAST_VALUES:
        return Estimate(float(values.mean()), np.nan, np.nan, count, 1, "too few searches")
    found = share_with_interval(round(values.sum()), count) if share else mean_with_interval(values, *limits)
    return Estimate(found["mean"], found["low"], found["high"], count, 1, "searches")


def _residuals(sums: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Return the contribution of each air to the error of the ratio of sums, linearised; arrays (..., airs)."""
    ratio = sums.sum(axis=-1, keepdims=True) / counts.sum(axis=-1, keepdims=True)
    return (sums - ratio * counts) / counts.mean(axis=-1, keepdims=True)


def _over_few(mean: float, residuals: np.ndarray, n: int, limits: tuple[float, float]) -> Estimate:
    """Estimate with Student's interval within limits, from the airs' residuals (airs,)."""
    airs = len(residuals)
    ends = interval_within(mean, float(residuals.std(ddof=1)) / sqrt(airs), airs, *limits)
    return Estimate(mean, *ends, n, airs, "few")


def _without_resampling(
    sums: np.ndarray, counts: np.ndarray, share: bool, limits: tuple[float, float]
) -> Estimate | None:
    """Estimate a mean or share without bootstrap, from sums and counts (airs,); None if a bootstrap is needed."""
    airs, n, mean = len(sums), int(counts.sum()), float(sums.sum() / counts.sum())
    alike = bool(np.all(sums * counts[0] == sums[0] * counts))
    if airs < LEAST_VALUES:
        return Estimate(mean, np.nan, np.nan, n, airs, "too few airs")
    if share and (alike or airs < FEWEST or n == airs):
        found = share_with_interval(mean * airs, airs)  # pyright: ignore[reportArgumentType]
        over = "alike" if alike and airs >= FEWEST else "few" if airs < FEWEST else "single"
        return Estimate(mean, found["low"], found["high"], n, airs, over)
    if alike:
        return Estimate(mean, np.nan, np.nan, n, airs, "same")
    return _over_few(mean, _residuals(sums, counts), n, limits) if airs < FEWEST else None


def differences(
    first: tuple[np.ndarray, np.ndarray], second: tuple[np.ndarray, np.ndarray], most: float = inf
) -> Estimate:
    """Estimate the second mean minus the first by a paired bootstrap; first, second: sums and counts (airs,).

    most: largest possible difference, 1 for shares.
    """
    sums, counts = np.stack([first[0], second[0]]), np.stack([first[1], second[1]])
    airs, n = sums.shape[1], int(counts.sum())
    if not airs:
        return Estimate(np.nan, np.nan, np.nan, 0, 0, "none")
    apart = float(np.diff(sums.sum(axis=1) / counts.sum(axis=1))[0])
    each = np.diff(sums / counts, axis=0)[0]
    if airs < LEAST_VALUES:
        return Estimate(apart, np.nan, np.nan, n, airs, "too few airs")
    if np.ptp(each) == 0:
        return Estimate(apart, np.nan, np.nan, n, airs, "same")
    if airs < FEWEST:
        residuals = np.diff(_residuals(sums, counts), axis=0)[0]
        return _over_few(apart, residuals, n, range_with(each, -most, most))
    low, high = resampled(sums[:, None], counts[:, None])
    return Estimate(apart, float(low[0]), float(high[0]), n, airs, "airs")


def confidence(airs: int) -> float:
    """Confidence level at which a bootstrap interval over a number of airs is as wide as Student's t interval."""
    t = float(stdtrit(airs - 1, 0.5 + LEVEL / 2))
    return float(1 - 2 * ndtr(-sqrt(airs / (airs - 1)) * t))


def resampled(sums: np.ndarray, counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return lower and upper ends (points,) of the bootstrap intervals of means, from sums and counts (points, airs).

    Sums and counts (2, points, airs) give intervals of the second mean minus the first.
    """
    from scipy.stats import bootstrap

    airs = sums.shape[-1]
    level = confidence(airs)

    def statistic(chosen: np.ndarray, axis: int = -1) -> np.ndarray:
        """Means (points, ...) of resamples; chosen: indices of the airs in each resample (..., n)."""
        draws = chosen.reshape(-1, chosen.shape[-1])
        places = draws + airs * np.arange(len(draws))[:, None]
        often = np.bincount(places.ravel(), minlength=airs * len(draws)).reshape(len(draws), airs)
        means = (sums @ often.T) / (counts @ often.T)
        means = means[1] - means[0] if sums.ndim == 3 else means
        return means.reshape(*means.shape[:-1], *chosen.shape[:-1])

    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")  # where BCa is undefined, percentiles replace it below
        found = bootstrap(
            [np.arange(airs)], statistic, vectorized=True, confidence_level=level,
            n_resamples=RESAMPLES, batch=max(1, AT_ONCE // (sums.size + airs)),
            method="BCa" if airs <= MANY else "percentile",
            rng=np.random.default_rng(SEED),
        )  # fmt: skip
    ends = []
    for end, share in zip(found.confidence_interval, ((1 - level) / 2, (1 + level) / 2), strict=True):
        plain = np.quantile(found.bootstrap_distribution, share, axis=-1)
        ends.append(np.where(np.isfinite(end), end, plain))
    return ends[0], ends[1]


# ---------------------------------------------------------------- words


def words(estimate: Estimate | None, unit: str = "", share: bool = False, what: str = "searches") -> str:
    """Return the sentence of an estimate: "68 % of 40 searches, 95 % interval 51-82 % over 10 airs"."""
    if estimate is None or not estimate.n:
        return WITHOUT["none"]
    what = what.removesuffix("es" if what == "searches" else "s") if estimate.n == 1 else what
    mean = "" if share else ", mean"
    return f"{number(estimate.mean, unit, share)}{mean} of {estimate.n:,} {what}, {interval(estimate, unit, share)}"


def interval(estimate: Estimate, unit: str = "", share: bool = False) -> str:
    """Return the text of an estimate's interval and what the interval is over, or why there is no interval."""
    if estimate.over in WITHOUT:
        return without(estimate)
    return f"95 % interval {ends(estimate, unit, share)} {OVER[estimate.over].format(airs=estimate.airs)}"


def without(estimate: Estimate) -> str:
    """Return the reason why an estimate has no interval."""
    count = estimate.n if estimate.over == "too few searches" else estimate.airs
    are = f"{'is' if count == 1 else 'are'} {count}"
    return WITHOUT[estimate.over].format(airs=estimate.airs, least=LEAST_VALUES, are=are)


def ends(estimate: Estimate, unit: str = "", share: bool = False) -> str:
    """Return the ends of an interval, such as "51-82 %", with enough digits to tell them apart."""
    by = 100.0 if share else 1.0
    low, high = by * estimate.low, by * estimate.high
    for digits in range(6):
        texts = [f"{end:.{digits}f}" if share else f"{end:.{3 + digits}g}" for end in (low, high)]
        if texts[0] != texts[1] or low == high:
            break
    parting = " to " if "-" in "".join(texts) else "-"
    return f"{parting.join(texts)} {'%' if share else '' if unit == '1' else unit}".rstrip()


def number(value: float, unit: str = "", share: bool = False) -> str:
    """Return a number with 3 significant digits and its unit, or a share in per cent, as text."""
    if share:
        return f"{100 * value:.0f} %"
    return f"{value:.3g} {'' if unit == '1' else unit}".rstrip()
