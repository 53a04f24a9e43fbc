"""`result.json`: what came of a run; written last and at once."""

import json
import os
from math import isfinite, prod
from pathlib import Path
from typing import Any

import numpy as np

from taichi_plume import __version__, scores
from taichi_plume.map_scores import MapScores, MapSeries
from taichi_plume.simulation import Simulation


def result(
    sim: Simulation, status: str, message: str, backend: str, map_scores: MapScores | None = None
) -> dict[str, Any]:
    """What came of a run, ready for `write_result`; map_scores: of its maps over time."""
    cells = prod(sim.grid.shape)
    steps = cells * sim.steps
    return begun(sim, status, message, backend) | {
        "steps": sim.steps,
        "cells": cells,
        "Mcell_steps_per_s": steps / sim.wall_s / 1e6 if sim.wall_s > 0 else None,
        "flow": sim.wind.diagnostics(),
        "gas": _budget(sim),
        "obstacles": _obstacles(sim),
        "groups": _groups(sim),
        "maps": [
            _map(sim, n) | (_over_time(map_scores.series[n]) if map_scores else {})
            for n in range(len(sim.maps))
        ],
    }


def begun(sim: Simulation, status: str, message: str, backend: str) -> dict[str, Any]:
    """What can be told of a run before its end."""
    return {
        "name": sim.scenario.name,
        "status": status,
        "message": message,
        "seed": sim.scenario.seed,
        "backend": backend,
        "version": __version__,
        "wall_s": sim.wall_so_far,
        "simulated_s": sim.t - sim.scenario.first_tick * sim.dt,
    }


def _budget(sim: Simulation) -> dict[str, Any]:
    """Of all gases that keep one, with an entry per gas where there are several."""
    parts: list[dict[str, Any]] = [dict(gas.budget()) for gas in sim.gas.gases]
    kept = [part for part in parts if part]
    if not kept:
        return {}
    total: dict[str, Any] = {key: sum(part[key] for part in kept) for key in kept[0]}
    for budget in [total, *kept]:
        missing = budget["emitted_kg"] - budget["in_domain_kg"] - budget["outflow_kg"]
        budget["relative_error"] = missing / budget["emitted_kg"] if budget["emitted_kg"] else None
    if len(parts) > 1:
        names = [gas.species.name for gas in sim.gas.gases]
        total["parts"] = [{"species": name, **part} for name, part in zip(names, parts, strict=True)]
    return total


def _obstacles(sim: Simulation) -> list[dict[str, Any]]:
    """The kind of each obstacle and the last force of the air on it [N]."""
    if sim.forces is None:
        return []
    kinds = [obstacle.kind for obstacle in sim.scenario.obstacles]
    return [{"kind": kind, "force_N": force} for kind, force in zip(kinds, sim.forces(), strict=True)]


def _groups(sim: Simulation) -> list[dict[str, Any]]:
    if not sim.swarm.count:
        return []
    now = sim.swarm.snapshot()
    groups = []
    sources = np.array([source.position[:2] for _, source in sim.scenario.sources]).reshape(-1, 2)
    for group in sim.swarm.groups:
        trials = scores.trial_outcomes(group, now, sources)
        times = [t for t, good in zip(trials["time_s"], trials["success"], strict=True) if good]
        paths = [p for p, good in zip(trials["path_m"], trials["success"], strict=True) if good]
        groups.append(
            {
                "name": group.name,
                "algorithm": group.model.algorithm.kind,
                "robots": group.count,
                "trials": group.trials,
                "success_rate": float(np.mean(trials["success"])),
                "median_time_s": float(np.median(times)) if times else None,
                "median_path_m": float(np.median(paths)) if paths else None,
                "summary": scores.trial_summary(trials, sim.scenario.duration),
                "per_trial": trials,
            }
        )
    return groups


def _map(sim: Simulation, n: int) -> dict[str, Any]:
    gas_map = sim.maps[n]
    estimate = np.asarray(gas_map.estimate())
    truth = scores.true_gas(sim, gas_map.cell, estimate.shape[1:])
    measurable = scores.measurable(sim, gas_map.cell, estimate.shape[1:])
    score = scores.map_score(estimate, np.where(measurable, truth, np.nan))
    forecast_error = scores.forecast_error(gas_map.errors, len(estimate))
    forecasts = [(t, np.asarray(errors, float)) for t, errors in gas_map.errors]
    return {
        "kind": sim.scenario.maps[n].kind,
        "cell_m": gas_map.cell,
        "mae_ppm": _mean(score.mae),
        "correlation": _mean(score.correlation),
        "known_fraction": _mean(score.known),
        "forecast_error_ppm": _mean(forecast_error),
        "per_trial": {
            "mae_ppm": score.mae.tolist(),
            "correlation": score.correlation.tolist(),
            "known_fraction": score.known.tolist(),
            "forecast_error_ppm": forecast_error.tolist(),
        },
        "forecast": {
            "time_s": [t for t, _ in forecasts],
            "error_ppm": [_mean(errors) for _, errors in forecasts],
        },
    }


def _over_time(series: MapSeries) -> dict[str, Any]:
    """Scores of a map against the mean of the gas (see map_scores), over time the mean of all trials."""
    last = {name: values[-1].tolist() for name, values in series.values.items() if values}
    means = {name: [_mean(value) for value in values] for name, values in series.values.items()}
    return {"mean_gas": {"time_s": series.time, **means, "per_trial_at_end": last}}


def _mean(values: np.ndarray) -> float | None:
    """Mean of what is known."""
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else None


def write_result(folder: Path, content: dict[str, Any]) -> None:
    """Write `result.json` so that a reader sees all of it or none; what is no number becomes null."""
    text = json.dumps(plain(content), indent=2, allow_nan=False, ensure_ascii=False) + "\n"
    part = folder / "result.json.part"
    try:
        with part.open("w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        part.replace(folder / "result.json")
    finally:
        part.unlink(missing_ok=True)


def plain(value: Any) -> Any:
    """What JSON can hold; what is no number becomes None."""
    if isinstance(value, dict):
        return {str(key): plain(part) for key, part in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(part) for part in value]
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float) and not isfinite(value):
        return None
    return value
