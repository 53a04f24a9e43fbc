"""Design of experiments of a study: points from a full-factorial grid, Sobol sequence or Latin hypercube.

A point has a value on each axis. Axes with values, variants, or a range with count form a grid of all combinations, in
the order written; the last axis changes fastest. Ranges without count are sampled together. Each sample is combined
with the whole grid and changes faster still. A sensitivity study has the points A, B, AB_1, AB_2 ... of Saltelli et al.
2010 (doi:10.1016/j.cpc.2009.09.018), see `indices.numbers`.
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np

from taichi_plume.studies.messages import Data, Value
from taichi_plume.studies.study_keys import Study, StudyAxis

DIGITS = 12  # significant digits of sampled values


class Level(NamedTuple):
    """Value of a study's axis, as written in the tables, and the changes that it makes to the scenario, by path."""

    value: Value
    changes: Mapping[str, object]


class Levels(NamedTuple):
    """Axis of a study with a list of values (levels), which forms a grid with the other such axes."""

    name: str
    unit: str
    levels: Sequence[Level]


class Range(NamedTuple):
    """Axis of a study that is sampled between low and high, uniformly or (log) uniformly in the logarithm."""

    name: str
    unit: str
    paths: Sequence[str]
    low: float
    high: float
    log: bool


class Point(NamedTuple):
    """Combination of axis values in a study. which: index of the level on each grid axis, then of the sample."""

    which: tuple[int, ...]
    values: dict[str, Value]
    changes: Data


def points(study: Study, axes: Sequence[Levels | Range]) -> Iterator[Point]:
    """Yield all combinations of axis values of a study: the grid, each combined with all samples of sampled axes."""
    grid = [axis for axis in axes if isinstance(axis, Levels)]
    drawn = [axis for axis in axes if isinstance(axis, Range)]
    draws = [scaled(axis, column) for axis, column in zip(drawn, _shares(study, len(drawn)).T, strict=True)]
    rows = list(zip(*draws, strict=True)) or [()]
    for which in product(*(range(len(axis.levels)) for axis in grid)):
        levels = [axis.levels[n] for axis, n in zip(grid, which, strict=True)]
        for k, row in enumerate(rows):
            values = {axis.name: level.value for axis, level in zip(grid, levels, strict=True)}
            changes = {key: value for level in levels for key, value in level.changes.items()}
            for axis, value in zip(drawn, row, strict=True):
                values[axis.name] = value
                changes |= dict.fromkeys(axis.paths, value)
            yield Point((*which, k), {axis.name: values[axis.name] for axis in axes}, changes)


def _shares(study: Study, axes: int) -> np.ndarray:
    """Return samples (samples, axes) in [0, 1] by Saltelli's design, Latin hypercube or Sobol sequence."""
    if not axes:
        return np.empty((0, 0))
    from scipy.stats import qmc  # half a second, for studies that sample

    if study.kind == "sensitivity":
        both = qmc.Sobol(2 * axes, rng=0).random_base2(study.samples.bit_length() - 1)
        a, b = both[:, :axes], both[:, axes:]
        mixed = [np.where(np.arange(axes) == k, b, a) for k in range(axes)]
        return np.vstack([a, b, *mixed])
    assert study.sampling is not None
    count, seed = study.sampling.count, study.sampling.seed
    if study.sampling.kind == "latin":
        return qmc.LatinHypercube(axes, rng=seed).random(count)
    return qmc.Sobol(axes, rng=seed).random_base2(count.bit_length() - 1)


def scaled(axis: Range, shares: np.ndarray) -> list[float]:
    """Map fractions (n,) in [0, 1] to values of a sampled axis, linear or logarithmic, rounded to 12 digits."""
    low, high = axis.low, axis.high
    found = low * (high / low) ** shares if axis.log else low + (high - low) * shares
    return [min(max(float(f"{value:.{DIGITS}g}"), low), high) for value in found]


def count_of(axis: StudyAxis) -> int:
    """Number of values of a grid axis; 1 for a sampled axis."""
    return len(axis.values or axis.variants or ()) or axis.count or 1
