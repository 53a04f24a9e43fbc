"""How a run went, by what only the simulation knows: sources found, maps against the true gas."""

from dataclasses import dataclass
from math import ceil
from typing import Any

import numpy as np

from taichi_plume import fields
from taichi_plume.grid import block_mean
from taichi_plume.simulation import Simulation

SAMPLES = 4  # per axis of a map cell, at most


@dataclass(frozen=True)
class MapScore:
    """A map against the true gas, per trial over the cells it knows; NaN where it knows none.

    mae [ppm], correlation (Pearson; NaN where one of the two is constant), known: share of cells.
    """

    mae: np.ndarray
    correlation: np.ndarray
    known: np.ndarray


def true_gas(sim: Simulation, cell: float, shape: tuple[int, int]) -> np.ndarray:
    """Mean true concentration [ppm] of each map cell at the height of the gas sensors, (nx, ny)."""
    n = min(SAMPLES, max(1, ceil(cell / sim.grid.dx - 1e-9)))
    axes = [(np.arange(count * n) + 0.5) * cell / n for count in shape]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    points = np.minimum(points, sim.grid.extent[:2])  # the last cell may reach over the edge
    if sim.grid.dim == 3:
        points = np.concatenate([points, np.full((*points.shape[:2], 1), sensor_height(sim))], axis=-1)
    ppm = fields.ppm_at(sim.gas, points, sim.t).sum(axis=-1)
    return block_mean(ppm, n)


def sensor_height(sim: Simulation) -> float:
    """Height of the first group's gas sensors [m]."""
    groups = sim.scenario.robots
    return groups[0].sensors.gas.height if groups else sim.scenario.recording.slice_height


def map_score(estimate: np.ndarray, truth: np.ndarray) -> MapScore:
    """Score of estimates (trials, nx, ny) [ppm], NaN where unknown, against the truth (nx, ny) [ppm]."""
    trials = len(estimate)
    mae, correlation, known = np.full(trials, np.nan), np.full(trials, np.nan), np.zeros(trials)
    for k in range(trials):
        cells = np.isfinite(estimate[k])
        known[k] = cells.mean()
        if not cells.any():
            continue
        a, b = estimate[k][cells].astype(float), truth[cells].astype(float)
        mae[k] = np.abs(a - b).mean()
        if len(a) > 1 and a.std() > 0 and b.std() > 0:
            correlation[k] = np.corrcoef(a, b)[0, 1]
    return MapScore(mae, correlation, known)


def trial_outcomes(group: Any, snapshot: dict[str, np.ndarray]) -> dict[str, Any]:
    """Per trial of a group, as columns: success, robots that found a source, first time [s], paths [m].

    path_m is that of the first robot to find a source, team_path_m that of all robots together.
    """
    span = slice(group.start, group.start + group.trials * group.count)
    found = snapshot["found"][span].reshape(group.trials, group.count).astype(bool)
    time = np.where(found, snapshot["found_time"][span].reshape(found.shape), np.inf)
    path = snapshot["path_length"][span].reshape(found.shape)
    first = time.argmin(axis=1)
    success = found.any(axis=1)
    trials = np.arange(group.trials)
    return {
        "success": success.tolist(),
        "found": found.sum(axis=1).tolist(),
        "time_s": np.where(success, time[trials, first], np.nan).tolist(),
        "path_m": np.where(success, path[trials, first], np.nan).tolist(),
        "team_path_m": path.sum(axis=1).tolist(),
    }
