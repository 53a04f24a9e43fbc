"""`result.json`: what came of a run; written last and at once."""

import json
from math import isfinite, prod
from pathlib import Path
from typing import Any

import numpy as np

from taichi_plume import __version__
from taichi_plume.files.disk import written_whole
from taichi_plume.scoring import trials as scores
from taichi_plume.scoring.beliefs import BeliefScores
from taichi_plume.scoring.maps import NAMES, MapScores, MapSeries
from taichi_plume.simulation import Simulation


def result(
    sim: Simulation,
    status: str,
    message: str,
    backend: str,
    map_scores: MapScores | None = None,
    belief_scores: BeliefScores | None = None,
) -> dict[str, Any]:
    """What came of a run, ready for `write_result`; map_scores, belief_scores: of its maps and beliefs over time."""
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
        "maps": [_map(sim, n, map_scores.series[n] if map_scores else None) for n in range(len(sim.maps))],
        "beliefs": (belief_scores or BeliefScores(sim)).told(sim),
    }


def begun(sim: Simulation, status: str, message: str, backend: str) -> dict[str, Any]:
    """What can be told of a run before its end."""
    return {
        "name": sim.scenario.name,
        "status": status,
        "message": message,
        **sim.scenario.seeds,
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
    keys = dict.fromkeys(key for part in kept for key in part)
    total: dict[str, Any] = {key: sum(part.get(key, 0.0) for part in kept) for key in keys}
    for budget in [total, *kept]:
        taken = budget.get("taken_up_kg", 0.0)
        given = sum(budget.get(key, 0.0) for key in ("initial_kg", "emitted_kg", "inflow_kg"))
        missing = given - taken - budget["in_domain_kg"] - budget["outflow_kg"]
        brought = given + max(0.0, -taken)
        budget["relative_error"] = missing / brought if brought else None
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
    """How each group did.

    found_by: what counts as found, "reached" or "declared". airs: in how many airs its trials were, always one;
    trials_differ_by: see `scores.trials_differ_by`. no_search: why no source could be found, or None.
    shares_arena_with: groups that it may have met; unlike_them: whether one of these has another algorithm, or the same
    one with other numbers. summary, per_trial: see `scores.trial_summary`, `scores.trial_outcomes`. beside_recorded: of
    robots that go recorded ways, see agents/replay.py.
    """
    if not sim.swarm.count:
        return []
    now = sim.swarm.snapshot()
    groups = []
    sources = scores.source_places(sim)
    for group in sim.swarm.groups:
        trials = scores.trial_outcomes(group, now, sources)
        times = [t for t, good in zip(trials["time_s"], trials["success"], strict=True) if good]
        paths = [p for p, good in zip(trials["path_m"], trials["success"], strict=True) if good]
        others = [] if sim.scenario.rivals else [one for one in sim.swarm.groups if one is not group]
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
                "shares_arena_with": [one.name for one in others],
                "unlike_them": any(one.model.algorithm != group.model.algorithm for one in others),
                "success_rate": None if no_search else float(np.mean(trials["success"])),
                "median_time_s": float(np.median(times)) if times else None,
                "median_path_m": float(np.median(paths)) if paths else None,
                "summary": {name: values | {"airs": 1} for name, values in summary.items()},
                "per_trial": trials,
                **_beside_recorded(sim, group),
            }
        )
    return groups


def _beside_recorded(sim: Simulation, group: Any) -> dict[str, Any]:
    """How the readings of a group that goes recorded ways are beside those recorded, if there are any."""
    found = None
    for team in sim.teams:
        told = getattr(team.algorithm, "recorded", None)
        if told is not None and group.number in team.numbers:
            found = told()
    return {"beside_recorded": found} if found else {}


def _map(sim: Simulation, n: int, series: MapSeries | None) -> dict[str, Any]:
    """Scores of a map; with several rivals, who make a map each, those of every group by its name in `groups`.

    made_by: the groups whose readings it is made of. Means are over their trials, never over groups.
    """
    gas_map = sim.maps[n]
    estimate = np.asarray(gas_map.estimate())
    truth = scores.true_gas(sim, gas_map.cell, estimate.shape[1:])
    measurable = scores.measurable(sim, gas_map.cell, estimate.shape[1:])
    score = scores.map_score(estimate, np.where(measurable, truth, np.nan))
    per_trial = {
        "mae_ppm": score.mae,
        "correlation": score.correlation,
        "known_fraction": score.known,
        "forecast_error_ppm": scores.forecast_error(gas_map.errors, len(estimate)),
    }
    parts = []
    for k, (names, rows) in enumerate(scores.map_rows(sim)):
        own = {name: values[rows] for name, values in per_trial.items()}
        parts.append(
            {
                "made_by": list(names),
                **{name: _mean(values) for name, values in own.items()},
                "per_trial": {name: values.tolist() for name, values in own.items()},
                "forecast": {
                    "time_s": [t for t, _ in gas_map.errors],
                    "error_ppm": [_mean(np.asarray(errors, float)[rows]) for _, errors in gas_map.errors],
                },
                **(_over_time(series, k) if series else {}),
            }
        )
    told: dict[str, Any] = {"kind": sim.scenario.maps[n].kind, "cell_m": gas_map.cell}
    if len(parts) == 1:
        return told | parts[0]
    return told | {"groups": [{"name": part.pop("made_by")[0], **part} for part in parts]}


def _over_time(series: MapSeries, k: int) -> dict[str, Any]:
    """Scores of part k of a map against the mean of the gas (see map_scores), over time the mean of its trials."""
    rows = series.parts[k]
    means = {name: [_known(value) for value in series.means(name)[:, k]] for name in NAMES}
    last = {name: values[rows].tolist() for name, values in zip(NAMES, series.last, strict=True)}
    return {"mean_gas": {"time_s": series.time, **means, "per_trial_at_end": last if series.time else {}}}


def _mean(values: np.ndarray) -> float | None:
    """Mean of what is known."""
    return _known(scores.mean_of_known(values))


def _known(value: float) -> float | None:
    return float(value) if isfinite(value) else None


def write_result(folder: Path, content: dict[str, Any]) -> None:
    """Write `result.json` so that a reader sees all of it or none; what is no number becomes null."""
    text = json.dumps(plain(content), indent=2, allow_nan=False, ensure_ascii=False) + "\n"
    with written_whole(folder / "result.json") as fresh:
        fresh.write_text(text, encoding="utf-8")


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
