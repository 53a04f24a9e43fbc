"""A robot has one colour in reports, pictures and recordings, which the colour-blind can tell from others."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from taichi_plume.record.drawing import ROBOTS
from taichi_plume.record.tracks import recorded_robots
from taichi_plume.report import theme
from taichi_plume.results.tracks import COLUMNS, tracks

# Machado, Oliveira & Fernandes 2009, doi:10.1109/TVCG.2009.113, severity 1
EYES = {
    "usual": np.eye(3),
    "protanopia": [[0.1523, 1.0526, -0.2049], [0.1145, 0.7863, 0.0992], [-0.0039, -0.0481, 1.0520]],
    "deuteranopia": [[0.3673, 0.8606, -0.2280], [0.2801, 0.6725, 0.0474], [-0.0118, 0.0429, 0.9689]],
}
XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])


def lab(rgb, eye):
    """CIELAB (n, 3) of sRGB (n, 3) in 0..1, as an eye sees it."""
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    x, y, z = (np.clip(linear @ np.array(EYES[eye]).T, 0, 1) @ XYZ.T / [0.9505, 1.0, 1.089]).T
    x, y, z = (np.where(v > 0.008856, np.cbrt(v), 7.787 * v + 16 / 116) for v in (x, y, z))
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], axis=-1)


@pytest.mark.parametrize("eye", EYES)
def test_colors_of_robots_differ_from_each_other_and_from_the_gas(eye):
    robots = lab(ROBOTS / 255, eye)
    gas = lab(theme.GAS(np.linspace(0.2, 1, 9))[:, :3], eye)
    apart = np.linalg.norm(robots[:, None] - robots, axis=-1) + 1e3 * np.eye(len(robots))
    assert apart.min() > 19
    assert np.linalg.norm(robots[:, None] - gas, axis=-1).min() > 15


@pytest.mark.parametrize("counts", [(3,), (2, 3), (1, 12, 2), (60, 4)])
def test_a_robot_has_one_color_in_report_and_recording(tmp_path, counts):
    names = [f"team{n}" for n in range(len(counts))]
    who = [(name, k) for name, count in zip(names, counts, strict=True) for k in range(count)]
    n = len(who)
    columns = dict.fromkeys((*COLUMNS, "t"), np.zeros(n)) | {"state": ["S"] * n, "found": np.zeros(n, bool)}
    columns |= {"group": [name for name, _ in who], "robot": np.array([k for _, k in who], np.int32)}
    columns |= {"trial": np.zeros(n, np.int32)}
    pq.write_table(pa.table(columns), tmp_path / "robots.parquet")
    starts = np.cumsum([0, *counts])
    model = SimpleNamespace(first_trial=0, odometry=None)
    groups: list[Any] = [
        SimpleNamespace(name=name, count=count, start=int(start), first_trial=0, model=model)
        for name, count, start in zip(names, counts, starts[:-1], strict=True)
    ]
    swarm = SimpleNamespace(groups=groups)
    sim: Any = SimpleNamespace(swarm=swarm, state_names=lambda: [("S",)] * len(groups))
    drawn = [theme.robot(track.number) for track in tracks(tmp_path / "robots.parquet", groups)]
    recorded = ["#{:02x}{:02x}{:02x}".format(*one.color) for one in recorded_robots(sim)]
    assert drawn == recorded
    assert drawn[-1] == theme.robot(starts[-2] + min(counts[-1], 50 // len(counts)) - 1)
