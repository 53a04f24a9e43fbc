"""Moments over time: mean, rms fluctuation, intermittency, percentiles; samples may be unevenly spaced.

The weight of a sample is the time up to halfway to its neighbours, as in `durations`.
"""

import numpy as np

from taichi_plume.fluctuations.durations import edges_of

PERCENTILES = (0.5, 0.99, 0.999)


def weights(times: np.ndarray) -> np.ndarray:
    """Weight of each sample, (n,): its fraction of the record's duration; times: (n,) [s]."""
    share = np.diff(edges_of(times))
    return share / share.sum()


def mean_of(values: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Mean over time of values (n, ...); share: see `weights`."""
    return np.tensordot(share, values, axes=(0, 0))


def quantiles(values: np.ndarray, share: np.ndarray, levels: tuple[float, ...] = PERCENTILES) -> np.ndarray:
    """Percentiles over time of values (n, points), (levels, points): values exceed them for 1 - level of the time."""
    order = np.argsort(values, axis=0, kind="stable")
    lasted = np.cumsum(share[order], axis=0)
    at = np.array([(lasted < level - 1e-12).sum(axis=0) for level in levels])
    ordered = np.take_along_axis(values, order, axis=0)
    return np.take_along_axis(ordered, np.minimum(at, len(values) - 1), axis=0)


def moments(times: np.ndarray, ppm: np.ndarray, threshold: float) -> dict[str, np.ndarray]:
    """Return statistics of concentrations (n, points) [ppm], a number per point.

    mean; rms: of the fluctuation [ppm]; intensity: rms / mean; intermittency: fraction of time above the threshold
    [ppm]; conditional_mean: mean above the threshold [ppm]; p50, p99, p99.9, maximum [ppm]; peak99, peak99.9, peak:
    p99, p99.9 and maximum over the mean. NaN if the mean is 0 or the threshold is never exceeded.
    """
    share = weights(times)
    mean = mean_of(ppm, share)
    rms = np.sqrt(mean_of((ppm - mean) ** 2, share))
    present = ppm > threshold
    gamma = mean_of(present.astype(float), share)
    largest = ppm.max(axis=0).astype(float)
    half, most, more = (values.astype(float) for values in quantiles(ppm, share))
    with np.errstate(divide="ignore", invalid="ignore"):
        positive = np.where(mean > 0.0, mean, np.nan)
        return {
            "mean": mean,
            "rms": rms,
            "intensity": rms / positive,
            "intermittency": gamma,
            "conditional_mean": mean_of(np.where(present, ppm, 0.0), share) / np.where(gamma > 0.0, gamma, np.nan),
            "p50": half,
            "p99": most,
            "p99.9": more,
            "maximum": largest,
            "peak99": most / positive,
            "peak99.9": more / positive,
            "peak": largest / positive,
        }  # fmt: skip


def wind(times: np.ndarray, velocity: np.ndarray) -> dict[str, np.ndarray]:
    """Return statistics of velocities (n, points, dim) [m/s], a number per point.

    mean_u, ... and rms_u, ... per axis; speed: magnitude of the mean velocity; turbulence_intensity: rms fluctuation of
    a component over `speed`.
    """
    share = weights(times)
    mean = mean_of(velocity, share)
    square = mean_of((velocity - mean) ** 2, share)
    speed = np.sqrt((mean**2).sum(axis=-1))
    dim = velocity.shape[-1]
    found = {f"mean_{name}": mean[:, d] for d, name in enumerate("uvw"[:dim])}
    found |= {f"rms_{name}": np.sqrt(square[:, d]) for d, name in enumerate("uvw"[:dim])}
    with np.errstate(divide="ignore", invalid="ignore"):
        intensity = np.sqrt(square.mean(axis=-1)) / np.where(speed > 0.0, speed, np.nan)
    return found | {"speed": speed, "turbulence_intensity": intensity}
