"""Scores of gas maps over time against a fake run whose maps know half the truth."""

from types import SimpleNamespace
from typing import Any

import fake_run
import numpy as np
import pytest
from saved import assert_plain
from scipy import stats

from taichi_plume.execution import result
from taichi_plume.grid.state import State
from taichi_plume.scoring import trials as scores
from taichi_plume.scoring.maps import MapScores
from taichi_plume.time_loop import Every

pytestmark = pytest.mark.usefixtures("taichi")


def scored(sim, truth=True):
    judge, truths = MapScores(sim), []
    if truth:
        look = Every(1.0, lambda sim: truths.append(scores.true_gas(sim, 0.25, sim.maps[0].shape)))
        sim.observers.append(look)
    sim.observers.append(judge.observer())
    sim.run()
    return judge, truths


def test_the_truth_is_the_mean_since_the_start():
    sim = fake_run.simulation(fake_run.scenario(2, duration=11, warm_up=2))
    judge, truths = scored(sim)
    assert len(truths) == 12
    one = judge.series[0]
    np.testing.assert_allclose(one.truth, np.mean(truths, axis=0, dtype=float), rtol=1e-6)
    assert one.time == pytest.approx([5.0, 10.0])
    fake: Any = sim.maps[0]
    for name in ("error_ppm", "correlation", "peak_distance_m", "nlpd"):
        assert one.means(name).shape == (2, 1)
        assert one.first(name).shape == (2,)
    assert one.last.shape == (4, fake.trials)
    assert (one.means("correlation")[-1] > 0.5).all()
    assert np.isnan(one.means("nlpd")).all(), "these maps know no variance"


def test_readings_are_judged_by_what_the_map_said_before_them():
    """A map that says 7 ± 2 ppm from 5 s on, of readings that scatter by 3 ppm, of two trials of four robots.

    The last of the robots believes to be off the map.
    """
    sim: Any = fake_run.simulation(fake_run.scenario(2, duration=10))
    fake = sim.maps[0]
    says = {5.0: (7.0, 4.0)}

    def reported(n: int) -> np.ndarray:
        return np.full((fake.trials, *fake.shape), says.get(round(sim.t, 6), (1e6, 1e-6))[n])

    fake.estimate, fake.variance, fake.noise = lambda: reported(0), lambda: reported(1), 9.0
    snapshot = sim.swarm.snapshot

    def strayed() -> dict[str, np.ndarray]:
        now = snapshot()
        now["believed_position"][7] = [4.001, 1.0]
        return now

    sim.swarm.snapshot = strayed
    readings = []
    sim.observers.append(Every(1.0, lambda sim: readings.append(sim.swarm.snapshot()["reading_ppm"])))
    judge, _ = scored(sim)
    series = judge.series[0]
    assert np.isnan(series.first("nlpd")[0]), "nothing had been forecast"
    later = np.array(readings[6:])
    expected = -stats.norm(7.0, np.sqrt(13.0)).logpdf(later)
    of_trials = [expected[:, :4].mean(), expected[:, 4:7].mean()]
    np.testing.assert_allclose(series.last[3], of_trials, rtol=1e-6)
    assert series.first("nlpd")[1] == pytest.approx(of_trials[0], rel=1e-6)
    assert series.means("nlpd")[1] == pytest.approx(np.mean(of_trials), rel=1e-6)


def test_scores_go_on_from_between_two_snaps():
    """With a map that tells a variance, saved 2 s after its last score; in between it runs on to the end."""
    sim: Any = fake_run.simulation(fake_run.scenario(2, duration=30))
    fake = sim.maps[0]
    fake.variance, fake.noise = lambda: 4.0 + fake.weight(), 9.0
    judge = MapScores(sim)
    state, look = State(judge), judge.observer()
    sim.observers.append(look)

    def go(ticks: int) -> list[np.ndarray]:
        for _ in range(ticks):
            sim.advance()
            sim.observe()
        series = judge.series
        return [part for one in series for part in (one.rows.table[: len(one.rows)], one.last, one.truth)]

    go(170)
    saved, tick, kept = state.save(), sim.tick, vars(look).copy()
    seen = [one.seen.copy() for one in sim.maps]
    assert_plain(saved)
    first = go(130)
    state.restore(saved)
    sim.tick = tick
    vars(look).update(kept)
    for one, was in zip(sim.maps, seen, strict=True):
        one.seen = was
    assert [len(one.rows) for one in judge.series] == [3, 3]
    again = go(130)
    assert np.isfinite(judge.series[0].means("nlpd")[1:]).all()
    for one, other in zip(again, first, strict=True):
        np.testing.assert_array_equal(one, other)


def test_what_a_map_leaves_out_is_no_surprise():
    mean, variance = np.array([[[1.0, 2.0], [np.nan, 4.0]]]), np.array([[[1.0, 4.0], [1.0, 0.0]]])
    expects = scores.Prediction(mean, variance, 0.5, (0.9, 1.0))
    place = np.array([[0.1, 0.1], [0.4, 1.0], [0.9, 0.1], [0.9, 0.9], [0.95, 0.1], [-0.1, 0.1], [np.nan, 0]])
    reported = expects.surprise(0, np.tile(place, (2, 1)), np.repeat([3.0, np.inf], len(place)))
    assert reported[:2] == pytest.approx(-stats.norm([1.0, 2.0], [1.0, 2.0]).logpdf(3.0))
    assert np.isnan(reported[2:]).all()


def test_forecasts_count_once_the_maps_have_settled():
    errors = [(t, np.array([t, np.nan, np.nan])) for t in (25.0, 30.0, 35.0, 40.0)]
    errors.append((45.0, np.array([np.nan, 3.0, np.nan])))
    np.testing.assert_allclose(scores.forecast_error(errors, 3), [37.5, 3.0, np.nan])
    np.testing.assert_allclose(scores.forecast_error(errors, 3, begin=6.0), [40.0, 3.0, np.nan])
    assert np.isnan(scores.forecast_error(errors[:2], 3)).all()
    assert np.isnan(scores.forecast_error([], 2)).all()


def test_cells_that_no_robot_can_measure_do_not_count():
    """A map that knows half the truth, and far too much where there is no way to."""
    sim: Any = fake_run.simulation(fake_run.scenario(2, duration=6))
    sim.swarm.clearance = SimpleNamespace(distance_at=lambda points: 2.0 - points[..., 0])
    one, free = sim.maps[0], np.arange(sim.maps[0].shape[0])[:, None] < 8
    half = one.estimate
    one.estimate = lambda: np.where(free, np.nan_to_num(half()), 1e6)
    judge, truths = scored(sim)
    reported = result.result(sim, "completed", "", "cpu", judge)["maps"][0]
    expected = np.abs(truths[-1] / 2 - truths[-1])[:8]
    seen = one.seen[:8]
    assert reported["mae_ppm"] == pytest.approx(np.where(seen, expected, truths[-1][:8]).mean())
    assert reported["known_fraction"] == 1.0
    assert reported["mean_gas"]["error_ppm"][0] < 1e3
    one.estimate = lambda: np.where(free, np.nan, np.full_like(half(), 1e6))
    reported = result.result(sim, "completed", "", "cpu")["maps"][0]
    assert (reported["mae_ppm"], reported["known_fraction"]) == (None, 0.0)


def test_peaks():
    estimate = np.full((4, 4, 2), np.nan)
    estimate[3] = 0.0
    estimate[0, 3, 1] = 5.0
    estimate[0, 0, 0] = 4.0
    estimate[1, 1, 0] = 0.2
    distance = scores.peak_distance(estimate, 0.5, np.array([[1.75, 0.75], [0.0, 0.25]]))
    assert distance[:2] == pytest.approx([0.0, 0.75])
    assert np.isnan(distance[2:]).all(), "nothing known, and no gas known"
    assert np.isnan(scores.peak_distance(estimate, 0.5, np.zeros((0, 2)))).all()


def test_the_result_tells_the_series():
    sim = fake_run.simulation(fake_run.scenario(2, duration=6))
    judge, _ = scored(sim)
    reported = result.result(sim, "completed", "", "cpu", judge)["maps"][0]["mean_gas"]
    assert reported["time_s"] == pytest.approx([5.0])
    assert reported["error_ppm"] == pytest.approx([judge.series[0].last[0].mean()])
    assert reported["nlpd"] == [None]
    assert len(reported["per_trial_at_end"]["peak_distance_m"]) == 2


def test_without_robots_maps_are_scored_all_the_same():
    sim: Any = fake_run.simulation(fake_run.scenario(2, duration=6, robots=[], maps=[]))
    about = {"cell": 0.25, "levels": None, "window": None, "errors": [], "update": lambda *_: None}
    vars(sim.scenario)["maps"] = (SimpleNamespace(robot=None, measures="gas", takes_beams=False),)
    sim.maps.append(SimpleNamespace(**about, estimate=lambda: np.zeros((1, 16, 12))))
    judge, _ = scored(sim, truth=False)
    assert judge.series[0].first("error_ppm")[0] > 0


def test_the_result_tells_the_settled_forecast():
    sim: Any = fake_run.simulation(fake_run.scenario(2, duration=1))
    sim.run()
    sim.maps[0].errors = [(t, np.array([t, np.nan])) for t in (30.0, 35.0, 40.0)]
    reported, unsettled = result.result(sim, "completed", "", "cpu")["maps"]
    assert reported["forecast_error_ppm"] == pytest.approx(37.5)
    assert reported["per_trial"]["forecast_error_ppm"] == pytest.approx([37.5, np.nan], nan_ok=True)
    assert unsettled["forecast_error_ppm"] is None
