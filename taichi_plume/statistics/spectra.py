"""How fast the gas fluctuates: spectrum, autocorrelation and integral time scale, of samples at even times."""

import numpy as np

EVEN = 1e-3  # of a step, by which steps of an even record may differ
SEGMENTS = 8  # of a record, at least, that a spectrum is the mean of
KOLMOGOROV = -5.0 / 3.0
"""Slope of spectra in the inertial range."""


def is_even(times: np.ndarray) -> bool:
    """Whether samples are at even times."""
    steps = np.diff(times)
    return bool(np.ptp(steps) <= EVEN * steps.mean()) if len(steps) else True


def evenly(times: np.ndarray, values: np.ndarray) -> tuple[float, np.ndarray]:
    """Time between samples [s], and values (n, ...) at even times: as they are if they are, or else linear in time.

    The step of uneven times is their mean step; what is faster than that is damped by this.
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

    values: (n, ...) at even times `step` [s] apart. Segments are Hann's, half of each in the next one, an eighth of the
    record long. The first frequency is above zero.
    """
    from scipy.signal import welch

    length = max(8, min(len(values), 2 ** int(np.log2(max(8, 2 * len(values) // (SEGMENTS + 1))))))
    f, density = welch(values, 1.0 / step, nperseg=min(length, len(values)), detrend="constant", axis=0)
    return f[1:], density[1:]


def autocorrelation(values: np.ndarray) -> np.ndarray:
    """Correlation of a record (n,) at even times with itself, for lags from 0 to half of it; ones if it is constant."""
    from scipy.signal import correlate

    apart = np.asarray(values, float) - np.mean(values)
    n = len(apart)
    if not np.any(apart):
        return np.ones(n // 2 + 1)
    total = correlate(apart, apart, mode="full", method="fft")[n - 1 : n + n // 2]
    return total / (n - np.arange(len(total))) / (total[0] / n)


def to_first_zero(step: float, correlation: np.ndarray) -> tuple[float, bool]:
    """Integral of a correlation from lag 0 to its first zero, in units of `step`, and whether there was one."""
    below = np.flatnonzero(correlation <= 0.0)
    if not len(below):
        return float(step * (correlation.sum() - 0.5 * (correlation[0] + correlation[-1]))), False
    k = int(below[0])
    before, after = float(correlation[k - 1]), float(correlation[k])
    whole = correlation[:k].sum() - 0.5 * (correlation[0] + before)
    return float(step * (whole + 0.5 * before * before / (before - after))), True


def integral_time(step: float, values: np.ndarray) -> float:
    """Integral time scale [s] of a record (n,) at even times: of its autocorrelation up to its first zero.

    NaN where the record does not fluctuate.
    """
    if np.ptp(values) == 0.0:
        return float("nan")
    return to_first_zero(step, autocorrelation(values))[0]
