"""`result.json`: status, scores and diagnostics of a run, written atomically."""

import json
import platform
from functools import cache
from importlib.metadata import version
from math import isfinite, prod
from pathlib import Path

import numpy as np

from taichi_plume.agents.groups import GroupRange
from taichi_plume.engine.choice import chosen
from taichi_plume.files.disk import written_whole
from taichi_plume.files.json_values import json_value
from taichi_plume.grid.blas import blas_libraries
from taichi_plume.scoring import trials as scores
from taichi_plume.scoring.beliefs import BeliefScores
from taichi_plume.scoring.declarations import Json
from taichi_plume.scoring.maps import WIND_NAMES, MapScores, MapSeries
from taichi_plume.time_loop import Mapper, TimeLoop
from taichi_plume.version import __version__


def result(
    sim: TimeLoop,
    status: str,
    message: str,
    backend: str,
    map_scores: MapScores | None = None,
    belief_scores: BeliefScores | None = None,
) -> Json:
    """Return the content of result.json. map_scores, belief_scores: scores over time of gas maps, source posteriors."""
    cells = prod(sim.grid.shape)
    return partial_result(sim, status, message, backend) | {
        "steps": sim.steps,
        "cells": cells,
        "Mcell_steps_per_s": cells * sim.steps / sim.wall_s / 1e6 if sim.wall_s > 0 else None,
        "flow": sim.wind.diagnostics(),
        "gas": _budget(sim),
        "obstacles": _obstacles(sim),
        "groups": _groups(sim),
        "maps": [_map(sim, n, map_scores.series[n] if map_scores else None) for n in range(len(sim.maps))],
        "beliefs": (belief_scores or BeliefScores(sim)).entries(sim),
    }


def partial_result(sim: TimeLoop, status: str, message: str, backend: str) -> Json:
    """Return the part of result.json that is known during the run: name, status, seeds, version, machine and times."""
    return {
        "name": sim.scenario.name,
        "status": status,
        "message": message,
        **sim.scenario.seeds,
        "backend": backend,
        "version": __version__,
        "machine": machine(),
        "wall_s": sim.wall_so_far,
        "simulated_s": sim.t - sim.scenario.first_tick * sim.dt,
    }


@cache
def machine() -> Json:
    """Return what decides the last bits of a run: engine, processor, operating system, BLAS libraries and versions."""
    engine = chosen()
    return {
        "engine": engine,
        "processor": _processor(),
        "system": platform.system(),
        "blas": blas_libraries(),
        "versions": {"python": platform.python_version()}
        | {name: version(name) for name in (engine, "numpy", "scipy")},
    }


def _processor() -> str:
    """Return the model of the processor; where the system does not name the model, its architecture."""
    try:
        names = [
            line for line in Path("/proc/cpuinfo").read_text().splitlines() if line.startswith("model name")
        ]
    except OSError:  # not Linux
        names = []
    return names[0].partition(":")[2].strip() if names else platform.processor() or platform.machine()


def _budget(sim: TimeLoop) -> Json:
    """Return the mass budget [kg] summed over all gases and its relative error; of several gases also each budget."""
    parts: list[Json] = [dict(gas.budget()) for gas in sim.gas.gases]
    budgets = [part for part in parts if part]
    if not budgets:
        return {}
    keys = dict.fromkeys(key for part in budgets for key in part)
    total: Json = {key: sum(part.get(key, 0.0) for part in budgets) for key in keys}
    for budget in [total, *budgets]:
        taken = budget.get("taken_up_kg", 0.0)
        given = sum(budget.get(key, 0.0) for key in ("initial_kg", "emitted_kg", "inflow_kg"))
        missing = given - taken - budget["in_domain_kg"] - budget["outflow_kg"]
        brought = given + max(0.0, -taken)
        budget["relative_error"] = missing / brought if brought else None
    if len(parts) > 1:
        names = [gas.species.name for gas in sim.gas.gases]
        total["parts"] = [{"species": name, **part} for name, part in zip(names, parts, strict=True)]
    return total


def _obstacles(sim: TimeLoop) -> list[Json]:
    """Return kind of each obstacle and the force of the air on the obstacle [N]; empty if forces are not computed."""
    if sim.forces is None:
        return []
    kinds = [obstacle.kind for obstacle in sim.scenario.obstacles]
    return [{"kind": kind, "force_N": force} for kind, force in zip(kinds, sim.forces(), strict=True)]


def _groups(sim: TimeLoop) -> list[Json]:
    """Return the results of each robot group.

    found_by: what counts as found, "reached" or "declared". airs: number of flow realisations of the trials, always 1;
    trials_differ_by: see `scores.trials_differ_by`. no_search: why no source could be found, or None.
    shares_arena_with: groups in the same arena; unlike_them: whether one of these has another algorithm, or other
    parameters. summary, per_trial: see `scores.trial_summary`, `scores.trial_outcomes`. beside_recorded: of robots
    that replay recorded paths, see agents/replay.py.
    """
    if not sim.swarm.count:
        return []
    now, groups = sim.swarm.snapshot(), []
    for group in sim.swarm.groups:
        trials = scores.trial_outcomes(sim, group, now)
        times = [t for t, good in zip(trials["time_s"], trials["success"], strict=True) if good]
        paths = [p for p, good in zip(trials["path_m"], trials["success"], strict=True) if good]
        others = [] if sim.scenario.rivals else [other for other in sim.swarm.groups if other is not group]
        differ = scores.trials_differ_by(group, now)
        no_search = scores.no_search(sim, group, trials["success"])
        counted = trials if differ != "nothing" else {name: values[:1] for name, values in trials.items()}
        summary = scores.trial_summary(counted, scores.end(sim, group), searched=no_search is None)
        groups.append(
            {
                "name": group.name,
                "algorithm": group.model.algorithm.kind,
                "found_by": group.model.found,
                "robots": group.count,
                "trials": group.trials,
                "airs": 1,
                "trials_differ_by": differ,
                "air_by_chance": sim.scenario.air_by_chance,
                "no_search": no_search,
                "shares_arena_with": [other.name for other in others],
                "unlike_them": any(other.model.algorithm != group.model.algorithm for other in others),
                "success_rate": None if no_search else float(np.mean(trials["success"])),
                "median_time_s": float(np.median(times)) if times else None,
                "median_path_m": float(np.median(paths)) if paths else None,
                "summary": {name: values | {"airs": 1} for name, values in summary.items()},
                "per_trial": trials,
                **_beside_recorded(sim, group),
            }
        )
    return groups


def _beside_recorded(sim: TimeLoop, group: GroupRange) -> Json:
    """Compare simulated and recorded readings of a group that replays recorded paths; {} if there are none."""
    if group.model.algorithm.kind != "replay":
        return {}
    team = next(team for team in sim.teams if group.number in team.numbers)
    comparison = team.algorithm.recorded()
    return {"beside_recorded": comparison} if comparison else {}


def _map(sim: TimeLoop, n: int, series: MapSeries | None) -> Json:
    """Return the scores of gas map n of the scenario; if rival groups map separately, a list with one entry each.

    made_by: groups whose readings are in the map. Means are over their trials, never over groups.
    """
    gas_map = sim.maps[n]
    model = sim.scenario.maps[n]
    estimate = np.asarray(gas_map.estimate())
    levels = gas_map.levels
    measurable = scores.measurable(sim, gas_map.cell, estimate.shape[1:3], levels)
    forecast = model.measures == "gas"
    if forecast:
        truth = scores.true_gas(sim, gas_map.cell, estimate.shape[1:3], levels)
        score = scores.map_score(estimate, np.where(measurable, truth, np.nan))
        per_trial = {
            "mae_ppm": score.mae,
            "correlation": score.correlation,
            "known_fraction": score.known,
            "forecast_error_ppm": scores.forecast_error(gas_map.errors, len(estimate)),
        }
    else:
        truth = scores.true_wind(sim, gas_map.cell, estimate.shape[1:3])
        found = scores.wind_score(estimate, np.where(measurable[..., None], truth, np.nan))
        per_trial = dict(zip((*WIND_NAMES, "known_fraction"), found, strict=True))
    parts = []
    for k, (names, rows) in enumerate(scores.map_rows(sim)):
        own = {name: values[rows] for name, values in per_trial.items()}
        parts.append(
            {
                "made_by": list(names),
                **{name: _mean(values) for name, values in own.items()},
                "per_trial": {name: values.tolist() for name, values in own.items()},
                **({"forecast": _forecast(gas_map, rows)} if forecast else {}),
                **(_over_time(series, k) if series else {}),
            }
        )
    about: Json = {"kind": model.kind, "cell_m": gas_map.cell}
    if levels:
        about |= {"layer_m": levels.layer, "heights_m": [levels.low, levels.high]}
    if model.robot is not None:
        about["robot"] = model.robot
    if len(parts) == 1:
        return about | parts[0]
    return about | {"groups": [{"name": part.pop("made_by")[0], **part} for part in parts]}


def _forecast(gas_map: Mapper, rows: slice) -> Json:
    """Return the forecast errors over time of some trials (rows) of a gas map."""
    return {
        "time_s": [t for t, _ in gas_map.errors],
        "error_ppm": [_mean(np.asarray(errors, float)[rows]) for _, errors in gas_map.errors],
    }


def _over_time(series: MapSeries, k: int) -> Json:
    """Return the scores over time of one group's part k of a map against the time-averaged gas or wind."""
    rows = series.parts[k]
    means = {name: [_known(value) for value in series.means(name)[:, k]] for name in series.names}
    last = {name: values[rows].tolist() for name, values in zip(series.names, series.last, strict=True)}
    return {
        f"mean_{series.quantity}": {
            "time_s": series.time,
            **means,
            "per_trial_at_end": last if series.time else {},
        }
    }


def _mean(values: np.ndarray) -> float | None:
    return _known(scores.mean_of_known(values))


def _known(value: float) -> float | None:
    return float(value) if isfinite(value) else None


def write_result(folder: Path, content: Json) -> None:
    """Write `result.json` atomically; NaN and infinities become null."""
    text = json.dumps(json_value(content), indent=2, allow_nan=False, ensure_ascii=False) + "\n"
    with written_whole(folder / "result.json") as fresh:
        fresh.write_text(text, encoding="utf-8")
