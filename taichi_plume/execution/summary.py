"""Text summary of a run's result, for the terminal and the report."""

import shlex
from collections.abc import Mapping, Sequence
from math import isfinite
from pathlib import Path
from statistics import mean
from typing import Any

from taichi_plume.files.run_folder import FILES
from taichi_plume.guard.terminal import show
from taichi_plume.scoring.declarations import Json, has_declared

MEAN = ("error_ppm", "correlation", "peak_distance_m")
"""Scores of a map against the mean gas since the start."""

DECLARED = (
    ("localisation_error_m", "localisation error", " m"),
    ("declared_time_s", "time to declare", " s"),
)
"""Scores of declarations: key, title and unit."""
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
    "max_speed": ("largest speed [m/s]", ""),
    "wall_y_plus_median": (
        "median y+ at the walls",
        "of the middles of the cells at the domain's walls, by the law of the wall; resolved below 3",
    ),
    "wall_y_plus_max": ("largest y+ at the walls", "at the end of the run"),
    "eddy_diffusivity_m2_per_s": (
        "eddy diffusivity [m²/s]",
        "mixing of the air, from particles in flows of this kind; 0.001 to 0.013 was measured in homes "
        "(Cheng et al. 2011, doi:10.1021/es103080p)",
    ),
    "eddy_diffusivity_error_m2_per_s": ("its standard error [m²/s]", ""),
    "as_of_air_changes_per_h": (
        "air changes per hour of equally mixed rooms",
        "in rooms of this volume, by the law of Cheng et al. 2011; below 0: less than closed rooms",
    ),
}


def print_summary(content: Json, folder: Path) -> None:
    """Print the text summary of result.json, and the commands that show recording and report."""
    from rich.table import Table
    from rich.text import Text

    table = Table(show_header=False, box=None, padding=(0, 2, 0, 0))
    table.add_column(style="bold")
    table.add_column(overflow="fold")
    for name, value in summary(content):
        table.add_row(name, Text(value))
    files = [name for name in FILES if (folder / name).exists()]
    show(table, Text(f"\n{folder}: {', '.join(files)}"))
    if "recording.rrd" in files:
        command = shlex.join(["rerun", str(folder / "recording.rrd")])
        show(Text.assemble("look at it:  ", (command, "bold cyan")), soft_wrap=True)
    if "report.html" in files:
        show(Text.assemble("read it:     ", (str(folder / "report.html"), "bold cyan")), soft_wrap=True)


def summary(content: Json) -> list[tuple[str, str]]:
    """Return a text summary of result.json as (name, text) lines."""
    wall, simulated = content["wall_s"], content["simulated_s"]
    status = ending(content) + (f": {content['message']}" if content["message"] else "")
    speed = f"{simulated / max(wall, 1e-9):.3g} x real time"
    grid = f"{content['cells']:,} cells, {content['steps']:,} steps, {content['backend']}"
    if content["Mcell_steps_per_s"]:
        grid += f", {content['Mcell_steps_per_s']:.3g} million cell steps per s"
    lines = [
        (content["name"], status),
        ("time", f"{simulated:.1f} s simulated in {wall:.1f} s ({speed})"),
        ("grid", grid),
    ]
    if rows := flow(content):
        lines.append(("flow", ", ".join(f"{name} {value}" for name, value, _ in rows)))
    if rows := budget(content):
        lines.append(("gas", ", ".join(f"{value} {name}" for name, value in rows)))
    for group in content["groups"]:
        lines.append((group["name"], _group_line(group)))
        if has_declared(group["per_trial"]) and not group["no_search"]:
            lines.append((f"{group['name']} declared", _declared_line(group)))
        if any(group["per_trial"].get("pushes", ())):
            lines.append((f"{group['name']} pushed", _pushed_line(group)))
        if "beside_recorded" in group:
            lines.append((f"{group['name']} recorded", _recorded_line(group["beside_recorded"])))
    if "service" in content:
        lines.append(("from outside", _service_line(content["service"])))
    lines += _caveats(content)
    return lines + [(name, _map_line(part)) for name, part in map_parts(content["maps"])]


def map_names(maps: Sequence[Json]) -> list[str]:
    """Return a unique name for each gas map in result.json: its kind, with the index if kinds repeat."""
    kinds = [f"{str(gas_map.get('kind', '?')).replace('_', ' ')} map" for gas_map in maps]
    return [f"{kind} (maps[{n}])" if kinds.count(kind) > 1 else kind for n, kind in enumerate(kinds)]


def map_parts(maps: Sequence[Json]) -> list[tuple[str, Json]]:
    """Return name and scores of each gas map in result.json; of a map of rivals, of the part of each group."""
    parts: list[tuple[str, Json]] = []
    for name, gas_map in zip(map_names(maps), maps, strict=True):
        parts += [(f"{name}, {part['name']}", part) for part in gas_map.get("groups", ())] or [
            (name, gas_map)
        ]
    return parts


def budget(result: Json) -> list[tuple[str, str]]:
    """Return a table (name, value) of the gas mass budget [g] and its relative error; empty without gas."""
    gas = result.get("gas") or {}
    rows = [(name, f"{1e3 * gas[key]:.4g} g") for key, name in BUDGET.items() if gas.get(key) is not None]
    error = gas.get("relative_error")
    if rows and error is not None:
        rows.append(("unaccounted for", f"{error:.1e} of the incoming mass"))
    return rows


def flow(result: Json) -> list[tuple[str, str, str]]:
    """Return the diagnostics of the flow solver: (name, value, meaning)."""
    rows = []
    for key, value in (result.get("flow") or {}).items():
        name, meaning = FLOW.get(key, (key.replace("_", " "), ""))
        if isinstance(value, int | float):
            rows.append((name, f"{value:.3g}", meaning))
    return rows


def ending(content: Mapping[str, Any]) -> str:
    """Return how a run ended: its status, or in words what ended a run before its duration.

    content: result.json. "source found": every robot had found a source; "ended early": no robot searched any more.
    """
    status, groups = str(content.get("status", "unknown")), content.get("groups") or []
    if status != "stopped":
        return status
    counts = [_found(group) for group in groups]
    return "source found" if counts and all(found == robots for found, robots in counts) else "ended early"


def robots_found(group: Json) -> str:
    """Return how many of a group's robots found a source, over all trials, such as "1 of 2 robots"."""
    found, robots = _found(group)
    return f"{found:,} of {robots:,} robot{'s' * (robots != 1)}"


def _found(group: Json) -> tuple[int, int]:
    """Return the number of robots that found a source, and of all robots, in all trials of a group of result.json."""
    return sum(group["per_trial"]["found"]), group["robots"] * group["trials"]


def _recorded_line(replay: Json) -> str:
    """Return a text on how simulated and recorded readings of a replayed path differ, as means over the trials."""
    mae, bias = (mean(replay[name]) for name in ("mae_ppm", "bias_ppm"))
    text = f"{replay['readings']:,} readings; the simulated ones are {mae:.3g} ppm off, on average {bias:+.3g} ppm"
    known = [value for value in replay["correlation"] if value is not None and isfinite(value)]
    return text + (f", correlation {mean(known):.2f}" if known else "")


def _service_line(service: Json) -> str:
    """Return a text on the service for external robots: missed time steps, messages and connection losses."""
    names = ("times_lost", "taken", "malformed", "oversized", "late")
    counts = {name: sum(robot[name] for robot in service["messages"].values()) for name in names}
    lost = counts.pop("times_lost")
    messages = ", ".join(f"{count:,} {name}" for name, count in counts.items() if count or name == "taken")
    return (
        f"{service['ticks_missed']:,} of {service['ticks']:,} ticks missed; messages: {messages}; "
        f"robots were lost {lost:,} times"
    )


def _group_line(group: Json) -> str:
    trials, n = group["per_trial"], group["trials"]
    text = f"{group['algorithm']}, "
    if group["no_search"]:
        return f"{text}no search took place: {group['no_search']}"
    text += f"{robots_found(group)} found a source"
    text += " by declaring" if group.get("found_by") == "declared" else ""
    if n > 1:
        text += f", in {sum(trials['success'])} of {n} trials at least one"
    if any(trials["success"]):
        text += f"; the first after {group['median_time_s']:.1f} s and {group['median_path_m']:.2f} m"
        text += " (median of these)" if n > 1 else ""
    if n > 1 and group["trials_differ_by"] != "nothing":
        rate = group["summary"]["success_rate"]
        text += (
            f"; success {100 * rate['mean']:.0f} % "
            f"({100 * rate['low']:.0f} to {100 * rate['high']:.0f} %, of {n} trials in one air)"
        )
    return text


def _pushed_line(group: Json) -> str:
    """Return a text on collisions of moving obstacles with a group's robots, summed over all trials."""
    pushes, pinned = (sum(group["per_trial"][name]) for name in ("pushes", "pinned_s"))
    text = f"moving obstacles ran into its robots {pushes:,} time{'s' * (pushes != 1)}"
    if not pinned:
        return f"{text} and pushed them aside"
    return f"{text}; robots were inside an obstacle for {pinned:.3g} s, where their readings mean nothing"


def _declared_line(group: Json) -> str:
    """Return a text on a group's source declarations: per trial the first right one, or else the last."""
    trials, n = group["per_trial"], group["trials"]
    errors = [error for error in trials["localisation_error_m"] if error is not None and isfinite(error)]
    false = sum(count or 0 for count in trials["false_declarations"])
    wrong = f"{false:g} false declaration{'s' * (false != 1)}"
    if n == 1:
        right = "rightly" if trials["outcome"] == ["declared"] else "falsely"
        text = f"{right} after {trials['declared_time_s'][0]:.1f} s"
        text += f", {errors[0]:.2f} m from a source" if errors else ""
        return f"{text}; {wrong}"
    count = trials["outcome"].count
    text = f"rightly in {count('declared')} of {n} trials; in {count('reached')} more a robot reached a source, in "
    text += f"{count('neither')} neither"
    for name, title, unit in DECLARED:
        score = group["summary"][name]
        if score["n"]:
            text += f"; {title} {score['mean']:.3g}{unit}"
            known = score["low"] is not None and isfinite(score["low"])
            text += f" ({score['low']:.3g} to {score['high']:.3g}{unit})" if known else ""
    return f"{text}; {wrong} in all"


def _caveats(content: Json) -> list[tuple[str, str]]:
    """Return (name, text) notes on limits of the statistics: trials share one turbulent flow, groups one arena."""
    lines, groups = [], content["groups"]
    searched = [group for group in groups if group["trials"] > 1 and not group["no_search"]]
    by = {group["trials_differ_by"] for group in searched}
    if by - {"nothing"}:
        differ = "what robots draw by chance differs"
        differ = f"starts and {differ[:-1]}" if "starts and chance" in by else differ
        others = "nothing random is in the air itself: other seeds make the same"
        if groups[0]["air_by_chance"]:
            others = "intervals say nothing of other airs, which other seeds make"
        lines.append(("one air", f"wind and gas are the same for all trials; only {differ}; {others}"))
    for group in searched:
        if group["trials_differ_by"] == "nothing":
            trials = f"the {group['trials']} trials of {group['name']} are identical to the bit"
            lines.append(("one trial", f"{trials}: nothing random differs; they count as one"))
    if any(group["unlike_them"] for group in groups):
        shared = "the arena and the maps" if content["maps"] else "the arena"
        names = ", ".join(group["name"] for group in groups)
        text = f"{names} share {shared}; add rivals: true to compare them"
        fewest = min(group["trials"] for group in groups)
        if fewest < max(group["trials"] for group in groups):
            text += f"; only the first {fewest} trials have all groups"
        lines.append(("one arena", text))
    return lines


def _map_line(gas_map: Json) -> str:
    known = f"over {100 * gas_map['known_fraction']:.0f} % of the cells"
    if "error_m_s" in gas_map:
        series = gas_map.get("mean_wind", {})
        error, angle = (
            (series.get(name) or [gas_map[name]])[-1] for name in ("error_m_s", "direction_error_deg")
        )
        if error is None:
            return "no cell is known"
        turned = "" if angle is None else f", {angle:.0f}° off"
        return f"beside the mean wind {known}: error {error:.2g} m/s{turned}"
    if gas_map["mae_ppm"] is None:
        return "no cell is known"
    trials = len(gas_map["per_trial"]["mae_ppm"])
    of = f", mean of {trials} trials" if trials > 1 else ""
    now = f"error {gas_map['mae_ppm']:.3g} ppm"
    if gas_map["correlation"] is not None:
        now += f", correlation {gas_map['correlation']:.2f}"
    mean = {
        name: values[-1] for name, values in gas_map.get("mean_gas", {}).items() if values and name in MEAN
    }
    if mean.get("error_ppm") is None:
        return f"{now} {known}{of}"
    text = f"beside the mean of the gas {known}{of}: error {mean['error_ppm']:.3g} ppm"
    if mean["correlation"] is not None:
        text += f", correlation {mean['correlation']:.2f}"
    if mean["peak_distance_m"] is not None:
        text += f", peak {mean['peak_distance_m']:.2f} m from a source"
    return f"{text}; beside the gas at the end: {now}"
