"""The run directory: the resolved scenario, a row per robot and sample, and what came of it all.

`scenario.yaml` can be run again as it is; `result.json` is written last and at once.
"""

import datetime
import json
import os
import platform
import shutil
import tempfile
from collections.abc import Sequence
from importlib.metadata import version
from math import ceil, isfinite, prod
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import yaml

from taichi_plume import __version__, disk, scores
from taichi_plume.map_scores import MapScores, MapSeries
from taichi_plume.scenario import Scenario
from taichi_plume.simulation import Every, Simulation

FILES = (
    "scenario.yaml",
    "recording.rrd",
    "robots.parquet",
    "forces.csv",
    "fields.zarr",
    "plume.pslog",
    "result.json",
)
PATHS = ("file", "files", "occupancy")  # keys of a scenario
MOST_ROWS = 2_000_000  # of robots.parquet: larger swarms are sampled less often
ROW_GROUP = 50_000


class RunFolderError(ValueError):
    """A run directory that cannot be used."""


def run_folder(
    name: str,
    out: Path | None = None,
    force: bool = False,
    runs: Path = Path("runs"),
    files: Sequence[str] = FILES,
) -> Path:
    """Make and return `out`, or the first free ``runs/<name>-<n>``; raises RunFolderError.

    One that holds files is refused, unless by `force` those `files` that an earlier run left there are removed.
    """
    try:
        if out is None:
            return _next_folder(name, runs)
        if out.is_file():
            raise RunFolderError(f"{out}: is a file; --out takes a folder")
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RunFolderError(
            f"{error.filename or out or runs}: cannot be made: {error.strerror or error}"
        ) from None
    try:
        with tempfile.NamedTemporaryFile(dir=out):
            pass  # now, rather than after minutes of compiling
        if not force and any(out.iterdir()):
            raise RunFolderError(f"{out}: is not empty; choose another --out or add --force to overwrite")
        for file in files:
            if (out / file).is_dir():
                shutil.rmtree(out / file)
            else:
                (out / file).unlink(missing_ok=True)
    except OSError as error:
        raise RunFolderError(f"{out}: cannot be written to: {error.strerror or error}") from None
    return out


def _next_folder(name: str, runs: Path) -> Path:
    n = 1
    while True:
        folder = runs / f"{name}-{n}"
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            n += 1
            continue
        return folder


# ---------------------------------------------------------------- the scenario


def to_yaml(scenario: Scenario, source: Path = Path(), target: Path | None = None) -> str:
    """The scenario with every default written out.

    Paths of files, relative to `source`, are written relative to `target` when one is given.
    """
    data = scenario.model_dump(mode="json", exclude_none=True)
    if target is not None:
        data = _moved(data, source.resolve(), target.resolve())
    return yaml.safe_dump(data, sort_keys=False, allow_unicode=True, width=100)


def _moved(value: Any, source: Path, target: Path) -> Any:
    if isinstance(value, list):
        return [_moved(part, source, target) for part in value]
    if not isinstance(value, dict):
        return value
    return {
        key: os.path.relpath(source / part, target) if key in PATHS else _moved(part, source, target)
        for key, part in value.items()
    }


def write_scenario(folder: Path, scenario: Scenario, source: Path, backend: str) -> None:
    """Write `scenario.yaml`, versions, backend and seed above it; `source` is the folder of the original."""
    now = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
    packages = ("taichi", "numpy", "rerun-sdk")
    versions = ", ".join(f"{name} {version(name)}" for name in packages)
    header = (
        f"# Every default written out. Again: python -m taichi_plume.run {folder / 'scenario.yaml'}\n"
        f"# started: {now}\n"
        f"# backend: {backend}\n"
        f"# seed: {scenario.seed}\n"
        f"# taichi_plume {__version__}, {versions}, Python {platform.python_version()}, {platform.system()}\n"
    )
    (folder / "scenario.yaml").write_text(header + to_yaml(scenario, source, folder), encoding="utf-8")


# ---------------------------------------------------------------- the robots


class RobotTable:
    """`robots.parquet`: one row per robot and sample. `close()` makes it readable, whatever happened."""

    def __init__(self, sim: Simulation, path: Path):
        self.path = path
        count = sim.swarm.count
        rows = count * (sim.scenario.duration / sim.dt + 1)
        self.period = sim.dt * ceil(max(1.0, rows / MOST_ROWS))
        self.pending: list[pa.RecordBatch] = []
        self.rows = 0
        groups = sim.swarm.groups
        self.group = np.concatenate([np.full(g.count * g.trials, n, np.int32) for n, g in enumerate(groups)])
        self.trial = np.concatenate([np.repeat(np.arange(g.trials, dtype=np.int32), g.count) for g in groups])
        self.robot = np.concatenate([np.tile(np.arange(g.count, dtype=np.int32), g.trials) for g in groups])
        self.group_names = pa.array([g.name for g in groups])
        teams: list[Any] = list(sim.teams)
        states = [team.state_names for team in teams]
        self.first_state = np.cumsum([0, *[len(names) for names in states]])[:-1].astype(np.int32)
        self.state_names = pa.array([name for names in states for name in names])
        names = pa.dictionary(pa.int32(), pa.string())
        self.schema = pa.schema(
            [
                ("t", pa.float64()),
                ("group", names),
                ("trial", pa.int32()),
                ("robot", pa.int32()),
                *[
                    (name, pa.float32())
                    for name in ("x", "y", "heading", "reading_ppm", "resistance_ohm", "true_ppm")
                ],
                ("wind_x", pa.float32()),
                ("wind_y", pa.float32()),
                ("believed_x", pa.float32()),
                ("believed_y", pa.float32()),
                ("believed_heading", pa.float32()),
                ("state", names),
                ("found", pa.bool_()),
            ]
        )
        disk.require_room(path)
        self.writer = pq.ParquetWriter(path, self.schema, compression="zstd")

    def observer(self) -> Every:
        """What the simulation has to call."""
        return Every(self.period, self.sample)

    def sample(self, sim: Simulation) -> None:
        """Take a row of every robot. Raises OSError when the disk is full."""
        now = sim.swarm.snapshot()
        state = self.first_state[self.group] + now["state"].astype(np.int32)
        columns = [
            np.full(len(self.group), sim.t),
            pa.DictionaryArray.from_arrays(self.group, self.group_names),
            self.trial,
            self.robot,
            now["position"][:, 0],
            now["position"][:, 1],
            now["heading"],
            now["reading_ppm"],
            pa.array(now["resistance_ohm"], from_pandas=True),  # null where a sensor has none
            now["true_ppm"],
            now["wind"][:, 0],
            now["wind"][:, 1],
            now["believed_position"][:, 0],
            now["believed_position"][:, 1],
            now["believed_heading"],
            pa.DictionaryArray.from_arrays(state, self.state_names),
            now["found"].astype(bool),
        ]
        arrays = [
            pa.array(column).cast(kind) for column, kind in zip(columns, self.schema.types, strict=True)
        ]
        self.pending.append(pa.RecordBatch.from_arrays(arrays, schema=self.schema))
        self.rows += len(self.group)
        if self.rows >= ROW_GROUP:
            self._write()

    def _write(self) -> None:
        if not self.pending:
            return
        table = pa.Table.from_batches(self.pending)
        disk.require_room(self.path, table.nbytes)
        self.pending.clear()
        self.rows = 0
        self.writer.write_table(table)

    def close(self) -> None:
        """Write the rest and the footer."""
        if not self.writer.is_open:
            return
        try:
            self._write()
        finally:
            self.writer.close()


# ---------------------------------------------------------------- forces on obstacles


class ForceTable:
    """`forces.csv`: the force of the air on each obstacle [N], a row per obstacle and simulated second."""

    def __init__(self, sim: Simulation, path: Path):
        self.file = path.open("w", encoding="utf-8")
        self.file.write(
            ",".join(["t_s", "obstacle", *(f"{axis}_N" for axis in "xyz"[: sim.grid.dim])]) + "\n"
        )

    def observer(self) -> Every:
        """What the simulation has to call."""
        return Every(1.0, self.sample)

    def sample(self, sim: Simulation) -> None:
        """Write a row per obstacle. Raises OSError when the disk is full."""
        assert sim.forces is not None
        for number, force in enumerate(sim.forces()):
            self.file.write(",".join([f"{sim.t:.6g}", str(number), *(f"{f:.6g}" for f in force)]) + "\n")

    def close(self) -> None:
        """Close the file."""
        self.file.close()


# ---------------------------------------------------------------- the result


def result(
    sim: Simulation, status: str, message: str, backend: str, map_scores: MapScores | None = None
) -> dict[str, Any]:
    """What came of a run, ready for `write_result`; map_scores: of its maps over time."""
    cells = prod(sim.grid.shape)
    steps = cells * sim.steps
    return {
        "name": sim.scenario.name,
        "status": status,
        "message": message,
        "seed": sim.scenario.seed,
        "backend": backend,
        "version": __version__,
        "wall_s": sim.wall_s,
        "simulated_s": sim.t - sim.scenario.first_tick * sim.dt,
        "steps": sim.steps,
        "cells": cells,
        "Mcell_steps_per_s": steps / sim.wall_s / 1e6 if sim.wall_s > 0 else None,
        "flow": _reported(sim.wind, "diagnostics"),
        "gas": _budget(sim),
        "obstacles": _obstacles(sim),
        "groups": _groups(sim),
        "maps": [
            _map(sim, n) | (_over_time(map_scores.series[n]) if map_scores else {})
            for n in range(len(sim.maps))
        ],
    }


def _budget(sim: Simulation) -> dict[str, Any]:
    """Of all gases that keep one, with an entry per gas where there are several."""
    parts = [_reported(gas, "budget") for gas in sim.gas.gases]
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


def _reported(solver: Any, name: str) -> dict[str, Any]:
    """What a solver's method tells of its state; closed forms have nothing to tell."""
    return dict(getattr(solver, name)()) if hasattr(solver, name) else {}


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
    gas_map: Any = sim.maps[n]
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


def print_summary(content: dict[str, Any], folder: Path) -> None:
    """Print a result for a person, and what to do next."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(show_header=False, box=None, padding=(0, 2, 0, 0))
    table.add_column(style="bold")
    table.add_column(overflow="fold")
    for name, value in summary(content):
        table.add_row(name, Text(value))
    console = Console(highlight=False)
    with console.capture() as text:
        console.print(table)
        files = [name for name in FILES if (folder / name).exists()]
        console.print(Text(f"\n{folder}: {', '.join(files)}"))
        if "recording.rrd" in files:
            command = f"rerun {folder / 'recording.rrd'}"
            console.print(Text.assemble("look at it:  ", (command, "bold cyan")), soft_wrap=True)
    print(text.get(), end="")  # rich itself would end the program where the reader is gone


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
