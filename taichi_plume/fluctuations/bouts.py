"""Bouts of a metal-oxide gas sensor: rises of the smoothed derivative, which are rarer farther from the source.

Schmuker, Bahr & Huerta 2016 (Sensors and Actuators B 235, 636-646, doi:10.1016/j.snb.2016.05.098): a Gaussian of 0.3 s
smooths the signal, an exponential moving average with a half-life of 0.4 s smooths the differences of its samples. A
bout is a stretch in which this average rises, from a local minimum to the next local maximum; the amplitude of the bout
is this rise. Bouts of at most the mean amplitude without gas plus three standard deviations do not count. In a wind
tunnel the number of bouts falls about linearly with the distance from the source.

Choices of this module, where the paper or the public program of the authors differ or say nothing:

- Amplitudes are per second, not per sample, so that they hardly depend on the step.
- The Gaussian is centred and cut off at four standard deviations. Samples beyond the ends equal the first and the last.
  The average starts at the first difference.
- A bout that an end of the record cuts does not count.
- The amplitudes without gas are those of white noise of the sensor's readings, instead of a record before the release.
- The signal is ln(R_air/R) of the resistance R, which rises with the gas and lags as the sensor.
"""

from typing import NamedTuple

import numpy as np

from taichi_plume.scenario.metal_oxides import MoxSensor

SMOOTHING = 0.3  # s: standard deviation of the Gaussian
HALF_LIFE = 0.4  # s: of the moving average
DEVIATIONS = 3.0  # of the amplitudes without gas, above their mean
LONGEST_STEP = 0.2  # s: between samples
SETTLING = 20.0  # s: left out at the start, in which the sensor adapts; at most half of the record
QUIET = 600.0  # s: length of the record without gas
ROUNDING = 1e-9  # least rise per sample, over the largest signal


class Bouts(NamedTuple):
    """Bouts at points, (points,) each: number per minute, mean amplitude [1/s] (NaN without any), std of the signal."""

    per_min: np.ndarray
    amplitude: np.ndarray
    deviation: np.ndarray


def smoothed_derivative(step: float, signals: np.ndarray) -> np.ndarray:
    """Return the smoothed derivative [1/s] of signals (n, points), `step` [s] apart, as (n - 1, points)."""
    from scipy.ndimage import gaussian_filter1d
    from scipy.signal import lfilter

    smooth = gaussian_filter1d(np.asarray(signals, float), SMOOTHING / step, axis=0, mode="nearest")
    slope = np.diff(smooth, axis=0) / step
    keep = 0.5 ** (step / HALF_LIFE)
    averaged, _ = lfilter([1.0 - keep], [1.0, -keep], slope, axis=0, zi=keep * slope[:1])
    return averaged


def amplitudes(step: float, signals: np.ndarray) -> list[np.ndarray]:
    """Return the amplitudes [1/s] of all complete bouts at each point; signals: (n, points), `step` [s] apart."""
    slope = smoothed_derivative(step, signals)
    least = ROUNDING * np.abs(signals).max(axis=0) / step
    rising = np.diff(slope, axis=0) > 0.0
    found = []
    for series, up, floor in zip(slope.T, rising.T, least, strict=True):
        turns = np.diff(up.astype(np.int8))
        lowest, highest = np.flatnonzero(turns > 0) + 1, np.flatnonzero(turns < 0) + 1
        if len(lowest) and len(highest) and highest[0] < lowest[0]:
            highest = highest[1:]
        rise = series[highest] - series[lowest[: len(highest)]]
        found.append(rise[rise > floor])
    return found


def noise_threshold(step: float, noise: float, period: float = 0.0, seed: int = 0) -> float:
    """Return the mean amplitude [1/s] of bouts of white noise plus three standard deviations.

    noise: standard deviation of a reading; period: time between readings [s], each of which holds until the next.
    """
    if noise == 0.0:
        return 0.0
    held = max(1, round(period / step))
    readings = np.random.default_rng(seed).normal(0.0, noise, round(QUIET / (step * held)))
    (found,) = amplitudes(step, np.repeat(readings, held)[:, None])
    return float(found.mean() + DEVIATIONS * found.std())


def bouts(step: float, signals: np.ndarray, threshold: float = 0.0) -> Bouts:
    """Count bouts with amplitudes above a threshold [1/s]; signals: (n, points), `step` [s] apart."""
    minutes = step * len(signals) / 60.0
    above = [rise[rise > threshold] for rise in amplitudes(step, signals)]
    return Bouts(
        np.array([len(rise) for rise in above]) / minutes,
        np.array([rise.mean() if len(rise) else np.nan for rise in above]),
        np.std(signals, axis=0, dtype=float),
    )


def signal(sensor: MoxSensor, ppm: np.ndarray) -> np.ndarray:
    """Return the signal ln(R_air/R) = b ln(1 + c/c0) of a metal oxide for readings c [ppm]; 0 if noise is below 0."""
    c0, b = sensor.reading_curve
    return b * np.log1p(np.asarray(ppm, float) / c0)


def bouts_of_sensor(sensor: MoxSensor, step: float, ppm: np.ndarray) -> tuple[Bouts, float]:
    """Count the bouts of a metal oxide that starts in clean air; return the threshold of amplitudes [1/s] as well.

    ppm: readings (n, points), `step` [s] apart. The time in which the sensor adapts is left out.
    """
    threshold = noise_threshold(step, sensor.signal.noise, sensor.period)
    first = min(round(SETTLING / step), len(ppm) // 2)
    return bouts(step, signal(sensor, ppm[first:]), threshold), threshold


class BoutTable(NamedTuple):
    """Bouts of a gas sensor at points: its name, threshold of amplitudes [1/s], distances from the source, counts.

    probe: index of each point's probe; distance: to the nearest source [m], NaN if unknown; per_min, deviation: as in
    `Bouts`.
    """

    sensor: str
    threshold: float
    probe: np.ndarray
    distance: np.ndarray
    per_min: np.ndarray
    deviation: np.ndarray

    def correlation(self, values: np.ndarray) -> float:
        """Return the rank correlation of values at the points with the distance; NaN if either is constant."""
        from scipy.stats import rankdata

        ranks = rankdata(self.distance), rankdata(values)
        if not np.isfinite(self.distance).all() or any(np.ptp(rank) == 0.0 for rank in ranks):
            return float("nan")
        return float(np.corrcoef(*ranks)[0, 1])

    def in_words(self) -> str:
        """Return the range of the counts, and how they change with the distance, in words."""
        low, high, points = self.per_min.min(), self.per_min.max(), len(self.per_min)
        count = f"{low:.3g} to {high:.3g}" if points > 1 else f"{low:.3g}"
        words = f"{count} bouts a minute at {points:,} point{'s' * (points != 1)} ({self.sensor})"
        correlation = self.correlation(self.per_min)
        if np.isfinite(correlation):
            words += f"; rank correlation with the distance from the source {correlation:.2f}"
        return words
