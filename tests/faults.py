"""Files and messages that a run leaves when it is ended early: ``python tests/faults.py`` writes docs/faults.md."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

DOC = Path(__file__).parents[1] / "docs" / "faults.md"
HEAD = """# Files that an interrupted run leaves

`python tests/faults.py` writes this table, and a test keeps it true. The run writes to the folder `out` with
`checkpoint: {every: 5 s}`; `scenario.yaml` is always there. With a checkpoint nothing is lost: `--resume` continues
from the checkpoint and gives bit-identical results. Without a checkpoint the tables may lack the last ten seconds of
wall time, and the recording the last 2 simulated seconds or 1/250 of the run.

| event | exit code | status | files in the folder | message |
|---|---|---|---|---|
"""
SCENARIO = """
name: long
duration: 1e5
stop_early: false
domain: {size: [2.0, 1.5], spacing: 0.1}
wind: {kind: uniform, velocity: [0.3, 0]}
gas: {kind: gaussian_plume, sources: [{position: [0.4, 0.75], rate: 10 mg/s}], diffusivity: 0.01}
robots:
  - name: team
    count: 2
    reach: 0.01
    start: {kind: positions, positions: [[1.5, 0.5], [1.5, 1.0]]}
    algorithm: ALGORITHM
checkpoint: {every: 5 s}
"""
FAILING = """
class Failing:
    def act(self, robots):
        1 / (robots.t < 12)

    def state(self):
        return None

    def restore(self, state):
        pass
"""
COMMAND = [sys.executable, "-m", "taichi_plume.run", "long.yaml", "--out", "out", "--quiet"]
WAIT = 60.0  # s


class Left(NamedTuple):
    """End of a run: exit code, status in result.json, files, and the lines of the message."""

    code: int
    status: str
    files: list[str]
    message: list[str]


def _prepared(folder: Path) -> None:
    (folder / "long.yaml").write_text(SCENARIO.replace("ALGORITHM", "{kind: casting}"))
    (folder / "own.py").write_text(FAILING)
    (folder / "failing.yaml").write_text(SCENARIO.replace("ALGORITHM", "{kind: own, file: own.py}"))


def _left(folder: Path, code: int, message: str) -> Left:
    out = folder / "out"
    try:
        status = json.loads((out / "result.json").read_text())["status"]
    except (OSError, ValueError, LookupError):
        status = ""
    files = sorted(file.name for file in out.iterdir()) if out.is_dir() else []
    files = [name for name in files if name not in (".lock", "scenario.yaml")]
    text = re.sub(r"t = [\d.]+", "t = ...", message.strip()).replace(f"{folder}/", "")
    text = re.sub(r"[\d,.]+ (rows|MB|instants)", r"... \1", text)
    return Left(code, status, files, text.split("\n"))


def _started(folder: Path, limit: int | None = None) -> "subprocess.Popen[str]":
    """Start a run and wait for its first checkpoint; limit: largest file [bytes]."""

    def prepare() -> None:
        signal.signal(signal.SIGINT, signal.default_int_handler)  # jobs in the background ignore it
        signal.signal(signal.SIGHUP, signal.SIG_DFL)  # and those under nohup this
        if limit is not None:
            import resource

            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    run = subprocess.Popen(COMMAND, stderr=subprocess.PIPE, text=True, cwd=folder, preexec_fn=prepare)
    begin = time.monotonic()
    while not (folder / "out" / "checkpoint.npz").exists() and run.poll() is None:
        if time.monotonic() > begin + WAIT:
            run.kill()
        time.sleep(0.02)
    return run


def _ended(folder: Path, run: "subprocess.Popen[str]") -> Left:
    try:
        _, message = run.communicate(timeout=WAIT)
    finally:
        run.kill()
    return _left(folder, run.returncode, message)


def by_signal(folder: Path, number: int) -> Left:
    """Send a signal."""
    run = _started(folder)
    run.send_signal(number)
    return _ended(folder, run)


def goes_on(folder: Path) -> Left:
    """Send SIGUSR1, which requests a checkpoint; the run continues."""
    run = _started(folder)
    before = (folder / "out" / "checkpoint.npz").stat().st_ino
    run.send_signal(signal.SIGSTOP)
    run.send_signal(signal.SIGUSR1)
    run.send_signal(signal.SIGCONT)
    while (folder / "out" / "checkpoint.npz").stat().st_ino == before and run.poll() is None:
        time.sleep(0.01)
    alive = run.poll() is None
    run.kill()
    left = _ended(folder, run)
    message = ["none: the run continues and writes a checkpoint"]
    return left._replace(code=0 if alive else run.returncode, message=message)


def repaired(folder: Path) -> Left:
    """Complete the files of a killed run."""
    by_signal(folder, signal.SIGKILL)
    done = _command(folder, [sys.executable, "-m", "taichi_plume", "repair", "out"])
    return _left(folder, done.returncode, done.stdout + done.stderr)


def disk_full(folder: Path) -> Left:
    """Limit the size of files."""
    return _ended(folder, _started(folder, limit=3 << 20))


def own_code(folder: Path) -> Left:
    """Raise an error in the user's algorithm."""
    return _run(folder, "failing.yaml", "--allow-code")


def removed(folder: Path) -> Left:
    """Remove the folder of a run."""
    run = _started(folder)
    run.send_signal(signal.SIGSTOP)
    shutil.rmtree(folder / "out")
    run.send_signal(signal.SIGCONT)
    return _ended(folder, run)


def second(folder: Path) -> Left:
    """Start another run with the same folder."""
    run = _started(folder)
    left = _run(folder, "long.yaml", "--force")
    run.kill()
    run.communicate()
    return left._replace(status="running", files=["all of the first run"])


def holds_input(folder: Path) -> Left:
    """Use --force on a folder that contains the scenario of the new run."""
    (folder / "out").mkdir()
    (folder / "out" / "result.json").write_text('{"name": "a", "status": "completed", "seed": 1}')
    (folder / "out" / "mine.yaml").write_text((folder / "long.yaml").read_text())
    return _run(folder, "out/mine.yaml", "--force")


def not_a_run(folder: Path) -> Left:
    """Use --force on a folder with files of other programs."""
    (folder / "out").mkdir()
    (folder / "out" / "result.json").write_text('{"mine": 1}')
    return _run(folder, "long.yaml", "--force")


def _command(folder: Path, command: list[str]) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=2 * WAIT)


def _run(folder: Path, scenario: str, option: str) -> Left:
    command = [scenario if part == "long.yaml" else part for part in COMMAND]
    done = _command(folder, [*command, option])
    return _left(folder, done.returncode, done.stderr)


FAULTS: dict[str, Callable[[Path], Left]] = {
    "Ctrl-C": lambda folder: by_signal(folder, signal.SIGINT),
    "SIGTERM: a batch system or container stops the run": lambda folder: by_signal(folder, signal.SIGTERM),
    "SIGHUP: the terminal is closed": lambda folder: by_signal(folder, signal.SIGHUP),
    "SIGXCPU: the limit of CPU time is reached": lambda folder: by_signal(folder, signal.SIGXCPU),
    "SIGUSR1": goes_on,
    "SIGKILL": lambda folder: by_signal(folder, signal.SIGKILL),
    "SIGKILL, then `python -m taichi_plume repair out`": repaired,
    "a file reaches the size limit, or the disk is full": disk_full,
    "an own algorithm raises an error": own_code,
    "the folder is removed": removed,
    "another run starts with the same folder, with or without `--force`": second,
    "`--force` on a folder that contains an input file of the run": holds_input,
    "`--force` on a folder whose files do not come from a run": not_a_run,
}


def rows() -> str:
    """Return the rows of the table."""
    lines = []
    for what, happen in FAULTS.items():
        with tempfile.TemporaryDirectory() as folder:
            _prepared(Path(folder))
            left = happen(Path(folder))
        message = "<br>".join(f"`{line}`" for line in left.message if line) or "none"
        code = f"killed by {signal.Signals(-left.code).name}" if left.code < 0 else str(left.code)
        lines.append(
            f"| {what} | {code} | {left.status or 'none'} | {', '.join(left.files) or 'none'} | {message} |\n"
        )
    return "".join(lines)


if __name__ == "__main__":
    os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")
    DOC.write_text(HEAD + rows())
    print(DOC.read_text())
