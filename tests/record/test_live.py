"""A run that a viewer follows: what it is sent, that nothing listens beyond the loopback, and its going away."""

import signal
import subprocess
import time
from collections import Counter
from pathlib import Path
from typing import Any

import fake_run
import psutil
import pytest
from recordings import stream

from taichi_plume.cli import run
from taichi_plume.files.run_folder import RunFolderError
from taichi_plume.record import live
from taichi_plume.record.recorder import Recorder
from taichi_plume.time_loop import Every

pytestmark = pytest.mark.usefixtures("taichi")


def rows(recording: Path) -> Counter[str]:
    """Return the number of rows of every entity that changes."""
    found: Counter[str] = Counter()
    for chunk in stream(recording):
        if not chunk.is_static and not chunk.entity_path.startswith("/__"):
            found[chunk.entity_path] += chunk.num_rows
    return found


@pytest.fixture
def viewer(monkeypatch, tmp_path):
    """Use rerun's server without a window as the viewer; return the processes that were opened."""
    opened: list[subprocess.Popen] = []
    start = subprocess.Popen

    def popen(command: Any, *args: Any, **keys: Any) -> subprocess.Popen:
        process = start(command, *args, **keys)
        if "--port" in command:
            opened.append(process)
        return process

    monkeypatch.setattr(live, "OPTIONS", ("--save", str(tmp_path / "seen.rrd")))
    monkeypatch.setattr(subprocess, "Popen", popen)
    yield opened
    for process in opened:
        if psutil.pid_exists(process.pid):
            for one in family(process.pid)[::-1]:
                one.terminate()


def family(pid: int) -> list[psutil.Process]:
    """Return a process and its descendants."""
    process = psutil.Process(pid)
    return [process, *process.children(recursive=True)]


def recorded(path: Path, address: str, observers: tuple[Every, ...] = ()) -> None:
    """A recording of a short run that a viewer at the address follows."""
    sim: Any = fake_run.simulation(fake_run.scenario(2, duration=5))
    recorder = Recorder(sim, path, live=address)
    sim.observers += [*recorder.observers(), *observers]
    recorder.start()
    sim.run()
    recorder.close()


def test_a_viewer_gets_what_the_file_gets_on_the_loopback_alone(viewer, tmp_path):
    address = live.open_viewer()
    sockets: list[Any] = [one for part in family(viewer[0].pid) for one in part.net_connections()]
    assert {one.laddr.ip for one in sockets if one.status == psutil.CONN_LISTEN} == {"127.0.0.1"}
    recorded(tmp_path / "recording.rrd", address)
    time.sleep(0.5)
    first, *children = family(viewer[0].pid)
    for one in children or [first]:
        one.send_signal(signal.SIGINT)
    viewer[0].wait(20)
    whole = rows(tmp_path / "recording.rrd")
    assert whole["/gas/slice"] > 5
    assert rows(tmp_path / "seen.rrd") == whole


def test_a_run_goes_on_when_its_viewer_is_closed(viewer, tmp_path):
    address = live.open_viewer()

    def leave(sim: Any) -> None:
        for one in family(viewer[0].pid)[::-1]:
            one.kill()

    recorded(tmp_path / "recording.rrd", address, (Every(3.0, leave),))
    recorded(tmp_path / "alone.rrd", "")
    assert rows(tmp_path / "recording.rrd") == rows(tmp_path / "alone.rrd")


def test_what_keeps_a_viewer_from_opening_is_one_line(monkeypatch, tmp_path, capsys):
    monkeypatch.chdir(tmp_path)
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(live, "OPTIONS", ("--no-such-option",))
    scenario = Path(__file__).parents[2] / "configs" / "gaussian.yaml"
    assert run.main([str(scenario), "--live", "--quiet"]) == 2
    reported = capsys.readouterr().err
    assert reported.startswith("--live: the viewer cannot be opened: ")
    assert reported.count("\n") == 1
    assert not list(tmp_path.glob("runs/*")), "no folder is left"
    with pytest.raises(SystemExit):
        run.main([str(scenario), "--live", "--no-recording"])


def test_a_viewer_that_would_report_is_not_opened(monkeypatch, tmp_path):
    reported = subprocess.CompletedProcess((), 0, '{"analytics_enabled": true}')
    monkeypatch.setattr(subprocess, "run", lambda *_, **__: reported)
    with pytest.raises(RunFolderError, match="rerun analytics disable"):
        live.quiet(str(tmp_path))


def test_what_a_viewer_reads_says_that_it_sends_nothing(tmp_path):
    environment = live.quiet(str(tmp_path))
    assert '"analytics_enabled":false' in next(tmp_path.rglob("analytics.json")).read_text().replace(" ", "")
    assert environment["HTTPS_PROXY"].startswith("http://127.0.0.1:")
