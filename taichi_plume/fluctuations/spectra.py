"""Power spectral density, autocorrelation and integral time scale of evenly spaced samples."""

import numpy as np

EVEN = 1e-3  # tolerance of even spacing as a fraction of the step
SEGMENTS = 8  # least number of Welch segments
KOLMOGOROV = -5.0 / 3.0
"""Slope of spectra in the inertial range."""


def is_even(times: np.ndarray) -> bool:
    """Return whether samples at the given times are evenly spaced, within 0.1 % of the mean step."""
    steps = np.diff(times)
    return bool(np.ptp(steps) <= EVEN * steps.mean()) if len(steps) else True


def evenly(times: np.ndarray, values: np.ndarray) -> tuple[float, np.ndarray]:
    """Return the step [s] and values (n, ...) of samples at evenly spaced times, interpolated linearly if needed.

    The step of uneven times is their mean step; faster fluctuations are damped by the interpolation.
    """
    step = float((times[-1] - times[0]) / (len(times) - 1))
    if is_even(times):
        return step, values
    even = times[0] + step * np.arange(len(times))
    at = np.clip(np.searchsorted(times, even, side="right") - 1, 0, len(times) - 2)
    part = np.clip((even - times[at]) / (times[at + 1] - times[at]), 0.0, 1.0)
    part = part.reshape(-1, *(1,) * (values.ndim - 1)).astype(values.dtype)
    return step, (1 - part) * values[at] + part * values[at + 1]


def spectrum(step: float, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies [Hz] and one-sided power spectral density [unit²/Hz], (f,) and (f, ...), by Welch's method.

    values: (n, ...), `step` [s] apart. Hann segments of an eighth of the record overlap by half. The first frequency is
    above zero.
    """
    from scipy.signal import welch

    length = max(8, min(len(values), 2 ** int(np.log2(max(8, 2 * len(values) // (SEGMENTS + 1))))))
    f, density = welch(values, 1.0 / step, nperseg=min(length, len(values)), detrend="constant", axis=0)
    return f[1:], density[1:]


def autocorrelation(values: np.ndarray) -> np.ndarray:
    """Autocorrelation of a time series (n,), for lags up to half of its length; ones if the series is constant."""
    from scipy.signal import correlate

    apart = np.asarray(values, float) - np.mean(values)
    n = len(apart)
    if not np.any(apart):
        return np.ones(n // 2 + 1)
    total = correlate(apart, apart, mode="full", method="fft")[n - 1 : n + n // 2]
    return total / (n - np.arange(len(total))) / (total[0] / n)


def to_first_zero(step: float, correlation: np.ndarray) -> tuple[float, bool]:
    """Return the integral of a correlation over the lag, up to its first zero, and whether there is a zero.

    The values are `step` apart in lag. Without a zero the integral is a lower bound.
    """
    below = np.flatnonzero(correlation <= 0.0)
    if not len(below):
        return float(step * (correlation.sum() - 0.5 * (correlation[0] + correlation[-1]))), False
    k = int(below[0])
    before, after = float(correlation[k - 1]), float(correlation[k])
    whole = correlation[:k].sum() - 0.5 * (correlation[0] + before)
    return float(step * (whole + 0.5 * before * before / (before - after))), True


def integral_time(step: float, values: np.ndarray) -> float:
    """Integral time scale [s] of a time series (n,): its autocorrelation integrated up to the first zero.

    NaN if the series is constant.
    """
    if np.ptp(values) == 0.0:
        return float("nan")
    return to_first_zero(step, autocorrelation(values))[0]
