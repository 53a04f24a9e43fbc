"""Casting finds a source up a steady plume, searches clean air, and gets past what is in its way."""

import numpy as np
import pytest
from arena import TICK
from hunt import PATCH, SOURCE, STRIP, Hunt

from taichi_plume.agents.casting import IN_PLUME, LOST, SIDESTEP
from taichi_plume.agents.tracking import FIND, UPWIND

pytestmark = pytest.mark.usefixtures("taichi")


@pytest.fixture(scope="module")
def hunt(taichi):
    """Robots with an ideal sensor, and others with a metal oxide."""
    return Hunt("casting", ({"kind": "ideal"}, {"kind": "mox"}))


def test_the_source_is_found_from_downwind_and_off_the_axis(hunt):
    """2.3 to 3.2 m downwind of the source, anywhere across: found by 9 of 10, without wandering."""
    for gas, run in zip(("ideal", "mox"), hunt.search(200.0, 60), strict=True):
        found = run.found == 1
        assert found.mean() >= 0.9, gas
        straight = np.hypot(*(run.tracks[0] - SOURCE).T) - 0.3
        assert np.median(run.path_length[found] / straight[found]) < 2.5, gas
        assert {FIND, IN_PLUME, LOST} <= set(np.unique(run.states)), gas


def test_the_plume_is_held_at_the_given_angle(hunt):
    """In the plume the course is 20° off upwind, to one side or the other."""
    run, _ = hunt.search(200.0, 20)
    steps = np.diff(run.tracks, axis=0)
    # well within the state, and not after the end
    steady = (np.lib.stride_tricks.sliding_window_view(run.states, 12, axis=0) == IN_PLUME).all(-1)[:-1]
    steps = steps[11:][steady[: len(steps) - 11]]
    steps = steps[np.hypot(*steps.T) > 0.01]
    off = np.degrees(np.arctan2(np.abs(steps[:, 1]), -steps[:, 0]))
    assert len(off) > 100
    assert np.percentile(off, [10, 90]) == pytest.approx([20, 20], abs=2)


def test_in_clean_air_they_go_on_finding(hunt):
    """Nobody believes to be in a plume; sweeps from wall to wall with a step upwind after each."""
    run, _ = hunt.search(0.0, 120, low=(3.2, 0.3), high=(3.7, 2.7), trials=20)
    assert set(np.unique(run.states)) == {FIND, UPWIND}
    assert run.tracks[:, :, 1].max() > 2.9
    assert run.tracks[:, :, 1].min() < 0.1
    found = run.found == 1
    assert (run.tracks[-1, ~found, 0] < 2.0).all()
    # steps of 0.3 m upwind, one per sweep of 2.84 m at 0.2 m/s
    sweeps = 0.2 * 120 / (2.84 + 0.3)
    advance = run.tracks[0, ~found, 0] - run.tracks[-1, ~found, 0]
    assert advance == pytest.approx(0.3 * sweeps, rel=0.35)


def test_a_search_that_went_past_the_source_comes_back(hunt):
    """Started upwind of the source there is no gas; blocked by the wall, the steps turn downwind."""
    run, _ = hunt.search(200.0, 80, low=(0.1, 0.3), high=(0.19, 0.9), trials=20, upwind_angle_deg=10)
    assert run.found.mean() >= 0.9


@pytest.mark.parametrize("peak_fraction", [0.0, 0.7])
def test_a_box_in_the_plume_is_passed(hunt, peak_fraction):
    """An obstacle as wide as the plume lies across it, its face square to the wind."""
    box = (1.6, 1.5, 0.15, 0.25)
    run, _ = hunt.search(200.0, 70, box=box, trials=30, peak_fraction=peak_fraction)
    assert (run.states == SIDESTEP).any()
    assert run.found.mean() >= 0.9


def test_a_robot_out_of_the_plume_that_meets_the_upwind_wall_turns_back(hunt):
    """It leaves a strip of gas at 45 degrees and comes to the wall before the distance that tells it is lost."""
    model = {"upwind_angle_deg": 45, "lost_distance": 2.0, "cast_distance": 2.0}
    run, _ = hunt.search(100.0, 25, STRIP, low=(1.0, 1.4), high=(1.2, 1.6), trials=20, **model)
    on_their_way = run.found == 0
    assert on_their_way.sum() > 10
    tracks = run.tracks.swapaxes(0, 1)[on_their_way]
    for of_robot, track in zip(run.states.T[on_their_way], tracks, strict=True):
        lost = np.flatnonzero(of_robot == LOST)[0]
        again = lost + np.flatnonzero(of_robot[lost:] == IN_PLUME)[0]
        assert SIDESTEP not in of_robot[:again]
        assert track[lost, 0] < 0.1
        off = np.abs(track[:again, 1] - 1.5)
        assert 0.8 < off.max() < 1.4  # the corner is 1.42 m off
        assert off[-1] < 0.35


def test_a_lost_plume_is_sought_on_both_sides_then_given_up(hunt):
    """Where the gas ends for good: four sweeps, each twice as long as the last, then FIND."""
    run, _ = hunt.search(100.0, 40, PATCH, low=(3.0, 1.4), high=(3.4, 1.6), trials=10, cast_distance=0.1)
    for of_robot in run.states.T:
        order = of_robot[np.flatnonzero(np.diff(of_robot, prepend=-1))]
        assert order[:3].tolist() == [IN_PLUME, LOST, FIND]
        given_up = np.flatnonzero(of_robot == FIND)[0]
        in_lost = (of_robot[:given_up] == LOST).sum()
        driving = (0.1 + 0.2 + 0.4 + 0.8) / 0.2
        assert driving < in_lost * TICK < driving + 4 * 1.5  # a turn takes about a second


def test_without_wind_the_search_goes_on(hunt):
    """Wind too weak for the anemometer: robots still move and keep their first heading for upwind."""
    run, _ = hunt.search(0.0, 40, wind=0.005, trials=10)
    assert (run.wind_known == 0).all()
    assert run.path_length.min() > 3
    assert set(np.unique(run.states)) == {FIND, UPWIND}
