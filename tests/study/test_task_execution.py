"""Runs of a task: what their records and folders hold, and what becomes of those that fail."""

import json
from math import nan
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
import tasks
from study_rooms import ROOM, UNIFORM, changed

from taichi_plume.cli import run
from taichi_plume.results.run import open_run
from taichi_plume.studies.store import table_of
from taichi_plume.studies.table_rows import found
from taichi_plume.studies.task_execution import execute_task

PROBES = {"points": [{"kind": "line", "name": "a.b", "start": [0.5, 0.6], "end": [1.5, 0.6], "count": 3}]}
BAD_CODE = """
class Late:
    ticks = 0
    def act(self, robots):
        self.ticks += 1
        robots.speed = 0.1
        if self.ticks > 5: raise RuntimeError("my own\\nfault")
"""


def own(folder: Path, code: str = BAD_CODE) -> dict[str, Any]:
    """A scenario whose robots run that code."""
    (folder / "late.py").write_text(code)
    algorithm = {"kind": "own", "file": "late.py", "name": "Late"}
    return changed(UNIFORM, robots=[UNIFORM["robots"][0] | {"algorithm": algorithm}])


def plain(records: Any) -> list[Any]:
    """Without what they cost."""
    return [one._replace(cost=None) for one in records]


@pytest.mark.slow
def test_rows_and_outcomes_are_those_of_the_result_of_the_run_alone(tmp_path):
    base = changed(ROOM, name="alone", seed=3)
    outcomes = {
        "rate": "groups.0.success_rate",
        "mae": "maps.0.per_trial.mae_ppm.1",
        "over_time": "maps[1].mean_gas.error_ppm.1",
        "mass": "gas.emitted_kg",
        "no": "maps.0.nowhere.3",
        "text": "name",
    }
    (record,) = execute_task(tasks.task(base, [{}], tmp_path, outcomes=outcomes))
    assert record.status == "completed", record.message
    (tmp_path / "a.yaml").write_text(json.dumps(base))
    out = tmp_path / "run"
    assert not run.main(
        [str(tmp_path / "a.yaml"), "--out", str(out), "--quiet", "--no-recording", "--no-report"]
    )
    reported = open_run(out).result
    columns = reported["groups"][0]["per_trial"]
    assert len(record.trials) == 3
    for row in record.trials:
        k = row["trial"]
        assert {name: row[name] for name in columns} == {name: values[k] for name, values in columns.items()}
        assert row["searched"]
        assert row["time_with_failures_s"] == (row["time_s"] if row["success"] else 2.0)
        assert (row["group"], row["algorithm"]) == ("casters", "casting")
    group, one = reported["groups"][0], reported["maps"][0]
    assert record.outcomes == {
        "rate": group["success_rate"],
        "mae": one["per_trial"]["mae_ppm"][1],
        "over_time": reported["maps"][1]["mean_gas"]["error_ppm"][1],
        "mass": pytest.approx(reported["gas"]["emitted_kg"]),
        "no": None,
        "text": None,
    }


@pytest.mark.slow
def test_the_tables_hold_what_trials_with_moving_obstacles_count(tmp_path):
    motion = {"path": [[1.0, 1.9, 0.3], [2.0, 0.9, 1.1]]}
    walkers = [{"kind": "cylinder", "center": [0.9, 1.1], "radius": 0.3, "motion": motion}]
    (record,) = execute_task(
        tasks.task(changed(ROOM, obstacles=walkers), [{}], tmp_path, structure="walkers")
    )
    assert record.status == "completed", record.message
    (row,) = table_of([record]).to_pylist()
    for name in ("pushes", "pinned_s"):
        assert [one[name] for one in row["trials"]] == [one[name] for one in record.trials]
    assert max(one["pushes"] for one in record.trials) > 0


def test_what_comes_of_a_run_does_not_depend_on_those_before_it(tmp_path):
    base = changed(UNIFORM)
    seeds = [{"seed": seed} for seed in (1, 2, 3)]
    task = tasks.task(base, seeds, tmp_path)
    one = execute_task(task)
    assert one[1].cost.compiled == one[2].cost.compiled == 0
    back = execute_task(task._replace(requests=task.requests[::-1]))
    assert all(record.cost.compiled == 0 for record in back)
    assert plain(one) == plain(back[::-1])
    assert plain(execute_task(task._replace(limit_s=0.0))) == plain(one[:1])
    assert one[0].trials != one[1].trials


def test_where_there_is_nothing_to_find_nobody_has_failed(tmp_path):
    still = changed(UNIFORM, robots=[UNIFORM["robots"][0] | {"reach": 0.0}])
    (record,) = execute_task(tasks.task(still, [{}], tmp_path, structure="reach"))
    for row in record.trials:
        assert (row["searched"], row["success"], row["time_with_failures_s"]) == (False, None, None)
        assert row["final_distance_m"] > 0


@pytest.mark.slow
def test_what_was_numbers_by_another_structure_is_assembled_anew(tmp_path):
    base = changed(UNIFORM)
    for trials in (3, 4):
        (record,) = execute_task(tasks.task(base, [{"robots.0.trials": trials}], tmp_path))
        assert len(record.trials) == trials


@pytest.mark.slow
def test_what_is_kept_is_a_run_folder_that_can_be_read_and_run_again(tmp_path):
    base = changed(ROOM, probes=PROBES)
    keep = ("robots.parquet", "report.html")
    outcomes = {"wind": "probes.a.b.wind_x", "gone": "probes.a.b.salt", "none": "probes.c.wind_x"}
    task = tasks.task(base, [{"seed": 4}], tmp_path / "out", keep=keep, outcomes=outcomes, structure="kept")
    for _ in range(2):  # the second time in the place of the first
        (record,) = execute_task(task)
        assert record.status == "completed", record.message
    folder = tmp_path / "out" / "kept" / record.run
    assert [path.name for path in folder.parent.iterdir()] == [record.run]
    names = {path.name for path in folder.iterdir()}
    assert names == {"scenario.yaml", "result.json", "manifest.json", *keep}
    kept = open_run(folder)
    assert kept.result["status"] == "completed"
    assert len(kept.robots) == 6 * 21
    assert str(folder / "scenario.yaml") in (folder / "scenario.yaml").read_text().splitlines()[0]
    again = tmp_path / "again"
    assert not run.main([str(folder / "scenario.yaml"), "--out", str(again), "--quiet", "--no-report"])
    assert open_run(again).robots.equals(kept.robots)
    table = pq.read_table(again / "probes.parquet").to_pandas()
    assert record.outcomes["wind"] == pytest.approx(table[table.t >= 0].wind_x.mean(), rel=1e-6)
    assert record.outcomes["gone"] is record.outcomes["none"] is None


def test_probes_leave_no_folder_unless_asked_for(tmp_path):
    task = tasks.task(changed(UNIFORM, probes=PROBES), [{}], tmp_path, outcomes={"u": "probes.a.b.wind_x"})
    (record,) = execute_task(task)
    assert record.outcomes["u"] == pytest.approx(0.5)
    assert not list((tmp_path / "kept").iterdir())
    assert not list((tmp_path / "unfinished").iterdir())


@pytest.mark.slow
def test_a_run_that_fails_is_reported_and_left_to_be_repeated_and_the_next_goes_on(tmp_path):
    base = own(tmp_path)
    changes = [{"duration": 0.4}, {"duration": 2.0}]
    task = tasks.task(base, changes, tmp_path, structure="own", allow_code=True)
    good, bad, again = execute_task(task._replace(requests=(*task.requests, task.requests[0])))
    assert (good.status, bad.status) == ("completed", "failed")
    assert "my own fault" in bad.message
    assert "\n" not in bad.message
    assert not bad.trials
    assert plain([again]) == plain([good])
    left = tmp_path / "failed" / bad.run
    assert (left / "message.txt").read_text().strip() == bad.message
    command = [str(left / "scenario.yaml"), "--out", str(tmp_path / "again"), "--quiet", "--allow-code"]
    assert run.main([*command, "--allow-outside", "--no-recording", "--no-report"]) == 1
    assert json.loads((tmp_path / "again" / "result.json").read_text())["status"] == "failed"
    (tmp_path / "late.py").write_text(BAD_CODE.replace("> 5", "> 500"))
    mending = task.requests[1]._replace(structure="mended")  # the structure counts the content of the file
    (mended,) = execute_task(task._replace(requests=(mending,)))
    assert mended.status in ("completed", "stopped")
    assert not left.exists()


@pytest.mark.parametrize(
    ("code", "allowed", "said"),
    [
        (BAD_CODE.replace("RuntimeError", "SystemExit"), True, "my own fault"),
        (BAD_CODE + "raise SystemExit('I ran')", False, "--allow-code"),
        (BAD_CODE + "raise SystemExit('I ran')", (64 * "0",), "SHA-256"),
    ],
)
def test_code_is_executed_where_it_is_wanted_and_ends_its_run_alone(tmp_path, code, allowed, said):
    task = tasks.task(own(tmp_path, code), [{}], tmp_path, structure=said, allow_code=allowed)
    (record,) = execute_task(task)
    assert record.status == "failed"
    assert said in record.message


def test_robots_that_do_not_fit_fail_alone(tmp_path):
    robots = [
        UNIFORM["robots"][0] | {"count": 2, "start": {"kind": "area", "low": [1, 0.5], "high": [1.3, 0.8]}}
    ]
    changes = [{"robots.0.body.radius": radius} for radius in (0.03, 0.25, 0.03)]
    records = execute_task(tasks.task(changed(UNIFORM, robots=robots), changes, tmp_path, structure="fit"))
    assert [one.status for one in records] == ["completed", "failed", "completed"], records[1].message
    assert "robots[0]" in records[1].message
    assert records[2].cost.compiled == 0


@pytest.mark.parametrize(
    ("content", "path", "number"),
    [
        ({"a": [{"b": 2}]}, "a.0.b", 2.0),
        ({"a": [1, 2]}, "a.2", None),
        ({"a": np.float32(0.5)}, "a", 0.5),
        ({"a": nan}, "a", None),
        ({"a": "1"}, "a", None),
        ({"a": {"b": 1}}, "a", None),
        ({"a": [3]}, "a.-1", None),
    ],
)
def test_a_path_leads_to_a_number_or_to_none(content, path, number):
    assert found(content, path) == number


@pytest.mark.slow
def test_the_folder_of_the_study_is_named_in_no_record(tmp_path):
    records = [execute_task(tasks.task(changed(UNIFORM), [{}], Path(tmp_path, name)))[0] for name in "ab"]
    assert plain(records)[0] == plain(records)[1]
