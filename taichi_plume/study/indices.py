"""Which axes matter: Sobol indices of what a study of kind sensitivity tells, by `scipy.stats.sobol_indices`.

The first-order index of an axis is the share of the variance that goes when its value is known; the total index the
share that stays when all others are known (Saltelli et al. 2010, doi:10.1016/j.cpc.2009.09.018).
"""

from collections.abc import Iterator
from math import nan
from typing import Any, NamedTuple

import numpy as np

SEED = 20261
RESAMPLES = 999


class Index(NamedTuple):
    """First-order and total index of an axis with intervals of 95 % confidence over the points that were drawn."""

    first: float
    first_low: float
    first_high: float
    total: float
    total_low: float
    total_high: float


class Found(NamedTuple):
    """The indices of a quantity, of a group.

    used, asked: rows of the design, each with a point of A, of B, and one of each AB_i; variance: over the points;
    noise: of a point's mean over airs, mean over the points, NaN where a point has a single air; indices: by axis, none
    where nothing varies.
    """

    used: int
    asked: int
    variance: float
    noise: float
    indices: dict[str, Index]


def numbers(samples: int, axes: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Numbers of the points of the design: A (samples,), B (samples,), AB (axes, samples).

    The plan orders them so: all of A, all of B, then all of AB_i for each axis, which are A with that axis of B.
    """
    blocks = np.arange((axes + 2) * samples).reshape(axes + 2, samples)
    return blocks[0], blocks[1], blocks[2:]


def sobol(values: np.ndarray, axes: tuple[str, ...], samples: int) -> tuple[int, dict[str, Index]]:
    """The indices of values (points,), in the order of `numbers`, NaN where there is none; and how many rows they use.

    Rows that lack a value are left out and, of the others, the first so many that are a power of two are used, as the
    sequence is even for these alone.
    """
    from scipy.stats import sobol_indices

    a, b, ab = (values[one] for one in numbers(samples, len(axes)))
    whole = np.flatnonzero(np.isfinite(np.vstack([a, b, ab])).all(axis=0))
    used = 1 << (len(whole).bit_length() - 1) if len(whole) else 0
    rows = whole[:used]
    if used < 2 or np.ptp(np.concatenate([a[rows], b[rows]])) == 0:
        return used, {}
    told = sobol_indices(func={"f_A": a[None, rows], "f_B": b[None, rows], "f_AB": ab[:, None, rows]}, n=used)
    with _seeded():
        spread = told.bootstrap(n_resamples=RESAMPLES)
    parts = []
    for index, its in ((told.first_order, spread.first_order), (told.total_order, spread.total_order)):
        ends = its.confidence_interval
        parts += [np.atleast_1d(index), np.atleast_1d(ends.low), np.atleast_1d(ends.high)]
    return used, {
        axis: Index(*map(float, one)) for axis, one in zip(axes, zip(*parts, strict=True), strict=True)
    }


class _seeded:  # noqa: N801
    """NumPy's global numbers, from which that bootstrap draws, from a seed of ours, and then as they were."""

    def __enter__(self) -> None:
        import warnings

        self.before = np.random.get_state()  # noqa: NPY002
        np.random.seed(SEED)  # noqa: NPY002
        self.quiet = warnings.catch_warnings()
        self.quiet.__enter__()
        warnings.simplefilter("ignore")  # of BCa where it cannot be told: its ends are NaN

    def __exit__(self, *_: object) -> None:
        self.quiet.__exit__(None, None, None)
        np.random.set_state(self.before)  # noqa: NPY002


def found(points: Any) -> Iterator[tuple[Any, str | None, Found]]:
    """For each quantity of `Points` that every point can have, and each group: (quantity, group, Found)."""
    samples, axes = int(points.plan.about["study"]["samples"]), tuple(one.name for one in points.plan.axes)
    table = points.table
    groups = list(dict.fromkeys(table["group"].dropna())) if "group" in table else []
    for one in points.quantities:
        if one.what == "successes":  # of points without a success there is none
            continue
        for group in groups if one.what != "runs" else [None]:
            rows = np.flatnonzero(table["group"] == group) if group is not None else np.arange(len(table))
            values = np.full((len(axes) + 2) * samples, nan)
            noise = []
            spread = points.between_airs(one)
            for row in rows:
                told, point = points.estimates[one.name][row], int(table["point"].iloc[row])
                if told is None or point >= len(values):
                    continue
                values[point] = told.mean
                noise.append(spread.get((point, group) if group is not None else point, nan))
            if not np.isfinite(values).any():
                continue
            used, indices = sobol(values, axes, samples)
            drawn = values[: 2 * samples]
            of_airs = np.array(noise)[np.isfinite(noise)]
            yield one, group, Found(
                used, samples, float(np.nanvar(drawn, ddof=1)), float(of_airs.mean()) if len(of_airs) else nan, indices
            )  # fmt: skip


def words(one: Found) -> list[str]:
    """What is to be known of indices beside their numbers: what is missing, how much is chance."""
    lines = []
    if one.used < one.asked:
        lines.append(
            f"{one.used} of {one.asked} rows of the design are used: the others lack a run that failed or has not been "
            "made, and the rows have to be a power of two"
        )
    if not one.indices:
        lines.append("nothing varies over the points, so there are no indices")
        return lines
    if np.isnan(one.noise):
        lines.append("how much is chance cannot be told: it takes two airs at each point")
    else:
        share = one.noise / one.variance if one.variance else nan
        more = ": more airs would tell more than more points" if share > 0.5 else ""
        lines.append(
            f"of the variance over the points, {100 * min(share, 1):.0f} % is chance from air to air{more}"
        )
    wide = max(each.total_high - each.total_low for each in one.indices.values())
    if not wide < 0.5:
        lines.append("intervals are wide: take more samples")
    return lines
