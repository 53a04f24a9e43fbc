"""Keys that may change during a run, and scenarios of one structure."""

import pytest

from taichi_plume.scenario.comparison import differences_at_start, structure
from taichi_plume.scenario.loading import read_scenario

ROOM = """\
duration: 10
domain: {size: [4, 3], spacing: 0.05, depth: 0.5}
wind:
  kind: cfd
  openings:
    - {kind: fan, face: x-, center: [1.5], diameter: 0.4, speed: 0.5}
    - {kind: outlet, face: x+}
obstacles: [{kind: box, center: [2, 1], size: [0.4, 0.3]}]
gas: {kind: eulerian, sources: [{position: [1, 1.5], rate: 1e-5}]}
robots:
  - count: 2
    start: {kind: positions, positions: [[1, 1], [1, 2]]}
    algorithm: {kind: own, parameters: {gain: 1.5, steps: 3}}
maps: [{kind: time_series}]
"""


@pytest.fixture
def room(tmp_path):
    """The scenario with changes as of the command line."""
    path = tmp_path / "room.yaml"
    path.write_text(ROOM)
    return lambda *changes: read_scenario(path, changes)


@pytest.mark.parametrize(
    "change",
    [
        "duration=99",
        "wind.viscosity=2e-5",
        "wind.openings.0.speed=-0.2",
        "gas.sources.0.position=[1.2, 1.4]",
        "robots.0.algorithm.parameters={gain: 2.5, steps: 4}",
        "stop_early=false",
    ],
)
def test_these_change_during_a_run(room, change):
    assert list(differences_at_start(room(), room(change))) == []


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ("seed=7", "seed: was 0, is 7"),
        ("wind={kind: uniform, velocity: [1, 0]}", "wind.kind: was cfd, is uniform"),
        ("wind.turbulence={kind: vreman}", "wind.turbulence.kind: was smagorinsky, is vreman"),
        ("obstacles=[]", "obstacles: was 1 item, is 0 items"),
        ("domain.size=[4, 4]", "domain.size[1]: was 3, is 4"),
        ("tick=0.2", "tick: was 0.1, is 0.2"),
        ("obstacles.0.center=[2, 1.5]", "obstacles[0].center[1]: was 1, is 1.5"),
        ("wind.openings.0.diameter=0.5", "wind.openings[0].diameter: was 0.4, is 0.5"),
        ("robots.0.start.positions=[[1, 1.1], [1, 2]]", "robots[0].start.positions[0][1]: was 1, is 1.1"),
    ],
)
def test_these_act_at_the_start_alone(room, change, line):
    assert list(differences_at_start(room(), room(change))) == [line]


@pytest.mark.parametrize(
    ("change", "same"),
    [
        ("wind.viscosity=2e-5", True),
        ("obstacles.0.center=[2, 1.5]", True),
        ("robots.0.count=1", False),
        ("gas.species=acetone", False),
        ("robots.0.algorithm.parameters={gain: 1.5, steps: 4}", False),
    ],
)
def test_scenarios_of_a_structure_differ_in_numbers_alone(room, change, same):
    assert (structure(room()) == structure(room(change))) == same
