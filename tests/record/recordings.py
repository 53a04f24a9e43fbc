"""Recordings of runs as the tests make and read them."""

import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pyarrow as pa
import rerun as rr

from taichi_plume.record.recorder import Recorder
from taichi_plume.time_loop import TimeLoop


def record(sim: TimeLoop, path: Path) -> Recorder:
    recorder = Recorder(sim, path)
    recorder.start()
    sim.observers += recorder.observers()
    return recorder


def recorded(sim: TimeLoop, path: Path) -> Path:
    recorder = record(sim, path)
    sim.run()
    recorder.close()
    return path


def stream(path: Path) -> rr.chunk.LazyChunkStream:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a file without footer
        return rr.chunk.RrdReader(str(path)).stream()


def column(path: Path, entity: str, component: str) -> tuple[np.ndarray, list]:
    """Return times [s] and values of a component of an entity."""
    times, values = [np.zeros(0)], []
    for chunk in stream(path).filter(content=entity, components=component, is_static=False):
        batch = chunk.to_record_batch()
        times.append(batch.column("sim_time").cast(pa.int64()).to_numpy() * 1e-9)
        values += batch.column(component).to_pylist()
    t = np.concatenate(times)
    order = np.argsort(t, kind="stable")
    return t[order], [values[i] for i in order]


def entities(path: Path) -> set[str]:
    return {chunk.entity_path for chunk in stream(path)}


def verified(path: Path) -> bool:
    command = [sys.executable, "-m", "rerun_cli", "rrd", "verify", path]
    return subprocess.run(command, capture_output=True, check=False).returncode == 0
