"""The points of a study: combinations of the values of its axes.

Axes with values, variants, or a range with count are a grid: all combinations, in the order written, of which the last
axis changes fastest. Ranges without count are drawn, all together, and each draw is combined with the whole grid; the
draw changes faster still.
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from taichi_plume.study.model import Study, StudyAxis

DIGITS = 12  # of numbers in ranges
Scalar = float | int | str | bool


class Level(NamedTuple):
    """A value of an axis in a grid: as the tables have it, and what it changes."""

    value: Scalar
    changes: Mapping[str, Any]


class Levels(NamedTuple):
    """An axis of the grid."""

    name: str
    unit: str
    levels: Sequence[Level]


class Range(NamedTuple):
    """An axis that is drawn, from low to high."""

    name: str
    unit: str
    paths: Sequence[str]
    low: float
    high: float
    log: bool


class Point(NamedTuple):
    """A combination. which: the number of each grid axis's value, and that of the draw."""

    which: tuple[int, ...]
    values: dict[str, Scalar]
    changes: dict[str, Any]


def points(study: Study, axes: Sequence[Levels | Range]) -> Iterator[Point]:
    """All points, in the plan's order; of a sensitivity study see `saltelli`."""
    grid = [axis for axis in axes if isinstance(axis, Levels)]
    drawn = [axis for axis in axes if isinstance(axis, Range)]
    draws = [scaled(axis, column) for axis, column in zip(drawn, _shares(study, len(drawn)).T, strict=True)]
    rows = list(zip(*draws, strict=True)) or [()]
    for which in product(*(range(len(axis.levels)) for axis in grid)):
        levels = [axis.levels[n] for axis, n in zip(grid, which, strict=True)]
        for k, row in enumerate(rows):
            values = {axis.name: one.value for axis, one in zip(grid, levels, strict=True)}
            changes = {key: value for one in levels for key, value in one.changes.items()}
            for axis, value in zip(drawn, row, strict=True):
                values[axis.name] = value
                changes |= dict.fromkeys(axis.paths, value)
            yield Point((*which, k), {axis.name: values[axis.name] for axis in axes}, changes)


def saltelli(number: int, samples: int) -> tuple[str, int, int]:
    """Which row of which matrix a point of a sensitivity study is: ("A", -1, row), ("B", -1, row), or ("AB", k, row),
    where AB has B's values of axis k in A (Saltelli et al. 2010, doi:10.1016/j.cpc.2009.09.018).

    Points are in the order A, B, AB of the first axis, AB of the second ..., each of `samples` rows.
    """
    block, row = divmod(number, samples)
    return ("AB", block - 2, row) if block > 1 else ("AB"[block], -1, row)


def _shares(study: Study, axes: int) -> np.ndarray:
    """Where the drawn values of each point lie in their ranges, from 0 to 1, (points, axes)."""
    if not axes:
        return np.empty((0, 0))
    from scipy.stats import qmc  # half a second, for studies that draw

    if study.kind == "sensitivity":
        both = qmc.Sobol(2 * axes, rng=0).random_base2(study.samples.bit_length() - 1)
        a, b = both[:, :axes], both[:, axes:]
        mixed = [np.where(np.arange(axes) == k, b, a) for k in range(axes)]
        return np.vstack([a, b, *mixed])
    assert study.sampling is not None
    its = study.sampling
    if its.kind == "latin":
        return qmc.LatinHypercube(axes, rng=its.seed).random(its.count)
    return qmc.Sobol(axes, rng=its.seed).random_base2(its.count.bit_length() - 1)


def scaled(axis: Range, shares: np.ndarray) -> list[float]:
    """The values of a range at these shares of it."""
    low, high = axis.low, axis.high
    found = low * (high / low) ** shares if axis.log else low + (high - low) * shares
    return [min(max(float(f"{value:.{DIGITS}g}"), low), high) for value in found]


def count_of(axis: StudyAxis) -> int:
    """How many values an axis of the grid has; 1 for one that is drawn."""
    return len(axis.values or axis.variants or ()) or axis.count or 1
