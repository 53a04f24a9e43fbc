"""Beliefs are scored, written, recorded and reported, whatever algorithm has them."""

import json
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from taichi_plume.assembly.assemble import assemble
from taichi_plume.assembly.preparation import load_scenario
from taichi_plume.execution import maps_output
from taichi_plume.execution.result import result, write_result
from taichi_plume.files import maps_file
from taichi_plume.record.recorder import Recorder
from taichi_plume.report.maps import belief_rows, beliefs_of
from taichi_plume.scoring.beliefs import OF_BELIEFS, BeliefScores, GroupBeliefs, beliefs
from taichi_plume.scoring.maps import MapScores

SCENARIO = """
duration: 8
domain: {size: [2, 1.5], spacing: 0.1}
wind: {kind: uniform, velocity: [0.3, 0]}
gas: {kind: eulerian, sources: [{position: [0.4, 0.8], rate: 20 mg/s}]}
robots:
  - &team
    name: first
    count: 2
    trials: 2
    start: {kind: area, low: [1.2, 0.5], high: [1.7, 1.1]}
    body: {radius: 0.05}
    algorithm: {kind: casting}
  - <<: *team
    name: second
    algorithm: {kind: infotaxis, cell: 0.2, wind_speed: 0.3, acquisition: 1, settle: 0, sample_period: 0.2}
    sensors: {gas: {kind: ideal}}
"""


def believed(p, **keys):
    model = SimpleNamespace(reach=0.5, capture="disc", **keys)
    group: Any = SimpleNamespace(model=model)
    return GroupBeliefs(group, 0.2, np.array([1.0, 0.0]), np.asarray(p, float))


def test_scores_of_simple_beliefs():
    p = np.zeros((3, 1, 10, 5))
    p[0, 0, 4, 2] = 1.0  # sure: at (1.9, 0.5)
    p[1, 0, [0, 9], 2] = 0.5  # at (1.1, 0.5) or (2.9, 0.5)
    p[2] = 1 / 50
    sources = np.array([[1.9, 0.9], [9.0, 9.0]])
    reported = dict(zip(OF_BELIEFS, believed(p).scores(sources), strict=True))
    assert reported["entropy_bits"] == pytest.approx([0.0, 1.0, np.log2(50)])
    assert reported["within_reach"][:2] == pytest.approx([1.0, 0.0])
    assert reported["peak_distance_m"][:2] == pytest.approx([0.4, np.hypot(0.8, 0.4)])
    assert reported["mean_distance_m"] == pytest.approx([0.4, np.hypot(0.1, 0.4), np.hypot(0.1, 0.4)])
    expected = [0.4, (np.hypot(0.8, 0.4) + np.hypot(1.0, 0.4)) / 2]
    assert reported["expected_distance_m"][:2] == pytest.approx(expected)
    none = dict(zip(OF_BELIEFS, believed(p).scores(np.zeros((0, 2))), strict=True))
    assert np.isnan(none["peak_distance_m"]).all()
    assert none["entropy_bits"][1] == pytest.approx(1.0)


@pytest.mark.slow
def test_a_run_leaves_its_beliefs(tmp_path, taichi):
    path = tmp_path / "beliefs.yaml"
    path.write_text(SCENARIO)
    sim = assemble(load_scenario(path), tmp_path)
    scores, judge = BeliefScores(sim), MapScores(sim)
    recorder = Recorder(sim, tmp_path / "recording.rrd", "cpu", judge)
    sim.observers += [scores.observer(), *recorder.observers()]
    writer = maps_output.MapsFile(sim, tmp_path / "maps.zarr", judge)
    recorder.start()
    writer.start()
    sim.run()
    writer.close()
    recorder.close()
    (one,) = beliefs(sim)
    assert one.p.shape == (2, 2, 10, 8)
    assert one.p.sum(axis=(2, 3)) == pytest.approx(1.0, rel=1e-4)
    assert one.p.std() > 1e-3  # it has learnt
    robots = [one.p.reshape(4, 10, 8)[k] for k in range(4)]
    np.testing.assert_array_equal(robots, sim.teams[1].algorithm.beliefs())
    assert maps_file.read(tmp_path / "maps.zarr") == []
    (read,) = maps_file.read_beliefs(tmp_path / "maps.zarr")
    np.testing.assert_array_equal(read["probability"].transpose("trial", "robot", "x", "y"), one.p)
    assert read.attrs["group"] == "second"
    write_result(tmp_path, result(sim, "completed", "", "cpu", judge, scores))
    (reported,) = json.loads((tmp_path / "result.json").read_text())["beliefs"]
    assert reported["group"] == "second"
    assert reported["over_time"]["time_s"] == pytest.approx([0.0, 5.0, 8.0])
    assert reported["over_time"]["entropy_bits"][0] == pytest.approx(np.log2(80), rel=1e-3)
    assert reported["entropy_bits"] == pytest.approx(np.mean(reported["per_trial"]["entropy_bits"]))
    (drawn,) = beliefs_of(tmp_path)
    assert drawn.density.shape == (8, 10)
    assert drawn.density.sum() * 0.04 == pytest.approx(1.0, rel=1e-3)
    assert drawn.reach == pytest.approx((0.0, 2.0, 0.0, 1.6))
    assert belief_rows([reported])[0][0] == "second"
    assert b"beliefs/1" in (tmp_path / "recording.rrd").read_bytes()
