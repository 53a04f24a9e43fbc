"""Scan of the parameters that a paper leaves open: sensitivity of a result to each, and the joint space of all.

One at a time: central differences about the usual values, a quarter of the range to either side; a choice between two
is compared as such. Joint space: a Sobol sequence (scipy.stats.qmc). Parameters of the air are costly, those of robots
are not: robots of many kinds search or map in one air. So the points come in blocks that share their air. Single
points are noisy. A response surface (Box & Wilson 1951, doi:10.1111/j.2517-6161.1951.tb00067.x) of all of
them selects the points that are repeated in several airs.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Literal, NamedTuple

import numpy as np
from scipy.stats import qmc, spearmanr

STEP = 0.25  # of the range, in central differences

Point = Mapping[str, float]
"""Value of each open parameter, by name."""


class Open(NamedTuple):
    """Parameter that a paper leaves open: range, usual value, and scale of the range.

    whole: integers, such as 0 and 1 for a choice. of_air: belongs to the air or the gas, not to a robot.
    """

    name: str
    low: float
    high: float
    usual: float
    scale: Literal["linear", "log", "whole"] = "linear"
    of_air: bool = False

    def value(self, share: float) -> float:
        """Return the value at a share of the range, 0 to 1."""
        if self.scale == "whole":
            return float(np.floor(self.low + share * (self.high - self.low + 1.0 - 1e-9)))
        if self.scale == "log":
            return float(self.low * (self.high / self.low) ** share)
        return self.low + share * (self.high - self.low)

    def share(self, value: float) -> float:
        """Return the share of the range at a value."""
        if self.scale == "log":
            return float(np.log(value / self.low) / np.log(self.high / self.low))
        return (value - self.low) / (self.high - self.low)

    def sides(self) -> tuple[float, float]:
        """Return the values below and above the usual one between which the difference is taken."""
        if self.scale == "whole":
            return self.low, self.high
        usual = self.share(self.usual)
        return self.value(max(usual - STEP, 0.0)), self.value(min(usual + STEP, 1.0))


def usual(parameters: Sequence[Open]) -> Point:
    """Return the point of all usual values."""
    return {parameter.name: parameter.usual for parameter in parameters}


def blocks(parameters: Sequence[Open], airs: int, each: int, seed: int = 1) -> list[list[Point]]:
    """Return `airs` blocks of `each` points of the joint space, powers of two; a block shares the values `of_air`."""
    inner = qmc.Sobol(len(parameters), rng=seed).random(airs * each).reshape(airs, each, -1)
    outer = qmc.Sobol(len(parameters), rng=seed + 1).random(airs)
    shared = np.array([parameter.of_air for parameter in parameters])
    shares = np.where(shared, outer[:, None, :], inner)
    return [
        [{p.name: p.value(u) for p, u in zip(parameters, row, strict=True)} for row in block]
        for block in shares
    ]


def one_at_a_time(parameters: Sequence[Open]) -> list[tuple[Open, Point, Point]]:
    """Return each parameter with the points at its two `sides`, all others at their usual values."""
    middle, pairs = dict(usual(parameters)), []
    for parameter in parameters:
        low, high = parameter.sides()
        pairs.append((parameter, {**middle, parameter.name: low}, {**middle, parameter.name: high}))
    return pairs


def rank_correlations(
    parameters: Sequence[Open], points: Sequence[Point], results: np.ndarray
) -> dict[str, float]:
    """Return Spearman's rank correlation of results, (n,), with each parameter over points of the joint space."""
    return {
        p.name: float(spearmanr([point[p.name] for point in points], results).statistic) for p in parameters
    }


def shares(parameters: Sequence[Open], points: Sequence[Point]) -> np.ndarray:
    """Return the points as shares of the ranges, (points, parameters)."""
    return np.array([[p.share(point[p.name]) for p in parameters] for point in points])


def response_surface(
    parameters: Sequence[Open], points: Sequence[Point], results: np.ndarray
) -> Callable[[Sequence[Point]], np.ndarray]:
    """Return a function of points, fitted to results (points, ...), without products of parameters.

    Quadratic in each share; linear in those `of_air`, of which there are few values.
    """

    def terms(points: Sequence[Point]) -> np.ndarray:
        x = shares(parameters, points)
        bent = x[:, [p.scale != "whole" and not p.of_air for p in parameters]]
        return np.column_stack([np.ones(len(x)), x, bent**2])

    fit = np.linalg.lstsq(terms(points), results, rcond=None)[0]
    return lambda points: terms(points) @ fit


def least_point(parameters: Sequence[Open], surface: Callable[[Sequence[Point]], np.ndarray]) -> Point:
    """Return the point at which a response surface is least, by quarters of each range.

    As a surface has no products of parameters, each is chosen on its own.
    """
    point = {}
    for p in parameters:
        values = [p.value(u) for u in np.linspace(0.0, 1.0, 5)]
        results = surface([{**usual(parameters), p.name: value} for value in values])
        point[p.name] = values[int(results.reshape(len(values), -1).mean(axis=-1).argmin())]
    return point


def between(parameters: Sequence[Open], point: Point, share: float) -> Point:
    """Return the point at a share of the way from the usual values to `point`, measured by shares of the ranges."""
    ends = shares(parameters, [usual(parameters), point])
    way = ends[0] + share * (ends[1] - ends[0])
    return {
        p.name: p.value(u) if p.scale != "whole" else point[p.name]
        for p, u in zip(parameters, way, strict=True)
    }


def way_to_least(
    parameters: Sequence[Open],
    points: Sequence[Point],
    results: np.ndarray,
    way: Sequence[float],
    with_air: bool = True,
) -> list[Point]:
    """Return points at shares of the way from the usual values to the least of results (points, ...) by their surface.

    with_air: otherwise parameters `of_air` keep their usual values.
    """
    end = least_point(parameters, response_surface(parameters, points, np.log(results)))
    end = {p.name: end[p.name] if with_air or not p.of_air else p.usual for p in parameters}
    return [between(parameters, end, share) for share in way]
