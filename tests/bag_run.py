"""A small run of two kinds of robots that err in where they are, for tests of bags."""

from pathlib import Path
from typing import Any

import numpy as np

from taichi_plume.cli import run

SCENARIO = """
name: bags
seed: 3
duration: 4
domain: {size: [1.6, 1.2], spacing: 0.1, depth: 0.3}
wind: {kind: uniform, velocity: [0.4, 0.1]}
gas: {kind: gaussian_plume, intensity: 0.1, sources: [{position: [0.2, 0.5], rate: 10 mg/s}]}
robots:
  - name: oxides
    count: 2
    trials: 2
    reach: 0
    start: {kind: positions, positions: [[1.4, 0.5], [1.2, 0.8]]}
    algorithm: {kind: random_walk}
    localization: {kind: odometry, veer_deg: 10, distance_scale: 0.1}
    sensors: {gas: {kind: mox, model: tgs2620, spread: 1, ahead: 0.05}}
  - name: linear
    count: 1
    reach: 0
    start: {kind: positions, positions: [[0.9, 0.5]]}
    algorithm: {kind: casting}
    sensors: {gas: [{kind: pid, calibrated_for: ethanol}, {kind: mox, model: tgs2611, left: 0.1}]}
maps: [{kind: time_series, cell: 0.2, window: 1}]
fields: {rate: 2}
"""


def made(folder: Path) -> Path:
    """Run it; returns the folder of the run."""
    (folder / "s.yaml").write_text(SCENARIO)
    out = folder / "run"
    assert (
        run.main([str(folder / "s.yaml"), "--out", str(out), "--quiet", "--no-report", "--no-recording"]) == 0
    )
    return out


def messages_of(bag: Path) -> dict[str, list[tuple[int, Any]]]:
    """Times [ns] and messages by topic, as rosbags reads them."""
    from rosbags.highlevel import AnyReader

    found: dict[str, list[tuple[int, Any]]] = {}
    with AnyReader([bag]) as reader:
        for one, t, data in reader.messages():
            found.setdefault(one.topic, []).append((t, reader.deserialize(data, one.msgtype)))
    return found


def cloud(message: Any) -> np.ndarray:
    """Points of a point cloud by the names of their fields."""
    dtype = np.dtype([(field.name, "<f4") for field in message.fields])
    assert [field.offset for field in message.fields] == list(range(0, 4 * len(message.fields), 4))
    assert message.point_step == dtype.itemsize
    return np.frombuffer(message.data.tobytes(), dtype)
