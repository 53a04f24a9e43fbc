"""Whiffs and blanks: for how long a fixed sensor smells gas without a break, and for how long none.

A sample stands for the time up to halfway to its neighbours. A whiff is a stretch of samples that are above the
threshold, a blank one of samples that are not; those that the begin or the end of the record cuts are left out.
Durations of a turbulent plume are those of first returns, p(T) ~ T^-3/2 over a range of T (Celani, Villermaux &
Vergassola 2014, doi:10.1103/PhysRevX.4.041015).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

CELANI = 1.5
"""What the exponent of durations is in turbulence."""
FEWEST = 20
"""Durations from which an exponent is told."""
RESOLVED = 5
"""Samples that the shortest duration of a range has at least."""
DECADE = 10.0
KOLMOGOROV = 1.358
"""Distance of samples to their distribution, times the root of their number, that 5 % exceed."""
BLOCKS = 60  # of time, that the bootstrap draws
RESAMPLES = 2000


class Spells(NamedTuple):
    """Stretches of a record: when each began and for how long it lasted [s], (n,); cut: how many were left out."""

    begin: np.ndarray
    lasted: np.ndarray
    cut: int

    def between(self, low: float, high: float) -> "Spells":
        """Those whose durations are between two."""
        chosen = (self.lasted > low) & (self.lasted < high)
        return Spells(self.begin[chosen], self.lasted[chosen], self.cut)


class Exponent(NamedTuple):
    """The power law T^-value between two durations [s], with its 95 % interval and how many durations it is of.

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
        """How wide the range is."""
        return float(np.log10(self.last / self.first))

    @property
    def is_law(self) -> bool:
        """Whether the durations may be of the law: their distance is not above what 5 % of such samples have."""
        return self.distance <= KOLMOGOROV / np.sqrt(self.count)


def edges_of(times: np.ndarray) -> np.ndarray:
    """Ends of the time [s] that each sample stands for, (n + 1,): halfway to its neighbours."""
    return np.concatenate([times[:1], 0.5 * (times[1:] + times[:-1]), times[-1:]])


def stretches(present: np.ndarray) -> np.ndarray:
    """Where stretches of equal samples begin, and the number of samples: cuts of the record, (k + 1,)."""
    changes = np.flatnonzero(present[1:] != present[:-1]) + 1
    return np.concatenate([[0], changes, [len(present)]])


def spells(times: np.ndarray, present: np.ndarray) -> tuple[Spells, Spells]:
    """Whiffs and blanks of one record: times (n,) [s], and whether there was gas, (n,) of bool."""
    cuts = stretches(present)
    ends = edges_of(times)[cuts]
    begin, lasted = ends[1:-2], np.diff(ends)[1:-1]
    kind = present[cuts[1:-2]]
    cut = {bool(present[0]), bool(present[-1])} if len(cuts) == 2 else None
    both = []
    for wanted in (True, False):
        left_out = int(wanted in cut) if cut else int(present[0] == wanted) + int(present[-1] == wanted)
        both.append(Spells(begin[kind == wanted], lasted[kind == wanted], left_out))
    return both[0], both[1]


def pooled(several: Sequence[Spells]) -> Spells:
    """Those of several points, together."""
    if not several:
        return Spells(np.empty(0), np.empty(0), 0)
    return Spells(
        np.concatenate([one.begin for one in several]),
        np.concatenate([one.lasted for one in several]),
        sum(one.cut for one in several),
    )


def halfway(duration: float, step: float) -> float:
    """The duration made to lie between two that can occur, multiples of the step of an even record [s]."""
    return float((np.floor(duration / step + 1e-9) + 0.5) * step)


def _mean_log(exponent: float, span: float) -> float:
    """Mean of ln(T/first) of the power law T^-exponent between first and first e^span."""
    s = (1.0 - exponent) * span
    if abs(s) < 1e-4:
        return span * (0.5 + s / 12.0)
    return span * (1.0 / -np.expm1(-s) - 1.0 / s) if s > -700.0 else -span / s


def likeliest(mean_log: float, span: float) -> float:
    """Exponent of the power law between first and last whose mean of ln(T/first) is that; span: ln(last/first).

    The maximum of the likelihood of durations that have this mean.
    """
    from scipy.optimize import brentq

    mean_log = min(max(mean_log, 1e-3 * span), (1.0 - 1e-3) * span)  # beyond, the exponent is in the hundreds
    bound = 2000.0 / span
    return float(brentq(lambda a: _mean_log(a, span) - mean_log, 1.0 - bound, 1.0 + bound))  # type: ignore[arg-type]


def law(exponent: float, first: float, last: float, durations: np.ndarray) -> np.ndarray:
    """Share of the power law's durations that are below some, between first and last."""
    s, x = 1.0 - exponent, np.log(durations / first)
    if abs(s) < 1e-9:
        return x / np.log(last / first)
    return np.expm1(s * x) / np.expm1(s * np.log(last / first))


def _distance(durations: np.ndarray, exponent: float, first: float, last: float) -> float:
    """Kolmogorov-Smirnov distance between durations and the law; the distance of ties, as of an even record."""
    values, count = np.unique(durations, return_counts=True)
    above = np.cumsum(count) / len(durations)
    middle = above - 0.5 * count / len(durations)  # equal ones stand for a bin
    return float(np.abs(middle - law(exponent, first, last, values)).max())


def exponent(found: Spells, first: float, last: float, seed: int = 0) -> Exponent | None:
    """Exponent of the durations between two [s], by maximum likelihood; None where they are fewer than FEWEST.

    The interval is of a bootstrap (percentiles) over blocks of time, as whiffs that are near in time, and those of
    several points that see the same gusts, are not independent.
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
    """95 % interval of the mean of values, whose blocks of time are drawn anew."""
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
    """The range [s] in which the durations are best a power law; None where there are too few of them.

    step: time between samples [s]. Its end is `last`, for instance half the time that the wind takes from the source,
    but no less than what a hundredth of them exceed: wide eddies make longer ones. Its begin is where the rest is
    nearest to its own power law (Clauset, Shalizi & Newman 2009, doi:10.1137/070710111): from RESOLVED samples on, and
    a decade before the end if it can be.
    """
    if len(found.lasted) < FEWEST:
        return None
    least = halfway((RESOLVED - 1) * step, step)
    last = max(last or 0.0, float(np.quantile(found.lasted, 0.99)) + 0.5 * step)
    most = halfway(min(last, float(found.lasted.max()) + step), step)
    if most <= 2.0 * least:
        return None
    latest = max(most / DECADE, least)
    begins = sorted({halfway(one, step) for one in np.geomspace(least, latest, 12)} | {least})
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
    """Distribution of durations in bins that are even in their logarithm: middle [s], density [1/s], count.

    step: time between samples [s], so that bins end between what durations can occur; empty bins are left out.
    """
    if not len(lasted):
        return np.empty(0), np.empty(0), np.empty(0, int)
    low, high = float(lasted.min()), float(lasted.max())
    edges = np.geomspace(low * (1.0 - 1e-9), max(high, low * 1.01) * (1.0 + 1e-9), bins + 1)
    if step:
        edges = np.unique((np.round(edges / step - 0.5) + 0.5) * step)
        edges = np.append(edges[edges < high], edges[-1] if edges[-1] > high else edges[-1] + step)
    count = np.histogram(lasted, edges)[0]
    some = count > 0
    middle = np.sqrt(np.maximum(edges[:-1], 0.5 * edges[1:]) * edges[1:])
    return middle[some], (count / np.diff(edges) / len(lasted))[some], count[some]
