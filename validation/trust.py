"""Picture of trust: computed beside measured values of all cases, by quantity, with bias and scatter of the model.

McGrattan & Toman 2011 (doi:10.1088/0026-1394/48/3/011), as in the validation guide of the Fire Dynamics Simulator: a
measurement is E = T (1 + e) and the model's value M = delta T (1 + m) for the true value T. The relative errors e and m
are Gaussian, with standard deviations sigma_E and sigma_M. For x = ln(M/E), with weights w that sum to 1,

    u²      = sum w (x - mean(x))² / (1 - sum w²)
    sigma_M = sqrt(max(u² - sigma_E², 0))
    delta   = exp(mean(x) + sigma_M²/2 - sigma_E²/2)

As there, sigma_E is at most u/sqrt(2): a model cannot be shown to be more certain than the measurements it is compared
with. sigma_E is that of the source; else that of the guide for velocity (8 %), concentration (8 %) and temperature
(7 %); else 0, and all scatter counts as the model's. Exact references and published bounds have sigma_E = 0.

Ours: (1) All cases count alike, w = 1/(cases * points of the case), and a curve has at most `POINTS` points, so that
long records do not decide. With one case the equations are those of the guide. (2) Velocities change sign and shares
end at 0 and 1, so x is the difference M - E over the case's largest measured speed, or in shares. sigma_E and sigma_M
are then in the same unit, and delta is the mean difference. (3) A published range is its geometric mean, and taken as
+-2 sigma_E; the interval of 95 % of a mean of n trials gives sigma_E by Student's t. (4) Published upper bounds have no
statistics but the share of values that keep them.
"""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import log, nan, sqrt
from typing import NamedTuple

import numpy as np
from scipy.stats import t as student

from taichi_plume.validation.case import Case, Comparison, Evidence, Keys, Quantity
from taichi_plume.validation.experiment import Experiment

POINTS = 20
"""Largest number of points of a curve in the picture, equally spaced."""


class Scale(NamedTuple):
    """Treatment of a quantity: differences instead of ratios, values over the case's largest, default sigma_E."""

    differences: bool = False
    relative: bool = True
    sigma: float = 0.0


SCALES: Mapping[Quantity, Scale] = {
    "velocity": Scale(differences=True, sigma=0.08),
    "mean concentration": Scale(sigma=0.08),
    "concentration fluctuation": Scale(relative=False),
    "temperature": Scale(sigma=0.07),
    "drag": Scale(relative=False),
    "time of searches": Scale(relative=False),
    "success of searches": Scale(differences=True, relative=False),
    "error of maps": Scale(relative=False),
}


@dataclass(frozen=True)
class Points:
    """Measured and computed values (n,) of a case in one quantity, over the case's largest where `Scale.relative`.

    sigma: relative standard deviation of each measured value. bound: the measured values are published upper bounds.
    """

    case: str
    evidence: Evidence
    met: bool
    measured: np.ndarray
    computed: np.ndarray
    sigma: np.ndarray
    bound: bool = False


@dataclass(frozen=True)
class Statistics:
    """Bias (delta) and standard deviations of model and experiments; NaN where too few points decide."""

    cases: int
    points: int
    bias: float
    model: float
    experiments: float


def statistics(groups: Sequence[Points], differences: bool = False) -> Statistics:
    """Return the statistics of a quantity; see the module for the equations."""
    weights = np.concatenate([np.full(len(group.measured), 1.0 / len(group.measured)) for group in groups])
    weights /= len(groups)
    measured, computed, sigma = (
        np.concatenate([getattr(group, name) for group in groups])
        for name in ("measured", "computed", "sigma")
    )
    x = computed - measured if differences else np.log(computed / measured)
    mean, count = float(weights @ x), len(x)
    if count < 2:
        return Statistics(len(groups), count, nan, nan, nan)
    variance = float(weights @ (x - mean) ** 2 / (1.0 - weights @ weights))
    errors = float(weights @ (sigma * measured if differences else sigma) ** 2)
    errors = min(errors, 0.5 * variance)
    rest = variance - errors
    bias = mean if differences else float(np.exp(mean + 0.5 * (rest - errors)))
    return Statistics(len(groups), count, bias, sqrt(rest), sqrt(errors))


def collected(
    cases: Mapping[str, Case | Experiment], results: Mapping[str, Keys]
) -> dict[Quantity, list[Points]]:
    """Return the points of all cases by quantity that has any; results: by name, as `report.json` has them."""
    found: dict[Quantity, list[Points]] = {quantity: [] for quantity in SCALES}
    if unknown := results.keys() - cases.keys():
        raise ValueError(f"results of no known case: {', '.join(sorted(unknown))}")
    for name, result in results.items():
        for quantity, scale in SCALES.items():
            parts = [part for part in comparisons(cases[name]) if part.quantity == quantity]
            exact = cases[name].evidence == "exact"
            sigma = 0.0 if exact else scale.sigma
            found_pairs = [pair for part in parts for pair in _pairs(part, result, sigma)]
            pairs = np.array(found_pairs, float).reshape(
                -1, 3
            )  # null, as not finite values are stored, is NaN
            pairs = pairs[np.isfinite(pairs).all(axis=1)]
            if not len(pairs):
                continue
            measured, computed, sigma = pairs.T
            if not scale.differences and min(measured.min(), computed.min()) <= 0.0:
                raise ValueError(f"{name}: values of {quantity} must be positive, as their ratio counts")
            top = np.abs(measured).max() if scale.relative else 1.0
            bound = any(part.bound for part in parts)
            points = measured / top, computed / top, sigma
            found[quantity].append(Points(name, cases[name].evidence, result["passed"], *points, bound))
    return {quantity: groups for quantity, groups in found.items() if groups}


def comparisons(case: Case | Experiment) -> tuple[Comparison, ...]:
    """Return the comparisons of a case; none if it states a reason."""
    return () if isinstance(case.compared, str) else case.compared


Pair = tuple[float, float, float]
"""Measured value, computed value and relative standard deviation of the measurement."""


def _pairs(part: Comparison, result: Keys, sigma: float) -> Iterator[Pair]:
    """Yield the pairs that a comparison selects in the stored result of a case; sigma: default."""
    default = sigma if part.sigma is None else part.sigma
    for title, picture in result.get("pictures", {}).items():
        if picture["kind"] in ("curve", "lines") and re.fullmatch(part.values, title):
            for reference, computed in _lines(part, picture):
                yield from ((m, c, default) for m, c in _thinned(reference, computed))
    for row in result.get("norms", ()):
        if re.fullmatch(part.values, row["norm"]) and isinstance(part.measured, float | int):
            yield float(part.measured), list(row["errors"].values())[-1], default
    for row in result.get("rows", ()):
        if not (re.fullmatch(part.values, row["quantity"]) and re.fullmatch(part.where, row["condition"])):
            continue
        if row["mean"] is not None:
            for measured, stated in _reference(part, row, result["rows"]):
                yield measured, row["mean"], default if stated is None or part.sigma is not None else stated


def _lines(part: Comparison, picture: Keys) -> Iterator[tuple[list, list]]:
    """Yield reference and computed values of a curve, or of the lines that `where` selects."""
    if picture["kind"] == "curve":
        yield picture["reference"], picture["computed"]
    elif isinstance(part.measured, str):
        lines = picture["lines"]
        for name in lines:
            if name != part.measured and re.fullmatch(part.where, name):
                yield lines[part.measured], lines[name]


def _thinned(reference: Iterable, computed: Iterable) -> list[tuple[float, float]]:
    """Return at most `POINTS` equally spaced pairs in which both values are known."""
    known = [pair for pair in zip(reference, computed, strict=True) if None not in pair]
    chosen = np.unique(np.linspace(0, len(known) - 1, min(len(known), POINTS)).round().astype(int))
    return [known[k] for k in chosen]


def _reference(part: Comparison, row: Keys, rows: Sequence[Keys]) -> list[tuple[float, float | None]]:
    """Return the values beside which a row stands, each with its stated sigma."""
    if isinstance(part.measured, str):
        return [
            (other["mean"], None)
            for other in rows
            if other["condition"] == row["condition"] and other["quantity"] == part.measured
        ]
    if part.measured is None:
        return published(row["published"]) if row["published"] else []
    return [(float(part.measured), None)]


NUMBER = r"(-?\d+(?:\.\d+)?)"


def published(text: str) -> list[tuple[float, float | None]]:
    """Return the values in the text of a published result, each with its relative standard deviation if stated.

    Texts are "11.5 +- 2.4 (n = 15)", an interval of 95 % of a mean; "0.3 to 0.5", a range; "9 of 10", a share; and
    "0.03, 0.06", several measurements. Raises ValueError for others.
    """
    if mean := re.match(rf"{NUMBER} \+- {NUMBER} \(n = (\d+)\)", text):
        value, half, n = map(float, mean.groups())
        if value and n > 1.0:
            return [(value, half / abs(value) / float(student.ppf(0.975, n - 1)))]
    if ends := re.match(rf"{NUMBER} to {NUMBER}\b", text):
        low, high = map(float, ends.groups())
        if 0.0 < low <= high:
            return [(sqrt(low * high), log(high / low) / 4.0)]
    if (share := re.match(rf"{NUMBER} of {NUMBER}\b", text)) and float(share[2]):
        return [(float(share[1]) / float(share[2]), None)]
    if re.fullmatch(rf"{NUMBER}(, {NUMBER})*", text):
        return [(float(value), None) for value in re.findall(NUMBER, text)]
    raise ValueError(f"no number that can be compared: {text!r}")
