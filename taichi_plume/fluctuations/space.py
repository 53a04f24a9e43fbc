"""Spatial statistics of a plume: Gaussian fit of a profile, two-point correlation."""

from typing import NamedTuple

import numpy as np

FEWEST = 5  # least number of points for a fit


class Gaussian(NamedTuple):
    """Gaussian profile peak exp(-(y - centre)²/2 width²); centre, width: [m]; share: fraction of variance explained."""

    peak: float
    centre: float
    width: float
    share: float

    def at(self, y: np.ndarray) -> np.ndarray:
        """Return the values of the profile at positions y [m]."""
        return gaussian(y, self.peak, self.centre, self.width)


def gaussian(y: np.ndarray, peak: float, centre: float, width: float) -> np.ndarray:
    """Return the values of the Gaussian profile peak exp(-(y - centre)²/2 width²) at positions y."""
    return peak * np.exp(-((y - centre) ** 2) / (2.0 * width**2))


def gaussian_fit(y: np.ndarray, values: np.ndarray) -> Gaussian | None:
    """Fit a Gaussian to a profile `values` (n,) at positions y (n,) [m] by least squares.

    None if the profile is constant, without gas or too short, or if the fit fails, is too wide or centred outside y.
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
    """Two-point correlation of time series (n, points) on a line, for separations of 0, 1, ... points.

    Sum of the covariances of all pairs of points with one separation over the sum of the products of their standard
    deviations. The result ends before the first separation without fluctuation. Samples must be evenly spaced in time.
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
