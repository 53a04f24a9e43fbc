"""Gas maps of synthetic readings: a steady plume along the paths of a line of robots, times whiffs of known duration.

The correlation of consecutive snapshots explains the results of the mapping experiment. Here the correlation is
prescribed: four robots side by side sweep across a Gaussian plume, and each reads its mean times a lognormal whiff
(standard deviation over mean 1, as in the middle of plumes; correlation exp(-t/memory), independent per robot). The
maps and their statistics are the same as in the experiment.

Two closed forms are compared. For normal readings about a steady mean, with correlation r of consecutive snapshots, the
last snapshot forecasts the next with an error of sqrt(2 (1 - r)) standard deviations, a long mean with 1. The mean is
better below r = 1/2 (`endless`). For a weighted mean of earlier snapshots see `remembering`.
"""

from itertools import product

import numpy as np
from pydantic import TypeAdapter

from taichi_plume.agents.gas_map import Floor
from taichi_plume.agents.mapping import mappers
from taichi_plume.agents.recorded_readings import RecordedTeam
from taichi_plume.agents.time_series import neighbourhood
from taichi_plume.scenario.maps import Map, TimeSeriesMap
from taichi_plume.validation.mapping_scenario import SOURCES, SPEEDS, WINDOW, maps, persistence

SIZE = (4.0, 3.0)  # m
TICK = 0.5  # s
LASTS = 750.0  # s, of each speed and memory
SETTLES = 250.0  # s, until alpha = 0.98 has forgotten earlier readings
MEMORIES = (0.5, 5.0, 20.0)  # s: gusts; gusts and a metal-oxide sensor; a slow sensor
CASES = tuple(product(MEMORIES, SPEEDS))
MARGIN = 0.3  # m from the walls, as in the line-up
AHEAD = 0.3  # m from robot to robot across the wind


def ways(speed: float, ticks: int) -> np.ndarray:
    """Return the paths of four robots in a diagonal line that sweeps across the wind, (ticks, 4, 2) [m]."""
    x = np.linspace(MARGIN, SIZE[0] - MARGIN, 4)
    width = SIZE[1] - 2.0 * MARGIN - 3.0 * AHEAD
    y = np.abs((speed * TICK * np.arange(ticks) + width) % (2.0 * width) - width)
    rows = MARGIN + y[:, None] + AHEAD * np.arange(4)
    return np.stack(np.broadcast_arrays(x, rows), axis=-1)


def plume(place: np.ndarray) -> np.ndarray:
    """Return mean gas at points (..., 2) [m] over its maximum: a Gaussian plume of 5 cm that widens by x/10."""
    downwind, across = np.moveaxis(place - np.array(SOURCES[0]), -1, 0)
    width = 0.05 + 0.1 * np.maximum(downwind, 0.0)
    return np.where(downwind > 0.0, 0.05 / width * np.exp(-0.5 * (across / width) ** 2), 0.0)


def whiffs(ticks: int, memory: float, rng: np.random.Generator) -> np.ndarray:
    """Return lognormal series of mean and standard deviation 1, (ticks, 4); the logarithm is autoregressive (AR(1))."""
    normal = rng.standard_normal((ticks, 4))
    coefficient = np.exp(-TICK / memory)
    for n in range(1, ticks):
        normal[n] = coefficient * normal[n - 1] + np.sqrt(1.0 - coefficient**2) * normal[n]
    square = np.log(2.0)
    return np.exp(np.sqrt(square) * normal - 0.5 * square)


def mapped(lasts: float = LASTS, seed: int = 1) -> dict[str, np.ndarray]:
    """Return statistics of maps of the synthetic readings: `error` over that of the pure interpolation (alphas, cases),
    and `correlation`, `scatter`, `endless` (see `persistence`), (cases,). Taichi must have been started.
    """
    rng, ticks, each = np.random.default_rng(seed), round(lasts / TICK), round(lasts / WINDOW)
    team, first = RecordedTeam(4), round(SETTLES / WINDOW)
    models = [TypeAdapter(Map).validate_python(gas_map) for gas_map in maps(WINDOW)]
    several = mappers(models, Floor(SIZE, 1, 4, TICK))
    rows = []
    for case, (memory, speed) in enumerate(CASES):
        place = ways(speed, ticks)
        reading = 1e3 * plume(place) * whiffs(ticks, memory, rng)
        snapshots = []
        for n in range(ticks):
            team.show(place[n], np.zeros((4, 2)), reading[n])
            for gas_map in several:
                gas_map.update(team, (case * ticks + n + 1) * TICK, TICK)
            if (n + 1) % round(WINDOW / TICK) == 0:
                snapshots.append(np.asarray(several[0].estimate()))
        late = case * each + first
        errors = [
            np.mean([e[0] for t, e in gas_map.errors if late * WINDOW < t <= (case + 1) * lasts + 1e-6])
            for gas_map in several
        ]
        known = [float(value[0]) for value in persistence(np.stack(snapshots)[first:])]
        rows.append([*known, *np.divide(errors[1:], errors[0])])
    correlation, scatter, long, *error = np.array(rows).T
    return {"correlation": correlation, "scatter": scatter, "endless": long, "error": np.array(error)}


# ---------------------------------------------------------------- closed forms


def endless(correlation: np.ndarray) -> np.ndarray:
    """Return the error of a long mean over that of the last snapshot: 1/sqrt(2 (1 - r)), r the `correlation`."""
    return 1.0 / np.sqrt(2.0 * (1.0 - correlation))


def remembering(alpha: float, correlation: np.ndarray | float, window: float = WINDOW) -> np.ndarray:
    """Return the error of a time-series map over that of the last snapshot, for snapshots correlated as r^lag.

    g: weight of each earlier snapshot in the neighbourhood of a cell (eq 7), for evenly distributed robots.
    """
    stencil = neighbourhood(TimeSeriesMap(kind="time_series", alpha=alpha, window=window), 15)
    g = np.bincount([lag for lag, *_ in stencil], [U for *_, U in stencil])[1:]
    g /= g.sum()
    lags = np.arange(1, len(g) + 1)
    apart = np.abs(lags[:, None] - lags)
    r = np.asarray(correlation, float)[..., None]
    square = 1.0 - 2.0 * (g * r**lags).sum(-1) + (np.outer(g, g) * r[..., None] ** apart).sum((-1, -2))
    return np.sqrt(square / (2.0 * (1.0 - r[..., 0])))
