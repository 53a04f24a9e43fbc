"""Groups that set off later: they wait, then do what they would have done, and their times count from then on."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from taichi_plume.assembly.assemble import assemble
from taichi_plume.assembly.preparation import checked
from taichi_plume.execution.result import result
from taichi_plume.grid.state import State
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scoring import trials as scores

pytestmark = [pytest.mark.usefixtures("taichi"), pytest.mark.slow]

LATER = 1.3  # s, no whole number of ticks
TICKS = 7  # until the first with a command, of 0.2 s: that after 1.2 s ends at 1.4 s


GROUP = yaml.safe_load("""
count: 1
start: {kind: positions, positions: [[0.6, 0.5]], heading_deg: 0}
algorithm: {kind: sweep}
sensors: {gas: {kind: ideal}, wind: {kind: ideal}}
reach: 0.4
""")
SCENARIO = yaml.safe_load("""
tick: 0.2
domain: {size: [4, 3], spacing: 0.25}
wind: {kind: uniform, velocity: [0.1, 0]}
gas: {kind: gaussian_plume, intensity: 0.1, sources: [{position: [2.5, 1.5], rate: 1 mg/s}]}
""")


def group(name, begin, **keys):
    return GROUP | {"name": name, "begin": begin} | keys


def scenario(*groups, duration=200.0):
    data = SCENARIO | {"duration": duration, "rivals": len(groups) > 1, "robots": list(groups)}
    return checked(Scenario.model_validate(data), Path())


@pytest.fixture(scope="module")
def sim(taichi):
    return assemble(scenario(group("now", 0.0), group("later", LATER)).scenario)


def played(sim, ticks):
    """Snapshots of so many ticks."""
    seen = []
    for _ in range(ticks):
        sim.advance()
        seen.append(sim.swarm.snapshot())
    return seen


def test_it_stands_and_smells_and_then_does_the_same(sim):
    sim.reset()
    first = sim.swarm.snapshot()["position"][1]
    seen = played(sim, 60)
    names = [sim.state_names()[k] for k in (0, 1)]
    assert names[1] == (*names[0], "BEFORE_BEGIN")
    waits = [names[1][one["state"][1]] == "BEFORE_BEGIN" for one in seen]
    assert waits == [True] * (TICKS - 1) + [False] * (60 - TICKS + 1)
    assert all((one["position"][1] == first).all() for one in seen[:TICKS])
    assert seen[2]["reading_ppm"][1] == seen[2]["true_ppm"][1]  # the sensor is on
    for key in ("position", "heading", "state", "path_length", "bumps"):
        now = np.array([one[key][0] for one in seen[: 60 - TICKS + 1]])
        later = np.array([one[key][1] for one in seen[TICKS - 1 :]])
        np.testing.assert_array_equal(now, later, err_msg=key)


def test_a_line_feels_the_wind_for_as_long():
    """Which takes time of its own, and has a state in which it waits."""
    line = {"algorithm": {"kind": "lineup", "listen": 3.0}}
    sim = assemble(scenario(group("now", 0.0, **line), group("later", LATER, **line)).scenario)
    names = sim.state_names()[1]
    assert len(set(names)) == len(names)
    states = np.array([one["state"] for one in played(sim, 40)])
    feels = names.index("FEEL")
    assert (states == feels).sum(axis=0).tolist() == [14, 14]  # it drives in the last of 15 ticks


def test_times_count_from_setting_off(sim):
    sim.reset()
    sim.run()
    now, later = (scores.trial_outcomes(sim, one, sim.swarm.snapshot()) for one in sim.swarm.groups)
    assert now["success"] == later["success"] == [True]
    assert abs(later["time_s"][0] - now["time_s"][0]) < sim.dt  # it learns what to do once in a tick
    assert now["path_m"] == later["path_m"]


def test_who_waits_finds_nothing_and_failures_had_the_time_since_then():
    """Not even at a source; a group that sets off there has found the source in the first tick."""
    at = {"start": {"kind": "area", "low": [2.4, 1.4], "high": [2.6, 1.6]}}
    groups = [group(*one, **at) for one in (("now", 0.0), ("later", LATER), ("never", 4.0))]
    sim = assemble(scenario(*groups, group("lost", 2.0, reach=0.01), duration=4.0).scenario)
    sim.run()
    now, later, never, lost = result(sim, "ok", "", "cpu")["groups"]
    assert now["per_trial"]["time_s"] == pytest.approx([0.2])
    assert later["per_trial"]["time_s"] == pytest.approx([0.2 * TICKS - LATER])
    assert never["per_trial"]["success"] == [False]
    assert never["no_search"] == "the robots had not started"
    assert lost["summary"]["time_with_failures_s"]["mean"] == pytest.approx(2.0)


def test_a_reset_and_a_saved_state_bring_the_waiting_back(sim):
    sim.reset()
    state = State(sim)
    played(sim, 3)
    saved = state.save()
    first = played(sim, 20)
    state.restore(saved)
    again = played(sim, 20)
    sim.reset()
    afresh = played(sim, 23)[3:]
    for key in ("position", "state", "reading_ppm"):
        one = np.array([now[key] for now in first])
        np.testing.assert_array_equal(one, [now[key] for now in again])
        np.testing.assert_array_equal(one, [now[key] for now in afresh])


def test_what_never_sets_off_is_remarked():
    never, late = (scenario(group("g", begin), duration=4.0).resources.warnings for begin in (4.0, 3.0))
    assert any("robots[0].begin: 4 s is not before the end at 4 s" in line for line in never)
    assert not any("begin: 3 s" in line for line in late)
