"""Robots with several gas sensors: where each measures, what each writes, and who sees it."""

import json

import numpy as np
import pytest
from robots import NOWHERE, Air, Floor, group, room, team

from taichi_plume import open_run
from taichi_plume.agents.members import Members
from taichi_plume.agents.observation import Observation
from taichi_plume.agents.sensors import Sensors
from taichi_plume.agents.swarm import Swarm
from taichi_plume.assembly.preparation import load
from taichi_plume.cli import run
from taichi_plume.engine import ti
from taichi_plume.grid.state import State
from taichi_plume.scenario.loading import ScenarioError, scenario_from

pytestmark = [pytest.mark.usefixtures("taichi"), pytest.mark.slow]

TICK = 0.1
PLACES = np.array([[1.0, 1.0], [2.0, 2.0], [3.0, 0.5], [1.0, 1.0]])
HEADINGS = np.array([0.0, 0.5 * np.pi, -2.2, 0.0])
EXACT = {"kind": "ideal", "noise_ppm": 0.0}
NOISY = {"kind": "mox", "model": "tgs2620", "noise": 0.05, "spread": 1.0}
STEREO = ({**EXACT, "ahead": 0.1, "left": 0.2}, {**EXACT, "ahead": 0.1, "left": -0.2}, NOISY)


def swarm_of(*sensors, algorithm=None, counts=(3, 1)) -> Swarm:
    """A group for each, of which the first has three robots."""
    algorithm = algorithm or {"kind": "casting"}
    groups = [
        group(
            name=f"group {n}",
            count=count,
            algorithm=algorithm,
            sensors={"gas": gas, "wind": {"kind": "ideal"}},
        )
        for n, (gas, count) in enumerate(zip(sensors, counts, strict=False))
    ]
    size = sum(one.count for one in groups)
    return Swarm(groups, PLACES[:size], HEADINGS[:size], Floor(), NOWHERE, 7)


@pytest.fixture(scope="module")
def air(taichi):
    """30 ppm, and 40 more for each m of x."""
    one = Air()
    one.level[None], one.slope[None] = 30.0, 40.0
    return one


@pytest.fixture(scope="module")
def stereo(taichi, air):
    """Two exact noses and a noisy one on three robots, beside a robot that has the noisy one alone."""
    swarm = swarm_of(list(STEREO), NOISY)
    return swarm, Sensors(swarm, 2, TICK, air.species)


def test_each_nose_measures_where_it_is(stereo, air):
    swarm, sensors = stereo
    sensors.measure(air, air, 1, TICK)
    now = swarm.snapshot()
    ahead = np.stack([np.cos(HEADINGS), np.sin(HEADINGS)], axis=1)
    left = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)
    for key, side in (("reading_ppm", 0.2), ("reading_1_ppm", -0.2)):
        x = (PLACES + 0.1 * ahead + side * left)[:3, 0]
        np.testing.assert_allclose(now[key][:3], 30.0 + 40.0 * x, rtol=1e-5)
    np.testing.assert_allclose(now["true_2_ppm"][:3], 30.0 + 40.0 * PLACES[:3, 0], rtol=1e-5)
    assert (now["resistance_2_ohm"][:3] > 0).all()
    assert np.isnan(now["resistance_1_ohm"]).all()  # of an ideal sensor


def test_who_has_fewer_has_no_numbers_of_the_others(stereo, air):
    swarm, sensors = stereo
    sensors.measure(air, air, 1, TICK)
    now = swarm.snapshot()
    assert all(np.isnan(now[f"{name}_{k}_ppm"][3]) for name in ("reading", "true") for k in (1, 2))
    assert np.isfinite(now["reading_ppm"]).all()
    assert [one.table for one in swarm.columns if one.table][-6:] == [
        (f"{name}_{k}_{unit}",)
        for k in (1, 2)
        for name, unit in (("reading", "ppm"), ("resistance", "ohm"), ("true", "ppm"))
    ]


def test_a_second_nose_leaves_the_first_as_it_is_alone(air):
    """To the bit, with noise and units; and has noise and a unit of its own."""
    runs = []
    for gas in (NOISY, [NOISY, NOISY]):
        swarm = swarm_of(gas)
        sensors = Sensors(swarm, 2, TICK, air.species)
        series = []
        for tick in range(1, 12):
            sensors.measure(air, air, tick, TICK * tick)
            now = swarm.snapshot()
            series.append(
                [now[key] for key in ("reading_ppm", "resistance_ohm", "reading_1_ppm") if key in now]
            )
        runs.append(np.array(series))
    np.testing.assert_array_equal(runs[0], runs[1][:, :2])
    apart = np.log(runs[1][:, 0] / runs[1][:, 2])
    assert (apart != 0.0).all()
    assert abs(np.corrcoef(np.diff(runs[1][:, 0, 0]), np.diff(runs[1][:, 2, 0]))[0, 1]) < 0.95


def test_all_noses_are_saved(stereo, air):
    swarm, sensors = stereo
    states = State(swarm), State(sensors)

    def go_on(first, last):
        for tick in range(first, last):
            sensors.measure(air, air, tick, TICK * tick)
        return swarm.snapshot()["reading_2_ppm"]

    go_on(1, 5)
    saved = [state.save() for state in states]
    then = go_on(5, 9)
    for state, what in zip(states, saved, strict=True):
        state.restore(what)
    np.testing.assert_array_equal(go_on(5, 9), then)


def test_a_policy_can_observe_all_noses():
    model = {"kind": "policy", "observe": ("gas", "noses", "clock")}
    swarm = swarm_of(list(STEREO), algorithm=model)
    seen = Observation(swarm, Members(swarm, (0,)), TICK)
    assert seen.names == ("gas", "gas of sensor 1", "gas of sensor 2", "clock")

    @ti.kernel
    def look(table: ti.types.ndarray(dtype=ti.f32, ndim=2)):
        for i in range(3):
            swarm.reading[i] = 9.0
            for k in ti.static(range(2)):
                seen.others[k][i] = 99.0 + 900.0 * k
            seen.write(i, 1.0, i, table, 0.0)

    table = np.zeros((3, seen.size), np.float32)
    look(table)
    np.testing.assert_allclose(table[:, :3], np.tile([1 / 6, 2 / 6, 3 / 6], (3, 1)), rtol=1e-5)


PLUME = {"kind": "gaussian_plume", "intensity": 0.2, "sources": [{"position": [0.5, 1.5], "rate": "1 g/s"}]}


def scenario(gas, duration=3.0, **keys):
    robots = team([3.5, 1.3], [3.5, 1.7], heading_deg=180, sensors={"gas": gas}, **keys)
    return room(robots, gas=PLUME, duration=duration)


OWN = """
import numpy as np

class Own:
    def act(self, robots):
        assert robots.readings.shape == (2, 2), robots.readings.shape
        np.testing.assert_array_equal(robots.readings[:, 0], robots.reading)
        left, right = robots.readings.T
        robots.turn_rate[:] = 5.0 * (left - right) / (left + right + 1e-3)
        robots.speed[:] = 0.1
"""


def test_an_own_algorithm_steers_by_two_noses_into_the_plume(tmp_path):
    (tmp_path / "own.py").write_text(OWN)
    pair = [{**EXACT, "left": side, "ahead": 0.05} for side in (0.1, -0.1)]
    content = scenario(pair, 12.0, algorithm={"kind": "own", "file": "own.py"})
    (tmp_path / "s.yaml").write_text(json.dumps(content))
    command = [str(tmp_path / "s.yaml"), "--out", str(tmp_path / "run"), "--allow-code", "--no-recording"]
    assert run.main(command) == 0
    rows = open_run(tmp_path / "run").robots
    assert np.isfinite(rows["reading_1_ppm"].to_numpy()).sum() > 100
    last = rows.iloc[-2:]
    np.testing.assert_allclose(last["y"], 1.5, atol=0.1)  # both began 0.2 m beside the axis
    assert max(last["x"]) < 2.6


@pytest.mark.parametrize(
    ("sensors", "reported"),
    [
        ([], "robots[0].sensors.gas: must have at least 1 item, got 0"),
        ([EXACT] * 9, "robots[0].sensors.gas: must have at most 8 items, got 9"),
        (
            [EXACT, {"noise": 0}],
            "robots[0].sensors.gas[1]: missing key 'kind'; known kinds: mox, pid, tdlas, ideal",
        ),
        ([EXACT, 3], "robots[0].sensors.gas[1]: must be a mapping (key: value), got 3"),
    ],
)
def test_faults_of_a_list_tell_its_place(sensors, reported):
    with pytest.raises(ScenarioError) as error:
        scenario_from(scenario(sensors))
    assert [line for line in error.value.faults if line.startswith(reported)], error.value.faults


@pytest.mark.parametrize(
    ("gas", "keys", "reported"),
    [
        (
            [EXACT, {**EXACT, "left": 7.0}],
            {},
            "robots[0].sensors.gas[1].left: 7 m is longer than the room",
        ),
        (
            EXACT,
            {"algorithm": {"kind": "policy", "observe": ["noses"]}},
            "robots[0].algorithm.observe: has 'noses', but there is one gas sensor",
        ),
    ],
)
def test_what_does_not_fit_is_reported(tmp_path, gas, keys, reported):
    (tmp_path / "s.yaml").write_text(json.dumps(scenario(gas, **keys)))
    with pytest.raises(ScenarioError) as error:
        load(tmp_path / "s.yaml")
    assert any(reported in line for line in error.value.faults)
