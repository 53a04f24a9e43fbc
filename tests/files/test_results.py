import errno
import json
import os
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import fake_run
import numpy as np
import pyarrow.parquet as pq
import pytest
import yaml

from taichi_plume.execution import result, robots_table
from taichi_plume.files import disk, run_folder, run_tables
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scoring import trials as scores
from taichi_plume.time_loop import Every, TimeLoop

pytestmark = pytest.mark.usefixtures("taichi")


def run_with_table(tmp_path: Path, **changes):
    sim = fake_run.simulation(fake_run.scenario(2, maps=[], **changes))
    table = robots_table.RobotTable(sim, tmp_path / "robots.parquet")
    table.start()
    sim.observers.append(table.observer())
    return sim, table


# ---------------------------------------------------------------- scenario.yaml


@pytest.mark.parametrize("dim", [2, 3])
def test_resolved_scenario_is_the_same_scenario(dim, tmp_path):
    model = fake_run.scenario(dim)
    source, target = tmp_path / "configs", tmp_path / "runs" / "a"
    target.mkdir(parents=True)
    run_folder.write_scenario(target, model, source, "cpu")
    text = (target / "scenario.yaml").read_text()
    again = Scenario.model_validate(yaml.safe_load(text))
    mesh, mesh_again = model.obstacles[-1], again.obstacles[-1]
    assert (target / mesh_again.file).resolve() == (source / mesh.file).resolve()  # type: ignore[union-attr]
    assert again.model_copy(update={"obstacles": model.obstacles}) == model
    assert "# backend: cpu" in text
    assert "# seed: 7" in text
    assert "tolerance:" in text  # a default


# ---------------------------------------------------------------- robots.parquet


def test_table_holds_what_the_swarm_was(tmp_path):
    sim, table = run_with_table(tmp_path, duration=10)
    kept = {}
    sim.observers.append(Every(0.1, lambda s: kept.__setitem__(s.tick, s.swarm.snapshot())))
    sim.run()
    table.close()
    rows = pq.read_table(tmp_path / "robots.parquet").to_pydict()
    assert len(rows["t"]) == 101 * 8
    n = 95 * 8 + 4 + 2  # tick 95, trial 1, robot 2
    now = kept[95]
    assert rows["t"][n] == pytest.approx(9.5)
    assert (rows["group"][n], rows["trial"][n], rows["robot"][n]) == ("team", 1, 2)
    assert (rows["x"][n], rows["y"][n]) == pytest.approx(tuple(now["position"][6]))
    assert (rows["believed_x"][n], rows["believed_y"][n]) == pytest.approx(tuple(now["believed_position"][6]))
    for name in ("reading_ppm", "true_ppm", "heading", "believed_heading"):
        assert rows[name][n] == pytest.approx(now[name][6])
    assert rows["wind_x"][n] == pytest.approx(0.3)
    assert rows["state"][n] == ("search", "surge")[now["state"][6]]
    assert [rows["found"][95 * 8 + i] for i in range(8)] == [i % 4 == 0 for i in range(8)]


def of_groups(names: str, count: int) -> TimeLoop:
    """A simulation of groups of these names."""
    group = {"count": count, "algorithm": {"kind": "casting"}}
    group["start"] = {"kind": "area", "low": [3, 0.5], "high": [3.8, 2.5]}
    robots = [{"name": name, **group} for name in names]
    return fake_run.simulation(fake_run.scenario(2, maps=[], robots=robots, duration=1))


def test_states_are_those_of_the_robots_own_group(tmp_path):
    sim = of_groups("ab", 2)
    sim.teams[1].state_names = ("one", "two", "three")  # type: ignore[attr-defined]
    table = robots_table.RobotTable(sim, tmp_path / "robots.parquet")
    table.start()
    table.sample(sim)
    table.close()
    rows = pq.read_table(tmp_path / "robots.parquet").to_pydict()
    state = sim.swarm.snapshot()["state"]
    names = ["search", "surge"], ["one", "two", "three"]
    assert rows["state"] == [names[i // 2][state[i]] for i in range(4)]
    assert rows["group"] == ["a", "a", "b", "b"]


def test_columns_tell_their_unit_and_meaning(tmp_path):
    sim, table = run_with_table(tmp_path, duration=1)
    table.sample(sim)
    table.close()
    schema = pq.read_schema(tmp_path / "robots.parquet")
    kinds = {"t": "double", "trial": "int32", "robot": "int32", "found": "bool"}
    kinds |= dict.fromkeys(("declarations", "false_declarations"), "int32")
    named = dict.fromkeys(("group", "state"), "dictionary<values=string, indices=int32, ordered=0>")
    assert schema.names == [
        *("t", "group", "trial", "robot", "x", "y", "heading", "reading_ppm", "resistance_ohm", "true_ppm"),
        *("wind_x", "wind_y", "believed_x", "believed_y", "believed_heading", "state", "found"),
        *("declared_x", "declared_y", "declarations", "false_declarations"),
    ]
    for field in schema:
        assert str(field.type) == (kinds | named).get(field.name, "float"), field.name
        assert field.metadata[b"meaning"], field.name
    units = {field.name: field.metadata[b"unit"].decode() for field in schema}
    assert (units["x"], units["wind_y"], units["resistance_ohm"]) == ("m", "m/s", "ohm")
    assert (units["t"], units["believed_heading"], units["state"]) == ("s", "rad", "1")


def test_what_is_not_known_is_null(tmp_path):
    sim, table = run_with_table(tmp_path, duration=1)
    now = sim.swarm.snapshot()
    now["resistance_ohm"] = np.where(np.arange(8) < 4, np.nan, 1e4)
    sim.swarm.snapshot = lambda: now
    table.sample(sim)
    table.close()
    rows = pq.read_table(tmp_path / "robots.parquet")
    assert rows["resistance_ohm"].to_pylist() == [None] * 4 + [1e4] * 4


def test_groups_of_one_team_have_its_states(tmp_path):
    sim = of_groups("abc", 1)
    own = SimpleNamespace(numbers=(1,), state_names=("one", "two"))
    both = SimpleNamespace(numbers=(0, 2), state_names=("search", "surge"))
    sim.teams = [both, own]  # type: ignore[list-item]
    assert sim.state_names() == [("search", "surge"), ("one", "two"), ("search", "surge")]


def test_bytes_depend_neither_on_flushes_nor_on_a_resumption(tmp_path, monkeypatch):
    monkeypatch.setattr(run_tables, "ROW_GROUP", 80)
    contents = []
    for name, period in (("seldom", 100), ("often", 7)):
        (tmp_path / name).mkdir()
        sim, table = run_with_table(tmp_path / name, duration=4)
        sim.observers.append(Every(0.1 * period, lambda s, table=table: table.flush()))
        sim.run()
        table.close()
        contents.append(table.path.read_bytes())
    sim, table = run_with_table(tmp_path, duration=4)
    for _ in range(20):
        sim.observe()
        sim.advance()
    table.flush()
    rows = table.rows
    sim.observe()  # a row that is on the disk when the run is cut off, after the checkpoint
    table.flush()
    again = robots_table.RobotTable(sim, tmp_path / "robots.parquet")
    again.rows = rows
    again.resume()
    sim.observers[-1] = again.observer()
    sim.run()
    again.close()
    assert contents == 2 * [again.path.read_bytes()]
    assert not again.stream.exists()


def test_full_disk_is_noticed_before_it_is_full(tmp_path, monkeypatch):
    monkeypatch.setattr(run_tables, "ROW_GROUP", 80)
    sim, table = run_with_table(tmp_path, duration=10)
    usage = SimpleNamespace(free=10 * disk.RESERVE)
    monkeypatch.setattr(disk.shutil, "disk_usage", lambda _: usage)
    sim.observers.insert(0, Every(5.0, lambda s: setattr(usage, "free", 0 if s.t > 4 else usage.free)))
    with pytest.raises(OSError, match="full") as caught:
        sim.run()
    assert caught.value.errno == errno.ENOSPC
    usage.free = 10 * disk.RESERVE
    table.close()
    file = pq.ParquetFile(tmp_path / "robots.parquet")
    assert file.num_row_groups > 1
    assert file.read().column("t").to_numpy().max() > 4


@pytest.mark.skipif(os.name == "nt", reason="no limit on file sizes")
def test_limit_on_file_sizes(tmp_path, monkeypatch):
    monkeypatch.setattr(disk, "largest_file", lambda: disk.FILE_RESERVE + 1000.0)
    disk.require_room(tmp_path / "new", 1000)
    with pytest.raises(OSError, match="file sizes") as caught:
        disk.require_room(tmp_path / "new", 1001)
    assert caught.value.errno == errno.EFBIG


def test_large_swarms_are_sampled_less_often(tmp_path, monkeypatch):
    monkeypatch.setattr(robots_table, "MOST_ROWS", 100)
    sim, table = run_with_table(tmp_path, duration=10)
    sim.run()
    table.close()
    assert pq.ParquetFile(tmp_path / "robots.parquet").metadata.num_rows <= 2 * 100


# ---------------------------------------------------------------- result.json


def test_result(tmp_path):
    sim = fake_run.simulation(fake_run.scenario(2, duration=9, warm_up=1))
    sim.run()
    result.write_result(tmp_path, result.result(sim, "completed", "", "cpu"))
    reported = json.loads((tmp_path / "result.json").read_text(), parse_constant=pytest.fail)
    assert (reported["status"], reported["seed"], reported["backend"]) == ("completed", 7, "cpu")
    assert reported["cells"] == 80 * 60
    assert reported["simulated_s"] == pytest.approx(10)
    assert reported["steps"] == 100
    assert reported["gas"]["relative_error"] == pytest.approx(0.05)  # 2 emitted, 1.9 found again
    (group,) = reported["groups"]
    assert group["success_rate"] == 1
    for key, value in {"time_s": 8, "found": 1, "path_m": 1.8, "team_path_m": 7.2}.items():
        assert group["per_trial"][key] == pytest.approx([value, value])
    series, _ = reported["maps"]
    assert series["kind"] == "time_series"
    assert series["correlation"] == pytest.approx(1)
    assert series["forecast"] == {"time_s": [5.0], "error_ppm": [pytest.approx(10 / 6)]}
    assert [file.name for file in tmp_path.iterdir()] == ["result.json"]


def test_warm_up_counts_in_whole_ticks(tmp_path):
    sim = fake_run.simulation(fake_run.scenario(2, duration=2, warm_up=0.25, tick=0.1))
    sim.run()
    reported = result.result(sim, "completed", "", "cpu")
    assert reported["simulated_s"] == pytest.approx(reported["steps"] * 0.1) == pytest.approx(2.3)


def test_failed_search_is_null(tmp_path):
    sim = fake_run.simulation(fake_run.scenario(2, duration=2))
    sim.run()
    result.write_result(tmp_path, result.result(sim, "completed", "", "cpu"))
    (group,) = json.loads((tmp_path / "result.json").read_text())["groups"]
    assert group["per_trial"]["success"] == [False, False]
    assert group["per_trial"]["time_s"] == [None, None]
    assert group["median_time_s"] is None


def test_result_is_replaced_at_once(tmp_path):
    result.write_result(tmp_path, {"n": 1, "x": float("nan"), "y": [np.float32("inf"), np.arange(2)]})
    with pytest.raises(TypeError):
        result.write_result(tmp_path, {"n": 2, "x": object()})
    assert json.loads((tmp_path / "result.json").read_text()) == {"n": 1, "x": None, "y": [None, [0, 1]]}
    assert len(list(tmp_path.iterdir())) == 1


# ---------------------------------------------------------------- scores


def test_map_score():
    truth = np.array([[1.0, 2.0], [3.0, 10.0]])
    estimate = np.stack([truth * 2 + 1, np.full((2, 2), np.nan), truth, np.full((2, 2), 4.0)])
    estimate[2, 1, 1] = np.nan
    score = scores.map_score(estimate, truth)
    assert score.mae[[0, 2, 3]] == pytest.approx([5.0, 0.0, 3.0])
    assert np.isnan(score.mae[1])
    assert score.correlation[[0, 2]] == pytest.approx([1, 1])
    assert np.isnan(score.correlation[[1, 3]]).all()
    assert score.known == pytest.approx([1, 0, 0.75, 1])


def test_first_finder_counts():
    model = SimpleNamespace(
        begin=0.5, found="reached", algorithm=SimpleNamespace(may_declare=False, estimates_rates=False)
    )
    group: Any = SimpleNamespace(name="team", start=1, count=2, trials=2, model=model)
    snapshot = {
        "found": np.array([1, 1, 1, 0, 0]),
        "found_time": np.array([1.0, 9.0, 4.0, np.nan, np.nan]),
        "path_length": np.array([1.0, 2.0, 3.0, 4.0, 5.0]),
        "start": np.array([[0.0, 0], [1, 0], [1.5, 0], [2, 0], [3, 0]]),
        "position": np.array([[0.0, 0], [0.3, 0.4], [0.2, 0], [2, 0], [1, 0]]),
        "acquisitions": np.array([9, 1, 2, 3, 4]),
        "hits": np.array([9, 1, 0, 0, 1]),
        "bumps": np.array([9, 0, 0, 2, 1]),
        "reached_time": np.array([1.0, 9.0, 4.0, np.nan, np.nan]),
        "declared_time": np.full(5, np.nan),
        "declared_position": np.zeros((5, 2)),
        "declarations": np.zeros(5, int),
        "false_declarations": np.zeros(5, int),
    }
    places = np.array([[0.0, 0.0], [9.0, 9.0]])
    scenario = SimpleNamespace(
        targets_at=lambda t: np.broadcast_to(places, (*np.shape(t), 2, 2)), rates=np.full(2, np.nan)
    )
    sim: Any = SimpleNamespace(grid=SimpleNamespace(dim=2), scenario=scenario, t=20.0)
    reported = scores.trial_outcomes(sim, group, snapshot)
    expected = {"group": ["team", "team"], "trial": [0, 1], "success": [True, False], "found": [2, 0]}
    expected |= {"acquisitions": [3, 7], "hits": [1, 1], "bumps": [0, 3], "team_path_m": [5.0, 9.0]}
    assert {key: reported[key] for key in expected} == expected
    assert reported["final_distance_m"] == pytest.approx([0.2, 1.0])
    # time since the group set off; the way is 3 m for 1.5 m
    assert [reported[key][0] for key in ("time_s", "path_m", "overhead")] == [3.5, 3.0, 2.0]
    assert np.isnan(reported["time_s"][1])
    assert np.isnan(reported["declarations"]).all()  # casting never declares


def test_summary_has_the_intervals_of_the_textbooks():
    """8 of 10: Wilson 0.490 to 0.943; 1 to 8 hits: 4.5 exp(+- 2.365 sqrt(6/8) / 4.5), Student's t of 7 degrees."""
    times = [*range(1, 9), None, None]
    names = ("time_s", "path_m", "overhead", "acquisitions", "hits", "bumps", "declarations", "outcome")
    names += ("declared_time_s", "localisation_error_m", "false_declarations")
    trials = {name: times for name in names}
    reported = scores.trial_summary({"success": [True] * 8 + [False] * 2, **trials}, duration=100.0)
    assert reported["success_rate"]["low"] == pytest.approx(0.4902, abs=1e-3)
    assert reported["success_rate"]["high"] == pytest.approx(0.9433, abs=1e-3)
    assert reported["time_s"]["mean"] == 4.5
    for end, sign in (("low", -1), ("high", 1)):
        expected = np.log(4.5) + sign * 2.3646 * np.sqrt(6.0 / 8) / 4.5
        assert np.log(reported["hits"][end]) == pytest.approx(expected, rel=1e-3)
    assert 0 < reported["time_s"]["low"] < 4.5 < reported["time_s"]["high"] < 100.0
    few = scores.trial_summary(
        {"success": [True] * 2, **{name: values[6:8] for name, values in trials.items()}}, duration=100.0
    )
    assert few["time_s"]["mean"] == 7.5
    assert np.isnan(few["time_s"]["low"])
    assert reported["time_s"]["n"] == 8
    assert reported["time_with_failures_s"]["mean"] == pytest.approx(23.6)
    none = scores.trial_summary({"success": [False], **{key: [None] for key in trials}}, duration=1.0)
    assert none["time_s"]["mean"] is None
