"""Means and shares of searches with intervals of 95 % confidence over airs, and the sentences that say them.

Searches in one air share its luck: counted as if each were by itself, they make intervals far too narrow. So airs are
resampled, whole, with all their searches (cluster bootstrap; Davison & Hinkley 1997, section 3.8,
doi:10.1017/CBO9780511802843), and the ratio of sums is taken: BCa intervals of `scipy.stats.bootstrap`, of a confidence
that is raised as Student's t asks for where airs are few (Hesterberg 2015, section 5.3,
doi:10.1080/00031305.2015.1089789). Resampling fewer than `FEWEST` airs cannot cover 95 %, as all resamples lie between
the least and the largest of them: there Wilson's interval counts each air once, and Student's takes the airs' means.

tests/study/test_intervals.py measures how often they cover the truth.
"""

import warnings
from math import sqrt
from typing import Any, NamedTuple

import numpy as np
from scipy.special import ndtr, stdtrit

from taichi_plume.scoring.trials import mean_with_interval, share_with_interval

FEWEST = 5  # airs that are resampled
MANY = 200  # airs, of more of which percentiles are as good, and far quicker
RESAMPLES = 2999
AT_ONCE = 1 << 22  # numbers of resamples that are held at a time
SEED = 20260
LEVEL = 0.95

OVER = {
    "airs": "over {airs} airs",
    "single": "over {airs} airs, one search in each",
    "few": "over {airs} airs, so few that it is wide",
    "alike": "over {airs} airs, which all agree",
    "searches": "over the searches, as chance does not change the air",
    "one air": "",
    "same": "",
    "one": "",
    "none": "",
}
"""What an interval is over, as it is said."""
WITHOUT = {
    "one air": "no interval: one air says nothing of others",
    "same": "no interval: all {airs} airs gave the same",
    "one": "no interval: a single one",
    "none": "nothing to count",
}
"""Why there is none."""


class Estimate(NamedTuple):
    """A mean or share with its interval, NaN where there is none.

    n: searches; airs: that they were in; over: a key of OVER.
    """

    mean: float
    low: float
    high: float
    n: int
    airs: int
    over: str


def estimates(values: Any, keys: Any, airs: Any, by_chance: Any, share: bool) -> dict[Any, Estimate]:
    """The estimate of each key, of searches given as columns (n,).

    values: NaN where there is nothing to count; of a share, 0 or 1; airs: seed of each search's air; by_chance: whether
    chance is in that air.
    """
    import pandas as pd

    table = pd.DataFrame({"value": np.asarray(values, float), "key": keys, "air": airs, "chance": by_chance})
    table = table[table["value"].notna()]
    made = {
        key: _over_searches(part["value"].to_numpy(), share)
        for key, part in table[~table["chance"].astype(bool)].groupby("key", sort=False)
    }
    cells = _cells(table[table["chance"].astype(bool)])
    waiting: dict[int, list[tuple[Any, np.ndarray, np.ndarray]]] = {}
    for key, sums, counts in cells:
        known = _without_resampling(sums, counts, share)
        if known is None:
            waiting.setdefault(len(sums), []).append((key, sums, counts))
        else:
            made[key] = known
    for count, some in waiting.items():
        sums, counts = (np.stack([one[n] for one in some]) for n in (1, 2))
        low, high = resampled(sums, counts)
        for (key, s, c), l, h in zip(some, low, high, strict=True):
            made[key] = Estimate(float(s.sum() / c.sum()), float(l), float(h), int(c.sum()), count, "airs")
    return made


def _cells(table: Any) -> list[tuple[Any, np.ndarray, np.ndarray]]:
    """Sums and counts per air, of each key."""
    if not len(table):
        return []
    place, keys = table["key"].factorize()
    cells = table.assign(place=place).groupby(["place", "air"], sort=True)["value"].agg(["sum", "count"])
    of = cells.index.get_level_values("place").to_numpy()
    parts = np.split(cells.to_numpy(float), np.flatnonzero(np.diff(of)) + 1)
    return [(key, part[:, 0], part[:, 1]) for key, part in zip(keys, parts, strict=True)]


def _over_searches(values: np.ndarray, share: bool) -> Estimate:
    """Where chance is not in the air, each search counts."""
    told = share_with_interval(round(values.sum()), len(values)) if share else mean_with_interval(values)
    over = "searches" if len(values) > 1 else "one"
    return Estimate(told["mean"], told["low"], told["high"], len(values), 1, over)


def _without_resampling(sums: np.ndarray, counts: np.ndarray, share: bool) -> Estimate | None:
    """The estimate where airs must not be resampled; None where they are."""
    airs, n, mean = len(sums), int(counts.sum()), float(sums.sum() / counts.sum())
    alike = bool(np.all(sums * counts[0] == sums[0] * counts))
    if airs == 1:
        return Estimate(mean, np.nan, np.nan, n, airs, "one air")
    if share and (alike or airs < FEWEST or n == airs):
        told = share_with_interval(mean * airs, airs)  # pyright: ignore[reportArgumentType]
        over = "alike" if alike and airs >= FEWEST else "few" if airs < FEWEST else "single"
        return Estimate(mean, told["low"], told["high"], n, airs, over)
    if alike:
        return Estimate(mean, np.nan, np.nan, n, airs, "same")
    if airs < FEWEST:
        told = mean_with_interval(sums / counts)
        return Estimate(
            mean, told["low"] - told["mean"] + mean, told["high"] - told["mean"] + mean, n, airs, "few"
        )
    return None


def differences(first: tuple[np.ndarray, np.ndarray], second: tuple[np.ndarray, np.ndarray]) -> Estimate:
    """Second minus first mean, of sums and counts (airs,) of searches in the same airs, resampled in pairs."""
    sums, counts = np.stack([first[0], second[0]]), np.stack([first[1], second[1]])
    airs, n = sums.shape[1], int(counts.sum())
    if not airs:
        return Estimate(np.nan, np.nan, np.nan, 0, 0, "none")
    apart = float(np.diff(sums.sum(axis=1) / counts.sum(axis=1))[0])
    each = np.diff(sums / counts, axis=0)[0]
    if airs == 1:
        return Estimate(apart, np.nan, np.nan, n, airs, "one air")
    if np.ptp(each) == 0:
        return Estimate(apart, np.nan, np.nan, n, airs, "same")
    if airs < FEWEST:
        told = mean_with_interval(each)
        return Estimate(
            apart, told["low"] - told["mean"] + apart, told["high"] - told["mean"] + apart, n, airs, "few"
        )
    low, high = resampled(sums[:, None], counts[:, None])
    return Estimate(apart, float(low[0]), float(high[0]), n, airs, "airs")


def confidence(airs: int) -> float:
    """The level of a bootstrap interval that is as wide as Student's t asks for, of so many airs."""
    t = float(stdtrit(airs - 1, 0.5 + LEVEL / 2))
    return float(1 - 2 * ndtr(-sqrt(airs / (airs - 1)) * t))


def resampled(sums: np.ndarray, counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Ends (points,) of the intervals of means, of sums and counts (points, airs) that are resampled together.

    Of two of each, (2, points, airs): of the second mean minus the first.
    """
    from scipy.stats import bootstrap

    airs = sums.shape[-1]
    level = confidence(airs)

    def statistic(chosen: np.ndarray, axis: int = -1) -> np.ndarray:
        """Of airs chosen by their numbers (..., n), by how often each is: (points, ...)."""
        draws = chosen.reshape(-1, chosen.shape[-1])
        places = draws + airs * np.arange(len(draws))[:, None]
        often = np.bincount(places.ravel(), minlength=airs * len(draws)).reshape(len(draws), airs)
        means = (sums @ often.T) / (counts @ often.T)
        means = means[1] - means[0] if sums.ndim == 3 else means
        return means.reshape(*means.shape[:-1], *chosen.shape[:-1])

    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")  # of BCa where it cannot be told: the percentiles are taken there
        told = bootstrap(
            [np.arange(airs)], statistic, vectorized=True, confidence_level=level,
            n_resamples=RESAMPLES, batch=max(1, AT_ONCE // (sums.size + airs)),
            method="BCa" if airs <= MANY else "percentile",
            rng=np.random.default_rng(SEED),
        )  # fmt: skip
    ends = []
    for end, share in zip(told.confidence_interval, ((1 - level) / 2, (1 + level) / 2), strict=True):
        plain = np.quantile(told.bootstrap_distribution, share, axis=-1)
        ends.append(np.where(np.isfinite(end), end, plain))
    return ends[0], ends[1]


# ---------------------------------------------------------------- words


def words(one: Estimate | None, unit: str = "", share: bool = False, what: str = "searches") -> str:
    """The sentence of an estimate: "68 % of 40 searches, 95 % interval 51-82 % over 10 airs"."""
    if one is None or not one.n:
        return WITHOUT["none"]
    what = what if one.n != 1 else what.removesuffix("es") if what == "searches" else what.removesuffix("s")
    begin = f"{number(one.mean, unit, share)} of {one.n:,} {what}"
    if not share:
        begin = f"{number(one.mean, unit)}, mean of {one.n:,} {what}"
    return f"{begin}, {interval(one, unit, share)}"


def interval(one: Estimate, unit: str = "", share: bool = False) -> str:
    """The interval of an estimate and what it is over, or why there is none."""
    if one.over in WITHOUT:
        return WITHOUT[one.over].format(airs=one.airs)
    return f"95 % interval {ends(one, unit, share)} {OVER[one.over].format(airs=one.airs)}"


def ends(one: Estimate, unit: str = "", share: bool = False) -> str:
    """The ends of an interval, with as many digits as it takes to tell them apart: "51-82 %"."""
    by = 100.0 if share else 1.0
    low, high = by * one.low, by * one.high
    for digits in range(6):
        told = [f"{end:.{digits}f}" if share else f"{end:.{3 + digits}g}" for end in (low, high)]
        if told[0] != told[1] or low == high:
            break
    parting = " to " if "-" in f"{told[0]}{told[1]}" else "-"
    return f"{told[0]}{parting}{told[1]} {'%' if share else '' if unit == '1' else unit}".rstrip()


def number(value: float, unit: str = "", share: bool = False) -> str:
    """A number with its unit: of a share in per cent."""
    if share:
        return f"{100 * value:.0f} %"
    return f"{value:.3g} {'' if unit == '1' else unit}".rstrip()
