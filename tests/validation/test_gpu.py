"""Command of the GPU benchmark: rows in processes of their own, limits, and what remains of a row that fails."""

import json
import os
import signal
import subprocess
import threading
import time
from pathlib import Path

import psutil
import pytest

from taichi_plume.validation.benchmark import gpu
from taichi_plume.validation.benchmark.__main__ import main
from taichi_plume.validation.benchmark.gpu import Row

STAND_IN = """
import json, os, sys, time
options = json.loads(sys.argv[1])
print(json.dumps({"us per launch": 2.5, "arch": options["arch"]}), flush=True)
if options["kind"] == "crash":
    os.abort()
if options["kind"] == "memory":
    sys.exit("out of memory")
if options["kind"] == "slow":
    print('{"half a li', end="", flush=True)
    with open(__file__ + ".new", "w") as file:
        file.write(str(os.getpid()))
    os.rename(file.name, __file__ + ".pid")
    time.sleep(60)
print(json.dumps({"launches": 7, "kernels": {"_copy": {"launches": 7.0}}}))
"""


@pytest.fixture
def stand_in(monkeypatch, tmp_path):
    """Rows without kernels, the last of which is slow."""
    (tmp_path / "gpu_rows.py").write_text(STAND_IN)
    rows = {kind: Row(f"the {kind} row", kind, 30.0) for kind in ("good", "crash", "memory")}
    monkeypatch.setattr(gpu, "ROWS", rows | {"slow": Row("the slow row", "slow", 1.0, target="10 M steps/s")})
    monkeypatch.setattr(gpu, "HERE", tmp_path)
    monkeypatch.setattr(gpu, "TWICE", ())
    return tmp_path / "figures.jsonl"


class Patient(subprocess.Popen):
    """Process whose time begins when the slow row has printed its line, however busy the machine is."""

    def wait(self, timeout=None):
        if timeout == 1.0:
            pid_of(Path(self.args[2]))  # pyright: ignore[reportArgumentType, reportIndexIssue]
        return super().wait(timeout)


def pid_of(program: Path) -> int:
    """Id of the process of a slow row, as soon as the row has printed its line."""
    file = Path(f"{program}.pid")
    while not file.exists():
        time.sleep(0.02)
    return int(file.read_text())


def test_rows_that_fail_are_reported_and_the_others_go_on(stand_in, monkeypatch, capsys):
    monkeypatch.setattr(gpu.subprocess, "Popen", Patient)
    order = ["crash", "slow", "memory", "good"]
    assert main(["gpu", "--arch", "cpu", "--json", str(stand_in), "--rows", *order]) == 1
    lines = [json.loads(line) for line in stand_in.read_text().splitlines()]
    assert [line["row"] for line in lines] == order
    assert all(
        line["us per launch"] == 2.5 and line["arch"] == "cpu" for line in lines
    )  # known before the end
    crash, slow, memory, good = lines
    assert "SIGABRT" in crash["error"]
    assert slow["error"] == "cut off after 1 s"
    assert "exit code 1: out of memory" in memory["error"]
    assert "error" not in good
    assert good["kernels"] == {"_copy": {"launches": 7.0}}
    table = capsys.readouterr().out.splitlines()[-4:]
    assert "| the slow row | 2.5 us per launch" in table[1]
    assert table[1].endswith("| 10 M steps/s |")
    assert "| the good row | 2.5 us per launch, arch: cpu, 7 launches |" in table[3]


def test_rows_without_time_left_are_dropped_and_named(stand_in, monkeypatch, capsys):
    monkeypatch.setattr(gpu, "LEAST", 1.0)
    monkeypatch.setitem(gpu.ROWS, "slow", Row("the slow row", "slow", 30.0))
    arguments = ["--rows", "slow", "good", "memory", "--minutes", "0.05"]
    assert main(["gpu", "--arch", "cpu", "--json", str(stand_in), *arguments]) == 1
    (line,) = stand_in.read_text().splitlines()
    assert json.loads(line)["error"] in ("cut off after 3 s", "cut off after 2 s")  # of 0.05 min
    assert "no time left for good, memory" in capsys.readouterr().out


@pytest.mark.skipif(os.name == "nt", reason="POSIX signals")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_row_and_shows_the_others(stand_in, monkeypatch, capsys, number):
    monkeypatch.setitem(gpu.ROWS, "slow", Row("the slow row", "slow", 60.0))
    program = stand_in.parent / "gpu_rows.py"

    def interrupt():
        pid_of(program)
        os.kill(os.getpid(), number)

    threading.Thread(target=interrupt, daemon=True).start()
    assert main(["gpu", "--arch", "cpu", "--json", str(stand_in), "--rows", "good", "slow"]) == 130
    assert not psutil.pid_exists(pid_of(program))
    assert [json.loads(line)["row"] for line in stand_in.read_text().splitlines()] == ["good"]
    said = capsys.readouterr()
    assert "| the good row | 2.5 us per launch" in said.out.splitlines()[-1]
    assert said.err == "interrupted\n"


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (["--rows", "steps_9"], ("--rows", "'steps_9'", "steps_750k")),
        (["--minutes", "0"], ("--minutes", "0 is not above 0")),
        (["--arch", "abacus"], ("--arch", "abacus", "vulkan")),
        (["--json", "/nowhere/figures.jsonl"], ("--json", "/nowhere/figures.jsonl")),
        (["--checkout", "/nowhere"], ("--checkout", "/nowhere", "no package")),
    ],
)
def test_wrong_arguments_are_refused_in_a_line(arguments, parts, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["gpu", *arguments])
    assert ended.value.code == 2
    (message,) = [line for line in capsys.readouterr().err.splitlines() if "error" in line]
    assert all(part in message for part in parts)


def test_more_cells_than_fit_into_the_memory_are_refused(monkeypatch, tmp_path):
    row = Row("steps", "steps", 600.0, {"shape": (100_000, 10_000, 10_000), "seconds": 0.1})
    monkeypatch.setattr(gpu, "ROWS", {"huge": row})
    monkeypatch.setattr(gpu, "TWICE", ())
    file = tmp_path / "figures.jsonl"
    assert main(["gpu", "--arch", "cpu", "--json", str(file)]) == 1
    assert "10,000,000,000,000 cells need about 6000000.0 GB" in json.loads(file.read_text())["error"]


@pytest.mark.slow
def test_rows_of_small_size_are_measured(monkeypatch, tmp_path):
    shape, span = (24, 18, 6), (0.2, 0.4)
    coarse = ["warm_up=0.2", "domain.spacing=0.1"]
    kinds = {
        "device": {},
        "steps": {"shape": shape, "seconds": 0.2},
        "counts": {"shape": shape, "steps": 2},
        "beside_air": {"config": "arena_3d", "span": span, "robots": 10, "set": coarse},
        "robots": {"robots": 100},
        "environments": {"count": 10, "seconds": 0.1},
        "agreement": {"steps": 2, "robots": 10},
        "tests": {"tests": ["grid/test_rng.py"]},
    }
    rows = {kind: Row(kind, kind, 600.0, options) for kind, options in kinds.items()}
    monkeypatch.setattr(gpu, "ROWS", rows)
    monkeypatch.setattr(gpu, "TWICE", ())
    file = tmp_path / "figures.jsonl"
    assert main(["gpu", "--arch", "cpu", "--json", str(file), "--minutes", "60"]) == 0
    found = {line["row"]: line for line in map(json.loads, file.read_text().splitlines())}
    assert found.keys() == kinds.keys()
    assert found["device"]["copy GB/s"] > 0.1
    assert 0.0 < found["device"]["us per launch"] < 1e4
    cells, steps = 24 * 18 * 6, found["steps"]
    assert steps["cells"] == found["counts"]["cells"] == cells
    assert steps["M cell-steps/s"] == pytest.approx(1e-3 * cells / steps["ms/step"])
    assert steps["GB/s"] == pytest.approx(steps["copy GB/s"] * 0.01 * steps["% of the copy bandwidth"])
    counts = found["counts"]
    assert counts["tasks"] >= counts["launches"] > 10
    assert counts["waits"] == 0
    assert found["beside_air"]["ms/step with"] > 0.0
    assert found["robots"]["M robot-steps/s"] > 0.0
    assert found["environments"]["M environment steps/s"] > 0.0
    assert [found["agreement"][name] for name in ("u", "p", "c", "readings")] == [0.0] * 4
    assert " passed in " in found["tests"]["summary"]
    assert found["tests"]["failed"] == []
