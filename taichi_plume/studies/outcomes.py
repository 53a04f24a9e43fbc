"""Check that the runs of a study yield the requested outcomes (paths in result.json) and files to keep."""

import difflib
from collections.abc import Iterator, Mapping, Sequence
from math import inf
from typing import Any

from taichi_plume.files.run_folder import FILES
from taichi_plume.files.trials_table import TRIAL
from taichi_plume.scenario.changes import steps_of
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scoring.declarations import OF_BELIEFS

PROBES = "probes"
ANY = None
"""Marks sections of result.json whose keys depend on the solver: any path below is accepted."""
NUMBERS = [0]
MEANS = (
    *(
        "success_rate",
        "time_s",
        "path_m",
        "overhead",
        "acquisitions",
        "hits",
        "bumps",
        "time_with_failures_s",
    ),
    *("declared_rate", "reached_rate", "neither_rate", "declared_time_s", "localisation_error_m"),
    "false_declarations",
)
PUSHING = frozenset(("pushes", "pinned_s"))  # only in runs with moving obstacles
TABLES_ALONE = (
    "group",
    "algorithm",
    "searched",
    "shortest_m",
    "time_with_failures_s",
    "outcome",
    "shares_arena",
)
OF_TRIALS = [column.name for column in TRIAL if column.name not in TABLES_ALONE]
GROUP = {
    **dict.fromkeys(("robots", "trials", "airs", "success_rate", "median_time_s", "median_path_m"), 0),
    "summary": dict.fromkeys(MEANS, dict.fromkeys(("mean", "low", "high", "n", "airs"), 0)),
    "per_trial": dict.fromkeys(OF_TRIALS, NUMBERS),
}
PART = {
    **dict.fromkeys(("mae_ppm", "correlation", "known_fraction", "forecast_error_ppm"), 0),
    "per_trial": ANY,
    "forecast": ANY,
    "mean_gas": ANY,
}
WIND_PART = {
    **dict.fromkeys(("error_m_s", "direction_error_deg", "known_fraction"), 0),
    "per_trial": ANY,
    "mean_wind": ANY,
}
BELIEF = {
    **dict.fromkeys(("cell_m", *OF_BELIEFS), 0),
    "per_trial": dict.fromkeys(OF_BELIEFS, NUMBERS),
    "over_time": ANY,
}
RESULT: Mapping[str, Any] = {
    **dict.fromkeys(("seed", "air_seed", "simulated_s", "steps", "cells"), 0),
    "flow": ANY,
    "gas": ANY,
    "obstacles": [{"force_N": NUMBERS}],
    "groups": [GROUP],
    "maps": [{"cell_m": 0, **PART, "groups": [PART]}],
    "beliefs": [BELIEF],
}
"""Structure of the run-dependent part of result.json: 0 stands for a number, a list for items of equal structure."""
SIGNED = frozenset(("bias_ppm", "relative_error", "force_N", "forecast", "nlpd"))
"""Names in result.json of numbers that may be negative, besides correlations and the numbers of flows and probes."""
SHARES = frozenset(("success", "within_reach"))
"""Names in result.json of shares, besides those that end with `_rate` or `_fraction`."""
SECTIONS = {
    "recording.rrd": "recording",
    "pictures.zarr": "recording",
    "forces.csv": "forces",
    "probes.parquet": "probes",
    "fields.zarr": "fields",
    "plume.pslog": "plumesim_log",
    "maps.zarr": "maps",
    "robots.parquet": "robots",
}
"""Files that only some runs write, and the section of a scenario that they require."""


class OutcomeCheck:
    """Requested outcomes and files of a study that no scenario examined so far yields."""

    def __init__(self, outcomes: Mapping[str, str], keep: Sequence[str]):
        self.outcomes, self.keep = dict(outcomes), list(keep)
        self.faults: dict[str, str] = {}

    def look(self, scenario: Scenario) -> None:
        """Drop the requested outcomes and files that runs of a scenario yield; record errors of the others."""
        for name, path in list(self.outcomes.items()):
            if not self._note(f"outcomes.{name}", next(_unknown(path, scenario), None)):
                del self.outcomes[name]
        self.keep = [name for name in self.keep if self._note(f"keep: {name}", not_left(name, scenario))]

    def _note(self, where: str, fault: str | None) -> bool:
        """Record the first error of a requested key, or None to remove the error. Return whether there is an error."""
        if fault is None:
            self.faults.pop(where, None)
        else:
            self.faults.setdefault(where, fault)
        return fault is not None

    @property
    def lines(self) -> list[str]:
        """Errors about the remaining outcomes and files: ``path: message``."""
        return [f"{where}: {fault}" for where, fault in self.faults.items()]


def limits_of(path: str) -> tuple[float, float]:
    """Return the least and the largest value that the number at a path of result.json, or of a probe, can have."""
    names = [step for step in steps_of(path) if not step.isdecimal()]
    if names[0] == PROBES:
        return (0.0 if names[-1].endswith("_ppm") else -inf), inf
    if names[-1] == "correlation":
        return -1.0, 1.0
    if any(name in SHARES or name.endswith(("_rate", "_fraction")) for name in names):
        return 0.0, 1.0
    return (-inf if names[0] == "flow" or not SIGNED.isdisjoint(names) else 0.0), inf


def not_left(name: str, scenario: Scenario) -> str | None:
    """Return the reason why runs of a scenario do not write a file; None if they do."""
    if name not in FILES:
        close = difflib.get_close_matches(name, FILES, n=1)
        meant = f"did you mean {close[0]}? " if close else ""
        return f"runs write no such file; {meant}they write {', '.join(FILES)}"
    if name == "maps.zarr" and scenario.believers:
        return None
    section = SECTIONS.get(name)
    if section is not None and not vars(scenario)[section]:
        return f"is written only by runs whose scenario has {section}; add {section} to the base"
    if name == "forces.csv" and not (scenario.obstacles and scenario.wind.computed):
        return "is written only by runs with obstacles and a computed wind"
    return None


def _unknown(path: str, scenario: Scenario) -> Iterator[str]:
    """Yield an error line if runs of a scenario yield no number at a path of result.json or of the probes."""
    steps = steps_of(path)
    if steps[0] == PROBES:
        yield from _no_probe(path, scenario)
        return
    known: Any = RESULT
    lists = {"groups": scenario.robots, "maps": scenario.maps, "obstacles": scenario.obstacles}
    sizes = {name: len(parts) for name, parts in (lists | {"beliefs": scenario.believers}).items()}
    for n, step in enumerate(steps):
        at = ".".join(steps[:n])
        if known is ANY:
            return
        if isinstance(known, list):
            size = sizes.get(at, 1 << 30)
            if not step.isdecimal() or int(step) >= size:
                has = f"{size} of them, the first is 0" if at in sizes else "a number, the first is 0"
                yield f"result.json has no {at}.{step}; {at} takes {has}"
                return
            known = known[0]
            if at == "maps" and scenario.maps[int(step)].measures == "wind":
                known = {"cell_m": 0, **WIND_PART, "groups": [WIND_PART]}
        elif not isinstance(known, Mapping) or step not in known:
            names = list(known) if isinstance(known, Mapping) else []
            close = difflib.get_close_matches(step, names, n=1)
            meant = f"; did you mean {'.'.join([*steps[:n], close[0]])}?" if close else ""
            which = f"; numbers of {at or 'result.json'}: {', '.join(names)}" if names and not close else ""
            yield f"result.json has no number at {'.'.join(steps[: n + 1])}{meant}{which}"
            return
        else:
            known = known[step]
    if isinstance(known, Mapping | list):
        yield f"{path} is a group of numbers; give the path of a single number"
    elif not PUSHING.isdisjoint(steps) and not any(obstacle.motion for obstacle in scenario.obstacles):
        yield f"only runs with moving obstacles have {path}; add motion to an obstacle of the base"


def _no_probe(path: str, scenario: Scenario) -> Iterator[str]:
    """Yield an error line if a path `probes.NAME.QUANTITY` names no probe or quantity. NAME may contain dots."""
    name, _, quantity = path.partition(".")[2].rpartition(".")
    names = [probe.name for probe in scenario.probes.points] if scenario.probes else []
    if not name:
        yield f"{path} is not the path of a probe; use probes.NAME.QUANTITY"
    elif name not in names:
        has = f"the scenario has {', '.join(names)}" if names else "the scenario has no probes; add them"
        yield f"there is no probe '{name}'; {has}"
    else:
        known = [f"wind_{axis}" for axis in "xyz"[: scenario.domain.dim]]
        known += dict.fromkeys(f"{gas.vapour.name}_ppm" for _, gas in scenario.gases)
        known += ["pressure"] if scenario.wind.computed else []
        known += ["temperature"] if scenario.heat else []
        if quantity not in known:
            yield f"probes have no quantity '{quantity}'; they have {', '.join(known)}"
