"""How the plume is spread out: the Gaussian of a profile, correlation from place to place, and its length."""

from typing import NamedTuple

import numpy as np

from taichi_plume.statistics.spectra import to_first_zero

FEWEST = 5  # places that a fit needs


class Gaussian(NamedTuple):
    """A profile: peak exp(-(y - centre)²/2 width²); centre and width [m]; share: of the variance that it explains."""

    peak: float
    centre: float
    width: float
    share: float

    def at(self, y: np.ndarray) -> np.ndarray:
        """Its values."""
        return gaussian(y, self.peak, self.centre, self.width)


def gaussian(y: np.ndarray, peak: float, centre: float, width: float) -> np.ndarray:
    """The curve that is fitted."""
    return peak * np.exp(-((y - centre) ** 2) / (2.0 * width**2))


def gaussian_fit(y: np.ndarray, values: np.ndarray) -> Gaussian | None:
    """The Gaussian nearest to a profile (n,) at places y (n,) [m], by least squares.

    None where there is nothing to fit, or its centre is not among the places: no peak was seen.
    """
    from scipy.optimize import curve_fit

    total = float(np.sum(values))
    if len(y) < FEWEST or not np.isfinite(total) or total <= 0.0 or np.ptp(values) == 0.0:
        return None
    reach = float(np.ptp(y))
    share = np.clip(values, 0.0, None)
    centre = float((share * y).sum() / share.sum())
    width = max(float(np.sqrt((share * (y - centre) ** 2).sum() / share.sum())), 0.5 * reach / len(y))
    peak = float(np.max(values))
    low, high = float(np.min(y)) - reach, float(np.max(y)) + reach
    try:
        found, _ = curve_fit(
            gaussian, y, values, p0=(peak, centre, width),
            bounds=((0.0, low, 1e-3 * reach), (1e3 * peak, high, 10.0 * reach)),
        )  # fmt: skip
    except (RuntimeError, ValueError):
        return None
    left = float(((values - gaussian(y, *found)) ** 2).sum())
    explained = 1.0 - left / float(((values - np.mean(values)) ** 2).sum())
    if not np.min(y) <= found[1] <= np.max(y) or found[2] >= 9.99 * reach:
        return None
    return Gaussian(float(found[0]), float(found[1]), float(found[2]), explained)


def correlation(values: np.ndarray) -> np.ndarray:
    """Two-point correlation of records (n, points) at places on a line, for separations of 0, 1, ... places.

    Covariances of all pairs of the same separation over their standard deviations; points that do not fluctuate are
    left out. Times are taken to be even.
    """
    apart = np.asarray(values, float)
    apart = apart - apart.mean(axis=0)
    deviation = np.sqrt((apart**2).mean(axis=0))
    points = values.shape[1]
    covariance = apart.T @ apart / len(values)
    scale = np.outer(deviation, deviation)
    found = np.full(points, np.nan)
    for k in range(points):
        total = float(np.trace(scale, offset=k))
        if total > 0.0:
            found[k] = float(np.trace(covariance, offset=k)) / total
    return found[: int(np.argmax(np.isnan(found)))] if np.isnan(found).any() else found


def integral_length(spacing: float, values: np.ndarray) -> tuple[float, bool]:
    """Length scale [m] of records (n, points) at places `spacing` [m] apart: their two-point correlation, integrated up
    to its first zero; and whether there was one. Without, the length is at least this. NaN where nothing fluctuates.
    """
    found = correlation(values)
    if len(found) < 2:
        return float("nan"), False
    return to_first_zero(spacing, found)
