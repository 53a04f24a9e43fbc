"""Rows of the GPU benchmark: ``python gpu_rows.py OPTIONS``, OPTIONS in JSON, prints figures in lines of JSON.

The script is run by its path, with PYTHONPATH set to the measured checkout. As it imports only long-established parts
of the package, it can measure checkouts older than itself.
"""

import ctypes
import json
import os
import platform
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
import psutil

import taichi_plume
from taichi_plume.engine import program, ti
from taichi_plume.engine.kernels import kernel
from taichi_plume.grid.kernels import Template

Figures = dict[str, Any]
Options = dict[str, Any]
Note = Callable[[Figures], None]
"""Function that prints figures."""


def library() -> Any:
    """Return the module of the engine, Taichi or Quadrants."""
    return import_module(os.environ.get("TAICHI_PLUME_ENGINE") or "taichi")


PROFILED = ("cpu", "cuda")
"""Devices whose kernels the engine's profiler times, task by task."""


class Count:
    """Numbers of launches, of their tasks, and of waits of the host for the device.

    A launched kernel is one task per loop that the engine executes in parallel, and one per stretch of code between
    such loops; a GPU is given each task separately. Tasks are counted by the engine's profiler, or elsewhere than on
    PROFILED devices in the code that the engine prints while it compiles. The host waits if it synchronises with
    launches that may still run, reads a returned number, or passes an array of its own.
    """

    def __init__(self, profiles: bool) -> None:
        self.profiles = profiles
        self.program: Any = None
        self._kept: list[Any] = []  # kernels and their code, whose ids are looked up
        self._names: dict[int, str] = {}
        self._tasks: dict[int, int] = {}
        self._recorded: dict[
            str, str
        ] = {}  # names by those in records, which are from whoever filled the cache
        self._launched: set[int] = set()
        self.clear()

    def clear(self) -> None:
        """Set all numbers to 0."""
        self.launches = self.waits = self.synchronisations = self.numbers = self.arrays = 0
        self.by_kernel: dict[str, list[float]] = {}
        """Launches, tasks and time on the device [ms], by kernel."""
        self._running = False
        self._passed = 0  # arrays of the host that were set for the next launch
        if self.profiles and self.program:
            self.program.sync_kernel_profiler()
            self.program.clear_kernel_profiler()

    @property
    def tasks(self) -> float:
        """Number of tasks of all launches."""
        return sum(tasks for _, tasks, _ in self.by_kernel.values())

    def collect(self) -> None:
        """Add the records of the profiler, if the engine profiles, to the tasks."""
        if self.profiles and self.program:
            self.program.sync_kernel_profiler()
            self.program.update_kernel_profiler()
            for record in self.program.get_kernel_profiler_records():
                name = self._recorded.get(recorded := _recorded_kernel(record), recorded)
                entry = self.by_kernel.setdefault(name, [0, 0, 0.0])
                entry[1:] = entry[1] + 1, entry[2] + record.kernel_time

    def _wait(self) -> None:
        self.waits += self._running
        self._running = False

    def launch_kernel(self, plain: Callable, program: Any, code: Any, context: Any) -> Any:
        """Count the launch of a kernel."""
        self.program = program
        entry = self.by_kernel.setdefault(self._names.get(id(code), "?"), [0, 0, 0.0])
        entry[:2] = entry[0] + 1, entry[1] + self._tasks.get(id(code), 0)
        self.launches += 1
        result = plain(program, code, context)
        if self.profiles and id(code) not in self._launched:
            self._launched.add(id(code))
            program.sync_kernel_profiler()
            program.update_kernel_profiler()
            if records := program.get_kernel_profiler_records():
                self._recorded[_recorded_kernel(records[-1])] = self._names.get(id(code), "?")
        self._running = True
        if self._passed:
            self.arrays += self._passed
            self._passed = 0
            self._wait()
        return result

    def synchronize(self, plain: Callable, program: Any) -> Any:
        """Count a synchronisation."""
        self.synchronisations += 1
        self._wait()
        return plain(program)

    def read(self, plain: Callable, *arguments: Any) -> Any:
        """Count a returned number."""
        self.numbers += 1
        self._wait()
        return plain(*arguments)

    def pass_array(self, plain: Callable, *arguments: Any) -> Any:
        """Count an array of the host that is an argument."""
        self._passed += 1
        return plain(*arguments)

    def create_kernel(self, plain: Callable, program: Any, generate: Callable, name: str, *more: Any) -> Any:
        """Note the name of a kernel."""
        kernel = plain(program, generate, name, *more)
        self._kept.append(kernel)
        self._names[id(kernel)] = name
        return kernel

    def compile_kernel(
        self, plain: Callable, program: Any, config: Any, capabilities: Any, kernel: Any
    ) -> Any:
        """Count the tasks of a kernel in the code that the engine prints, the last version of several."""
        with tempfile.TemporaryFile() as printed:
            if not self.profiles:
                sys.stdout.flush()
                stdout = os.dup(1)
                os.dup2(printed.fileno(), 1)
                config.print_ir = True
            try:
                code = plain(program, config, capabilities, kernel)
            finally:
                if not self.profiles:
                    config.print_ir = False
                    ctypes.CDLL(None).fflush(None)
                    os.dup2(stdout, 1)
                    os.close(stdout)
            printed.seek(0)
            tasks = 0
            for line in printed:
                tasks = 0 if line.startswith(b"kernel {") else tasks + bool(_OFFLOADED.match(line))
        self._kept.append(code)
        self._names.setdefault(id(code), self._names.get(id(kernel), "?"))
        self._tasks.setdefault(
            id(code), tasks
        )  # the engine returns code that it has in memory without printing it
        return code


def _recorded_kernel(record: Any) -> str:
    """Return the name of the kernel of a record, without number and name of the task."""
    return record.name.rsplit("_kernel_", 1)[0]


_OFFLOADED = re.compile(rb"\s*\$\d+ = offloaded")


@contextmanager
def counting(arch: str) -> Iterator[Count]:
    """Context in which launches and waits are counted, by wrapped methods of the engine's core.

    Start the engine within the context, on `arch`: only kernels compiled in it are known by name. The wrapped names
    are the engine's own, so that all checkouts are counted alike.
    """
    core = import_module(f"{library().__name__}._lib").core
    count = Count(arch in PROFILED)
    if count.profiles:
        os.environ["TI_KERNEL_PROFILER"] = os.environ["QD_KERNEL_PROFILER"] = "1"
    else:  # a kernel from the cache prints no code
        os.environ["TI_OFFLINE_CACHE"] = os.environ["QD_OFFLINE_CACHE"] = "0"
    context = core.KernelLaunchContext
    wrapped = [
        *((core.Program, name, getattr(count, name)) for name in _COUNTED),
        (context, "set_arg_external_array_with_shape", count.pass_array),
        *((context, f"get_struct_ret_{kind}", count.read) for kind in ("float", "int", "uint")),
    ]
    plain = [getattr(owner, name) for owner, name, _ in wrapped]

    def through(counted: Callable, method: Callable) -> Callable:
        return lambda *arguments: counted(method, *arguments)

    for (owner, name, counted), method in zip(wrapped, plain, strict=True):
        setattr(owner, name, through(counted, method))
    try:
        yield count
    finally:
        for (owner, name, _), method in zip(wrapped, plain, strict=True):
            setattr(owner, name, method)


_COUNTED = ("create_kernel", "compile_kernel", "launch_kernel", "synchronize")


def _arena(shape: tuple[int, ...], note: Note) -> tuple[Any, Callable[[], float]]:
    """Return the flow solver and the step function of the arena, without obstacles where these do not compile."""
    from taichi_plume.validation.benchmark.steps import arena_step

    try:
        return arena_step(shape, True)
    except RuntimeError as error:
        note({"obstacles": False, "why": f"{error}"[:160]})
        return arena_step(shape, False)


def _total_iterations(flow: Any) -> Callable[[], int]:
    """Return a function for the number of pressure iterations of all solves since its last call."""
    solver, total = flow.solver, 0
    solve = solver.solve

    def counted(*arguments: Any, **more: Any) -> None:
        nonlocal total
        solve(*arguments, **more)
        total += solver.iterations

    def since() -> int:
        nonlocal total
        result, total = total, 0
        return result

    solver.solve = counted
    return since


def counts(options: Options, note: Note) -> Figures:
    """Return the launches, tasks and waits of a step of flow and gas in the arena, and the time by kernel."""
    with counting(options["arch"]) as count:
        program.start(options["arch"])
        flow, step = _arena(tuple(options["shape"]), note)
        iterations = _total_iterations(flow)
        for _ in range(3):
            step()
        ti.sync()
        iterations()
        count.clear()
        n = options["steps"]
        for _ in range(n):
            step()
        launches, waits = count.launches / n, count.waits / n  # without those below
        numbers, arrays = count.numbers / n, count.arrays / n
        iterated = iterations() / n
        count.collect()
    most = sorted(count.by_kernel.items(), key=lambda entry: entry[1][:0:-1], reverse=True)
    return {
        "cells": prod(flow.grid.shape),
        "launches": launches,
        "tasks": count.tasks / n,
        "waits": waits,
        "returned numbers": numbers,
        "host arrays": arrays,
        "iterations": iterated,
        "kernels": {
            name: {"launches": k / n, "tasks": tasks / n} | ({"ms": ms / n} if count.profiles else {})
            for name, (k, tasks, ms) in most[:10]
        },
    }


# ---------------------------------------------------------------- the device


@kernel
def _copy(a: Template, b: Template):
    for n in range(b.shape[0]):
        a[n] = b[n]


@kernel
def _first(a: Template) -> ti.f32:
    return a[0]


ENTRIES = {"cuda": 1 << 28, "cpu": 1 << 24}
"""Numbers that the copy moves, 4 bytes each, read and written; 2^26 on other devices."""


def copy_bandwidth(arch: str) -> float:
    """Return the rate [GB/s] of a kernel that copies a field, reads and writes together."""
    a, b = (ti.field(ti.f32, ENTRIES.get(arch, 1 << 26)) for _ in range(2))
    return 8e-9 * b.shape[0] / _seconds(lambda: _copy(a, b), 10)


def _seconds(work: Callable[[], Any], times: int) -> float:
    """Return the time of a call of `work` [s], of several between two synchronisations; the least of three."""
    work()
    ti.sync()
    spent = []
    for _ in range(3):
        begin = time.perf_counter()
        for _ in range(times):
            work()
        ti.sync()
        spent.append((time.perf_counter() - begin) / times)
    return min(spent)


def device(options: Options, note: Note) -> Figures:
    """Return the device, its copy bandwidth, and the prices of a launch, a read-back and a synchronisation."""
    arch = options["arch"]
    note(_machine(Path(options["checkout"])))
    program.start(arch)
    note({"copy GB/s": copy_bandwidth(arch)})
    a, b = (ti.field(ti.f32, 32) for _ in range(2))

    def launch_and_wait() -> None:
        _copy(a, b)
        ti.sync()

    launch = 1e6 * _seconds(lambda: _copy(a, b), 1000)
    return {
        "us per launch": launch,
        "us per launch with read-back": 1e6 * _seconds(lambda: _first(a), 200),
        "us per launch with synchronisation": 1e6 * _seconds(launch_and_wait, 200),
    }


def _machine(checkout: Path) -> Figures:
    """Return the names of the machine's parts and the versions."""
    engine = library()
    return {
        "card, driver, memory": _card("name,driver_version,memory.total") or "none that nvidia-smi knows",
        "processor": f"{os.cpu_count()} x {platform.processor() or platform.machine()}",
        "engine": f"{engine.__name__} {'.'.join(map(str, engine.__version__))}",
        "Python": platform.python_version(),
        "NumPy": np.__version__,
        "taichi_plume": f"{taichi_plume.__version__} {_reported('git', '-C', str(checkout), 'describe', '--always')}",
    }


def _card(properties: str) -> str:
    """Return properties of the first NVIDIA card, empty without one."""
    return _reported("nvidia-smi", f"--query-gpu={properties}", "--format=csv,noheader", "--id=0")


def _reported(*command: str) -> str:
    """Return the output of a command, empty if it cannot be executed."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=20)
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return "" if done.returncode else done.stdout.strip()


# ---------------------------------------------------------------- steps

BYTES_PER_CELL = 600
"""Memory that a step of flow and gas needs at most, per cell, for fields and their preparation on the host."""
VALUES, VALUES_OF_ITERATION = 180, 60
"""Numbers of 4 bytes that a step of flow and gas moves per cell without its pressure iterations, and an iteration.

Each field that a pass over the cells reads or writes is counted once, as if all neighbours came from the cache: 110 of
the flow, 70 of the gas; 20 of an iteration of conjugate gradients, 40 of a V-cycle (35 on the finest level).
"""


def steps(options: Options, note: Note) -> Figures:
    """Return the speed of steps of flow and gas in the arena, and their share of the copy bandwidth."""
    from taichi_plume.validation.benchmark import steps as case

    arch, shape = options["arch"], tuple(options["shape"])
    needed, free = BYTES_PER_CELL * prod(shape), psutil.virtual_memory().available
    if arch == "cuda" and (of_card := _card("memory.free").split()):  # in MiB
        free = min(free, int(of_card[0]) << 20)
    if needed > free:
        raise MemoryError(
            f"{prod(shape):,} cells need about {needed / 1e9:.1f} GB, {free / 1e9:.1f} GB are free"
        )
    iterations: list[int] = []

    def assembled() -> tuple[Any, Callable[[], float]]:
        flow, step = _arena(shape, note)
        since = _total_iterations(flow)

        def counted() -> float:
            dt = step()
            iterations.append(since())
            return dt

        return flow, counted

    case.CASES["arena"] = assembled
    case.bandwidth = lambda: 0.0  # of the host
    row = case.measure("arena", arch, options["seconds"])
    steady = float(np.mean(iterations[11:]))  # without the first steps, as in `measure`
    figures = {
        "M cell-steps/s": row.Mcell_steps_per_s,
        "ms/step": row.ms_per_step,
        "cells": row.cells,
        "iterations": steady,
        "s for the first step": row.first_step_s,
    }
    note(figures)
    rate = 4e-9 * row.cells * (VALUES + VALUES_OF_ITERATION * steady) / (1e-3 * row.ms_per_step)
    copy = copy_bandwidth(arch)
    return {"GB/s": rate, "copy GB/s": copy, "% of the copy bandwidth": 100 * rate / copy}


# ---------------------------------------------------------------- scenarios, robots, environments


def scenario(options: Options, note: Note) -> Figures:
    """Return the simulated seconds per second of a scenario, with maps, without a recording."""
    from taichi_plume.validation.benchmark import clock_rows

    values = clock_rows.scenario(
        Path(options["checkout"]),
        options["arch"],
        options["config"],
        tuple(options["span"]),
        "--no-recording",
        *(word for setting in options["set"] for word in ("--set", setting)),
    )
    keys = "ms/step", "steps/s", "M cell-steps/s"
    return {"simulated s/s": 1.0 / values["s/s"], **{key: values[key] for key in keys}}


def robots(options: Options, note: Note) -> Figures:
    """Return the speed of robots in gas that stands still."""
    from taichi_plume.validation.benchmark import clock_rows

    return clock_rows.robots(options["arch"], options["robots"])


def beside_air(options: Options, note: Note) -> Figures:
    """Return the cost of robots beside the air of a scenario: its speed without robots, and with `robots` of them."""
    without = scenario(options | {"set": ["maps=[]", "robots=[]", *options["set"]]}, note)
    note({"ms/step without": without["ms/step"]})
    crowd = ["maps=[]", "robots[0].count=1", f"robots[0].trials={options['robots']}", *options["set"]]
    with_robots = scenario(options | {"set": crowd}, note)
    more = with_robots["ms/step"] / without["ms/step"] - 1.0
    return {"ms/step with": with_robots["ms/step"], "% more": 100 * more}


def environments(options: Options, note: Note) -> Figures:
    """Return the steps per second of environments that play films."""
    from taichi_plume.envs.episodes import Episodes
    from taichi_plume.scenario.loading import scenario_from
    from taichi_plume.validation.benchmark import envs

    program.start(options["arch"])
    episodes = Episodes(scenario_from(envs.TASK), count=options["count"], bank=envs.films())
    rate, cpu = envs.rate(episodes, options["seconds"])
    return {"M environment steps/s": 1e-6 * rate, "us of CPU": 1e6 * cpu}


# ---------------------------------------------------------------- agreement and tests

TOLERANCE = 1e-3
"""Largest allowed difference between device and CPU, over the largest value: rounding makes 1e-5 (Vulkan, lavapipe)."""


def agreement(options: Options, note: Note) -> Figures:
    """Return the largest differences of small runs on the device from the same on the CPU, over the largest value.

    Each run has its own process, as Taichi crashes after a change from Vulkan to the CPU.
    """
    figures: Figures = {}
    agrees = True
    with tempfile.TemporaryDirectory() as folder:
        for run in SMALL_RUNS:
            values = []
            for arch in (options["arch"], "cpu"):
                more = {"kind": "small_run", "run": run, "arch": arch, "file": f"{folder}/{run}_{arch}.npz"}
                command = [sys.executable, "-P", __file__, json.dumps(options | more)]
                if code := subprocess.run(command, stdout=subprocess.DEVNULL).returncode:
                    raise RuntimeError(f"{run} on {arch}: exit code {code}")
                values.append(dict(np.load(more["file"])))
            for name, here in values[1].items():
                figures[name] = float(np.abs(values[0][name] - here).max() / np.abs(here).max())
                agrees &= figures[name] <= TOLERANCE
            note(figures)
    return {"allowed": TOLERANCE, "verdict": "agree" if agrees else "DIFFER"}


def small_run(options: Options, note: Note) -> Figures:
    """Write the results of a small run to a file."""
    program.start(options["arch"])
    results: Any = SMALL_RUNS[options["run"]](options)
    np.savez(options["file"], **results)
    return {}


def _flow_and_gas(options: Options) -> dict[str, np.ndarray]:
    """Return velocity, pressure and concentration of the arena, in cells of 10 cm, after steps of 0.03 s."""
    from taichi_plume.validation.benchmark.steps import arena_flow

    flow, gas, _ = arena_flow((40, 30, 8), False)
    for _ in range(options["steps"]):
        flow.advance(0.0, 0.03)
        gas.advance(0.0, 0.03)
    u = [flow.grid.inner(field.to_numpy()).ravel() for field in flow.u]
    return {
        "u": np.concatenate(u),
        "p": flow.grid.inner(flow.p.to_numpy()),
        "c": flow.grid.inner(gas.c.to_numpy()),
    }


def _readings(options: Options) -> dict[str, np.ndarray]:
    """Return the readings of robots after ten ticks."""
    from taichi_plume.validation.benchmark.robots import TICK, crowd

    gas, wind, swarm, sensors, team = crowd("casting", options["robots"])
    for tick in range(1, 11):
        sensors.measure(gas, wind, tick, tick * TICK)
        team.act(tick, tick * TICK, TICK)
        swarm.move(tick, tick * TICK, TICK)
    return {"readings": swarm.reading.to_numpy()}


SMALL_RUNS = {"flow and gas": _flow_and_gas, "robots": _readings}


def tests(options: Options, note: Note) -> Figures:
    """Return the summary of the tests of solvers, grid and agents, and the names of those that fail."""
    checkout = Path(options["checkout"])
    folders = [f"tests/{name}" for name in options["tests"]]
    if not (checkout / "tests").is_dir():
        raise RuntimeError(f"{checkout} has no tests: run the command in a checkout")
    workers = str(min(12, os.cpu_count() or 1))
    command = [sys.executable, "-m", "pytest", *folders, "--arch", options["arch"], "-n", workers]
    command += ["--tb=line", "-rfE", "--maxfail=60", "-p", "no:cacheprovider"]
    process = subprocess.Popen(
        command, cwd=checkout, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    watch = threading.Timer(
        options["limit"] - 15.0, process.send_signal, [signal.SIGINT]
    )  # pytest then summarises
    watch.start()
    lines = process.communicate()[0].splitlines()
    cut = not watch.is_alive()
    watch.cancel()
    failed = [line.partition(" ")[2] for line in lines if line.startswith(("FAILED", "ERROR"))]
    summary = next((line for line in reversed(lines) if " in " in line), lines[-1] if lines else "")
    return {"summary": summary.strip("= ") + " (cut off)" * cut, "failed": failed}


ROWS: dict[str, Callable[[Options, Note], Figures]] = {
    "device": device,
    "steps": steps,
    "counts": counts,
    "scenario": scenario,
    "robots": robots,
    "beside_air": beside_air,
    "environments": environments,
    "agreement": agreement,
    "small_run": small_run,
    "tests": tests,
}
"""Kinds of rows."""


def main(options: Options) -> None:
    """Measure a row of the kind in the options, and print its figures, each as soon as known."""
    shown = os.fdopen(os.dup(1), "w")

    def note(figures: Figures) -> None:
        print(json.dumps(figures), file=shown, flush=True)

    try:
        note(ROWS[options["kind"]](options, note))
    except Exception as error:
        traceback.print_exc()
        note({"error": f"{type(error).__name__}: {error}"[:300]})
        sys.exit(1)


if __name__ == "__main__":
    main(json.loads(sys.argv[1]))
