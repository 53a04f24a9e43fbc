"""Scores of gas maps over time against a fake run whose maps know half the truth."""

from types import SimpleNamespace
from typing import Any

import fake_run
import numpy as np
import pytest
from scipy import stats

from taichi_plume import results, scores
from taichi_plume.map_scores import MapScores
from taichi_plume.simulation import Every


def scored(sim):
    judge = MapScores(sim)
    truths = []
    sim.observers += [
        Every(1.0, lambda sim: truths.append(scores.true_gas(sim, 0.25, sim.maps[0].shape))),
        judge.observer(),
    ]
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
        assert [value.shape for value in one.values[name]] == [(fake.trials,)] * 2
    assert (one.values["correlation"][-1] > 0.5).all()
    assert np.isnan(one.values["nlpd"]).all(), "these maps know no variance"


def test_readings_are_judged_by_what_the_map_said_before_them():
    """A map that says 7 ± 2 ppm from 5 s on, and the truth later, of two trials of four robots."""
    sim: Any = fake_run.simulation(fake_run.scenario(2, duration=10))
    fake = sim.maps[0]
    says = {5.0: (7.0, 4.0)}

    def told(n: int) -> np.ndarray:
        return np.full((fake.trials, *fake.shape), says.get(round(sim.t, 6), (1e6, 1e-6))[n])

    fake.estimate, fake.variance = lambda: told(0), lambda: told(1)
    readings = []
    sim.observers.append(Every(1.0, lambda sim: readings.append(sim.swarm.snapshot()["reading_ppm"])))
    judge, _ = scored(sim)
    first, second = judge.series[0].values["nlpd"]
    assert np.isnan(first).all(), "nothing had been forecast"
    later = np.array(readings[6:]).reshape(5, 2, 4)
    expected = -stats.norm(7.0, 2.0).logpdf(later).mean(axis=(0, 2))
    np.testing.assert_allclose(second, expected, rtol=1e-6)


def test_peaks():
    estimate = np.full((3, 4, 2), np.nan)
    estimate[0, 3, 1] = 5.0
    estimate[0, 0, 0] = 4.0
    estimate[1, 1, 0] = 0.0
    distance = scores.peak_distance(estimate, 0.5, np.array([[1.75, 0.75], [0.0, 0.25]]))
    assert distance[:2] == pytest.approx([0.0, 0.75])
    assert np.isnan(distance[2])
    assert np.isnan(scores.peak_distance(estimate, 0.5, np.zeros((0, 2)))).all()


def test_the_result_tells_the_series():
    sim = fake_run.simulation(fake_run.scenario(2, duration=6))
    judge, _ = scored(sim)
    told = results.result(sim, "completed", "", "cpu", judge)["maps"][0]["mean_gas"]
    assert told["time_s"] == pytest.approx([5.0])
    assert told["error_ppm"] == pytest.approx([judge.series[0].values["error_ppm"][0].mean()])
    assert told["nlpd"] == [None]
    assert len(told["per_trial_at_end"]["peak_distance_m"]) == 2


def test_without_robots_maps_are_scored_all_the_same():
    sim = fake_run.simulation(fake_run.scenario(2, duration=6, robots=[], maps=[]))
    sim.maps.append(
        SimpleNamespace(  # type: ignore[arg-type]
            cell=0.25, errors=[], update=lambda *_: None, estimate=lambda: np.zeros((1, 16, 12))
        )
    )
    judge = MapScores(sim)
    sim.observers.append(judge.observer())
    sim.run()
    assert judge.series[0].values["error_ppm"][0][0] > 0
