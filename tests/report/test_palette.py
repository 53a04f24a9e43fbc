"""Colours of things: for the colour-blind too, on paper and on the dark ground, the same in report and recording."""

import json
from types import SimpleNamespace
from typing import Any

import made_run
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from matplotlib.colors import to_hex

from taichi_plume.agents.algorithm_table import ALGORITHMS
from taichi_plume.agents.team import BEFORE
from taichi_plume.files.run_tables import VOCABULARY
from taichi_plume.record import layout, scene
from taichi_plume.record.tracks import Tracks, recorded_robots
from taichi_plume.report import figures, theme
from taichi_plume.results.run import Run
from taichi_plume.results.tracks import COLUMNS, tracks
from taichi_plume.scenario import palette
from taichi_plume.scenario.palette import rgb

# Machado, Oliveira & Fernandes 2009, doi:10.1109/TVCG.2009.113, severity 1
EYES = {
    "usual": np.eye(3),
    "protanopia": [[0.1523, 1.0526, -0.2049], [0.1145, 0.7863, 0.0992], [-0.0039, -0.0481, 1.0520]],
    "deuteranopia": [[0.3673, 0.8606, -0.2280], [0.2801, 0.6725, 0.0474], [-0.0118, 0.0429, 0.9689]],
    "tritanopia": [[1.2555, -0.0767, -0.1788], [-0.0784, 0.9308, 0.1476], [0.0047, 0.6914, 0.3039]],
}
XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])


def lab(colors, eye):
    """CIELAB (n, 3) of sRGB bytes (n, 3), as an eye sees them."""
    colors = np.asarray(colors, float) / 255
    linear = np.where(colors <= 0.04045, colors / 12.92, ((colors + 0.055) / 1.055) ** 2.4)
    x, y, z = (np.clip(linear @ np.array(EYES[eye]).T, 0, 1) @ XYZ.T / [0.9505, 1.0, 1.089]).T
    x, y, z = (np.where(v > 0.008856, np.cbrt(v), 7.787 * v + 16 / 116) for v in (x, y, z))
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], axis=-1)


def ciede2000(first, second):
    """CIEDE2000 of CIELAB (..., 3), after Sharma, Wu & Dalal 2005, doi:10.1002/col.20070."""
    (L1, a1, b1), (L2, a2, b2) = (np.moveaxis(np.asarray(each, float), -1, 0) for each in (first, second))
    mean = 0.5 * (np.hypot(a1, b1) + np.hypot(a2, b2))
    red = 1.5 - 0.5 * np.sqrt(mean**7 / (mean**7 + 25.0**7))
    C1, C2 = np.hypot(red * a1, b1), np.hypot(red * a2, b2)
    h1, h2 = np.arctan2(b1, red * a1) % (2 * np.pi), np.arctan2(b2, red * a2) % (2 * np.pi)
    turn = (h2 - h1 + np.pi) % (2 * np.pi) - np.pi
    L, C, h = 0.5 * (L1 + L2), 0.5 * (C1 + C2), h1 + 0.5 * turn
    T = 1 - 0.17 * np.cos(h - np.radians(30)) + 0.24 * np.cos(2 * h)
    T += 0.32 * np.cos(3 * h + np.radians(6)) - 0.20 * np.cos(4 * h - np.radians(63))
    bent = np.radians(60) * np.exp(-(((np.degrees(h) % 360 - 275) / 25) ** 2))
    lightness = (L2 - L1) / (1 + 0.015 * (L - 50) ** 2 / np.sqrt(20 + (L - 50) ** 2))
    chroma = (C2 - C1) / (1 + 0.045 * C)
    hue = 2 * np.sqrt(C1 * C2) * np.sin(0.5 * turn) / (1 + 0.015 * C * T)
    crossed = -2 * np.sqrt(C**7 / (C**7 + 25.0**7)) * np.sin(bent) * chroma * hue
    return np.sqrt(lightness**2 + chroma**2 + hue**2 + crossed)


def test_the_color_difference_is_the_published_one():
    """Four pairs of the table of Sharma et al.: blue hues, grey, red hues, and dark colours."""
    pairs = [
        ((50, 2.6772, -79.7751), (50, 0, -82.7485), 2.0425),
        ((50, 0, 0), (50, -1, 2), 2.3669),
        ((50, 2.5, 0), (58, 24, 15), 19.4535),
        ((2.0776, 0.0795, -1.1350), (0.9033, -0.0636, -0.5514), 0.9082),
    ]
    for first, second, expected in pairs:
        assert ciede2000(first, second) == pytest.approx(expected, abs=1e-4)


def hexadecimal(color) -> str:
    return "#{:02x}{:02x}{:02x}".format(*color[:3])


PAPER, DARK = [theme.PAPER, theme.FLOOR], [hexadecimal(color) for color in (scene.FLOOR, layout.BACKGROUND)]
GAS = theme.GAS(np.linspace(0.2, 1, 9), bytes=True)[:, :3]


def least(some, others, eye) -> float:
    """Least difference between colours of two lists, as an eye sees them."""
    return float(ciede2000(lab(some, eye)[:, None], lab(others, eye)).min())


def apart(colors, eye) -> float:
    """Least difference between two colours of a list, as an eye sees them."""
    return min(least([one], [other], eye) for k, one in enumerate(colors) for other in colors[:k])


def of(*names):
    return [rgb(name) for name in names]


@pytest.mark.parametrize("eye", EYES)
def test_robots_differ_from_each_other_from_solids_and_from_gas(eye):
    robots = of(*palette.ROBOTS)
    assert apart(robots, eye) > 13
    assert apart(robots[:4], eye) > 19
    assert least(robots, of(palette.SOLID), eye) > 10
    assert least(robots, of(palette.SOURCE), eye) > 10
    assert least(robots, GAS, eye) > 7
    assert least(robots, of(*PAPER, *DARK), eye) > 18


@pytest.mark.parametrize("eye", EYES)
def test_states_and_declarations_differ(eye):
    states = of(*palette.STATES)
    assert apart(states, eye) > 20
    assert least(states, of(palette.FOUND), eye) > 12
    assert least(states, of(*PAPER, *DARK), eye) > 12
    assert least(of(palette.FOUND), of(palette.WRONG), eye) > 15
    assert least(of(palette.WARM), of(palette.COOL), eye) > 15


def test_every_algorithm_has_as_many_colors_as_states():
    for algorithm in ALGORITHMS.values():
        names = (*algorithm.STATE_NAMES, BEFORE)
        assert len(set(palette.state_colors(names).values())) == len(names)


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
    model = SimpleNamespace(first_trial=0, localization=None)
    groups: list[Any] = [
        SimpleNamespace(name=name, count=count, start=int(start), first_trial=0, model=model)
        for name, count, start in zip(names, counts, starts[:-1], strict=True)
    ]
    swarm = SimpleNamespace(groups=groups)
    sim: Any = SimpleNamespace(swarm=swarm, state_names=lambda: [("S",)] * len(groups))
    drawn = [theme.robot(track.number) for track in tracks(tmp_path / "robots.parquet", groups)]
    recorded = [hexadecimal(one.color) for one in recorded_robots(sim)]
    assert drawn == recorded
    assert drawn[-1] == theme.robot(starts[-2] + min(counts[-1], 50 // len(counts)) - 1)


def test_a_state_has_one_color_in_report_and_recording(tmp_path, drawn):
    """Two groups whose robots were not in all states of their algorithms."""
    names = [("FIND", "UPWIND", "SURGE", "CAST"), ("TRANSIT", "SURGE", "SWEEP", "DONE")]
    folder = made_run.made(tmp_path / "run", recording=False)
    table = pq.read_table(folder / "robots.parquet")
    at = table.schema.get_field_index("state")
    known = pa.field("state", table.schema.field(at).type, metadata={VOCABULARY: json.dumps(sum(names, ()))})
    states = np.where(table["t"].to_numpy() < 5, "CAST", "SWEEP").tolist()
    pq.write_table(
        table.set_column(at, known, pa.array(states).dictionary_encode()), folder / "robots.parquet"
    )
    run = Run(folder, lenient=True)
    figures.smelt(run, run.tracks)
    (axes,) = drawn[0].axes
    shown = {patch.get_label(): patch.get_facecolor() for patch in axes.get_legend().get_patches()}
    assert set(shown) == {"CAST", "SWEEP"}
    model = made_run.scenario().robots[0]
    groups = [SimpleNamespace(name=f"team{k}", count=1, start=k, model=model) for k in range(2)]
    sim: Any = SimpleNamespace(swarm=SimpleNamespace(groups=groups), state_names=lambda: names)
    logged: dict[str, Any] = {}
    stream: Any = SimpleNamespace(log_still=logged.update)
    stage: Any = SimpleNamespace(length=4.0, lift=0.01)
    Tracks(stream, stage, recorded_robots(sim), (), [], ())
    for k, each in enumerate(names):
        lane = logged[f"states/team{k}"]
        packed = lane.colors.as_arrow_array().to_pylist()
        named = dict(zip(lane.values.as_arrow_array().to_pylist(), packed, strict=True))
        assert list(named) == [*each, "found"]
        assert [hexadecimal(named["found"].to_bytes(4)), len(set(packed))] == [palette.FOUND, 5]
        for name in set(each) & set(shown):
            assert hexadecimal(named[name].to_bytes(4)) == to_hex(shown[name])
