"""Validation case: a problem with a known answer, solved at several resolutions, and the bounds of its errors."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import inf, isfinite, log, nan
from typing import Any, Literal, TypeAlias

import numpy as np

from taichi_plume.engine import program

Keys: TypeAlias = dict[str, Any]
"""Scenario or section of a scenario, as a YAML file holds it; part of a report, as JSON holds it."""

Evidence: TypeAlias = Literal["exact", "law", "measured", "published"]
"""Kind of the reference that decides the verdict of a case; if there are several, of most judged quantities."""

EVIDENCE: Mapping[Evidence, str] = {
    "exact": "closed form, invariant or numerical reference: another method, a finer grid, a benchmark",
    "law": "law of the field, as the law of the wall or the exponent of a decay",
    "measured": "raw data that others measured, point by point",
    "published": "figure, table or statement of a paper",
}
"""Meaning of each kind of evidence."""


Quantity: TypeAlias = Literal[
    "velocity",
    "mean concentration",
    "concentration fluctuation",
    "temperature",
    "drag",
    "time of searches",
    "success of searches",
    "error of maps",
]
"""Quantity of the picture of trust (see `trust`)."""


@dataclass(frozen=True)
class Comparison:
    """Values of a case that the picture of trust shows beside measured or published values (see `trust`).

    values: regular expression of names of errors or means, or of titles of pictures. where: of conditions, or of the
    computed line of a picture of several lines. measured: a number, or the name of the line or mean that is the
    reference; by default the reference of a curve, or the number in `published`. sigma: relative standard deviation of
    the measurement; by default that in `published`, or the quantity's. bound: the published value is an upper bound.
    """

    quantity: Quantity
    values: str
    where: str = ".*"
    measured: float | str | None = None
    sigma: float | None = None
    bound: bool = False


Compared: TypeAlias = tuple[Comparison, ...] | str
"""Comparisons of a case, or the reason why the picture of trust has none."""


@dataclass(frozen=True)
class Expected:
    """Bounds of an error: at least an order of accuracy, at most a tolerance.

    The tolerance holds at resolution `at`; at n cells it is (at/n)² times as large, as the schemes are of second order.
    Without `at` the tolerance holds at every resolution.
    """

    order: float | None = None
    tolerance: float | None = None
    at: int | None = None

    def limit(self, n: int) -> float:
        """Return the largest error allowed at resolution n."""
        if self.tolerance is None:
            return inf
        return self.tolerance * ((self.at / n) ** 2 if self.at else 1.0)

    def met(self, errors: Mapping[int, float]) -> bool:
        """Return whether errors by ascending resolution are within the bounds."""
        within = all(isfinite(error) and error <= self.limit(n) for n, error in errors.items())
        return within and (self.order is None or observed_order(errors) >= self.order)

    def __str__(self) -> str:
        parts = [] if self.order is None else [f"order >= {self.order:g}"]
        if self.tolerance is not None:
            parts.append(f"<= {self.tolerance:g}" + (f" at {self.at}" if self.at else ""))
        return ", ".join(parts)


SECOND_ORDER = Expected(order=1.9)


@dataclass(frozen=True)
class Curve:
    """Computed curve beside its reference, for the plots of the report: arrays of one shape.

    fit: a law fitted to the computed curve, if any.
    """

    x_label: str
    y_label: str
    x: np.ndarray
    computed: np.ndarray
    reference: np.ndarray
    log_x: bool = False
    log_y: bool = False
    fit: np.ndarray | None = None


Answer = Mapping[str, float | Curve]
"""Errors by norm, and curves by title."""


@dataclass(frozen=True)
class Case:
    """Validation case: problem with a known answer. `solve` takes a resolution; it returns errors by norm, and curves.

    Tests solve the case at the coarse resolutions, the command at the fine ones. A case without coarse resolutions is
    left to the command: a test or another case decides the same. A norm that is not in `expected` is
    reported but not judged.
    """

    name: str
    about: str
    reference: str
    solve: Callable[[int], Answer]
    coarse: tuple[int, ...]
    fine: tuple[int, ...]
    expected: Mapping[str, Expected]
    evidence: Evidence = field(kw_only=True)
    compared: Compared = field(default=(), kw_only=True)
    discussion: str = ""
    """Text of the report: which results are reproduced, which are not, and why."""


@dataclass(frozen=True)
class Finding:
    """Result of one norm of a solved case: errors by resolution and the verdict."""

    norm: str
    errors: dict[int, float]
    expected: Expected | None

    @property
    def met(self) -> bool | None:
        """True if the errors are within the bounds; None without bounds."""
        return None if self.expected is None else self.expected.met(self.errors)

    @property
    def order(self) -> float:
        """Observed order of accuracy; nan if no dependence on the resolution is expected."""
        constant = self.expected is not None and self.expected.order is None and self.expected.at is None
        return nan if constant else observed_order(self.errors)


def observed_order(errors: Mapping[int, float]) -> float:
    """Return the order of accuracy between the last two resolutions; errors: by resolution. NaN if undefined."""
    if len(errors) < 2:
        return nan
    (n, coarse), (m, fine) = list(errors.items())[-2:]
    return log(coarse / fine) / log(m / n) if coarse > 0.0 and fine > 0.0 else nan


def examine(
    case: Case, resolutions: tuple[int, ...], arch: str = "cpu"
) -> tuple[list[Finding], dict[str, Curve]]:
    """Solve a case at ascending resolutions; Taichi is restarted for each.

    Return every norm with its verdict, and the curves of the finest resolution.
    """
    errors: dict[str, dict[int, float]] = {}
    curves: dict[str, Curve] = {}
    for n in resolutions:
        program.start(arch)
        for name, part in case.solve(n).items():
            if isinstance(part, Curve):
                curves[name] = part
            else:
                errors.setdefault(name, {})[n] = part
    unknown = case.expected.keys() - errors.keys()
    if unknown:
        raise KeyError(f"{case.name} has no norm {sorted(unknown)}")
    return [Finding(norm, values, case.expected.get(norm)) for norm, values in errors.items()], curves
