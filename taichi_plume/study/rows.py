"""What the tables hold of a run: a row per trial, and numbers of the whole run."""

import re
from collections.abc import Mapping
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from taichi_plume.grid.geodesic import shortest_ways
from taichi_plume.scoring import trials as scores
from taichi_plume.simulation import Simulation
from taichi_plume.study.messages import Request

STEP = re.compile(r"[^.\[\]]+")  # of a path
PROBES = "probes."  # begin of the outcomes that are means of a probe


def trial_rows(sim: Simulation, request: Request) -> list[dict[str, Any]]:
    """A row for each trial of each group of a run that is over.

    searched: whether there was anything that its robots could find; success and outcome are None where not.
    time_with_failures_s: a failure counts as all the time that its group had. shares_arena: whether other groups are in
    the same arena. shortest_m: of the robot that found first, or of the team's first. What is no number is None.
    """
    if not sim.swarm.count:
        return []
    now, sources = sim.swarm.snapshot(), scores.source_places(sim)
    who = {"run": request.run, "point": request.point, "air": request.air, "air_seed": request.air_seed}
    who |= {"seed": request.seed, **request.values}
    rows = []
    for group in sim.swarm.groups:
        trials = scores.trial_outcomes(group, now, sources)
        trials["shortest_m"] = _shortest(sim, group, now, sources).tolist()
        searched = scores.no_search(sim, group, trials["success"]) is None
        end = scores.end(sim, group)
        its = who | {"group": group.name, "algorithm": group.model.algorithm.kind}
        its["shares_arena"] = len(sim.swarm.groups) > 1 and not sim.scenario.rivals
        for k in range(group.trials):
            row = {name: _number(values[k]) for name, values in trials.items()}
            if not searched:
                row["success"] = row["outcome"] = None
            late = row["time_s"] if row["success"] else end
            row["time_with_failures_s"] = late if searched else None
            rows.append(its | {"searched": searched} | row)
    return rows


def _shortest(sim: Simulation, group: Any, now: dict[str, np.ndarray], sources: np.ndarray) -> np.ndarray:
    """The shortest way on the floor to a source of the robot that found one first, of each trial of a group (trials,)
    [m]; NaN of what flies.
    """
    if group.model.body.flies:
        return np.full(group.trials, np.nan)
    floor, radius = sim.swarm.clearance, group.model.body.radius
    span = slice(group.start, group.start + group.trials * group.count)
    time = np.where(now["found"][span], now["found_time"][span], np.inf)
    first = time.reshape(group.trials, group.count).argmin(axis=1) + group.count * np.arange(group.trials)
    starts = now["start"][span][first].astype(float)
    return shortest_ways(
        starts, sources[:, :2], group.model.reach, radius, floor.distance_at, floor.low, floor.high
    )


def _number(value: Any) -> Any:
    return value if not isinstance(value, float) or isfinite(value) else None


def probed(wanted: Mapping[str, str]) -> bool:
    """Whether any of the outcomes is a mean of a probe."""
    return any(path.startswith(PROBES) for path in wanted.values())


def outcomes_of(
    wanted: Mapping[str, str], content: Mapping[str, Any], probes: Path | None
) -> dict[str, float | None]:
    """The numbers at the `wanted` paths of a run's result, or of its table of probes; None where there is none."""
    told: dict[str, float | None] = {}
    samples = Samples(probes) if probes is not None else None
    for name, path in wanted.items():
        if path.startswith(PROBES):
            told[name] = samples.mean(path) if samples is not None else None
        else:
            told[name] = found(content, path)
    return told


def found(content: Any, path: str) -> float | None:
    """The number at a path such as ``maps[0].correlation`` or ``maps.0.correlation``; None where no finite one is."""
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


class Samples:
    """What the probes of a run have measured since the robots started."""

    def __init__(self, path: Path):
        import pyarrow.parquet as pq

        self.table = pq.read_table(path) if path.exists() else None

    def mean(self, path: str) -> float | None:
        """Over time and points, of `probes.NAME.QUANTITY`; names may hold dots."""
        import pyarrow.compute as pc

        name, _, quantity = path.removeprefix(PROBES).rpartition(".")
        if self.table is None or quantity not in self.table.column_names:
            return None
        compute: Any = pc
        its = compute.and_(
            compute.equal(self.table["probe"].cast("string"), name),
            compute.greater_equal(self.table["t"], 0.0),
        )
        values = np.asarray(self.table.filter(its)[quantity], float)
        value = scores.mean_of_known(values)
        return value if isfinite(value) else None
