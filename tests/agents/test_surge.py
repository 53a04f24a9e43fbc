"""Surge-cast and surge-spiral: up a steady plume, and where it is lost."""

import numpy as np
import pytest
from hunt import PATCH, SOURCE, Hunt
from scipy.signal import find_peaks

from taichi_plume.agents.surge_cast import CAST, SURGE
from taichi_plume.agents.surge_spiral import SPIRAL
from taichi_plume.agents.tracking import FIND

pytestmark = pytest.mark.usefixtures("taichi")


@pytest.fixture(scope="module")
def hunts(taichi):
    return {kind: Hunt(kind) for kind in ("surge_cast", "surge_spiral")}


@pytest.mark.parametrize("kind", ["surge_cast", "surge_spiral"])
@pytest.mark.slow
def test_the_source_is_found(hunts, kind):
    (run,) = hunts[kind].search(200.0, 60)
    found = run.found == 1
    assert found.mean() >= 0.9
    straight = np.hypot(*(run.tracks[0] - SOURCE).T) - 0.3
    assert np.median(run.path_length[found] / straight[found]) < 2.0
    assert {FIND, SURGE} <= set(np.unique(run.states))


def test_surges_go_straight_upwind(hunts):
    (run,) = hunts["surge_cast"].search(200.0, 20)
    steps = np.diff(run.tracks, axis=0)
    steady = (np.lib.stride_tricks.sliding_window_view(run.states, 12, axis=0) == SURGE).all(-1)[:-1]
    steps = steps[11:][steady[: len(steps) - 11]]
    steps = steps[np.hypot(*steps.T) > 0.01]
    assert len(steps) > 100
    off = np.degrees(np.arctan2(steps[:, 1], -steps[:, 0]))
    assert np.abs(off).mean() < 3  # the wind's own noise
    assert off.mean() == pytest.approx(0, abs=1)


def test_casts_reach_both_sides_twice_as_far_each_time(hunts):
    """0.1, 0.2 and 0.4 m to either side of where the plume was lost, then the search starts anew."""
    start = {"low": (2.7, 1.45), "high": (2.9, 1.55)}
    (run,) = hunts["surge_cast"].search(100.0, 45, PATCH, **start, trials=10, cast_distance=0.1)
    for of_robot, track in zip(run.states.T, run.tracks.transpose(1, 0, 2), strict=True):
        lost = np.flatnonzero(of_robot == CAST)[0]
        given_up = lost + np.flatnonzero(of_robot[lost:] != CAST)[0]
        assert of_robot[given_up] == FIND
        across = track[lost:given_up, 1] - track[lost, 1]
        turns = np.sort(np.concatenate([find_peaks(way, prominence=0.1)[0] for way in (across, -across)]))
        ends = across[turns] * np.sign(across[turns[0]])
        assert ends == pytest.approx([0.1, -0.1, 0.2, -0.2, 0.4], abs=0.06)
        assert across[-1] * np.sign(across[turns[0]]) == pytest.approx(-0.4, abs=0.06)


def test_the_spiral_widens_by_its_gap(hunts):
    """r = gap phi / 2 pi around the place where the plume was lost."""
    gap = 0.3
    start = {"low": (2.7, 1.45), "high": (2.9, 1.55)}
    (run,) = hunts["surge_spiral"].search(100.0, 60, PATCH, **start, trials=10, gap=gap, turns=2)
    for of_robot, track in zip(run.states.T, run.tracks.transpose(1, 0, 2), strict=True):
        lost = np.flatnonzero(of_robot == SPIRAL)[0]
        over = lost + np.flatnonzero(of_robot[lost:] != SPIRAL)[0]
        arm = track[lost:over] - track[lost]
        r = np.hypot(*arm.T)
        phi = np.abs(np.unwrap(np.arctan2(arm[5:, 1], arm[5:, 0])))
        turned = np.abs(phi - phi[0])
        growth = np.polyfit(turned[20:], r[25:], 1)[0]
        assert growth == pytest.approx(gap / (2 * np.pi), rel=0.15)
