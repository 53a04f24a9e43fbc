import os
import subprocess
import sys
from pathlib import Path

import fake_run
import pyarrow.parquet as pq
import pytest
import rerun as rr
from scripts import read_result

from taichi_plume.assembly import assemble
from taichi_plume.cli import run
from taichi_plume.engine import program
from taichi_plume.execution import robots_table
from taichi_plume.files import disk
from taichi_plume.grid import fields
from taichi_plume.time_loop import Every, UnstableError

SCENARIO = """
name: small
seed: 3
duration: 1
domain: {size: [2.0, 1.5], spacing: 0.1}
wind: {kind: uniform, velocity: [0.3, 0]}
gas: {kind: eulerian, sources: [{position: [0.4, 0.75], rate: 10 mg/s}]}
robots:
  - name: team
    count: 2
    start: {kind: positions, positions: [[1.5, 0.5], [1.5, 1.0]]}
    algorithm: {kind: casting}
maps: [{kind: time_series, window: 0.1}]
"""


@pytest.fixture
def scenario(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "small.yaml"
    path.write_text(SCENARIO)
    return path


@pytest.fixture
def fake(monkeypatch):
    """Runs are fake ones, and `at(t, action)` makes something happen in them."""
    happenings = []

    def built(prepared, driven):
        scenario = fake_run.scenario(2, duration=prepared.scenario.duration, maps=[])
        sim = fake_run.simulation(scenario)
        for at, action in happenings:
            sim.observers.append(Every(at, lambda s, a=at, f=action: f() if s.t >= a else None))
        return sim

    monkeypatch.setattr(assemble, "build", built)
    return lambda at, action: happenings.append((at, action))


def fails(error: BaseException):
    def action():
        raise error

    return action


def readable(folder: Path) -> float:
    """Last time in robots.parquet [s]; the recording has to be whole."""
    rr.chunk.RrdReader(str(folder / "recording.rrd")).recordings()
    rerun = Path(sys.executable).with_name("rerun")
    subprocess.run([rerun, "rrd", "verify", folder / "recording.rrd"], capture_output=True, check=True)
    return pq.read_table(folder / "robots.parquet").column("t").to_numpy().max()


@pytest.mark.slow
def test_a_synthetic_room_tells_how_fast_its_air_mixes(scenario, capsys):
    keys = ("--set", "wind={kind: synthetic}", "--set", "domain={size: [2.0, 1.5, 1.0], spacing: 0.1}")
    source = "gas.sources.0.position=[0.4, 0.75, 0.5]"
    assert run.main([str(scenario), *keys, "--set", source, "--no-recording", "--out", "room"]) == 0
    flow = read_result(Path("room"))["flow"]
    K = flow["eddy_diffusivity_m2_per_s"]
    assert 0.0 < flow["eddy_diffusivity_error_m2_per_s"] < K
    by_law = 3.0 ** (2 / 3) * (0.52 * flow["as_of_air_changes_per_h"] + 0.31) / 3600
    assert pytest.approx(by_law) == K
    assert f"eddy diffusivity [m²/s] {K:.3g}" in " ".join(capsys.readouterr().out.split())
    assert "eddy diffusivity" in Path("room/report.html").read_text()


def test_air_that_cannot_be_measured_costs_no_result(scenario, fake, monkeypatch):
    def mixing(self):
        raise IndexError("off the grid")

    monkeypatch.setattr(fields.Wind, "mixing", mixing)
    assert run.main([str(scenario), "--quiet"]) == 0
    reported = read_result(Path("runs/small-1"))
    assert reported["status"] == "completed"
    assert reported["groups"]
    assert "how fast the air mixes could not be measured: IndexError: off the grid" in reported["remarks"][-1]


@pytest.mark.slow
def test_a_run_leaves_its_directory(scenario, capsys):
    assert run.main([str(scenario)]) == 0
    folder = Path("runs/small-1")
    files = "manifest.json scenario.yaml recording.rrd pictures.zarr robots.parquet maps.zarr result.json report.html"
    assert {file.name for file in folder.iterdir()} - {".lock"} == set(files.split())
    assert read_result(folder)["status"] == "completed"
    assert readable(folder) == pytest.approx(1.0)
    reported = capsys.readouterr().out
    assert all(f"runs/small-1/{name}" in reported for name in ("recording.rrd", "report.html"))


def test_remarks_are_printed_and_kept(scenario, fake, capsys):
    options = ["--no-recording", "--set", "robots.0.reach=0", "--set", "maps=[]"]
    assert run.main([str(scenario), "--out", "out", *options]) == 0
    lines = capsys.readouterr().err.splitlines()
    assert run.main([str(scenario), "--out", "quiet", "--quiet", *options]) == 0
    assert capsys.readouterr() == ("", "")
    assert lines[0].startswith("note: robots[0].reach: 0 m: its robots")
    assert read_result(Path("out"))["remarks"] == [line.removeprefix("note: ") for line in lines]


@pytest.mark.slow
def test_it_can_be_run_again_as_it_is(scenario):
    assert run.main([str(scenario), "--quiet", "--no-recording", "--seed", "9", "--set", "robots.0.count=1",
                     "--set", "robots.0.start.positions=[[1.0, 1.0]]"]) == 0  # fmt: skip
    again = ["runs/small-1/scenario.yaml", "--quiet", "--no-recording", "--out", "again"]
    assert run.main(again) == 0
    tables = [pq.read_table(Path(folder) / "robots.parquet") for folder in ("runs/small-1", "again")]
    assert tables[0].equals(tables[1])
    assert read_result(Path("again"))["seed"] == 9
    assert not (Path("again") / "recording.rrd").exists()


@pytest.mark.slow
def test_its_air_can_be_played_back(scenario):
    starts = "robots.0.start.positions=[[0.8, 0.75], [1.5, 1]]"
    common = ["--no-recording", "--quiet", "--set", "warm_up=2", "--set", starts]
    first = [str(scenario), *common, "--out", "first"]
    assert run.main([*first, "--set", "fields={rate: 10, start: -2}"]) == 0
    film = "{kind: playback, file: first/fields.zarr}"
    again = [str(scenario), *common, "--set", f"wind={film}", "--set", f"gas={film}", "--out", "again"]
    assert run.main(again) == 0
    tables = [pq.read_table(Path(out) / "robots.parquet") for out in ("first", "again")]
    truth = [table.column("true_ppm").to_numpy() for table in tables]
    assert truth[0].max() > 1.0
    assert abs(truth[1] - truth[0]).max() < 1e-4 * truth[0].max()
    resolved = (Path("again") / "scenario.yaml").read_text()
    assert "file: ../first/fields.zarr" in resolved
    assert "species: ethanol" in resolved
    assert run.main(["again/scenario.yaml", "--check", "--allow-outside"]) == 0
    assert run.main([*first, "--force"]) == 0
    assert not Path("first/fields.zarr").exists()
    assert Path("first.old/fields.zarr").exists()


@pytest.mark.parametrize(
    ("options", "fault"),
    [
        (["--set", "domain.spacin=0.1"], "spacing"),
        (["--duration", "-1"], "duration"),
        (["--seed", "x"], "seed"),
        (["--set", "robots.0.start.positions=[[9, 9], [1.5, 1.0]]"], "robots"),
    ],
)
def test_bad_input_is_reported_without_traceback(scenario, options, fault, capsys):
    assert run.main([str(scenario), *options]) == 2
    reported = capsys.readouterr()
    assert (reported.out, fault in reported.err, "Traceback" in reported.err) == ("", True, False)
    assert not Path("runs").exists()


@pytest.mark.slow
def test_full_directory_is_refused(scenario, fake, capsys):
    Path("out").mkdir()
    Path("out/result.json").write_text('{"name": "a", "status": "completed", "seed": 1}')
    assert run.main([str(scenario), "--out", "out"]) == 2
    assert "--force" in capsys.readouterr().err
    assert run.main([str(scenario), "--out", "out", "--force", "--quiet", "--no-recording"]) == 0
    assert read_result(Path("out"))["status"] == "completed"


def test_folder_that_cannot_be_used_is_reported_before_anything_is_made(scenario, monkeypatch, capsys):
    monkeypatch.setattr(assemble, "build", lambda *_, **__: pytest.fail("compiled"))
    Path("out").write_text("mine")
    assert run.main([str(scenario), "--out", "out", "--force", "--quiet"]) == 2
    assert capsys.readouterr().err == "out: is a file; --out takes a folder\n"
    assert Path("out").read_text() == "mine"


def test_missing_device_is_reported_and_leaves_earlier_results(scenario, monkeypatch, capsys):
    def start(arch):
        raise program.DeviceError(f"no {arch} device was found; use --arch cpu or auto")

    monkeypatch.setattr(program, "start", start)
    Path("out").mkdir()
    Path("out/result.json").write_text("{}")
    for options in (["--out", "out", "--force"], []):
        assert run.main([str(scenario), "--arch", "cuda", "--quiet", *options]) == 2
        assert capsys.readouterr().err == "no cuda device was found; use --arch cpu or auto\n"
    assert Path("out/result.json").exists()
    assert not Path("runs").exists()


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="POSIX pipes")
@pytest.mark.parametrize(
    "command",
    ["run small.yaml --check --quiet", "scenario --schema", "run small.yaml --no-recording --duration 0.2"],
)
def test_readers_may_close_the_pipe(scenario, command):
    end, begin = os.pipe()
    os.close(end)
    command = [sys.executable, "-m", *f"taichi_plume.{command}".split()]
    done = subprocess.run(command, stdout=begin, stderr=subprocess.PIPE, check=False)
    os.close(begin)
    assert all(line.startswith(b"note: ") for line in done.stderr.splitlines())
    if "--duration" in command:
        assert done.returncode == 0
        assert read_result(Path("runs/small-1"))["status"] == "completed"
    else:
        assert done.stderr == b""


@pytest.mark.parametrize(
    ("error", "status", "code"),
    [
        (UnstableError("c is not finite"), "unstable", 1),
        (KeyboardInterrupt(), "interrupted", 130),
        (OSError(28, "No space left on device"), "disk_full", 1),
        (ZeroDivisionError("oh"), "failed", 1),
    ],
)
def test_whatever_ends_a_run_its_files_are_kept(scenario, fake, error, status, code, capsys):
    fake(2.0, fails(error))
    assert run.main([str(scenario), "--duration", "5"]) == code
    folder = Path("runs/small-1")
    assert read_result(folder)["status"] == status
    assert readable(folder) == pytest.approx(1.9, abs=0.11)
    reported = capsys.readouterr().err
    assert f"{status}: " in reported
    assert ("recording.rrd" in reported, "Traceback" in reported) == (True, False)


def test_full_disk_is_reported(scenario, fake, monkeypatch, capsys):
    fake(2.0, lambda: monkeypatch.setattr(disk, "RESERVE", 1 << 60))
    assert run.main([str(scenario), "--duration", "5"]) == 1
    folder = Path("runs/small-1")
    assert read_result(folder)["status"] == "disk_full"
    assert "disk is full" in capsys.readouterr().err
    rr.chunk.RrdReader(str(folder / "recording.rrd")).recordings()


def test_a_run_that_cannot_create_its_files_leaves_the_reason(scenario, fake, monkeypatch, capsys):
    """And the earlier run under its new name."""
    assert run.main([str(scenario), "--out", "out", "--quiet"]) == 0
    full = OSError(28, "No space left on device")
    monkeypatch.setattr(robots_table.RobotTable, "start", lambda _: fails(full)())
    assert run.main([str(scenario), "--out", "out", "--quiet", "--force"]) == 1
    assert "the earlier run is now out.old\ndisk_full: " in capsys.readouterr().err
    assert read_result(Path("out"))["status"] == "disk_full"
    assert read_result(Path("out.old"))["status"] == "completed"


def test_all_found_is_stopped(scenario, fake, monkeypatch):
    monkeypatch.setattr(fake_run.FakeSwarm, "all_over", lambda swarm: swarm.t > 1.5)
    assert run.main([str(scenario), "--duration", "5", "--quiet"]) == 0
    reported = read_result(Path("runs/small-1"))
    assert (reported["status"], reported["simulated_s"] < 2) == ("stopped", True)


def test_broken_assembly_leaves_no_folder(scenario, monkeypatch, capsys):
    monkeypatch.setattr(assemble, "build", lambda *_, **__: 1 / 0)
    assert run.main([str(scenario)]) == 1
    assert "ZeroDivisionError" in capsys.readouterr().err
    assert not any(Path("runs").iterdir())
