"""Overhead of the worker of a study, and savings by sharing a computed flow between searches.

    python -m taichi_plume.validation.benchmark studies shared [CONFIG] [--searches N] [--alone N] [--duration S]
    python -m taichi_plume.validation.benchmark studies overhead [CONFIG] [--runs N]

`shared` runs searches in one flow that is filmed once, and compares them with the same searches run by a command each,
and by resets of a warm simulation. Of the latter only N are run, and their mean is scaled up. `overhead` runs a cheap
scenario repeatedly in this process. It reports the seconds per run outside the simulation and the memory of the
process. Times are CPU time of the process and wall time.
"""

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import psutil

from taichi_plume.assembly.preparation import load_scenario
from taichi_plume.guard.terminal import Parser, say
from taichi_plume.studies.air_plan import why_not
from taichi_plume.studies.messages import Options, Record, Request, Task
from taichi_plume.studies.shared_air import solve_air
from taichi_plume.studies.task_execution import execute_task
from taichi_plume.validation.case import Keys

ROOT = Path(__file__).resolve().parents[2]
STEPS = 10  # lines of the table of `overhead`


def main(arguments: Sequence[str]) -> int:
    """Run the measurement named on the command line and return the exit code."""
    parser = Parser(prog="python -m taichi_plume.validation.benchmark studies", description=__doc__)
    parser.add_argument("what", choices=("shared", "overhead"))
    parser.add_argument("config", nargs="?", help="a scenario (default: casting_room, or gaussian)")
    parser.add_argument("--searches", type=int, default=100, help="searches in one flow (default: 100)")
    parser.add_argument("--alone", type=int, default=2, help="searches without sharing (default: 2)")
    parser.add_argument("--runs", type=int, default=2000, help="runs of `overhead` (default: 2000)")
    parser.add_argument("--set", action="append", default=[], metavar="PATH=VALUE", help="change a key")
    args = parser.parse_args(list(arguments))
    config = args.config or ("casting_room" if args.what == "shared" else "gaussian")
    file = Path(config) if Path(config).suffix else ROOT / "configs" / f"{config}.yaml"
    base = load_scenario(file, args.set).model_dump(mode="json", exclude_none=True)
    with tempfile.TemporaryDirectory() as folder:
        if args.what == "shared":
            return _shared(base, file, Path(folder), args)
        return _overhead(base, file, Path(folder), args.runs)


def _task(base: Keys, file: Path, out: Path, runs: int, film: Path | None = None) -> Task:
    """Return a task of `runs` searches with different seeds in one flow, played from `film` if given."""
    options = Options(out, (), {}, False, True, {})
    seed = base.get("air_seed", base["seed"])
    requests = tuple(
        Request(f"{n:016x}", n, 0, {}, n, seed, "air", True, {"seed": n, "air_seed": seed}, "one")
        for n in range(runs)
    )
    return Task(base, file.resolve().parent, requests, options, film)


def _timed(work: Any, *given: Any) -> tuple[Any, float, float]:
    """Return the result of the call work(*given), its CPU time in this process and its wall time [s]."""
    cpu, clock = time.process_time(), time.perf_counter()
    result = work(*given)
    return result, time.process_time() - cpu, time.perf_counter() - clock


def _shared(base: Keys, file: Path, folder: Path, args: Any) -> int:
    fault = why_not(load_scenario(file, args.set), {}, "exact")
    if fault:
        say(f"{file}: its air cannot be shared: {fault}", error=True)
        return 2
    n, film = args.searches, folder / "airs" / "one.zarr"
    task = _task(base, file, folder, n, film)
    air, cpu_air, clock_air = _timed(solve_air, task)
    if air.message:
        say(air.message, error=True)
        return 1
    records, cpu, clock = _timed(execute_task, task)
    _tell(f"one air, filmed: {air.frames} frames, {air.bytes / 1e6:.0f} MB", cpu_air, clock_air)
    _tell(f"{n} searches in its film, with the start of Taichi", cpu, clock)
    subset = task._replace(requests=task.requests[: args.alone], film=None)
    execute_task(subset._replace(requests=subset.requests[:1]))  # compiles
    alone, cpu_warm, clock_warm = _timed(execute_task, subset)
    same = [a._replace(cost=b.cost) == b for a, b in zip(alone, records, strict=False)]
    cpu_apart, clock_apart = _commands(base, file, folder, subset)
    for how, its_cpu, its_clock in (
        ("simulations in one process", cpu_warm / args.alone, clock_warm / args.alone),
        ("separate commands", cpu_apart / args.alone, clock_apart / args.alone),
    ):
        _tell(f"mean of {args.alone} {how}", its_cpu, its_clock)
        ratios = n * its_cpu / (cpu + cpu_air), n * its_clock / (clock + clock_air)
        say(
            f"  {n} {how}: {ratios[0]:.1f} times the CPU time of a shared air, {ratios[1]:.1f} times its wall time"
        )
    say(f"  the same to the bit: {sum(same)} of {len(same)}")
    return 0 if all(same) else 1


def _tell(what: str, cpu: float, clock: float) -> None:
    say(f"{what}: {cpu:.2f} CPU s, {clock:.2f} s", flush=True)


def _commands(base: Keys, file: Path, folder: Path, task: Task) -> tuple[float, float]:
    """Return CPU and wall time [s] of the runs of a task, each by the command, without recording and report."""
    source = folder / "scenario.yaml"
    source.write_text(json.dumps(base))
    clock, cpu = 0.0, 0.0
    for number, request in enumerate((task.requests[0], *task.requests)):  # the first one fills the cache
        changes = [f"--set={key}={value}" for key, value in request.changes.items()]
        command = [sys.executable, "-m", "taichi_plume.run", str(source), *changes]
        command += ["--out", str(folder / f"run{number}"), "--quiet", "--no-recording", "--no-report"]
        before, begun = sum(os.times()[2:4]), time.perf_counter()
        subprocess.run([*command, "--allow-outside"], cwd=file.resolve().parent, check=True)
        if number:
            cpu += sum(os.times()[2:4]) - before
            clock += time.perf_counter() - begun
    return cpu, clock


def _overhead(base: Keys, file: Path, folder: Path, runs: int) -> int:
    task = _task(base, file, folder, runs)
    process, each = psutil.Process(), max(1, runs // STEPS)
    records: list[Record] = execute_task(task._replace(requests=task.requests[:1]))
    records.clear()
    beyond, cpu = [], 0.0
    for n, request in enumerate(task.requests):
        (record,), its, _ = _timed(execute_task, task._replace(requests=(request,)))
        if record.status == "failed":
            say(record.message, error=True)
            return 1
        cpu += its
        beyond.append(record.cost.total_s - record.cost.simulation_s)
        if (n + 1) % each == 0:
            half = statistics.median(beyond[-each:])
            say(
                f"{n + 1:6} runs: {process.memory_info().rss / 1e6:7.1f} MB, CPU per run {1e3 * cpu / each:6.2f} ms, "
                f"beyond the simulation {1e3 * half:6.2f} ms (median), {1e3 * sum(beyond[-each:]) / each:6.2f} ms "
                f"(mean); simulation {1e3 * record.cost.simulation_s:6.2f} ms",
                flush=True,
            )
            cpu = 0.0
    return 0
