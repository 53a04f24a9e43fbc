"""Experiment: searches, maps or rooms repeated in several airs under several conditions, with confidence intervals."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from math import inf
from typing import Any

import numpy as np
from scipy.stats import bootstrap

from taichi_plume.engine import program
from taichi_plume.validation.case import Compared, Curve, Evidence


@dataclass(frozen=True)
class Mean:
    """Mean over n trials with its 95 % confidence interval from `low` to `high`; None if no trial has a value.

    airs: number of flow realisations of the trials if the interval is over airs.
    """

    mean: float | None
    low: float | None
    high: float | None
    n: int
    airs: int | None = None


@dataclass(frozen=True)
class Tracks:
    """Picture of robots' paths seen from above. size: of the arena [m]; ways: paths, (k, 2) [m] each; names: of the
    paths, for a legend.
    """

    size: tuple[float, float]
    source: tuple[float, float]
    ways: tuple[np.ndarray, ...]
    names: tuple[str, ...] = ()


@dataclass(frozen=True)
class Plume:
    """Picture of a plume seen from above. size: of the arena [m]; nodes: positions of sensors, (n, 2) [m]; ppm:
    concentration in equal cells that fill the arena, (columns, rows).
    """

    size: tuple[float, float]
    source: tuple[float, float]
    nodes: np.ndarray
    ppm: np.ndarray


@dataclass(frozen=True)
class Lines:
    """Picture of several quantities over the same abscissa: arrays of one shape by name."""

    x_label: str
    y_label: str
    x: np.ndarray
    lines: Mapping[str, np.ndarray]


Picture = Curve | Tracks | Lines | Plume


@dataclass(frozen=True)
class Range:
    """Range in which the mean of a quantity has to lie."""

    least: float = -inf
    most: float = inf

    def met(self, mean: float | None) -> bool:
        """Return whether a mean lies in the range."""
        return mean is not None and self.least <= mean <= self.most

    def __str__(self) -> str:
        if self.most == inf:
            return f">= {self.least:g}"
        return f"<= {self.most:g}" if self.least == -inf else f"{self.least:g} to {self.most:g}"


def resampled(data: Sequence[np.ndarray], statistic: Callable[..., np.ndarray]) -> Mean:
    """Return a statistic of paired samples, (n,) each, with the percentile interval of a bootstrap.

    statistic: function of arrays and `axis`. Efron 1979, doi:10.1214/aos/1176344552.
    """
    n, mean = len(data[0]), float(statistic(*data))
    if n < 2:
        return Mean(mean, None, None, n)
    return Mean(mean, *_percentiles(data, statistic, paired=True, n_resamples=2000), n)


def _percentiles(
    data: Sequence[np.ndarray], statistic: Callable[..., np.ndarray], **options: Any
) -> tuple[float, float]:
    """Return the percentile interval of a bootstrap; options: arguments of SciPy's `bootstrap`."""
    options |= {"vectorized": True, "method": "percentile", "rng": np.random.default_rng(1)}
    interval = bootstrap(data, statistic, **options).confidence_interval
    return float(interval.low), float(interval.high)


def over_airs(
    values: Sequence[float] | np.ndarray,
    airs: np.ndarray | None = None,
    share: bool = False,
    limits: tuple[float, float] = (0.0, inf),
) -> Mean:
    """Return the mean of trials, (n,), with a confidence interval over their airs (see studies/intervals.py).

    values: NaN for trials without a value; 0 or 1 for a share. airs: index of the air of each trial; by default every
    trial has its own air. limits: least and largest possible value; values beyond them take them away.
    """
    from taichi_plume.studies.intervals import estimates

    airs = np.arange(len(values)) if airs is None else airs
    values = np.asarray(values, float)
    groups = estimates(values, np.zeros(len(values)), airs, np.ones(len(values)), share, limits)
    if not groups:
        return Mean(None, None, None, 0, 0)
    (estimate,) = groups.values()
    low, high = (float(end) if np.isfinite(end) else None for end in (estimate.low, estimate.high))
    return Mean(estimate.mean, low, high, estimate.n, estimate.airs)


def ratio_over_airs(
    a: np.ndarray, b: np.ndarray, airs_a: np.ndarray | None = None, airs_b: np.ndarray | None = None
) -> Mean:
    """Return the ratio of the means of two samples, (n,) and (m,), in the same airs, which are resampled in pairs.

    Percentiles of the bootstrap at a level corrected for Student's t; no interval below `FEWEST` airs. airs_a, airs_b:
    as in `over_airs`.
    """
    from taichi_plume.studies.intervals import FEWEST, confidence

    airs_a, airs_b = (np.arange(len(part)) if of is None else of for part, of in ((a, airs_a), (b, airs_b)))
    airs = np.intersect1d(airs_a, airs_b)
    sums = np.array([[part[of == air].sum() for air in airs] for part, of in ((a, airs_a), (b, airs_b))])
    counts = np.array([[(of == air).sum() for air in airs] for of in (airs_a, airs_b)])
    n = int(counts.min(axis=0).sum())
    mean = float(np.divide(*sums.sum(axis=1)) / np.divide(*counts.sum(axis=1)))
    if len(airs) < FEWEST:
        return Mean(mean, None, None, n, len(airs))

    def ratio(chosen: np.ndarray, axis: int = -1) -> np.ndarray:
        first, second = (sums[k][chosen].sum(axis) / counts[k][chosen].sum(axis) for k in (0, 1))
        return first / second

    level = confidence(len(airs))
    ends = _percentiles((np.arange(len(airs)),), ratio, n_resamples=2999, confidence_level=level)
    return Mean(mean, *ends, n, len(airs))


def deviation_over_airs(values: np.ndarray, airs: np.ndarray) -> Mean:
    """Return the standard deviation of all trials, (n,), with a confidence interval over their airs.

    Percentiles of a bootstrap of airs with all their trials, at a level corrected for Student's t; no interval below
    `FEWEST` airs, and no value below two trials. airs: as in `over_airs`.
    """
    from taichi_plume.studies.intervals import FEWEST, confidence

    each, n = np.unique(airs), len(values)
    if n < 2:
        return Mean(None, None, None, n, len(each))
    off = values - values.mean()  # sums of squares of it keep their digits
    parts = [off[airs == air] for air in each]
    moments = np.array([(len(part), part.sum(), (part**2).sum()) for part in parts])

    def deviation(chosen: np.ndarray, axis: int = -1) -> np.ndarray:
        count, first, second = (moments[chosen, k].sum(axis) for k in range(3))
        return np.sqrt(np.maximum(second - first**2 / count, 0.0) / (count - 1.0))

    numbers = np.arange(len(each))
    ends: tuple[float | None, float | None] = (None, None)
    if len(each) >= FEWEST:
        level = confidence(len(each))
        ends = _percentiles((numbers,), deviation, n_resamples=2999, confidence_level=level)
    return Mean(float(deviation(numbers)), *ends, n, len(each))


SHARE, CORRELATION = (0.0, 1.0), (-1.0, 1.0)
"""Limits of a fraction and of a correlation, see `over_airs`."""
Results = Mapping[str, Mean | Picture]
"""Results of a condition: means by quantity, and pictures by title."""


@dataclass(frozen=True)
class Condition:
    """Condition of an experiment. `run` takes a number of trials and returns results; `published`, `expected`: by
    quantity.
    """

    name: str
    run: Callable[[int], Results]
    published: Mapping[str, str] = field(default_factory=dict)
    expected: Mapping[str, Range] = field(default_factory=dict)


@dataclass(frozen=True)
class Experiment:
    """Experiment: conditions compared with published results. A quantity without `expected` is reported, not judged.

    The command runs `trials` of each condition, the tests `test_trials`; 0 if an experiment is too long for the tests.
    """

    name: str
    about: str
    reference: str
    conditions: tuple[Condition, ...]
    evidence: Evidence = field(kw_only=True)
    compared: Compared = field(default=(), kw_only=True)
    trials: int = 200
    test_trials: int = 4
    discussion: str = ""
    """Text of the report: which results are reproduced, which are not, and why."""


@dataclass(frozen=True)
class Row:
    """Result of one quantity under a condition: our mean, the published result and the verdict."""

    condition: str
    quantity: str
    found: Mean
    published: str
    expected: Range | None

    @property
    def met(self) -> bool | None:
        """True if the mean is in the expected range; None without a range."""
        return None if self.expected is None else self.expected.met(self.found.mean)

    @property
    def refuted(self) -> bool:
        """True if the whole interval lies outside the expected range, the only verdict that few trials allow."""
        if self.expected is None:
            return False
        low, high = self.found.low, self.found.high
        return low is None or high is None or high < self.expected.least or low > self.expected.most


def examine(experiment: Experiment, trials: int, arch: str = "cpu") -> tuple[list[Row], dict[str, Picture]]:
    """Run `trials` of every condition, restarting Taichi for each; return all rows, and pictures by title."""
    rows: list[Row] = []
    pictures: dict[str, Picture] = {}
    for condition in experiment.conditions:
        program.start(arch)
        results = condition.run(trials)
        means = {name: part for name, part in results.items() if isinstance(part, Mean)}
        pictures |= {name: part for name, part in results.items() if not isinstance(part, Mean)}
        unknown = (condition.published.keys() | condition.expected.keys()) - means.keys()
        if unknown:
            raise KeyError(f"{experiment.name}, {condition.name} has no quantity {sorted(unknown)}")
        published, expected = condition.published, condition.expected
        rows += [
            Row(condition.name, name, mean, published.get(name, ""), expected.get(name))
            for name, mean in means.items()
        ]
    return rows, pictures
