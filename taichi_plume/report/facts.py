"""Tables of a report: key facts, trials, gas budget, flow solution, maps' scores, files."""

from collections import Counter
from collections.abc import Sequence
from math import isfinite, prod
from typing import Any

from taichi_plume.execution.summary import robots_found
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
BUDGET = {
    "initial_kg": "in the room at the start",
    "emitted_kg": "emitted by the sources",
    "inflow_kg": "brought in by the air",
    "in_domain_kg": "still in the room at the end",
    "outflow_kg": "carried out by the air",
    "taken_up_kg": "taken up by surfaces",
}
FLOW = {
    "max_divergence": ("largest divergence", "should be nearly zero: conservation of air"),
    "max_courant": (
        "largest Courant number",
        "cells crossed by the air in a step; the scheme is stable up to 1.3 (CFL)",
    ),
    "correction": (
        "largest correction",
        "change of the given wind that makes it conserve air, over its speed; from 0.5 on it is another wind",
    ),
    "max_speed": ("largest speed", "in m/s"),
    "wall_y_plus_median": (
        "median y+ at the walls",
        "of the middles of the cells at the domain's walls, by the law of the wall; resolved below 3",
    ),
    "wall_y_plus_max": ("largest y+ at the walls", "at the end of the run"),
    "eddy_diffusivity_m2_per_s": (
        "eddy diffusivity",
        "mixing of the air, in m²/s, from particles in flows of this kind; 0.001 to 0.013 was measured in homes "
        "(Cheng et al. 2011, doi:10.1021/es103080p)",
    ),
    "eddy_diffusivity_error_m2_per_s": ("its standard error", "in m²/s"),
    "as_of_air_changes_per_h": (
        "air changes per hour of equally mixed rooms",
        "in rooms of this volume, by the law of Cheng et al. 2011; below 0: less than closed rooms",
    ),
}


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


def budget(result: dict[str, Any]) -> Rows:
    """Return a table (name, value) of the gas mass budget [g] and its relative error; empty without gas."""
    gas = result.get("gas") or {}
    rows: Rows = [
        (name, f"{1e3 * gas[key]:.4g} g") for key, name in BUDGET.items() if gas.get(key) is not None
    ]
    error = gas.get("relative_error")
    if rows and error is not None:
        rows.append(("unaccounted for", f"{error:.1e} of the incoming mass"))
    return rows


def flow(result: dict[str, Any]) -> Rows:
    """Return the diagnostics of the flow solver: (name, value, meaning)."""
    rows: Rows = []
    for key, value in (result.get("flow") or {}).items():
        name, meaning = FLOW.get(key, (key.replace("_", " "), ""))
        if isinstance(value, int | float):
            rows.append((name, f"{value:.3g}", meaning))
    return rows


def map_rows(maps: Sequence[dict[str, Any]], names: Sequence[str]) -> Rows:
    """Return final gas map scores: name, fraction of cells known, and the scores that `captions.MAP_HEADS` names."""
    rows: Rows = []
    for name, result in zip(names, maps, strict=True):
        for part in result.get("groups", [result]):
            mean_gas = part.get("mean_gas", {})
            error, correlation = ((mean_gas.get(key) or [None])[-1] for key in ("error_ppm", "correlation"))
            whose = f"{name}, {part['name']}" if "groups" in result else name
            share = part.get("known_fraction")
            known = "–" if share is None else f"{100 * share:.0f} %"
            of_mean = _number(error), _number(correlation, "{:.2f}")
            at_end = _number(part.get("mae_ppm")), _number(part.get("correlation"), "{:.2f}")
            rows.append((whose, known, *of_mean, *at_end))
    return rows


def map_names(maps: Sequence[dict[str, Any]]) -> list[str]:
    """Return a unique name for each gas map in result.json: its kind, with the index if kinds repeat."""
    kinds = [str(result.get("kind", "?")).replace("_", " ") for result in maps]
    return [f"{kind} (maps[{n}])" if kinds.count(kind) > 1 else kind for n, kind in enumerate(kinds)]


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
