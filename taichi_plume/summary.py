"""A run's result in words."""

import shlex
from pathlib import Path
from typing import Any

from taichi_plume.files.run_folder import FILES
from taichi_plume.guard.terminal import show, visible


def print_summary(content: dict[str, Any], folder: Path) -> None:
    """Print a result for a person, and what to do next."""
    from rich.table import Table
    from rich.text import Text

    table = Table(show_header=False, box=None, padding=(0, 2, 0, 0))
    table.add_column(style="bold")
    table.add_column(overflow="fold")
    for name, value in summary(content):
        table.add_row(visible(name), Text(visible(value)))
    files = [name for name in FILES if (folder / name).exists()]
    show(table, Text(f"\n{visible(folder)}: {', '.join(files)}"))
    if "recording.rrd" in files:
        command = shlex.join(["rerun", str(folder / "recording.rrd")])
        show(Text.assemble("look at it:  ", (command, "bold cyan")), soft_wrap=True)


def summary(content: dict[str, Any]) -> list[tuple[str, str]]:
    """A result as (name, text) lines for a person."""
    wall, simulated = content["wall_s"], content["simulated_s"]
    status = content["status"] + (f": {content['message']}" if content["message"] else "")
    lines = [
        (content["name"], status),
        (
            "time",
            f"{simulated:.1f} s simulated in {wall:.1f} s ({simulated / max(wall, 1e-9):.3g} x real time)",
        ),
        ("grid", f"{content['cells']:,} cells, {content['steps']:,} steps, {content['backend']}"),
    ]
    if content["Mcell_steps_per_s"]:
        lines[-1] = (
            lines[-1][0],
            f"{lines[-1][1]}, {content['Mcell_steps_per_s']:.3g} million cell steps per s",
        )
    flow, gas = content["flow"], content["gas"]
    if flow:
        lines.append(
            ("flow", ", ".join(f"{name.replace('_', ' ')} {value:.4g}" for name, value in flow.items()))
        )
    if gas:
        text = ", ".join(
            f"{1e3 * gas[f'{name}_kg']:.4g} g {name.replace('_', ' ')}"
            for name in ("emitted", "in_domain", "outflow")
        )
        if gas["relative_error"] is not None:
            text += f", {gas['relative_error']:.1e} of it unaccounted for"
        lines.append(("gas", text))
    for group in content["groups"]:
        trials, robots = group["per_trial"], group["robots"] * group["trials"]
        text = f"{group['algorithm']}, {sum(trials['found'])} of {robots} robots found a source"
        if group["trials"] > 1:
            text += f", in {sum(trials['success'])} of {group['trials']} trials at least one"
        if any(trials["success"]):
            text += f"; the first after {group['median_time_s']:.1f} s and {group['median_path_m']:.2f} m"
            text += " (median)" if group["trials"] > 1 else ""
            rate = group["summary"]["success_rate"]
            if group["trials"] > 1:
                text += f"; success {100 * rate['mean']:.0f} % ({100 * rate['low']:.0f} to {100 * rate['high']:.0f} %)"
        lines.append((group["name"], text))
    for gas_map in content["maps"]:
        lines.append((f"{gas_map['kind'].replace('_', ' ')} map", _map_line(gas_map)))
    return lines


def _map_line(gas_map: dict[str, Any]) -> str:
    if gas_map["mae_ppm"] is None:
        return "knows no cell"
    text = (
        f"mean error {gas_map['mae_ppm']:.3g} ppm over {100 * gas_map['known_fraction']:.0f} % of the cells"
    )
    if gas_map["correlation"] is not None:
        text += f", correlation {gas_map['correlation']:.2f}"
    over_time = gas_map.get("mean_gas", {})
    if over_time.get("time_s") and over_time["error_ppm"][-1] is not None:
        text += f"; from the mean of the gas {over_time['error_ppm'][-1]:.3g} ppm"
        if over_time["peak_distance_m"][-1] is not None:
            text += f", its peak {over_time['peak_distance_m'][-1]:.2f} m from a source"
    return text
