"""Grid refinement study: observed order of convergence, Richardson extrapolation and grid convergence index (GCI).

Values f = f0 + a h^p at the three finest spacings h1 < h2 < h3 make (f3 - f2)/(f2 - f1) a function of the order p only.
The ratios of spacings may differ (Celik et al. 2008, doi:10.1115/1.2960953). Oscillating values converge if each change
is smaller than the previous change; their order follows from the same equation with alternating signs.
"""

from collections.abc import Iterator, Sequence
from math import nan
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import root_scalar

from taichi_plume.studies.messages import Data, Row
from taichi_plume.studies.study_keys import SPACING

if TYPE_CHECKING:
    from taichi_plume.studies.estimates import Points
    from taichi_plume.studies.intervals import Estimate

SAFETY = 1.25  # safety factor of the GCI with three grids
HIGHEST = 12.0  # upper bound of the reported order


class Order(NamedTuple):
    """Convergence of a value at three spacings.

    order, extrapolated (value at zero spacing), index (grid convergence index, in the value's unit): NaN if undefined;
    behaviour: converges, oscillates, diverges, still (no change) or too few.
    """

    order: float
    extrapolated: float
    index: float
    behaviour: str


SENTENCES = {
    "converges": "monotone convergence",
    "oscillates": "oscillatory convergence, whose observed order is unreliable",
    "diverges": "no convergence: the last change is too large compared with the previous change",
    "still": "no change between the finest spacings, so the order is undefined",
    "too few": "the order needs three spacings",
}


def order(spacings: ArrayLike, values: ArrayLike) -> Order:
    """Return the observed order of values (n,) at spacings (n,), from the three finest spacings with finite values."""
    pairs = zip(np.asarray(spacings, float).tolist(), np.asarray(values, float).tolist(), strict=True)
    known = sorted((h, f) for h, f in pairs if np.isfinite(f))[:3]
    if len(known) < 3:
        return Order(nan, nan, nan, "too few")
    (h1, f1), (h2, f2), (h3, f3) = known
    fine, coarse = h2 / h1, h3 / h2
    change, before = f2 - f1, f3 - f2
    if abs(change) <= 1e-12 * max(abs(f1), abs(f2), abs(f3)):
        return Order(nan, f1, 0.0, "still")
    ratio = before / change
    sign = 1.0 if ratio > 0 else -1.0

    def off(p: float) -> float:
        return fine**p * (coarse**p - sign) / (fine**p - sign) - abs(ratio)

    least = 1e-6
    if off(least) >= 0:
        return Order(nan, nan, nan, "diverges")
    p = root_scalar(off, bracket=(least, HIGHEST)).root if off(HIGHEST) > 0 else HIGHEST
    gain = fine**p - 1
    return Order(
        p, f1 - change / gain, SAFETY * abs(change) / gain, "converges" if sign > 0 else "oscillates"
    )


def axis_of(about: Data) -> str | None:
    """Return the name of the axis that varies the spacing; about: metadata of a plan's table."""
    axes = about["study"].get("axes") or {}
    for name, axis in axes.items():
        if isinstance(axis, dict) and SPACING in (axis.get("key"), *(axis.get("keys") or ())):
            return name
    return None


def orders(points: "Points", axis: str) -> Iterator[Row]:
    """Yield the order of each quantity, for each combination of the other axes' values and group.

    A row has the values and group, `quantity`, `unit`, `spacings` (finest first), `values`, the fields of Order, and
    `chance`: whether the last change lies within the interval of one of the two values and may be chance; None without
    an interval.
    """
    table = points.table
    others = [name for name in (*points.axes, "group") if name != axis and name in table]
    groups = {(): np.arange(len(table))}
    if others:
        groups = table.groupby(others, sort=False, dropna=False).indices
    for values, rows in groups.items():
        key = values if isinstance(values, tuple) else (values,)
        rows = rows[np.argsort(table[axis].to_numpy(float)[rows])]
        spacings = table[axis].to_numpy(float)[rows]
        for quantity in points.quantities:
            estimates = [points.estimates[quantity.name][row] for row in rows]
            means = [each.mean if each else nan for each in estimates]
            if not np.isfinite(means).any():
                continue
            found = order(spacings, means)
            yield {
                **dict(zip(others, key, strict=True)), "quantity": quantity.name, "unit": quantity.unit,
                "spacings": spacings.tolist(), "values": means, **found._asdict(), "chance": _chance(estimates),
            }  # fmt: skip


def _chance(estimates: "Sequence[Estimate | None]") -> bool | None:
    known = [estimate for estimate in estimates if estimate]
    if len(known) < 2 or not all(np.isfinite(estimate.low) for estimate in known[:2]):
        return None
    (a, b) = known[:2]
    return bool(a.low <= b.mean <= a.high or b.low <= a.mean <= b.high)


def words(row: Row) -> str:
    """Return a sentence on grid convergence from a row of `orders`: order, extrapolated value, error, chance."""
    if row["behaviour"] not in ("converges", "oscillates"):
        return SENTENCES[row["behaviour"]]
    unit = "" if row["unit"] == "1" else f" {row['unit']}"
    prefix = f"{SENTENCES[row['behaviour']]}: " if row["behaviour"] == "oscillates" else ""
    about = "at least " if row["order"] >= HIGHEST else ""
    text = (
        f"{prefix}order {about}{row['order']:.2f}, towards {row['extrapolated']:.4g}{unit}; "
        f"at the finest spacing it may be off by {row['index']:.2g}{unit} (grid convergence index)"
    )
    if row["chance"]:
        text += "; the last change is within the interval over airs, so it may be chance; use more airs"
    return text
