"""tp.study and tp.contest: the results of the commands, in any program; errors before anything is written."""

import errno
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from html import unescape
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
import yaml

import taichi_plume as tp
from taichi_plume.cli import contest as contest_command
from taichi_plume.cli import study as study_command
from taichi_plume.files.bundled import path_of
from taichi_plume.studies import workers
from taichi_plume.studies.plan import load_plan

BASE = {
    "name": "wide", "duration": 2.0, "domain": {"size": [2, 1.5], "spacing": 0.1},
    "wind": {"kind": "uniform", "velocity": [0.5, 0.0], "gusts": {"intensity": 0.3, "time": "1 s"}},
    "gas": {"kind": "meandering", "sources": [{"position": [0.5, 0.75], "rate": "10 mg/s", "radius": "5 cm"}]},
    "robots": [
        {
            "name": "team", "count": 1, "trials": 3, "algorithm": {"kind": "casting"},
            "start": {"kind": "area", "low": [1.2, 0.3], "high": [1.8, 1.2]},
        }
    ],
}  # fmt: skip
AXIS = {"speed": {"key": "robots.0.algorithm.speed", "values": ["20 cm/s", 0.3]}}
STUDY = {"name": "speeds", "base": BASE, "axes": AXIS, "airs": 2}
PROGRAM = """
import taichi_plume as tp
base = tp.Scenario.from_dict({base!r})
study = {study!r} | {{"base": base}}
results = tp.study(study, out="call", workers=1, progress=False)
print(len(results.runs()))
"""


@pytest.mark.slow
def test_a_program_without_a_main_guard_gets_the_results_of_the_command(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    program = tmp_path / "program.py"
    program.write_text(PROGRAM.format(base=BASE, study=STUDY))
    (tmp_path / "base.yaml").write_text(yaml.safe_dump(BASE))
    (tmp_path / "study.yaml").write_text(yaml.safe_dump(STUDY | {"base": "base.yaml"}))
    done = subprocess.run([sys.executable, program], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["4"]
    assert not done.stderr
    assert study_command.main(["study.yaml", "--out", "command", "--workers", "1", "--quiet"]) == 0
    call, command = (tp.open_study(folder) for folder in ("call", "command"))
    for name in ("trials", "runs", "points"):
        pd.testing.assert_frame_equal(getattr(call, name)(), getattr(command, name)())
    assert len(call.trials()) == 2 * 2 * 3
    html = call._repr_html_()
    assert html.count("<tr") == 1 + 2
    assert "success" in html


@pytest.mark.slow
def test_failed_runs_cause_a_warning_and_other_processes_live_on(tmp_path):
    (tmp_path / "broken.py").write_text(
        "class Broken:\n    def act(self, robots):\n        raise OSError('no idea')\n"
    )
    own = {"kind": "own", "file": str(tmp_path / "broken.py")}
    axes = {"algorithm": {"key": "robots.0.algorithm", "values": [own, {"kind": "casting"}]}}
    other = multiprocessing.get_context("spawn").Process(target=time.sleep, args=(60,))
    other.start()
    try:
        with pytest.warns(UserWarning, match="1 run has failed") as caught:
            results = tp.study(
                STUDY | {"axes": axes, "airs": 1}, out=tmp_path / "out", workers=1, progress=False,
                allow_code=True, allow_outside=True,
            )  # fmt: skip
        assert other.is_alive()
    finally:
        other.kill()
    assert [each.filename for each in caught if "has failed" in str(each.message)] == [__file__]
    assert sorted(results.runs()["status"]) == ["completed", "failed"]
    assert "no idea" in results.runs()["message"].max()


def test_lost_workers_are_an_error_that_keeps_the_tables(tmp_path, monkeypatch):
    def lost(*_: object) -> None:
        raise workers.WorkersError("the workers are gone")

    monkeypatch.setattr(workers.LocalWorkers, "submit", lost)
    with pytest.raises(tp.RunError, match="the workers are gone") as caught:
        tp.study(STUDY, out=tmp_path / "out", progress=False)
    assert caught.value.folder == tmp_path / "out"
    assert set(tp.open_study(tmp_path / "out").runs()["status"]) == {"missing"}


@pytest.mark.skipif(os.name == "nt", reason="POSIX signals")
@pytest.mark.parametrize("signals", [1, 2])
def test_ctrl_c_ends_a_study(tmp_path, monkeypatch, signals):
    """The first lets the tables be written, the second does not wait for them."""
    submit = workers.LocalWorkers.submit

    def interrupt(*given: Any) -> Any:
        for _ in range(signals):
            os.kill(os.getpid(), signal.SIGINT)
        return submit(*given)

    monkeypatch.setattr(workers.LocalWorkers, "submit", interrupt)
    with pytest.raises(KeyboardInterrupt, match="missing" if signals == 1 else "finished runs are kept"):
        tp.study(STUDY, out=tmp_path / "out", workers=1, progress=False)
    assert (tmp_path / "out/runs.parquet").exists() == (signals == 1)
    assert set(tp.open_study(tmp_path / "out").runs()["status"]) <= {"missing", "completed"}


def test_the_first_error_is_reported_if_the_disk_is_full_as_well(tmp_path, monkeypatch):
    def lost(*_: object) -> None:
        raise workers.WorkersError("the workers are gone")

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "the disk is full", "runs.parquet")

    monkeypatch.setattr(workers.LocalWorkers, "submit", lost)
    monkeypatch.setattr("taichi_plume.studies.tables.publish", full)
    with pytest.raises(tp.RunError, match=r"the workers are gone(.|\n)*the disk is full: runs\.parquet"):
        tp.study(STUDY, out=tmp_path / "out", progress=False)


def test_a_study_of_an_example_is_resumed_by_the_same_call(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "studies/wind_speeds").mkdir(parents=True)
    plan = load_plan("studies/wind_speeds")
    assert plan.default_out == Path("studies/wind_speeds")
    assert plan == load_plan(path_of("studies/wind_speeds"))


@pytest.mark.slow
def test_threads_may_execute_studies_at_once(tmp_path):
    main, environment = sys.modules["__main__"], dict(os.environ)
    with ThreadPoolExecutor(2) as threads:
        calls = [
            threads.submit(tp.study, STUDY | {"airs": 1}, out=tmp_path / name, workers=1, progress=False)
            for name in ("a", "b")
        ]
    a, b = (call.result() for call in calls)
    pd.testing.assert_frame_equal(a.trials(), b.trials())
    assert sys.modules["__main__"] is main
    assert dict(os.environ) == environment


@pytest.mark.parametrize(
    ("study", "parts"),
    [
        ({"name": "a", "axes": AXIS}, ["base"]),
        (STUDY | {"base": "nowhere.yaml"}, ["nowhere.yaml"]),
        (STUDY | {"base": 3}, ["base", "3", "Scenario"]),
        (STUDY | {"base": BASE | {"duration": "2 kg"}}, ["duration", "2 kg"]),
        (STUDY | {"axes": {"a": {"key": "robots.0.algorithm.sped", "values": [1]}}}, ["sped", "speed"]),
        ("wind_speds", ["wind_speds"]),
        (7, ["study", "7"]),
    ],
)
def test_bad_studies_are_refused_before_anything_is_written(tmp_path, monkeypatch, study, parts):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(tp.InputError) as caught:
        tp.study(study)
    with pytest.raises(tp.InputError, match="workers: got 'x'"):
        tp.study(STUDY, workers="x")  # type: ignore[arg-type]
    with pytest.raises(tp.InputError, match=r"workers.*scheduler"):
        tp.study(STUDY, workers=2, scheduler="tcp://127.0.0.1:1")
    assert len(caught.value.lines) == 1
    assert all(part in caught.value.lines[0] for part in parts), caught.value.lines
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_a_contest_by_call_has_the_standings_of_the_command(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    line = (
        "--scenarios meandering --algorithms surge_cast,random_walk --airs 2 --searches 2 --workers 1 --quiet"
    )
    assert contest_command.main([*line.split(), "--out", "command"]) == 0
    standings = tp.contest(
        ["surge_cast", "random_walk"], scenarios=["meandering"], airs=2, searches=2, workers=1, out="call",
        progress=False,
    )  # fmt: skip
    assert (tmp_path / "call/contest.csv").read_bytes() == (tmp_path / "command/contest.csv").read_bytes()
    assert standings.table.attrs["units"]["time_s"] == "s"
    trials = standings.study("meandering").trials()
    for row in standings.rows:
        mine = trials[trials["algorithm"] == row.algorithm]
        assert (row.searches, standings.table.success[standings.rows.index(row)]) == (
            4,
            mine["success"].mean(),
        )
    assert standings._repr_html_().count("<tr") == 1 + 2
    assert "scenarios=['meandering'], airs=2, searches=2, out='call')" in unescape(
        (tmp_path / "call/contest.html").read_text()
    )


def test_bad_contests_are_refused_before_anything_is_written(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text("class Mine:\n    def act(self, robots):\n        pass\n")
    refused: list[tuple[dict[str, Any], str]] = [
        ({"algorithms": ["infotax"]}, "infotaxis"),
        ({"algorithms": "casting"}, "algorithms.*list"),
        ({"algorithms": 3}, "algorithms.*3"),
        ({"scenarios": []}, "scenarios.*1"),
        ({"files": "mine.py"}, "files.*list"),
        ({"policies": [3]}, "policies.*3"),
        ({"airs": 0}, "airs.*0"),
        ({"searches": 10**6}, "searches.*1000000"),
        ({"seed": -1}, "seed.*-1"),
        ({"workers": 0}, "workers.*0"),
        ({"workers": True}, "workers.*True"),
        ({"scenarios": ["open_3"]}, "open_3d"),
        ({"files": ["nowhere.py"]}, "nowhere.py"),
        ({"files": ["mine.py"]}, "allow_code=True"),
    ]
    for chosen, part in refused:
        with pytest.raises(tp.InputError, match=part):
            tp.contest(**chosen)
    assert [file.name for file in tmp_path.iterdir()] == ["mine.py"]
