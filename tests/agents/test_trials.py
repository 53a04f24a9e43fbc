"""A trial alone is the same trial as among many, to the bit."""

import numpy as np
import pytest

from taichi_plume.assembly.assemble import assemble
from taichi_plume.assembly.preparation import load_scenario
from taichi_plume.scenario.loading import ScenarioError
from taichi_plume.scoring.maps import NAMES, MapScores

pytestmark = pytest.mark.usefixtures("taichi")

WORLD = """
duration: {duration}
seed: 4
domain: {{size: [4, 3], spacing: 0.1}}
wind: {{kind: uniform, velocity: [0.5, 0]}}
gas: {{kind: eulerian, sources: [{{position: [0.5, 1.5], rate: 20 mg/s, start: -6}}]}}
warm_up: 6
stop_early: false
rivals: {rivals}
robots:
"""
TEAM = """
  - name: {name}
    count: 2
    trials: {trials}
    first_trial: {first}
    start: {{kind: area, low: [2, 0.5], high: [3.5, 2.5]}}
    algorithm: {algorithm}
    localization: {{kind: odometry, veer_deg: 5}}
    sensors: {{gas: {{kind: mox, spread: 1, drift: 0.05, noise: 0.01}}, wind: {{kind: ultrasonic}}}}
"""
ALGORITHMS = [  # of all others see test_search.py
    "{kind: surge_cast}",
    "{kind: spiral, random: true, acquisition: 2}",
    "{kind: particle_filter, particles: 100, period: 0.5, estimates: 5}",
]


@pytest.mark.slow
def test_a_trial_alone(tmp_path):
    """Robots, sensors, odometers and algorithms of three rival teams."""
    path = tmp_path / "trials.yaml"

    def run(**trials):
        groups = [
            TEAM.format(name=f"team {n}", algorithm=algorithm, **trials)
            for n, algorithm in enumerate(ALGORITHMS)
        ]
        path.write_text(WORLD.format(duration=12, rivals="true") + "".join(groups))
        sim = assemble(load_scenario(path), tmp_path)
        sim.run()
        return sim.swarm.snapshot()

    many, alone = run(trials=5, first=0), run(trials=1, first=3)
    poses = ("position", "heading", "path_length", "believed_position", "believed_heading", "odometer")
    for name in (*poses, "reading_ppm", "resistance_ohm", "wind", "state"):
        of_teams = many[name].reshape(3, 5, 2, *many[name].shape[1:])
        np.testing.assert_array_equal(of_teams[:, 3].reshape(alone[name].shape), alone[name], err_msg=name)
    assert (many["position"][4:6] != alone["position"][:2]).any()


RIVAL = """
  - name: {name}
    count: 2
    trials: 3
    start: {{kind: positions, positions: [[2, 1], [2, 2]], heading_deg: 0}}
    algorithm: {{kind: sweep}}
    sensors: {{gas: {{kind: ideal}}}}
"""


@pytest.mark.slow
def test_rivals_search_as_if_they_were_alone_and_have_maps_of_their_own(tmp_path):
    path = tmp_path / "rivals.yaml"

    def run(*names, rivals):
        robots = "".join(RIVAL.format(name=name) for name in names)
        maps = "maps: [{kind: kernel_dmv, cell: 0.25}]\n"
        path.write_text(WORLD.format(duration=12, rivals=rivals) + robots + maps)
        sim = assemble(load_scenario(path), tmp_path)
        scores = MapScores(sim)
        sim.observers.append(scores.observer())
        sim.run()
        return sim.swarm.snapshot()["position"], sim.maps[0].estimate(), scores.series[0]

    (positions, together, reported), (places, alone, ours) = (
        run("rivals", "others", rivals="true"),
        run("rivals", rivals="false"),
    )
    np.testing.assert_array_equal(positions, np.concatenate([places, places]))
    np.testing.assert_array_equal(together, np.concatenate([alone, alone]))
    for name in NAMES:
        assert reported.means(name).shape[1] == 2, "one of each rival"
        np.testing.assert_allclose(reported.means(name)[:, 1:], ours.means(name), rtol=1e-6, err_msg=name)
    np.testing.assert_allclose(reported.last[:, 3:], ours.last, rtol=1e-6)
    assert np.isfinite(reported.means("nlpd")[1:]).all()
    with pytest.raises(ScenarioError, match="too close"):
        run("rivals", "others", rivals="false")
