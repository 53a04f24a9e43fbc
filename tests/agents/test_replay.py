"""Robots that go recorded ways: where they are at each time, what they read there, and what is refused."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from recorded_bag import POSE, gas, pose, write
from robots import room, team

from taichi_plume.assembly.assemble import assemble
from taichi_plume.assembly.preparation import checked
from taichi_plume.execution.result import _beside_recorded
from taichi_plume.execution.summary import _recorded_line
from taichi_plume.files import ros_messages as ros
from taichi_plume.files.bag_readings import BagOptions
from taichi_plume.files.trajectories import WayError, read
from taichi_plume.grid.state import State
from taichi_plume.scenario.loading import ScenarioError, scenario_from

pytestmark = [pytest.mark.usefixtures("taichi"), pytest.mark.slow]
TIMES = np.arange(100.0, 104.01, 0.25)
PLUME = {
    "kind": "gaussian_plume",
    "diffusivity": 0.01,
    "sources": [{"position": [0.5, 1.5], "rate": "10 mg/s"}],
}
BAG = {"kind": "replay", "file": "bag", "origin": [0.5, 0.25], "robots": ["b", "a"], "start": 1.0}
SENSORS = {"gas": {"kind": "ideal"}}
TABLE = team(
    [3, 2.7], name="table", reach=0, algorithm={"kind": "replay", "file": "robots.parquet"}, sensors=SENSORS
)


def scenario(*others, **changes):
    """Robots that go the ways of the bag, with these changes of the algorithm, and others."""
    real = team([3, 1], [3, 2], name="real", trials=2, reach=0, algorithm=BAG | changes, sensors=SENSORS)
    return scenario_from(room(real, *others, gas=PLUME, duration=6.0))


def way(name, t):
    """x, y, heading in the frame of the bag."""
    return (
        (1.0 + 0.4 * (t - 100), 1.0, 3.0 + 0.1 * (t - 100)) if name == "a" else (0.5, 0.2 * (t - 100), -1.0)
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A bag of two robots, and the table of a run with one."""
    folder = tmp_path_factory.mktemp("replay")
    messages = []
    for name in "ab":
        messages += [(t, f"/{name}/pose", pose(t, *way(name, t), POSE)) for t in TIMES]
        messages += [(t, f"/{name}/gas", gas(t, 5.0)) for t in TIMES + 0.1]
    write(folder / "bag", messages)
    write(folder / "poses", [one for one in messages if one[1].endswith("pose")])
    t = np.repeat(np.arange(0.0, 3.01, 0.1), 2)
    n = len(t)
    columns = {
        "t": t, "group": pa.array(["one"] * n).dictionary_encode(), "trial": np.tile([0, 1], n // 2).astype(np.int32),
        "robot": np.zeros(n, np.int32), "x": 1.0 + 0.5 * t, "y": 1.5 + np.tile([0.0, 1.0], n // 2),
        "heading": np.zeros(n), "reading_ppm": t,
    }  # fmt: skip
    pq.write_table(pa.table(columns), folder / "robots.parquet")
    return folder


@pytest.fixture(scope="module")
def sim(taichi, folder):
    return assemble(scenario(TABLE), folder=folder)


def test_robots_are_where_they_were_recorded(sim):
    """In every trial, between poses too; from the last pose on they stand."""
    sim.reset()
    readings = []
    while sim.t < 6.0 - 1e-6:
        sim.advance()
        if sim.tick <= 0:
            continue
        now = sim.swarm.snapshot()
        t = min(101.0 + sim.t, 104.0)
        wanted = [way("b", t), way("a", t)] * 2
        np.testing.assert_allclose(now["position"][:4], np.array(wanted)[:, :2] + [0.5, 0.25], atol=1e-5)
        np.testing.assert_allclose(
            np.exp(1j * now["heading"][:4]), np.exp(1j * np.array(wanted)[:, 2]), atol=1e-5
        )
        np.testing.assert_allclose(now["position"][4], [1.0 + 0.5 * min(sim.t, 3.0), 1.5], atol=1e-5)
        readings.append((sim.t, now["reading_ppm"], now["state"]))
    t, ppm, state = (np.array(one) for one in zip(*readings, strict=True))
    np.testing.assert_array_equal(state[:, 4] == 2, t > 3.0 + 1e-6)
    np.testing.assert_allclose(ppm[:, 0], ppm[:, 2])
    assert ppm[:, 4].max() > 10
    check_score(sim, t, ppm)


def check_score(sim, t, ppm):
    """Beside the recorded readings, of which there is one per quarter of a second, or one per tick."""
    real, table = (_beside_recorded(sim, group)["beside_recorded"] for group in sim.swarm.groups)
    kept = (TIMES >= 101) & (TIMES < 104)  # those with poses around them
    at = np.ceil((TIMES[kept] + 0.1 - 101.0) / sim.dt - 1e-3).astype(int)
    pairs = ppm[at - 1][:, [0, 1]].ravel()
    assert real["readings"] == len(pairs)
    np.testing.assert_allclose(real["mae_ppm"], [np.abs(pairs - 5.0).mean()] * 2, rtol=1e-5)
    np.testing.assert_allclose(real["bias_ppm"], [(pairs - 5.0).mean()] * 2, rtol=1e-5, atol=1e-6)
    assert np.isnan(real["correlation"]).all(), "what was recorded is always the same"
    own = ppm[t < 3.0 + 1e-6][:, 4]
    assert table["readings"] == len(own) == 30
    wanted = np.corrcoef(own, t[t < 3.0 + 1e-6])[0, 1]
    np.testing.assert_allclose(table["correlation"], [wanted], rtol=1e-4)


def test_the_summary_tells_how_they_compare():
    expected = {"readings": 1200, "correlation": [0.5, None], "mae_ppm": [1.0, 3.0], "bias_ppm": [-1.0, -2.0]}
    line = "1,200 readings; the simulated ones are 2 ppm off, on average -1.5 ppm, correlation 0.50"
    assert _recorded_line(expected) == line


def test_a_reset_begins_again_with_other_numbers(sim):
    sim.reset()
    for _ in range(20):
        sim.advance()
    sim.reset(scenario(TABLE, origin=[1.0, 0.5]))
    while sim.tick < 1:
        sim.advance()
    np.testing.assert_allclose(sim.swarm.snapshot()["position"][0], [1.5, 0.5 + 0.2 * (1 + sim.t)], atol=1e-5)


def test_it_goes_on_where_it_was_saved(sim):
    sim.reset()
    state = State(sim)
    for _ in range(15):
        sim.advance()
    saved, ends = state.save(), []
    for _ in range(2):
        for _ in range(15):
            sim.advance()
        found = [_beside_recorded(sim, group)["beside_recorded"] for group in sim.swarm.groups]
        ends.append((sim.t, sim.swarm.snapshot()["position"].tolist(), str(found)))
        state.restore(saved)
    assert ends[0] == ends[1]


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"file": "none.mcap"}, "robots[0].algorithm.file: {folder}/none.mcap: does not exist"),
        ({"file": "../bag"}, "lies outside the scenario's folder"),
        ({"robots": ["a", "c"]}, "robots[0].algorithm.robots: there is no 'c' in bag; it has a, b"),
        ({"robots": ["a"]}, "robots[0].algorithm.robots: 1 names for 2 robots"),
        (
            {"file": "robots.parquet", "robots": []},
            "robots[0].algorithm.file: robots.parquet has 1 robots, one 0; the",
        ),
        ({"origin": [9, 9]}, "robots[0].algorithm.origin: b is never in the domain"),
        ({"frame": "odom", "start": -1}, "robots[0].algorithm.start"),
        (
            {"topics": ["/c/gas"]},
            "robots[0].algorithm.file: {folder}/bag: has no topic '/c/gas'; it has /a/gas, /a/pose",
        ),
        ({"poses": ["/a/pose"]}, "poses is given 1 times for 2 topics of gas"),
    ],
)
def test_what_cannot_be_is_reported(folder, changes, expected):
    with pytest.raises(ScenarioError) as error:
        checked(scenario(**changes), folder)
    assert expected.format(folder=folder) in str(error.value)


def test_what_is_probably_not_meant_is_reported(folder):
    remarks = checked(scenario(file="poses", origin=[2.0, 0.25]), folder).resources.warnings
    assert any("a is not in the domain for 41 % of its poses" in one for one in remarks), remarks
    assert any("b in poses end at 3 s, the run at 6 s" in one for one in remarks), remarks


def test_gas_that_cannot_be_read_does_not_stop_a_replay(tmp_path):
    """Its readings are left out; and topics may be chosen."""
    messages = [(t, "/a/pose", pose(t, *way("a", t), POSE)) for t in TIMES]
    messages += [(t, "/b/pose", pose(t, *way("b", t), POSE)) for t in TIMES]
    write(tmp_path / "bag", messages + [(t, "/gas", gas(t, 1.0, "volt")) for t in TIMES])
    with pytest.raises(
        WayError, match=r"several topics of poses for /gas, /a/pose, /b/pose; choose with poses$"
    ):
        read(tmp_path / "bag")
    (one,) = read(tmp_path / "bag", BagOptions(pose=("/b/pose",)))
    assert len(one.ppm) == 0
    np.testing.assert_allclose(one.place, [(*way("b", t)[:2], 0.0) for t in TIMES])


def test_a_check_reports_what_was_read(folder):
    """Of the bag, in the frame that there is, with a note; of a table, in the domain."""
    resources = checked(scenario(TABLE), folder).resources
    facts = resources.facts["robots[0].algorithm"]
    for part in (
        "2 robots",
        "4 s from 100 s",
        "positions in frame odom",
        "x 0.5 to 2.6 m, y 0 to 1 m",
        "32 readings",
    ):
        assert part in facts.text
    assert {line.split(": ")[0] for line in facts.remarks} == {"a", "b"}
    assert any("robots[0].algorithm: a: positions are in frame odom" in line for line in resources.warnings)
    table = resources.facts["robots[1].algorithm"]
    for part in ("1 robot,", "positions in the domain", "x 1 to 2.5 m, y 1.5 to 1.5 m", "at most 3 ppm"):
        assert part in table.text
    assert not table.remarks


def test_an_origin_that_is_assumed_is_reported(folder):
    """Of a frame that is not the map's, if it is not given."""
    warnings = checked(scenario(robots=["a", "b"], origin=None), folder).resources.warnings
    assert any("robots[0].algorithm.origin: the positions are in frame odom" in line for line in warnings)
    warnings = checked(scenario(), folder).resources.warnings
    assert not any("algorithm.origin" in line for line in warnings)
    with pytest.raises(ScenarioError, match="has no frame 'map'; it has odom"):
        checked(scenario(frame="map"), folder)


def test_readings_and_their_unit_are_chosen_by_keys(tmp_path):
    """Two numbers of each message of an array, in ppb."""
    messages = [(t, "/r/pose", pose(t, *way("a", t), POSE, "map")) for t in TIMES]
    for t in TIMES + 0.1:
        data = np.array([1000.0, 100.0 * t])
        messages.append((t, "/r/enose", ros.message("std_msgs/msg/Float32MultiArray", data=data)))
    write(tmp_path / "bag", messages)
    keys = {"readings": ["/r/enose.data[1]"], "units": "ppb", "robots": ["r"], "origin": None}
    real = team([3, 1], name="real", reach=0, algorithm=BAG | keys, sensors=SENSORS)
    resources = checked(scenario_from(room(real, gas=PLUME, duration=2.0)), tmp_path).resources
    (one,) = resources.recorded_paths("robots[0].algorithm")
    np.testing.assert_allclose(one.ppm, 0.1 * one.read_at, rtol=1e-6)
    np.testing.assert_allclose(one.place[:, 0], 1.0 + 0.4 * (one.t - 100.0))
    assert not any("ppm" in remark for remark in resources.facts["robots[0].algorithm"].remarks)
    real["algorithm"]["readings"] = ["/r/enose.data[2]"]
    with pytest.raises(ScenarioError, match=r"readings /r/enose.data\[2\]: no message has this number"):
        checked(scenario_from(room(real, gas=PLUME)), tmp_path)


def test_its_robots_do_not_err(folder):
    with pytest.raises(ScenarioError, match="the poses of these robots are recorded"):
        checked(scenario_from(room(TABLE | {"localization": {"kind": "odometry"}}, gas=PLUME)), folder)


@pytest.mark.parametrize(("x", "ppm", "what"), [(1e300, 5.0, "position"), (1.0, -1e300, "reading")])
def test_numbers_that_are_mistakes_are_refused(tmp_path, x, ppm, what):
    """They would overflow in single precision."""
    poses = [(float(t), "/odom", pose(float(t), x if t == 2 else 0.1 * t, 1.0, 0.0)) for t in range(5)]
    bag = write(tmp_path / "bag", [*poses, (1.5, "/gas", gas(1.5, ppm))])
    with pytest.raises(WayError, match=rf"a {what} of robot is 1e\+300, a mistake"):
        read(bag)
