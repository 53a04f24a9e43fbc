"""Durations of whiffs (gas above a threshold at a fixed point) and blanks (gas below), and their power laws.

A sample represents the time up to halfway to its neighbours. A whiff is an interval of samples above the threshold, a
blank an interval of samples below. Intervals that the start or end of the record cuts are left out. In a turbulent
plume durations follow first-return times, p(T) ~ T^-3/2 over a range of T (Celani, Villermaux & Vergassola 2014,
doi:10.1103/PhysRevX.4.041015).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

CELANI = 1.5
"""Exponent of durations in turbulence."""
FEWEST = 20
"""Smallest number of durations for an exponent."""
RESOLVED = 5
"""Smallest number of samples in the shortest duration of a range."""
DECADE = 10.0
KOLMOGOROV = 1.358
"""Kolmogorov-Smirnov distance times the root of the number of samples, exceeded with a probability of 5 %."""
BLOCKS = 60  # of time, resampled by the bootstrap
RESAMPLES = 2000


class Spells(NamedTuple):
    """Whiffs or blanks of a record: start and duration of each [s], (n,); cut: number that the record's ends cut."""

    begin: np.ndarray
    lasted: np.ndarray
    cut: int

    def between(self, low: float, high: float) -> "Spells":
        """Return the whiffs or blanks whose durations lie between two bounds."""
        chosen = (self.lasted > low) & (self.lasted < high)
        return Spells(self.begin[chosen], self.lasted[chosen], self.cut)


class Exponent(NamedTuple):
    """Power law T^-value between two durations [s], with a 95 % interval; count: of durations.

    distance: Kolmogorov-Smirnov distance between the durations and the law.
    """

    value: float
    low: float
    high: float
    first: float
    last: float
    count: int
    distance: float

    @property
    def decades(self) -> float:
        """Width of the power law's range of durations in decades, log10(last/first)."""
        return float(np.log10(self.last / self.first))

    @property
    def is_law(self) -> bool:
        """Whether durations agree with their power law by a Kolmogorov-Smirnov test at the 5 % level."""
        return self.distance <= KOLMOGOROV / np.sqrt(self.count)


def edges_of(times: np.ndarray) -> np.ndarray:
    """Edges of the time intervals [s] that the samples represent, (n + 1,): halfway between neighbours."""
    return np.concatenate([times[:1], 0.5 * (times[1:] + times[:-1]), times[-1:]])


def stretches(present: np.ndarray) -> np.ndarray:
    """Return the first index of each run of equal samples, then the number of samples, (k + 1,)."""
    changes = np.flatnonzero(present[1:] != present[:-1]) + 1
    return np.concatenate([[0], changes, [len(present)]])


def spells(times: np.ndarray, present: np.ndarray) -> tuple[Spells, Spells]:
    """Return whiffs and blanks of a record. times: (n,) [s]; present: whether there is gas, (n,) of bool."""
    cuts = stretches(present)
    ends = edges_of(times)[cuts]
    begin, lasted = ends[1:-2], np.diff(ends)[1:-1]
    kind = present[cuts[1:-2]]
    cut = {bool(present[0]), bool(present[-1])} if len(cuts) == 2 else None
    both = []
    for with_gas in (True, False):
        left_out = int(with_gas in cut) if cut else int(present[0] == with_gas) + int(present[-1] == with_gas)
        both.append(Spells(begin[kind == with_gas], lasted[kind == with_gas], left_out))
    return both[0], both[1]


def pooled(several: Sequence[Spells]) -> Spells:
    """Return the whiffs or blanks of several points together."""
    begin, lasted = (np.concatenate([np.empty(0), *(point[n] for point in several)]) for n in (0, 1))
    return Spells(begin, lasted, sum(point.cut for point in several))


def halfway(duration: float, step: float) -> float:
    """Return a duration [s] moved to the middle between two multiples of the step."""
    return float((np.floor(duration / step + 1e-9) + 0.5) * step)


def _mean_log(exponent: float, span: float) -> float:
    """Return the mean of ln(T/first) for durations T with density ~ T^-exponent between first and first e^span."""
    s = (1.0 - exponent) * span
    if abs(s) < 1e-4:
        return span * (0.5 + s / 12.0)
    return span * (1.0 / -np.expm1(-s) - 1.0 / s) if s > -700.0 else -span / s


def likeliest(mean_log: float, span: float) -> float:
    """Maximum-likelihood exponent of durations with mean `mean_log` of ln(T/first); span: ln(last/first)."""
    from scipy.optimize import brentq

    mean_log = min(max(mean_log, 1e-3 * span), (1.0 - 1e-3) * span)  # beyond, the exponent is in the hundreds
    bound = 2000.0 / span
    return float(brentq(lambda a: _mean_log(a, span) - mean_log, 1.0 - bound, 1.0 + bound))  # type: ignore[arg-type]


def law(exponent: float, first: float, last: float, durations: np.ndarray) -> np.ndarray:
    """Return the cumulative distribution at `durations` of the power law T^-exponent between first and last."""
    s, x = 1.0 - exponent, np.log(durations / first)
    if abs(s) < 1e-9:
        return x / np.log(last / first)
    return np.expm1(s * x) / np.expm1(s * np.log(last / first))


def _distance(durations: np.ndarray, exponent: float, first: float, last: float) -> float:
    """Return the Kolmogorov-Smirnov distance of durations (ties allowed) from a power law between first and last."""
    values, count = np.unique(durations, return_counts=True)
    above = np.cumsum(count) / len(durations)
    middle = above - 0.5 * count / len(durations)  # equal durations represent a bin
    return float(np.abs(middle - law(exponent, first, last, values)).max())


def exponent(found: Spells, first: float, last: float, seed: int = 0) -> Exponent | None:
    """Maximum-likelihood exponent of the durations between two bounds [s]; None for fewer than FEWEST durations.

    The interval comes from a bootstrap (percentiles) over blocks of time, as whiffs that are near in time, and whiffs
    at points in the same gusts, are correlated.
    """
    chosen = found.between(first, last)
    if len(chosen.lasted) < FEWEST:
        return None
    span, logs = float(np.log(last / first)), np.log(chosen.lasted / first)
    value = likeliest(float(logs.mean()), span)
    ends = [likeliest(end, span) for end in _interval(chosen.begin, logs, seed)]
    distance = _distance(chosen.lasted, value, first, last)
    return Exponent(value, min(ends), max(ends), float(first), float(last), len(logs), distance)


def _interval(begin: np.ndarray, values: np.ndarray, seed: int) -> tuple[float, float]:
    """Return the 95 % interval of the mean of values (n,) at times `begin` by a bootstrap over blocks of time."""
    from scipy.stats import bootstrap

    reach = np.linspace(begin.min(), begin.max(), BLOCKS + 1)[1:-1]
    block = np.searchsorted(reach, begin, side="right")
    count = np.bincount(block, minlength=BLOCKS).astype(float)
    total = np.bincount(block, values, minlength=BLOCKS)
    total, count = total[count > 0], count[count > 0]
    if len(count) < 3:
        total, count = values, np.ones(len(values))

    def mean(total: np.ndarray, count: np.ndarray, axis: int = -1) -> np.ndarray:
        return total.sum(axis=axis) / count.sum(axis=axis)

    found = bootstrap(
        (total, count), mean, paired=True, vectorized=True, method="percentile", n_resamples=RESAMPLES,
        rng=np.random.default_rng(seed), batch=100,
    )  # fmt: skip
    return float(found.confidence_interval.low), float(found.confidence_interval.high)


def range_of(found: Spells, step: float, last: float | None = None) -> tuple[float, float] | None:
    """Return the range [s] in which the durations are closest to a power law; None if there are too few durations.

    step: time between samples [s]. The range ends at `last`, for instance half the travel time from the source, but not
    below the 99 % quantile, as large eddies make longer durations. The range starts where the rest is closest to a
    power law (Clauset, Shalizi & Newman 2009, doi:10.1137/070710111): at RESOLVED samples or later and, if possible, a
    decade before the end.
    """
    if len(found.lasted) < FEWEST:
        return None
    least = halfway((RESOLVED - 1) * step, step)
    last = max(last or 0.0, float(np.quantile(found.lasted, 0.99)) + 0.5 * step)
    most = halfway(min(last, float(found.lasted.max()) + step), step)
    if most <= 2.0 * least:
        return None
    latest = max(most / DECADE, least)
    begins = sorted({halfway(start, step) for start in np.geomspace(least, latest, 12)} | {least})
    best = None
    for first in begins:
        lasted = found.between(first, most).lasted
        if len(lasted) < FEWEST or most <= 2.0 * first:
            continue
        a = likeliest(float(np.log(lasted / first).mean()), float(np.log(most / first)))
        distance = _distance(lasted, a, first, most)
        if best is None or distance < best[0]:
            best = distance, first
    return None if best is None else (best[1], most)


def density(
    lasted: np.ndarray, step: float = 0.0, bins: int = 24
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Histogram of durations in logarithmic bins: middle [s], density [1/s], count.

    step: time between samples [s]; bins then end between possible durations. Empty bins are left out.
    """
    if not len(lasted):
        return np.empty(0), np.empty(0), np.empty(0, int)
    low, high = float(lasted.min()), float(lasted.max())
    edges = np.geomspace(low * (1.0 - 1e-9), max(high, low * 1.01) * (1.0 + 1e-9), bins + 1)
    if step:
        edges = np.unique((np.round(edges / step - 0.5) + 0.5) * step)
        edges = np.append(edges[edges < high], edges[-1] if edges[-1] > high else edges[-1] + step)
    count = np.histogram(lasted, edges)[0]
    filled = count > 0
    middle = np.sqrt(np.maximum(edges[:-1], 0.5 * edges[1:]) * edges[1:])
    return middle[filled], (count / np.diff(edges) / len(lasted))[filled], count[filled]
