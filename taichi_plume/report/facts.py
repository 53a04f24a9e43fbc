"""Tables of a report: key facts, trials, maps' scores, files."""

from collections import Counter
from collections.abc import Sequence
from math import isfinite, prod
from typing import Any

from taichi_plume.execution.summary import map_parts, robots_found
from taichi_plume.results.run import Run
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scoring.declarations import has_declared
from taichi_plume.scoring.trials import LEAST_VALUES

Rows = list[tuple[str, ...]]

FILES = {
    "report.html": "this report",
    "pictures.zarr": "numbers of the recorded pictures: gas, temperature and wind in planes, for xarray",
    "recording.rrd": "gas, wind, robots, sensors and maps over time, for the viewer: rerun recording.rrd",
    "result.json": "results of the run, as numbers",
    "robots.parquet": "a row per robot and time: pose, reading, true gas, wind, state",
    "maps.zarr": "gas maps at the end, beside the truth, and beliefs (posterior) of the source's position",
    "fields.zarr": "wind and gas on the grid over time, for xarray, ParaView (by export) and playing back",
    "probes.parquet": "wind, pressure and gas at points",
    "forces.csv": "the force of the air on each obstacle",
    "plume.pslog": "wind and gas as a log of PlumeSim",
    "scenario.yaml": "the scenario with every default written out; run it again with the command on top of it",
    "manifest.json": "size and SHA-256 of what the run read and wrote",
    "checkpoint.npz": "saved states from which the run can be resumed",
}
QUANTITIES = {
    "time_s": ("time to find the source", "s", "successful trial"),
    "path_m": ("path of the robot that found the source", "m", "successful trial"),
    "overhead": ("this path over the straight path", "×", "successful trial"),
    "time_with_failures_s": ("time, a failure counts as the whole run", "s", "trial"),
}
OUTCOMES = {
    "declared_rate": "declared rightly",
    "reached_rate": "reached, not declared",
    "neither_rate": "neither",
}
DECLARED = {
    "localisation_error_m": ("from the declared place to the nearest source", "m", "trial that declared"),
    "declared_time_s": ("time to declare", "s", "trial that declared"),
    "false_declarations": ("false declarations", "a trial", "trial"),
}
"""Quantities of robots that have declared."""


def key_facts(run: Run) -> Rows:
    """Return a table (name, value) of the scenario: room, grid, time, gas, robots and so on."""
    scenario, domain = run.scenario, run.scenario.domain
    room = " × ".join(f"{length:g}" for length in domain.extent) + " m"
    room += f", a slab {domain.depth:g} m deep seen from above" if domain.dim == 2 else ""
    shape, warm_up = domain.shape, scenario.warm_up
    gases = [f"{gas.vapour.name} ({gas.kind.replace('_', ' ')})" for _, gas in scenario.gases]
    rows: Rows = [
        ("room", room),
        ("grid", f"{' × '.join(map(str, shape))} = {prod(shape):,} cells of {domain.spacing:g} m"),
        (
            "time",
            f"{scenario.duration:g} s, after {warm_up:g} s without robots; a tick is {scenario.tick:g} s",
        ),
        ("wind", _wind(scenario)),
        ("gas", ", ".join(dict.fromkeys(gases))),
        ("sources", f"{len(scenario.sources)}"),
    ]
    if scenario.obstacles:
        rows.append(("obstacles", _counted([obstacle.kind for obstacle in scenario.obstacles])))
    for group in scenario.robots:
        trials = f", {group.trials} trials at once in the same air" if group.trials > 1 else ""
        later = f"; sets off at {group.begin:g} s" if group.begin else ""
        sensor = group.sensors.nose
        smells = " ".join(part for part in (sensor.kind, vars(sensor).get("model")) if isinstance(part, str))
        how = f"{group.body.kind} by {group.algorithm.kind.replace('_', ' ')}"
        rows.append((group.name, f"{group.count} × {how}{trials}; smells by {smells}{later}"))
    if scenario.maps:
        rows.append(("maps", ", ".join(gas_map.kind.replace("_", " ") for gas_map in scenario.maps)))
    rows += [(name.replace("_", " "), str(seed)) for name, seed in scenario.seeds.items()]
    return rows


def _wind(scenario: Scenario) -> str:
    kinds = [opening.label for opening in scenario.openings]
    return scenario.wind.kind + (f": {_counted(kinds)}" if kinds else "")


def _counted(names: Sequence[str]) -> str:
    """Return names with their counts as text."""
    counts = Counter(names)
    return ", ".join(f"{n} × {name}" if n > 1 else name for name, n in counts.items())


def trials(group: dict[str, Any]) -> Rows:
    """Return a group's means with intervals: (quantity, mean, interval of 95 % confidence, trials of the mean)."""
    summary, quantities, shares = group["summary"], QUANTITIES, {"success_rate": "success"}
    if has_declared(group["per_trial"]):
        quantities, shares = quantities | DECLARED, shares | OUTCOMES
    rows: Rows = []
    if summary["success_rate"]["n"] == 1 or group["robots"] > 1:
        over = f"{_trials(group['trials'], 'trial')} in one air"
        rows.append(("found a source", robots_found(group), "", over))
    for key, name in shares.items():
        rate = summary.get(key, {})
        if rate.get("n", 0) > 1:
            interval = f"{100 * rate['low']:.0f} to {100 * rate['high']:.0f} %"
            over = f"{_trials(rate['n'], 'trial')} in one air (Wilson)"
            rows.append((name, f"{100 * rate['mean']:.0f} %", interval, over))
        elif key in OUTCOMES and rate.get("mean"):
            rows.append(("outcome", name, "", f"{_trials(1, 'trial')} in one air"))
    for key, (name, unit, over) in quantities.items():
        mean = summary.get(key, {})
        if mean.get("mean") is not None:
            known = mean.get("low") is not None and isfinite(mean["low"])
            interval = f"none: fewer than {LEAST_VALUES}"
            if known:
                interval = f"{mean['low']:.3g} to {mean['high']:.3g} {unit}"
            over = f"{_trials(mean['n'], over)} in one air"
            rows.append((name, f"{mean['mean']:.3g} {unit}", interval, over))
    return rows


def _trials(n: int, what: str) -> str:
    """Return a number of trials; `what` begins or ends with the noun "trial"."""
    return f"{n:,} {what.replace('trial', 'trials', 1) if n != 1 else what}"


def map_rows(maps: Sequence[dict[str, Any]]) -> Rows:
    """Return final gas map scores: name, fraction of cells known, and the scores that `captions.MAP_HEADS` names."""
    rows: Rows = []
    for name, part in map_parts(maps):
        if "error_m_s" in part:
            continue
        mean_gas = part.get("mean_gas", {})
        error, correlation = ((mean_gas.get(key) or [None])[-1] for key in ("error_ppm", "correlation"))
        known = _percent(part)
        of_mean = _number(error), _number(correlation, "{:.2f}")
        at_end = _number(part.get("mae_ppm")), _number(part.get("correlation"), "{:.2f}")
        rows.append((name, known, *of_mean, *at_end))
    return rows


def wind_rows(maps: Sequence[dict[str, Any]]) -> Rows:
    """Return final wind map scores: name, fraction of cells known, and what `captions.WIND_HEADS` names."""
    rows: Rows = []
    for name, part in map_parts(maps):
        if "error_m_s" in part:
            mean = part.get("mean_wind", {})
            of_mean = ((mean.get(key) or [None])[-1] for key in ("error_m_s", "direction_error_deg"))
            rows.append((name, _percent(part), *map(_number, of_mean), _number(part["error_m_s"])))
    return rows


def _percent(part: dict[str, Any]) -> str:
    return "–" if part.get("known_fraction") is None else f"{100 * part['known_fraction']:.0f} %"


def _number(value: float | None, form: str = "{:.3g}") -> str:
    return "–" if value is None else form.format(value)


def files(run: Run) -> Rows:
    """Return the files in the folder: (name, size, contents)."""
    rows: Rows = []
    for name, what in FILES.items():
        path = run.folder / name
        if path.exists() and name != "report.html":
            parts = path.rglob("*") if path.is_dir() else [path]
            size = sum(part.stat().st_size for part in parts)
            rows.append((name, f"{size / 1e6:.3g} MB" if size > 1e5 else f"{size / 1e3:.3g} kB", what))
    return rows
