"""Sobol indices of a sensitivity study (variance-based global sensitivity analysis), by `scipy.stats.sobol_indices`.

The first-order index of an axis is the fraction of the variance that vanishes if the axis is fixed. The total index is
the fraction that remains if all other axes are fixed (Saltelli et al. 2010, doi:10.1016/j.cpc.2009.09.018).
"""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from math import nan
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from taichi_plume.studies.estimates import Points, Quantity

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
    """Sobol indices of a quantity for a group of robots.

    used, asked: number of used and of all rows of the design; a row has a point of A, of B, and of each AB_i. variance:
    over the points; noise: variance of a point's mean over airs, averaged over the points, NaN if points have a single
    air; indices: by axis, empty if the quantity does not vary.
    """

    used: int
    asked: int
    variance: float
    noise: float
    indices: dict[str, Index]


def numbers(samples: int, axes: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the indices of the points of Saltelli's design: A (samples,), B (samples,), AB (axes, samples).

    The plan lists A, then B, then AB_i for each axis i: A with the values of B on axis i.
    """
    blocks = np.arange((axes + 2) * samples).reshape(axes + 2, samples)
    return blocks[0], blocks[1], blocks[2:]


def sobol(values: np.ndarray, axes: tuple[str, ...], samples: int) -> tuple[int, dict[str, Index]]:
    """Return the number of design rows used and the Sobol indices by axis, from values (points,) of Saltelli's design.

    Estimates and ends of intervals below 0 or above 1 become 0 or 1, as an index is a fraction of the variance.
    Rows with a NaN are left out. Of the other rows the first 2^k are used, as a Sobol sequence needs a power of two for
    its low discrepancy.
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
        parts += [np.clip(np.atleast_1d(values), 0.0, 1.0) for values in (index, ends.low, ends.high)]
    return used, {axis: Index(*map(float, row)) for axis, *row in zip(axes, *parts, strict=True)}


@contextmanager
def _seeded() -> Iterator[None]:
    """Seed NumPy's global random generator, which scipy's bootstrap uses; restore the state afterwards."""
    before = np.random.get_state()  # noqa: NPY002
    np.random.seed(SEED)  # noqa: NPY002
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # undefined BCa intervals: their ends are NaN
            yield
    finally:
        np.random.set_state(before)  # noqa: NPY002


def found(points: "Points") -> Iterator[tuple["Quantity", str | None, Found]]:
    """Yield (quantity, group of robots or None, Sobol indices) for all quantities except means over successes."""
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
    """Return sentences about Sobol indices: unused rows, share of variance due to chance, width of intervals."""
    lines = []
    if result.used < result.asked:
        lines.append(
            f"{result.used} of {result.asked} rows of the design are used: the others lack a run that failed or is "
            "missing, and the number of rows must be a power of two"
        )
    if not result.indices:
        lines.append("all points have the same value, so there are no indices")
        return lines
    if np.isnan(result.noise):
        lines.append("the variance due to chance is unknown: each point needs at least two airs")
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
