"""The folder of a run that was never run: a plume whose peak is known, robots whose ways are known, and pictures."""

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import yaml

from taichi_plume import Scenario
from taichi_plume.execution.result import write_result
from taichi_plume.files import pictures_file, zarr_groups
from taichi_plume.files.run_folder import write_scenario

LOW, HIGH = 0.1, 1000.0
TIMES = np.arange(-1.0, 10.01, 0.5)
PEAK = (23, 11)
"""The pixel of the largest concentration; of 40 x 30, 0.1 m each."""
ROOM_PLANES: dict[str, dict[str, Any]] = {
    "gas_slice": {"plane": "0.1 m above the floor", "level": 0.1},
    "gas_column": {"plane": "maximum over the height"},
    "gas_section": {"level": 1.5, "plane": "y = 1.5 m", "axes": "xz", "shape": (40, 10)},
}


def scenario(dim: int = 2, **changes: Any) -> Scenario:
    """A room of 4 x 3 (x 1) m with a box, a source and two robots."""
    flat = dim == 2
    content: dict[str, Any] = {
        "name": "made", "duration": 10, "warm_up": 1,
        "domain": {"size": [4, 3] if flat else [4, 3, 1], "spacing": 0.1},
        "wind": {"kind": "synthetic"},
        "obstacles": [{"kind": "cylinder", "center": [3.2, 2.4], "radius": 0.2}],
        "gas": {"kind": "eulerian", "sources": [{"position": [1, 1.5] if flat else [1, 1.5, 0.3], "rate": "1 mg/s"}]},
        "robots": [
            {
                "name": "pair", "count": 2, "algorithm": {"kind": "casting", "threshold_ppm": 5},
                "start": {"kind": "positions", "positions": [[3.5, 0.5], [3.5, 1.5]]},
            }
        ],
        "recording": {"range_ppm": [LOW, HIGH], "rate": 2},
    }  # fmt: skip
    return Scenario.model_validate(content | changes)


def result(model: Scenario, **changes: Any) -> dict[str, Any]:
    """Content of result.json of such a run."""
    known = {"mean": 1.0, "low": 0.2, "high": 1.0, "n": 1, "airs": 1}
    group = {
        "name": "pair", "algorithm": "casting", "robots": 2, "trials": 1, "airs": 1, "trials_differ_by": None,
        "air_by_chance": False, "no_search": None, "shares_arena_with": [], "unlike_them": False,
        "success_rate": 1.0, "median_time_s": 8.0, "median_path_m": 2.0,
        "summary": {"success_rate": known, "time_s": known | {"mean": 8.0, "low": None, "high": None}},
        "per_trial": {"success": [True], "found": [1], "time_s": [8.0], "path_m": [2.0]},
    }  # fmt: skip
    content = {
        "name": model.name, "status": "completed", "message": "", "seed": 0, "backend": "cpu", "version": "0.1.0",
        "wall_s": 2.0, "simulated_s": 11.0, "steps": 100, "cells": 1200, "Mcell_steps_per_s": 1.0,
        "flow": {"max_divergence": 1e-7, "max_courant": 0.9, "max_speed": 0.5},
        "gas": {"emitted_kg": 1e-5, "in_domain_kg": 4e-6, "outflow_kg": 6e-6, "relative_error": 1e-8},
        "obstacles": [], "groups": [group] if model.robots else [], "maps": [], "remarks": ["one thing is unlikely"],
    }  # fmt: skip
    return content | changes


def pixels(n: int, shape: tuple[int, int] = (40, 30)) -> np.ndarray:
    """Positions 0 to 255 on the colour scale, (nx, ny), of frame n: one growing peak on a slope, 0 in the left half."""
    x, y = np.meshgrid(*(np.arange(k) for k in shape), indexing="ij")
    away = np.hypot(x - PEAK[0], y - PEAK[1])
    return np.where(x > 15, np.clip(100 + 6 * n - 8 * away, 0, 255), 0).astype(np.uint8)


def record(path: Path, planes: dict[str, dict[str, Any]] | None = None, **about: Any) -> None:
    """Write pictures and wind. planes: attributes of each picture, its shape among them; about: further attributes."""
    group = zarr_groups.create(path, {"format": pictures_file.FORMAT})
    air = zarr_groups.create(path / "wind", {})
    for part in (group, air):
        zarr_groups.add(part, "time", ("time",), TIMES, {"units": "s"})
    for name, its in (planes or {"gas_slice": {}}).items():
        shape, axes = its.get("shape", (40, 30)), its.get("axes", "xy")
        dims = [f"{axis}_{name}" for axis in axes]
        for dim, count in zip(dims, shape, strict=True):
            zarr_groups.add(group, dim, (dim,), (np.arange(count) + 0.5) * 0.1, {"units": "m"})
        attributes = {
            "quantity": "ethanol", "units": "ppm", "colors_from": LOW, "colors_to": HIGH, "colors": "log", "plane": "",
            "axes": axes, "cell": [0.1, 0.1], "view": name.removeprefix("gas_"), "species": "ethanol",
        }  # fmt: skip
        attributes |= {key: value for key, value in its.items() if key != "shape"} | about
        frames = np.stack([ppm(pixels(n, shape)).T for n in range(len(TIMES))])
        zarr_groups.add(group, name, ("time", *dims[::-1]), frames, attributes)
    for dim, count in (("x", 8), ("y", 6)):
        zarr_groups.add(air, dim, (dim,), (np.arange(count) + 0.5) * 0.5, {"units": "m"})
    for name, speed in (("u_slice", 0.5), ("v_slice", 0.0)):
        about = {"units": "m s-1", "axes": "xy", "cell": [0.5, 0.5], "view": "slice", "plane": ""}
        zarr_groups.add(air, name, ("time", "y", "x"), np.full((len(TIMES), 6, 8), speed, np.float32), about)
    zarr_groups.consolidate(path, "wind")
    zarr_groups.consolidate(path)


def ppm(levels: np.ndarray) -> np.ndarray:
    """Concentrations [ppm], float32, of positions 0 to 255 on the colour scale; 0 at 0."""
    return np.where(levels > 0, LOW * (HIGH / LOW) ** (levels / 255), 0.0).astype(np.float32)


def table(path: Path, model: Scenario, trials: int = 1, period: float = 0.5) -> None:
    """Write robots.parquet: robot k drives from x = 3.5 m to the left with 0.25 m/s at y = 0.5 + k m."""
    times = np.arange(0.0, model.duration + 1e-9, period)
    count = sum(group.count for group in model.robots)
    names = [group.name for group in model.robots for _ in range(group.count)] * trials
    number = [k for group in model.robots for k in range(group.count)] * trials
    t = np.repeat(times, count * trials)
    k = np.tile(number, len(times))
    found = (t >= 8) & (k == 0)
    columns = {
        "t": t, "group": pa.array(names * len(times)).dictionary_encode(),
        "trial": np.tile(np.repeat(np.arange(trials), count), len(times)).astype(np.int32), "robot": k.astype(np.int32),
        "x": (3.5 - 0.25 * t).astype(np.float32), "y": (0.5 + k).astype(np.float32),
        "heading": np.full(len(t), np.pi, np.float32), "reading_ppm": (t + k).astype(np.float32),
        "true_ppm": (2 * t + k).astype(np.float32), "believed_x": (3.5 - 0.24 * t).astype(np.float32),
        "believed_y": (0.5 + k).astype(np.float32), "believed_heading": np.zeros(len(t), np.float32),
        "state": pa.array(np.where(t < 4, "FIND", "IN_PLUME").tolist()).dictionary_encode(), "found": found,
        **dict.fromkeys(("declared_x", "declared_y"), np.full(len(t), np.nan, np.float32)),
        **dict.fromkeys(("declarations", "false_declarations"), np.zeros(len(t), np.int32)),
    }  # fmt: skip
    pq.write_table(pa.table(columns), path)


def made(
    folder: Path,
    model: Scenario | None = None,
    recording: bool = True,
    trials: int = 1,
    content: dict[str, Any] | None = None,
) -> Path:
    """Make such a folder; returns it."""
    folder.mkdir(parents=True, exist_ok=True)
    model = model or scenario()
    write_scenario(folder, model, folder, "cpu")
    write_result(folder, content if content is not None else result(model))
    if recording:
        record(folder / pictures_file.NAME, ROOM_PLANES if model.domain.dim == 3 else None)
    if model.robots:
        table(folder / "robots.parquet", model, trials)
    return folder


def reworded(folder: Path, **changes: Any) -> None:
    """Change keys of a run's scenario.yaml."""
    file = folder / "scenario.yaml"
    text = file.read_text(encoding="utf-8")
    head = "".join(line for line in text.splitlines(keepends=True) if line.startswith("#"))
    file.write_text(head + yaml.safe_dump(yaml.safe_load(text) | changes), encoding="utf-8")
