"""Runs of a session: started as by the command, stopped, failed, and alive when the server is killed."""

import os
import signal
import subprocess
import sys
import time
import zipfile
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import made_run
import numpy as np
import pytest
from scipy.integrate import quad

from taichi_plume.draw.repeats import Repeats, seeds_of
from taichi_plume.draw.runs import LISTED, Run, changes
from taichi_plume.draw.workplace import Workplace
from taichi_plume.execution import latest_instant
from taichi_plume.execution.result import write_result
from taichi_plume.guard.input_error import InputError

TEXT = """\
name: small
duration: 6
stop_early: false
domain: {size: [2, 1], spacing: 0.1}
wind: {kind: uniform, velocity: [0.3, 0]}
gas: {kind: continuous, diffusivity: 0.01, sources: [{position: [0.4, 0.5], rate: 1e-5}]}
robots:
  - name: team
    count: 2
    start: {kind: positions, positions: [[1.6, 0.3], [1.6, 0.7]]}
    algorithm: {kind: casting}
"""
PATIENCE = 180  # s


def until(condition, patience=PATIENCE):
    end = time.monotonic() + patience
    while not (found := condition()):
        assert time.monotonic() < end, "waited too long"
        time.sleep(0.1)
    return found


def place(folder: Path, text: str = TEXT, **permissions) -> Workplace:
    (folder / "small.yaml").write_text(text)
    return Workplace(folder, folder / "small.yaml", **permissions)


def ended(work: Workplace, run):
    def poll():
        work.watch()
        return run.wall is not None

    until(poll)
    return run


@pytest.mark.slow
def test_a_run_is_that_of_the_command_and_is_seen_as_it_goes(tmp_path):
    work = place(tmp_path)
    run = ended(work, work.run(TEXT))
    assert run.state == "completed", run.output
    assert run.folder == tmp_path / "runs" / "small-1"
    assert [f.name for f in tmp_path.iterdir() if f.suffix == ".yaml"] == ["small.yaml"], (
        "no copy of the text stays"
    )
    sight = run.sight
    assert (sight.t, sight.end, sight.done) == (6, 6, 1)
    assert sight.robots.shape == (3, 2)
    assert len(sight.readings) == 61
    command = [sys.executable, "-m", "taichi_plume.run", "small.yaml", "--out", "by_hand", "--quiet"]
    subprocess.run(
        command, cwd=tmp_path, check=True, env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    )
    tables = [(folder / "robots.parquet").read_bytes() for folder in (run.folder, tmp_path / "by_hand")]
    assert tables[0] == tables[1], "watching changes no result"
    again = work.run(TEXT)
    work.put(TEXT.replace("duration: 6", "duration: 5"))
    third = work.run(work.text)
    for other in (again, third):
        assert ended(work, other).state == "completed"
    assert [other.folder.name for other in work.runs] == ["small-1", "small-2", "small-3"]
    assert third.row()["changed"] == "duration: 6 → 5"
    assert third.row()["simulated"] == "5 s"
    assert " of 2 robots" in run.row()["found"]
    from taichi_plume.draw.downloads import zipped

    names = set(zipfile.ZipFile(zipped(run.folder, tmp_path / "run.zip")).namelist())
    assert {"small-1/robots.parquet", "small-1/report.html", "small-1/recording.rrd"} <= names


@pytest.mark.parametrize(("found", "words"), [(2, "source found"), (1, "ended early")])
def test_the_list_names_success_and_counts_robots(tmp_path, found, words):
    model = made_run.scenario()
    result = made_run.result(model, status="stopped", message="t = 8 s")
    result["groups"][0]["per_trial"]["found"] = [found]
    run = Run(1, made_run.made(tmp_path / "run", model, recording=False, content=result), "")
    assert (run.row()["state"], run.row()["found"]) == (words, f"pair: {found} of 2 robots, the first in 8 s")


def test_a_run_whose_file_says_running_is_interrupted_unless_its_folder_is_locked(tmp_path):
    from taichi_plume.files.own_folder import FolderLock

    model = made_run.scenario()
    folder = made_run.made(tmp_path / "runs/one", model, content=made_run.result(model, status="running"))
    work = place(tmp_path)
    (run,) = work.runs
    assert (run.state, run.words, run.elsewhere) == ("interrupted", "interrupted", False)
    assert run.why == "computed until 10.0 of 10 s"
    lock = FolderLock(folder)
    assert (run.state, run.words, run.elsewhere) == ("running", "running elsewhere", True)
    assert run.past is None
    with pytest.raises(InputError, match=r"^one: is not removed"):
        work.discard(run)
    lock.release()
    assert run.state == "interrupted"
    write_result(folder, made_run.result(model, status="completed"))
    assert run.state == "completed"
    assert run.why == ""


@pytest.mark.parametrize(
    "groups",
    ["5", "[5]", '[{"per_trial": 1}]', '[{"per_trial": [1], "no_search": false, "summary": {"time_s": 1}}]'],
)
def test_a_folder_of_another_program_is_listed_like_a_run(tmp_path, groups):
    """Otherwise the page of its folder could not be opened."""
    study, folder = tmp_path / "studies/a-1", tmp_path / "runs/b-1"
    for each in (study, folder):
        each.mkdir(parents=True)
    (study / "study.yaml").write_text("axes: {seed: {values: [1]}}")
    (study / "base.yaml").write_text("a: [")
    os.utime(study / "study.yaml", (1, 1))
    (folder / "result.json").write_text(f'{{"status": "completed", "groups": {groups}}}')
    (folder / "scenario.yaml").write_text(TEXT)
    rows = [run.row() for run in place(tmp_path).runs]
    assert [row["name"] for row in rows] == ["a-1", "b-1"]
    assert (rows[1]["found"], rows[1]["changed"]) == ("", "")


def test_name_and_pin_of_a_run_are_there_again_at_the_next_start(tmp_path):
    model = made_run.scenario()
    for n in range(LISTED + 2):
        folder = made_run.made(tmp_path / f"runs/made-{n}", model, recording=False)
        os.utime(folder / "result.json", (n, n))
    assert len(place(tmp_path).runs) == LISTED
    made_run.made(tmp_path / "elsewhere", model, recording=False)
    early = Run(1, tmp_path / "runs/made-0")
    before = {file.name: file.read_bytes() for file in early.folder.iterdir() if file.is_file()}
    early.mark("  the\x1b good one ", True)
    after = {file.name: file.read_bytes() for file in early.folder.iterdir() if file.is_file()}
    assert after.keys() - before.keys() == {"draw.json"}
    assert {name: after[name] for name in before} == before, "no file of the run changes"
    runs = place(tmp_path).runs
    assert [run.folder.name for run in runs] == ["made-0", *(f"made-{n}" for n in range(2, LISTED + 2))]
    assert runs[0].pinned
    assert "good one" in runs[0].name
    assert "\x1b" not in runs[0].name
    assert [run.name for run in runs[1:]] == [run.folder.name for run in runs[1:]]
    runs[0].mark("", False)
    assert [run.folder.name for run in place(tmp_path).runs] == [f"made-{n}" for n in range(2, LISTED + 2)]
    for content in ("[]", "{", '{"name": 7, "pinned": "yes"}'):
        (runs[0].folder / "draw.json").write_text(content)
        assert not Run(1, runs[0].folder).pinned
    victim = tmp_path / "victim"
    victim.write_text("mine")
    (runs[0].folder / "draw.json").unlink()
    (runs[0].folder / "draw.json").symlink_to(victim)
    runs[0].mark("other", True)
    assert victim.read_text() == "mine"


def test_a_run_that_is_not_there_yet_keeps_its_name_for_later(tmp_path):
    run = Run(1, tmp_path / "later", TEXT)
    run.mark("mine", False)
    assert not run.folder.exists(), "a run takes no folder that holds files"
    model = made_run.scenario()
    made_run.made(run.folder, model, recording=False)
    run.poll()
    assert Run(1, run.folder).name == "mine"


@pytest.mark.slow
def test_a_room_is_run_with_five_seeds(tmp_path):
    import taichi_plume as tp

    work = place(tmp_path, TEXT + "seed: 3\n")
    run = work.run(work.text, kind=Repeats)
    assert run.folder == tmp_path / "studies/small-1"
    run.mark("five", False)
    ended(work, run)
    assert run.state == "completed", run.output
    assert [f.name for f in tmp_path.iterdir() if f.suffix == ".yaml"] == ["small.yaml"]
    study = tp.open_study(run.folder)
    assert study.runs()["seed"].tolist() == [3, 4, 5, 6, 7]
    points = study.points()
    assert run.found() == [f"team: success {study.by_points.brief()['success [%]'][0]}"]
    words = (
        f"team: success {points.success_words[0]}",
        f"team: time with failures {points.time_with_failures_s_words[0]}",
    )
    assert tuple(run.found(full=True)) == words
    assert "95 % interval" in words[0]
    assert (run.recorded, run.moment(1.0)) == ((0.0, 0.0), None)
    (again,) = place(tmp_path, TEXT + "seed: 3\n").runs
    assert isinstance(again, Repeats)
    assert (again.name, again.state, again.text, again.found()) == (
        "five",
        "completed",
        work.text,
        run.found(),
    )


@pytest.mark.slow
def test_five_seeds_of_a_room_without_robots_have_its_gas_and_a_stop(tmp_path):
    text = TEXT[: TEXT.index("robots:")].replace("continuous, diffusivity: 0.01", "eulerian")
    work = place(tmp_path, text)
    run = ended(work, work.run(text, kind=Repeats))
    assert run.state == "completed", run.output
    (words,) = run.found(full=True)
    assert words.startswith("no robots; gas in the room at the end ")
    assert "5 runs" in words
    long = work.run(text.replace("duration: 6", "duration: 100000"), kind=Repeats)
    until((long.folder / "study.json").is_file)
    long.stop()
    assert ended(work, long).state == "interrupted", long.output
    assert long.why == "0 of 5 runs are done"


def test_seeds_follow_that_of_the_room():
    assert seeds_of("seed: 7") == [7, 8, 9, 10, 11]
    assert seeds_of("name: a") == [0, 1, 2, 3, 4]
    assert seeds_of("seed: 4294967295") == [4294967295, 0, 1, 2, 3]


@pytest.mark.slow
def test_a_run_is_stopped_as_by_ctrl_c(tmp_path):
    work = place(tmp_path, TEXT.replace("duration: 6", "duration: 100000"))
    run = work.run(work.text)

    def runs():
        work.watch()
        return run.state == "running"

    until(runs)
    assert run.left is not None
    assert run.left > 0
    run.stop()
    assert run.state == "stopping"
    assert ended(work, run).state == "interrupted"
    assert (run.folder / "checkpoint.zip").exists() or any("resume" in line for line in run.output)


@pytest.mark.slow
def test_a_run_that_fails_says_why_and_keeps_its_files(tmp_path):
    (tmp_path / "mine.py").write_text(
        "class Mine:\n    def act(self, robots):\n        raise ValueError('no idea')\n"
    )
    text = TEXT.replace("{kind: casting}", "{kind: own, file: mine.py}")
    work = place(tmp_path, text)
    refused = ended(work, work.run(text))
    assert refused.state == "failed"
    assert any("--allow-code" in line for line in refused.output), "no code is executed unasked"
    other = ended(work, work.run(text, [64 * "0"]))
    assert other.state == "failed"
    assert any("mine.py" in line and "SHA-256" in line for line in other.output), "nor other code"
    run = ended(work, work.run(text, work.check()[1].code.values()))
    assert run.state == "failed"
    assert any("no idea" in line for line in run.output)
    assert (run.folder / "result.json").exists()
    assert work.text == text


@pytest.mark.slow
def test_a_run_outlives_a_server_that_is_killed(tmp_path):
    (tmp_path / "small.yaml").write_text(TEXT.replace("duration: 6", "duration: 30"))
    code = (
        "import time; from pathlib import Path; from taichi_plume.draw.workplace import Workplace\n"
        "work = Workplace(Path(), Path('small.yaml')); work.put(work.text + '# mine\\n'); run = work.run(work.text)\n"
        "print(run.process.pid, flush=True); time.sleep(600)"
    )
    server = subprocess.Popen(
        [sys.executable, "-c", code], cwd=tmp_path, stdout=subprocess.PIPE, text=True, start_new_session=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
    )  # fmt: skip
    server.stdout.readline()
    os.killpg(server.pid, signal.SIGKILL)
    server.wait()
    folder = tmp_path / "runs" / "small-1"
    until((folder / "manifest.json").exists)
    assert '"completed"' in (folder / "result.json").read_text()
    assert Workplace(tmp_path, tmp_path / "small.yaml").recovered.text.endswith("# mine\n")


def test_a_run_is_not_written_through_links(tmp_path, monkeypatch):
    victim, outside, inner = tmp_path / "victim", tmp_path / "outside", tmp_path / "inner"
    victim.write_text("mine")
    outside.mkdir()
    inner.mkdir()
    started = []
    alive = SimpleNamespace(poll=lambda: None)
    monkeypatch.setattr(subprocess, "Popen", lambda command, **_: started.append(command) or alive)
    monkeypatch.setattr("taichi_plume.draw.runs.secrets.token_hex", lambda _: "0123abcd")
    (inner / ".small-1.run-0123abcd.yaml").symlink_to(victim)
    work = place(inner)
    run = work.run(TEXT)
    assert victim.read_text() == "mine"
    assert run.scenario.read_text() == TEXT
    assert not run.scenario.is_symlink()
    (inner / "runs").mkdir()
    (inner / "runs/small-2").symlink_to(outside / "made")
    assert work.run(TEXT).folder.name == "small-3"
    (inner / "runs/small-2").unlink()
    (inner / "runs").rmdir()
    (inner / "runs").symlink_to(outside)
    with pytest.raises(InputError, match=r"runs: .*outside.*--allow-outside"):
        work.run(TEXT)
    assert len(started) == 2
    assert list(outside.iterdir()) == []
    assert place(inner, allow_outside=True).run(TEXT).folder == inner / "runs" / "small-1"


def test_stopping_the_command_asks_while_runs_are_alive(monkeypatch, tmp_path, capsys):
    import asyncio
    import io

    from taichi_plume.cli.draw import _asked

    class Terminal(io.StringIO):
        def isatty(self):
            return True

    run = SimpleNamespace(alive=True, stop=lambda: stopped.append(run))
    service: Any = SimpleNamespace(workplace=SimpleNamespace(root=tmp_path, runs=[run]))

    for answer, ends, stops in (
        ("", False, False),
        ("c", False, False),
        ("e", True, False),
        ("s", True, True),
    ):
        monkeypatch.setattr(sys, "stdin", Terminal(f"{answer}\n"))
        event, stopped = asyncio.Event(), []
        _asked(service, signal.SIGINT, event)
        assert (event.is_set(), bool(stopped)) == (ends, stops)
    assert "1 run is alive" in capsys.readouterr().err
    event = asyncio.Event()
    _asked(service, signal.SIGTERM, event)
    assert event.is_set()
    assert "go on" in capsys.readouterr().err


def test_changes_between_runs_are_named():
    assert changes(TEXT, TEXT) == ""
    boxes = "obstacles: [{kind: box, yaw_deg: 1}, {kind: box, yaw_deg: 1}]"
    assert changes(boxes, boxes.replace("1}]", "2}]")) == "box 2, yaw_deg: 1 → 2", "the name in the plan"
    assert changes("a: 1\nb: [1, 2]", "a: 2\nb: [1]") == "a: 1 → 2; b[1]: 2 → —"


def test_a_file_that_is_damaged_is_not_read(tmp_path):
    assert latest_instant.read(tmp_path / "none.npz") is None
    (tmp_path / "bad.npz").write_bytes(b"PK\x03\x04")
    assert latest_instant.read(tmp_path / "bad.npz") is None
    np.savez(tmp_path / "other.npz", a=np.ones(2))
    assert latest_instant.read(tmp_path / "other.npz") is None
    with (tmp_path / "code.npz").open("wb") as file:
        np.savez(file, t=np.array([{}], object))
    assert latest_instant.read(tmp_path / "code.npz") is None
    whole: dict[str, Any] = dict.fromkeys(
        ("t", "end", "done", "speed", "phase", "wind", "robots", "readings"), 1.0
    )
    for pictures in ("[]", "{", '{"a": {}}', '{"a": 1}'):
        np.savez(tmp_path / "pictures.npz", **whole, places=np.empty((0, 0, 2)), pictures=np.array(pictures))
        assert latest_instant.read(tmp_path / "pictures.npz") is None
    np.savez(tmp_path / "pictures.npz", **whole, places=np.empty((0, 0, 2)), pictures=np.array("{}"))
    assert latest_instant.read(tmp_path / "pictures.npz").pictures == {}


def plume(x: float, y: float) -> float:
    """Steady plume [kg/m³] of the text's source, a Gaussian of 5 cm: its puffs of all ages, integrated."""

    def puff(age: float) -> float:
        spread = 0.05**2 + 2 * 0.01 * age
        return 1e-5 / (2 * np.pi * spread) * np.exp(-((x - 0.3 * age) ** 2 + y**2) / (2 * spread))

    return quad(puff, 0, 60, points=[max(1e-3, x / 0.3)], limit=200)[0]


@pytest.mark.usefixtures("taichi")
@pytest.mark.slow
def test_the_latest_instant_holds_the_air_and_the_robots(tmp_path):
    import taichi_plume as tp
    from taichi_plume.guard.yaml_text import parse

    with tp.Simulation(parse(TEXT)) as sim:
        watch = latest_instant.InstantFile(sim.loop, tmp_path / "w.npz")
        watch.written = float("-inf")
        (tmp_path / "victim").write_text("mine")
        (tmp_path / "w.npz.new").symlink_to(tmp_path / "victim")
        sim.run(until=2)
        watch.update(sim.loop)
        assert (tmp_path / "victim").read_text() == "mine"
        sight = latest_instant.read(tmp_path / "w.npz")
        (gas,) = sight.pictures.values()
        assert (gas.quantity, gas.unit, gas.cell, gas.values.shape) == ("ethanol", "ppm", 0.1, (10, 20))
        density = sim.loop.gas.species[0].ppm_per_density
        for n in range(20):
            corners = [(0.1 * n + dx - 0.4, dy) for dx in (0.025, 0.075) for dy in (0.025, 0.075)]
            expected = density * max(plume(x, y) for x, y in corners)
            assert gas.values[5, n] == pytest.approx(expected, rel=0.02, abs=0.01)
        assert sight.wind()[2:] == pytest.approx(np.broadcast_to([[0.3], [0.0]], sight.wind()[2:].shape))
        robots = sim.robots
        assert sight.robots[0] == pytest.approx(robots.x)
        assert sight.robots[2] == pytest.approx(robots.heading)
        assert (sight.t, sight.done) == (2, pytest.approx(2 / 6))
