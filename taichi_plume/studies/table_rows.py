"""Rows of a study's tables: a row per trial of a run, and outcomes of the whole run."""

import re
from collections.abc import Mapping
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow.compute as pc

from taichi_plume.files import parquet
from taichi_plume.grid.geodesic import shortest_ways
from taichi_plume.scoring import trials as scores
from taichi_plume.studies.messages import Outcomes, Row
from taichi_plume.time_loop import TimeLoop

if TYPE_CHECKING:
    import pyarrow as pa

STEP = re.compile(r"[^.\[\]]+")  # of a path
PROBES = "probes."  # prefix of outcomes that are means of a probe


def trial_rows(sim: TimeLoop) -> list[Row]:
    """Return a row for each trial of each group of a finished run, with the columns of `trials_table.TRIAL`.

    searched: whether the group searched for a source; if not, success and outcome are None. time_with_failures_s: time,
    or the full time of the group after a failure. shares_arena: whether other groups are in the same arena. shortest_m:
    shortest path of the robot that found a source first, else of the team's first robot. NaN and infinity become None.
    """
    if not sim.swarm.count:
        return []
    now = sim.swarm.snapshot()
    rows = []
    for group in sim.swarm.groups:
        trials = scores.trial_outcomes(sim, group, now)
        trials["shortest_m"] = _shortest(sim, group, now).tolist()
        searched = scores.no_search(sim, group, trials["success"]) is None
        end = scores.end(sim, group)
        common: Row = {"group": group.name, "algorithm": group.model.algorithm.kind}
        common["shares_arena"] = len(sim.swarm.groups) > 1 and not sim.scenario.rivals
        for k in range(group.trials):
            row = {name: _number(values[k]) for name, values in trials.items()}
            if not searched:
                row["success"] = row["outcome"] = None
            late = row["time_s"] if row["success"] else end
            row["time_with_failures_s"] = late if searched else None
            rows.append(common | {"searched": searched} | row)
    return rows


def _shortest(sim: TimeLoop, group: Any, now: dict[str, np.ndarray]) -> np.ndarray:
    """Return the shortest path on the floor [m] from the start of the first successful robot to a source, (trials,).

    Sources count where they are when the robot finds one, without success at the end. NaN for flying robots.
    """
    if group.model.body.flies:
        return np.full(group.trials, np.nan)
    floor, radius = sim.swarm.clearance, group.model.body.radius
    span = slice(group.start, group.start + group.trials * group.count)
    time = np.where(now["found"][span], now["found_time"][span], np.inf)
    first = time.reshape(group.trials, group.count).argmin(axis=1) + group.count * np.arange(group.trials)
    starts = now["start"][span][first].astype(float)
    at = np.where(now["found"][span][first] > 0, now["found_time"][span][first], sim.t)

    def ways(starts: np.ndarray, t: float) -> np.ndarray:
        sources = scores.present(sim.scenario, t)
        return shortest_ways(
            starts, sources, group.model.reach, radius, floor.distance_at, floor.low, floor.high
        )

    if not sim.scenario.sources_change:
        return ways(starts, sim.t)
    lengths = np.empty(len(starts))
    for t in np.unique(at):
        lengths[at == t] = ways(starts[at == t], float(t))
    return lengths


def _number(value: object) -> object:
    return value if not isinstance(value, float) or isfinite(value) else None


def probed(outcomes: Mapping[str, str]) -> bool:
    """Return whether any requested outcome is the mean of a probe (a path that begins with `probes.`)."""
    return any(path.startswith(PROBES) for path in outcomes.values())


def outcomes_of(
    outcomes: Mapping[str, str], content: Mapping[str, Any], probes: Path | None = None
) -> Outcomes:
    """Return the numbers at the paths `outcomes` of a run's result or table of probes; None if there is none."""
    table = None
    if probes is not None and probes.exists():
        with parquet.opened(probes) as file:
            table = file.read(use_threads=False)
    return {
        name: probe_mean(table, path) if path.startswith(PROBES) else found(content, path)
        for name, path in outcomes.items()
    }


def found(content: Any, path: str) -> float | None:
    """Return the number at a path such as ``maps[0].correlation``; None if there is no finite number."""
    for step in STEP.findall(path):
        if isinstance(content, Mapping):
            content = content.get(step)
        elif isinstance(content, list | tuple | np.ndarray) and step.isdecimal() and int(step) < len(content):
            content = content[int(step)]
        else:
            return None
    if not isinstance(content, int | float | np.number):
        return None
    return float(content) if isfinite(content) else None


def probe_mean(table: "pa.Table | None", path: str) -> float | None:
    """Return the mean of `probes.NAME.QUANTITY` over points and time t >= 0; names may contain dots."""
    name, _, quantity = path.removeprefix(PROBES).rpartition(".")
    if table is None or quantity not in table.column_names:
        return None
    chosen = pc.and_(pc.equal(table["probe"].cast("string"), name), pc.greater_equal(table["t"], 0.0))
    value = scores.mean_of_known(np.asarray(table.filter(chosen)[quantity], float))
    return value if isfinite(value) else None
