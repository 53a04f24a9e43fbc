"""Signals while files are begun, while a run goes on and while it ends."""

import os
import signal
import sys
from pathlib import Path

import fake_run
import pytest
from scripts import python, read_result

from taichi_plume.assembly import assemble
from taichi_plume.cli import run
from taichi_plume.execution import execute as running
from taichi_plume.execution import outputs
from taichi_plume.time_loop import Every

pytestmark = [
    pytest.mark.usefixtures("taichi"),
    pytest.mark.skipif(os.name == "nt", reason="POSIX signals"),
    pytest.mark.slow,
]
SCENARIO = """
duration: 2
domain: {size: [2.0, 1.5], spacing: 0.1}
wind: {kind: uniform, velocity: [0.3, 0]}
gas: {kind: gaussian_plume, sources: [{position: [0.4, 0.75], rate: 1e-6}], diffusivity: 0.01}
"""
OBSERVERS: list[Every] = []


@pytest.fixture
def started(tmp_path, monkeypatch):
    """Runs a fake simulation into `out`; what is in OBSERVERS watches it."""

    def built(_, driven):
        sim = fake_run.simulation(fake_run.scenario(2, duration=2, maps=[], checkpoint=None))
        sim.observers += OBSERVERS
        return sim

    OBSERVERS.clear()
    monkeypatch.setattr(assemble, "build", built)
    monkeypatch.setattr(signal, "signal", allowing(signal.signal))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.yaml").write_text(SCENARIO)
    return lambda: run.main(["a.yaml", "--out", "out", "--quiet", "--no-recording", "--force"])


def allowing(function):
    """`signal.signal`, to which no signal is ignored: tests may run in the background, or under nohup."""
    for number, usual in ((signal.SIGINT, signal.default_int_handler), (signal.SIGHUP, signal.SIG_DFL)):
        if signal.getsignal(number) is signal.SIG_IGN:
            function(number, usual)
    return function


def before(function, number: int, times: int = 1):
    """The function, where so many signals come as it is called."""

    def wrapped(*args, **more):
        for _ in range(times):
            signal.raise_signal(number)
        return function(*args, **more)

    return wrapped


def at_one(number: int, times: int) -> Every:
    """So many signals one second after the begin."""
    signals = before(lambda: None, number, times)
    return Every(1.0, lambda sim: signals() if sim.t else None)


def status() -> str:
    return read_result(Path("out"))["status"]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGXCPU])
@pytest.mark.parametrize("times", [1, 2, 5])
def test_a_run_that_is_asked_to_end_keeps_what_there_is(started, number, times):
    OBSERVERS.append(at_one(number, times))
    assert started() == 130
    assert status() == "interrupted"
    assert Path("out/robots.parquet").exists()
    assert Path("out/manifest.json").exists()


@pytest.mark.parametrize("where", ["_interrupted", "_conclude"])
@pytest.mark.parametrize("times", [1, 3])
def test_signals_while_a_run_ends_do_not_disturb_it(started, monkeypatch, where, times):
    OBSERVERS.append(at_one(signal.SIGINT, 1))
    monkeypatch.setattr(running, where, before(getattr(running, where), signal.SIGTERM, times))
    assert started() == 130
    assert status() == "interrupted"
    assert Path("out/manifest.json").exists()


@pytest.mark.parametrize("where", ["start", "_write_progress"])
def test_a_signal_while_files_are_begun_waits_for_a_tick(started, monkeypatch, where):
    """The new run has its folder already."""
    monkeypatch.setattr(outputs.Outputs, where, before(getattr(outputs.Outputs, where), signal.SIGTERM))
    assert started() == 130
    assert status() == "interrupted"


def test_a_signal_before_files_are_begun_leaves_the_earlier_run(started, monkeypatch):
    assert started() == 0
    kept = {file.name: file.read_bytes() for file in Path("out").iterdir()}
    monkeypatch.setattr(outputs.Outputs, "__init__", before(outputs.Outputs.__init__, signal.SIGINT))
    assert started() == 130
    assert {file.name: file.read_bytes() for file in Path("out").iterdir()} == kept


@pytest.mark.parametrize("ignored", [False, True], ids=["ends", "ignores it"])
def test_a_terminal_that_is_closed_ends_a_run_in_order(tmp_path, ignored):
    """Its progress bar cannot be drawn any more; where the hang-up is ignored, the run goes on without."""
    pty = pytest.importorskip("pty")
    (tmp_path / "a.yaml").write_text(SCENARIO.replace("duration: 2", "duration: 400\ncheckpoint: {every: 1}"))
    command = [sys.executable, "-m", "taichi_plume.run", "a.yaml", "--out", "out", "--no-recording"]
    number, terminal = pty.fork()
    if not number:
        os.chdir(tmp_path)
        signal.signal(signal.SIGHUP, signal.SIG_IGN if ignored else signal.SIG_DFL)
        os.execvp(command[0], command)
    try:
        while not (tmp_path / "out" / "checkpoint.npz").exists():
            os.read(terminal, 1 << 16)
    finally:
        os.close(terminal)
    _, code = os.waitpid(number, 0)
    reported = read_result(tmp_path / "out")
    if ignored:
        assert (os.waitstatus_to_exitcode(code), reported["status"]) == (0, "completed")
    else:
        assert (os.waitstatus_to_exitcode(code), reported["status"]) == (130, "interrupted")
        assert reported["message"].startswith("by SIGHUP")


def test_ctrl_c_while_python_ends_is_no_fault(tmp_path):
    """Python waits there for threads, long after the command's own handlers have gone."""
    program = """
import os, signal, time
from concurrent.futures import ThreadPoolExecutor
from taichi_plume.execution.signals import leave

def late():
    time.sleep(0.3)
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(0.1)

ThreadPoolExecutor(1).submit(late)
leave(130)
"""
    ended = python(tmp_path, "-c", program)
    assert (ended.returncode, ended.stdout, ended.stderr) == (130, "", "")
