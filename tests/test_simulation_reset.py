"""An assembled simulation, set back to its beginning with the same scenario, with another, and with faults."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from taichi_plume.assembly.assemble import assemble
from taichi_plume.assembly.preparation import again, checked
from taichi_plume.engine.program import compiled
from taichi_plume.grid.state import State
from taichi_plume.scenario.loading import ScenarioError
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.time_loop import TimeLoop

pytestmark = [pytest.mark.usefixtures("taichi"), pytest.mark.slow]

ROOM = """
duration: 1.0
warm_up: 0.3
domain: {size: [1.6, 1.2], spacing: 0.1, depth: 0.5}
wind:
  kind: cfd
  openings:
    - {kind: fan, face: x-, center: [0.6], diameter: 0.6, speed: 0.5, turbulence_intensity: 0.1}
    - {kind: outlet, face: x+}
obstacles:
  - {kind: cylinder, center: [0.9, 0.9], radius: 0.15}
  - {kind: cylinder, center: [1.3, 0.3], radius: 0.1, motion: {path: [[1, 1.3, 0.8]]}}
gas:
  kind: mixture
  parts:
    - {kind: eulerian, species: ethanol, sources: [{position: [0.3, 0.6], rate: 1.0e-5}]}
    - {kind: puffs, species: acetone, sources: [{position: [0.4, 0.4], rate: 1.0e-5}]}
robots:
  - &group
    name: a
    count: 2
    trials: 2
    reach: 0.02
    body: {radius: 0.03}
    start: {kind: area, low: [1.0, 0.1], high: [1.5, 0.6]}
    algorithm: {kind: casting, threshold_ppm: 1.0, speed: 0.1}
    sensors: {gas: {kind: mox, model: tgs2620}}
  - <<: *group
    name: b
    algorithm: {kind: casting, threshold_ppm: 5.0, speed: 0.1}
    sensors: {gas: {kind: pid, calibrated_for: ethanol}}
maps: [{kind: time_series, cell: 0.2, window: 0.5}, {kind: kernel_dmv, cell: 0.2}]
"""
OTHER = {
    "seed": 7,
    "air_seed": 8,
    "wind.openings.0.speed": 0.4,
    "wind.viscosity": 2e-5,
    "gas.parts.0.sources.0.position": [0.35, 0.5],
    "gas.parts.1.sources.0.rate": 2e-5,
    "obstacles.1.motion.path": [[1, 1.2, 0.7]],
    "robots.0.start.low": [1.0, 0.2],
    "robots.0.algorithm.speed": 0.15,
    "robots.1.body.max_speed": 0.05,
    "maps.1.sigma": 0.4,
    "robots.1.count": 3,
    "obstacles.0.radius": 0.1,
    "maps.0.cell": 0.1,
}


def scenario(changes: dict) -> Scenario:
    data = Scenario.model_validate(yaml.safe_load(ROOM)).model_dump(mode="json", exclude_none=True)
    for path, value in changes.items():
        *way, key = [int(part) if part.isdecimal() else part for part in path.split(".")]
        place: Any = data
        for part in way:
            place = place[part]
        place[key] = value
    return Scenario.model_validate(data)


def story(sim) -> list[np.ndarray]:
    """What robots, gas and maps went through, to the end."""
    reported = []
    while not sim.finished:
        sim.advance()
        reported.append(
            np.column_stack([values.reshape(sim.swarm.count, -1) for values in sim.swarm.snapshot().values()])
        )
    budgets = [float(number) for gas in sim.gas.gases for number in gas.budget().values()]
    return [np.array(reported), np.array(budgets), *(np.asarray(one.estimate()) for one in sim.maps)]


def same(one: list[np.ndarray], other: list[np.ndarray]) -> bool:
    return all(np.array_equal(a, b, equal_nan=True) for a, b in zip(one, other, strict=True))


@pytest.fixture(scope="module")
def fresh_other(taichi) -> list[np.ndarray]:
    """Story of a fresh simulation, which is gone then: the next one finds the kernels in the cache."""
    return story(assemble(scenario(OTHER)))


@pytest.fixture(scope="module")
def sim(fresh_other) -> TimeLoop:
    return assemble(scenario({}))


def test_a_reset_equals_a_fresh_simulation_to_the_bit_and_compiles_nothing(sim, fresh_other):
    first = story(sim)
    kernels = compiled()
    sim.reset()
    assert same(story(sim), first)
    for path, value in OTHER.items():
        sim.reset(scenario({path: value}))
        assert not same(story(sim), first), f"{path} changes nothing"
    sim.reset(scenario(OTHER))
    assert same(story(sim), fresh_other)
    sim.reset(scenario({}))
    assert same(story(sim), first)
    assert compiled() == kernels


def test_what_equal_sections_have_opened_stays_open():
    known = checked(scenario({}), Path())
    moved = again(known, scenario({"obstacles.0.radius": 0.1})).resources.shapes
    larger = again(known, scenario({"domain.size": [1.7, 1.2]})).resources.shapes
    shapes = known.resources.shapes
    assert [moved[path] is shape for path, shape in shapes.items()] == [False, True]
    assert not any(larger[path] is shape for path, shape in shapes.items())


def test_a_run_goes_on_from_a_saved_state(sim):
    sim.reset(scenario({}))
    for _ in range(8):
        sim.advance()
    state = State(sim)
    saved = state.save()
    rest = story(sim)
    state.restore(saved)
    assert same(story(sim), rest)


@pytest.mark.parametrize(
    ("path", "value", "line"),
    [
        ("robots.0.count", 50, r"robots\[0\].start: "),
        ("gas.parts.0.sources.0.position", [0.9, 0.9], r"position: \(0.9, 0.9\) m is inside obstacles\[0\]"),
    ],
)
def test_a_faulty_scenario_is_reported_and_leaves_all_as_it_was(sim, path, value, line):
    sim.reset(scenario({}))
    sim.advance()
    state = State(sim)
    before = state.save()
    with pytest.raises(ScenarioError, match=line):
        sim.reset(scenario({path: value}))
    after = state.save()
    assert before.keys() == after.keys()
    assert all(np.array_equal(before[key], after[key], equal_nan=True) for key in state.paths)
