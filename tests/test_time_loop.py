from collections.abc import Callable

import numpy as np
import pytest
import yaml

from taichi_plume.assembly.assemble import assemble
from taichi_plume.scenario.loading import ScenarioError
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.time_loop import Every, TimeLoop, UnstableError

pytestmark = pytest.mark.usefixtures("taichi")


ROOM = """
duration: 1.0
warm_up: 0.5
domain: {size: [1.0, 0.8], spacing: 0.1}
wind: {kind: cfd, openings: [{kind: inlet, face: x-, speed: 0.5}, {kind: outlet, face: x+}]}
gas: {kind: eulerian, sources: [{position: [0.2, 0.4], rate: 1.0e-6}]}
robots: [{count: 1, start: {kind: positions, positions: [[0.8, 0.4]]}, algorithm: {kind: casting}, reach: 0.1}]
"""


def small(text: str = "", **changes) -> TimeLoop:
    """A room of few cells with one robot; text: changed keys, in YAML."""
    return assemble(Scenario.model_validate(yaml.safe_load(ROOM) | (yaml.safe_load(text) or {}) | changes))


@pytest.fixture(scope="module")
def room(taichi) -> Callable[..., TimeLoop]:
    """Reset the small room to other numbers."""
    sim = small()

    def begun(**changes) -> TimeLoop:
        sim.reset(Scenario.model_validate(yaml.safe_load(ROOM) | changes))
        return sim

    return begun


@pytest.mark.slow
def test_the_warm_up_comes_before_zero_and_robots_wait(room):
    sim = room()
    seen = []
    sim.observers += [
        Every(0.1, lambda s: seen.append((s.t, s.swarm.snapshot()["path_length"][0])), warm_up=True)
    ]
    sim.run()
    t, path = np.array(seen).T
    np.testing.assert_allclose(t, np.linspace(-0.5, 1.0, 16), atol=1e-9)
    assert np.all(path[t <= 1e-9] == 0.0)
    assert path[-1] > 0.0
    assert sim.gas.gases[0].budget()["emitted_kg"] == pytest.approx(1.5e-6)


def test_observers_keep_their_cadence_and_see_the_end(room):
    sim = room(warm_up=0.0)
    often, seldom = [], []
    sim.observers += [Every(0.2, lambda s: often.append(s.t)), Every(0.7, lambda s: seldom.append(s.t))]
    sim.run()
    np.testing.assert_allclose(often, [0, 0.2, 0.4, 0.6, 0.8, 1.0], atol=1e-9)
    np.testing.assert_allclose(seldom, [0, 0.7, 1.0], atol=1e-9)


def test_a_run_is_whole_ticks(room):
    sim = room(duration=0.35, warm_up=0.15)
    sim.run()
    assert sim.t == pytest.approx(0.4)
    assert sim.gas.gases[0].budget()["emitted_kg"] == pytest.approx(0.6e-6)


@pytest.mark.parametrize(
    ("spoilt", "message"),
    [
        (lambda s: s.wind.u[0], r"air flow is no longer finite at t = 0\.30 s .*courant"),
        (lambda s: s.gas.gases[0].c, r"gas is no longer finite at t = 1\.00 s"),
    ],
)
def test_fields_that_are_no_longer_finite_end_the_run(room, spoilt, message):
    sim = room(duration=3.0)
    sim.observers += [Every(0.3, lambda s: s.t > 0.2 and spoilt(s).fill(np.nan))]
    with pytest.raises(UnstableError, match=message):
        sim.run()


@pytest.mark.slow
def test_it_ends_when_all_have_found_a_source():
    start = "{kind: positions, positions: [[0.35, 0.4]]}"
    robots = f"robots: [{{count: 1, start: {start}, algorithm: {{kind: spiral}}, reach: 0.1}}]"
    sim = small(robots, duration=20.0)
    sim.run()
    assert sim.swarm.all_over()
    assert sim.t < 1.0
    patient = small(robots, stop_early=False)
    patient.run()
    assert patient.t == pytest.approx(1.0)


WALL = {"kind": "box", "center": [0.5, 0.4], "size": [0.2, 1.0]}


@pytest.mark.slow
def test_air_that_cannot_leave_is_refused():
    with pytest.raises(ScenarioError, match=r"wind.openings\[0\]: its air has no way to an outlet"):
        small(obstacles=[WALL], robots=[])


@pytest.mark.slow
def test_a_balanced_pocket_is_fine():
    """A room without outlet may have two fans, one of which draws out what the other blows in."""
    wind = """
wind:
  kind: cfd
  openings:
    - {kind: fan, face: x-, center: [0.2], diameter: 0.2, speed: 1.0}
    - {kind: fan, face: x-, center: [0.6], diameter: 0.2, speed: -1.0}
    - {kind: outlet, face: x+}
"""
    sim = small(wind, obstacles=[WALL], robots=[])
    sim.run()
    assert sim.t == pytest.approx(1.0)  # without robots to the end
    assert sim.wind.diagnostics()["max_divergence"] < 1e-4
    assert sim.wind.diagnostics()["max_speed"] > 0.5


def test_a_source_in_sealed_air_is_refused():
    sealed = """
wind: {kind: synthetic}
gas: {kind: eulerian, sources: [{position: [0.85, 0.4], rate: 1.0e-6}]}
obstacles:
  - {kind: box, center: [0.85, 0.15], size: [0.4, 0.12]}
  - {kind: box, center: [0.85, 0.65], size: [0.4, 0.12]}
  - {kind: box, center: [0.65, 0.4], size: [0.12, 0.5]}
  - {kind: box, center: [0.97, 0.4], size: [0.1, 0.5]}
"""
    with pytest.raises(ScenarioError, match=r"gas.sources\[0\].position: is not in the air"):
        small(sealed, robots=[])


@pytest.mark.slow
def test_a_fan_that_starts_hard_keeps_the_courant_number():
    fan = "{kind: fan, face: x-, center: [0.4], diameter: 0.4, speed: 0, schedule: [{at: 0, speed: 5}], ramp: 0}"
    sim = small(f"wind: {{kind: cfd, openings: [{fan}, {{kind: outlet, face: x+}}]}}", robots=[], warm_up=0.0)
    sim.run()
    assert 3.0 < sim.wind.diagnostics()["max_speed"] < 10.0
    assert sim.wind.diagnostics()["max_courant"] < 1.25 * sim.wind.courant


@pytest.mark.slow
def test_walkers_wakes_screens_and_fan_curves_work_together():
    sim = small("""
duration: 2.0
domain: {size: [1.6, 0.8], spacing: 0.05}
wind:
  kind: cfd
  openings: [{kind: fan, face: x-, curve: {pressure: 1.0, flow: 0.5}}, {kind: outlet, face: x+}]
  screens: [{kind: honeycomb, axis: x, at: 0.2}]
obstacles: [{kind: cylinder, center: [0.9, 0.2], radius: 0.1, motion: {path: [[2, 0.9, 0.6]]}}]
robots: [{count: 1, start: {kind: positions, positions: [[1.4, 0.4]]}, algorithm: {kind: casting}, wake: true}]
""")
    sim.run()
    assert len(sim.wind.resistances) == 3
    v = sim.grid.inner(sim.wind.u[1].to_numpy())
    assert v[17:19, 12].mean() == pytest.approx(0.2, abs=0.03)  # the walker's speed, where it is now
    assert sim.wind.diagnostics()["max_divergence"] < 1e-4
    assert sim.wind.boundaries.curved[0].speed > 0.1
    budget = sim.gas.gases[0].budget()
    assert budget["in_domain_kg"] + budget["outflow_kg"] == pytest.approx(budget["emitted_kg"], rel=1e-4)


@pytest.mark.slow
def test_an_obstacle_that_moves_has_no_force_of_its_own():
    moving = "{kind: cylinder, center: [0.5, 0.4], radius: 0.1, motion: {path: [[9, 0.5, 0.6]]}}"
    assert small(f"obstacles: [{moving}]", robots=[]).forces is None
    sim = small(f"obstacles: [{moving}, {{kind: cylinder, center: [0.2, 0.2], radius: 0.1}}]", robots=[])
    assert sim.forces is not None
    sim.run()
    assert np.isnan(sim.forces()[0]).all()
    assert sim.forces()[1][0] > 0.0
