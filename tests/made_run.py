"""The folder of a run that was never run: a plume whose peak is known, robots whose ways are known, and a recording."""

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import rerun as rr
import yaml

from taichi_plume import Scenario
from taichi_plume.execution.result import write_result
from taichi_plume.files.run_folder import write_scenario
from taichi_plume.record.drawing import rows

LOW, HIGH = 0.1, 1000.0
TIMES = np.arange(-1.0, 10.01, 0.5)
PEAK = (23, 11)
"""The pixel of the largest concentration; of 40 x 30, 0.1 m each."""
ROOM_PLANES: dict[str, dict[str, Any]] = {
    "gas/slice": {"plane": "0.1 m above the floor"},
    "gas/column": {"plane": "maximum over the height"},
    "gas/section": {"plane": "y = 1.5 m", "axes": "xz", "shape": (40, 10)},
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
    """Bytes (nx, ny) of frame n: a slope with one peak that grows, 0 in the left half."""
    x, y = np.meshgrid(*(np.arange(k) for k in shape), indexing="ij")
    away = np.hypot(x - PEAK[0], y - PEAK[1])
    return np.where(x > 15, np.clip(100 + 6 * n - 8 * away, 0, 255), 0).astype(np.uint8)


def record(
    path: Path, planes: dict[str, dict[str, Any]] | None = None, scales: bool = True, **about: Any
) -> None:
    """Write a recording. planes: of each entity what it says of itself, its shape among it; scales: whether it does."""
    stream = rr.RecordingStream("taichi_plume", recording_id="made")
    stream.set_log_time_enabled(False)
    stream.save(path)
    planes = planes or {"gas/slice": {}}
    for entity, its in planes.items():
        shape = its.get("shape", (40, 30))
        size = {"width": shape[0], "height": shape[1]}
        format_ = rr.components.ImageFormat(**size, color_model="L", channel_datatype="U8")
        stream.log(entity, rr.GridMap.from_fields(format=format_, cell_size=0.1), static=True)
        says = {
            "quantity": "ethanol", "unit": "ppm", "low": LOW, "high": HIGH, "scale": "log", "plane": "",
            "axes": "xy", "cell": 0.1, "origin": [0.0, 0.0],
        }  # fmt: skip
        says |= about | {key: value for key, value in its.items() if key != "shape"}
        if scales:
            stream.log(entity, rr.AnyValues(**says), static=True)
    for n, t in enumerate(TIMES):
        stream.set_time("sim_time", duration=float(t))
        for entity, its in planes.items():
            data = rows(pixels(n, its.get("shape", (40, 30))))
            stream.log(entity, rr.GridMap.from_fields(data=data))
        origins = [[1.0 + k, 0.5, 0] for k in range(2 + n % 3)]
        stream.log("wind/slice", rr.Arrows3D(origins=origins, vectors=[[0.5, 0, 0]] * len(origins)))
    stream.flush()
    stream.disconnect()


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
        record(folder / "recording.rrd", ROOM_PLANES if model.domain.dim == 3 else None)
    if model.robots:
        table(folder / "robots.parquet", model, trials)
    return folder


def reworded(folder: Path, **changes: Any) -> None:
    """Change keys of a run's scenario.yaml."""
    file = folder / "scenario.yaml"
    text = file.read_text(encoding="utf-8")
    head = "".join(line for line in text.splitlines(keepends=True) if line.startswith("#"))
    file.write_text(head + yaml.safe_dump(yaml.safe_load(text) | changes), encoding="utf-8")
