"""Trials of a search spread over airs, and the experiment of PlumeSim as the configs tell it."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from taichi_plume import load_scenario
from taichi_plume.files.point_frames import PointFrames, read_fluent
from taichi_plume.scenario.loading import ScenarioError
from taichi_plume.validation import dapso_cases
from taichi_plume.validation.plumesim_cases import LAMINAR, PLUME, arena, export, in_airs
from taichi_plume.validation.searches import WAY, scenario_of, searches, spread

pytestmark = [pytest.mark.usefixtures("taichi"), pytest.mark.slow]

CONFIG = Path(__file__).parents[2] / "configs" / "plumesim_casting.yaml"


@pytest.mark.parametrize(
    ("trials", "airs", "shares"), [(200, 5, [40] * 5), (7, 3, [3, 2, 2]), (2, 5, [1, 1]), (4, 1, [4])]
)
def test_trials_are_spread_evenly(trials, airs, shares):
    assert spread(trials, airs) == shares


def test_the_config_is_the_experiment_of_the_validation():
    ours, theirs = scenario_of(arena(LAMINAR, PLUME)), load_scenario(CONFIG)
    assert ours == theirs


def test_the_arena_of_dapso_is_that_of_the_config():
    theirs = load_scenario(CONFIG.with_name("dapso_arena.yaml"))
    robots = [dapso_cases.team("team", 1, dapso_cases.TEAMS["DAPSO"])]
    ours = scenario_of(dapso_cases.arena(robots))
    assert ours.model_copy(update={"maps": theirs.maps, "seed": theirs.seed}) == theirs


def test_what_is_wrong_with_a_scenario_is_reported():
    with pytest.raises(ScenarioError, match=r"gas.sources\[0\]"):
        scenario_of(arena(LAMINAR, PLUME | {"sources": [{"position": [9.0, 1.5], "rate": 1e-6}]}))


def test_trials_of_all_airs_come_together():
    reported: Any = in_airs(5, arena(LAMINAR, PLUME) | {"duration": 60.0}, "ways", airs=2)
    success, time, way, tracks = (reported[name] for name in ("success", "time [s]", WAY, "ways"))
    assert (success.mean, success.n) == (1.0, 5)
    assert way.mean > 0.9  # they stop 0.35 m before the source, 3.6 m away
    assert time.mean > 3.0 / 0.2
    assert len(tracks.ways) == 5
    for track in tracks.ways:
        assert np.hypot(*(track[-1] - tracks.source)) == pytest.approx(0.35, abs=0.03)
        assert (track[0] > (3.5, 0.2)).all()
    assert len({tuple(track[0]) for track in tracks.ways}) == 5


def test_failures_are_shown_first():
    """Two seconds are too short for all."""
    reported: Any = searches([arena(LAMINAR, PLUME) | {"duration": 2.0}], [4], "ways")
    success, time, tracks = reported["success"], reported["time [s]"], reported["ways"]
    assert (success.mean, time.mean) == (0.0, None)
    assert len(tracks.ways) == 3


def test_exported_frames_are_read_again(tmp_path):
    rng = np.random.default_rng(1)
    place, percent = rng.uniform(0.0, 3.0, (7, 2)), rng.uniform(0.0, 100.0, 7)
    frames = PointFrames(tmp_path, 1.0, 0.1, place, np.zeros((7, 2)), percent, np.array([0, 4, 7]))
    export(frames, tmp_path)
    again = read_fluent(tmp_path / "plume%03d.txt", None, 1.0, 0.1, 100.0)
    assert again.begin.tolist() == [0, 4, 7]
    np.testing.assert_allclose(again.place, place, rtol=1e-4)
    np.testing.assert_allclose(again.percent, percent, rtol=1e-5)
