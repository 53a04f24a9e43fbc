"""Sobol indices of a sensitivity study: which axes matter, by `scipy.stats.sobol_indices`.

The first-order index of an axis is the share of the variance that vanishes when the axis's value is known; the total
index is the share that remains when all other values are known (Saltelli et al. 2010, doi:10.1016/j.cpc.2009.09.018).
"""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from math import nan
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from taichi_plume.study.points import Points, Quantity

SEED = 20261
RESAMPLES = 999


class Index(NamedTuple):
    """First-order and total index of an axis with 95 % confidence intervals over the sampled points."""

    first: float
    first_low: float
    first_high: float
    total: float
    total_low: float
    total_high: float


class Found(NamedTuple):
    """Indices of a quantity in a group.

    used, asked: rows of the design, each with a point of A, of B, and of each AB_i; variance: over the points; noise:
    variance of a point's mean over airs, averaged over the points, NaN if points have a single air; indices: by axis,
    empty if nothing varies.
    """

    used: int
    asked: int
    variance: float
    noise: float
    indices: dict[str, Index]


def numbers(samples: int, axes: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the numbers of the design's points: A (samples,), B (samples,), AB (axes, samples).

    In the plan all of A come first, then all of B, then for each axis AB_i, which is A with that axis's values of B.
    """
    blocks = np.arange((axes + 2) * samples).reshape(axes + 2, samples)
    return blocks[0], blocks[1], blocks[2:]


def sobol(values: np.ndarray, axes: tuple[str, ...], samples: int) -> tuple[int, dict[str, Index]]:
    """Return the number of rows used and the indices of values (points,), in the order of `numbers`.

    Rows with a NaN are left out. Of the other rows the first ones are used, as many as are a power of two, since the
    Sobol sequence is evenly spread only then.
    """
    from scipy.stats import sobol_indices

    a, b, ab = (values[points] for points in numbers(samples, len(axes)))
    whole = np.flatnonzero(np.isfinite(np.vstack([a, b, ab])).all(axis=0))
    used = 1 << (len(whole).bit_length() - 1) if len(whole) else 0
    rows = whole[:used]
    if used < 2 or np.ptp(np.concatenate([a[rows], b[rows]])) == 0:
        return used, {}
    found = sobol_indices(
        func={"f_A": a[None, rows], "f_B": b[None, rows], "f_AB": ab[:, None, rows]}, n=used
    )
    with _seeded():
        spread = found.bootstrap(n_resamples=RESAMPLES)
    parts = []
    for index, spread_of in (
        (found.first_order, spread.first_order),
        (found.total_order, spread.total_order),
    ):
        ends = spread_of.confidence_interval
        parts += [np.atleast_1d(index), np.atleast_1d(ends.low), np.atleast_1d(ends.high)]
    return used, {axis: Index(*map(float, row)) for axis, *row in zip(axes, *parts, strict=True)}


@contextmanager
def _seeded() -> Iterator[None]:
    """Seed NumPy's global random numbers, from which that bootstrap draws, and restore their state afterwards."""
    before = np.random.get_state()  # noqa: NPY002
    np.random.seed(SEED)  # noqa: NPY002
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of BCa where it is undefined: its ends are NaN
            yield
    finally:
        np.random.set_state(before)  # noqa: NPY002


def found(points: "Points") -> Iterator[tuple["Quantity", str | None, Found]]:
    """Yield (quantity, group, Found) for each quantity that every point can have, and each group."""
    samples, axes = int(points.plan.about["study"]["samples"]), tuple(axis.name for axis in points.plan.axes)
    table = points.table
    groups = list(dict.fromkeys(table["group"].dropna())) if "group" in table else []
    for quantity in points.quantities:
        if quantity.what == "successes":  # undefined at points without a success
            continue
        for group in groups if quantity.what != "runs" else [None]:
            rows = np.flatnonzero(table["group"] == group) if group is not None else np.arange(len(table))
            values = np.full((len(axes) + 2) * samples, nan)
            noise = []
            spread = points.between_airs(quantity)
            for row in rows:
                estimate, point = points.estimates[quantity.name][row], int(table["point"].iloc[row])
                if estimate is None or point >= len(values):
                    continue
                values[point] = estimate.mean
                noise.append(spread.get((point, group) if group is not None else point, nan))
            if not np.isfinite(values).any():
                continue
            used, indices = sobol(values, axes, samples)
            drawn = values[: 2 * samples]
            of_airs = np.array(noise)[np.isfinite(noise)]
            yield quantity, group, Found(
                used, samples, float(np.nanvar(drawn, ddof=1)), float(of_airs.mean()) if len(of_airs) else nan, indices
            )  # fmt: skip


def words(result: Found) -> list[str]:
    """Return sentences about indices: which rows are missing, how much of the variance is chance."""
    lines = []
    if result.used < result.asked:
        lines.append(
            f"{result.used} of {result.asked} rows of the design are used: the others lack a run that failed or is "
            "missing, and the number of rows must be a power of two"
        )
    if not result.indices:
        lines.append("nothing varies over the points, so there are no indices")
        return lines
    if np.isnan(result.noise):
        lines.append("how much is chance is unknown: at least two airs at each point are needed")
    else:
        share = result.noise / result.variance if result.variance else nan
        more = ": more airs would help more than more points" if share > 0.5 else ""
        lines.append(
            f"of the variance over the points, {100 * min(share, 1):.0f} % is chance from air to air{more}"
        )
    wide = max(each.total_high - each.total_low for each in result.indices.values())
    if not wide < 0.5:
        lines.append("intervals are wide: take more samples")
    return lines
