"""Rows of the GPU benchmark: ``python gpu_rows.py OPTIONS``, OPTIONS in JSON, prints figures in lines of JSON.

The script is run by its path, with PYTHONPATH set to the measured checkout. As it imports only long-established parts
of the package, it can measure checkouts older than itself.
"""

import ctypes
import json
import os
import re
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from math import prod
from typing import Any

Figures = dict[str, Any]
Options = dict[str, Any]
SHAPES = {"48k": (80, 60, 10), "750k": (200, 150, 25), "6M": (400, 300, 50), "20M": (600, 450, 75)}
"""Numbers of cells of the arena along its axes."""


def library() -> Any:
    """Return the module of the engine, Taichi or Quadrants."""
    import_module("taichi_plume")  # keeps Taichi from the network
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
                entry = self.by_kernel.setdefault(record.name.split("_kernel_")[0], [0, 0, 0.0])
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
        self._names[id(code)] = self._names.get(id(kernel), "?")
        self._tasks.setdefault(
            id(code), tasks
        )  # the engine returns code that it has in memory without printing it
        return code


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


def _arena(shape: tuple[int, ...], note: Callable[[Figures], None]) -> tuple[Any, Callable[[], float]]:
    """Return the flow solver and the step function of the arena, without obstacles where these do not compile."""
    steps = import_module("taichi_plume.validation.benchmark.steps")
    try:
        return steps.arena_step(shape, True)
    except RuntimeError as error:
        note({"obstacles": False, "why": f"{error}"[:160]})
        return steps.arena_step(shape, False)


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


def counts(options: Options, note: Callable[[Figures], None]) -> Figures:
    """Return the launches, tasks and waits of a step of flow and gas in the arena, and the time by kernel."""
    with counting(options["arch"]) as count:
        ti = library()
        import_module("taichi_plume.engine.program").start(options["arch"])
        flow, step = _arena(tuple(options.get("shape") or SHAPES["48k"]), note)
        iterations = _total_iterations(flow)
        for _ in range(3):
            step()
        ti.sync()
        iterations()
        count.clear()
        n = options.get("steps", 5)
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


ROWS: dict[str, Callable[[Options, Callable[[Figures], None]], Figures]] = {"counts": counts}


def main(options: Options) -> None:
    """Measure the row that the options name and print its figures."""
    shown = os.fdopen(os.dup(1), "w")

    def note(figures: Figures) -> None:
        print(json.dumps(figures), file=shown, flush=True)

    note(ROWS[options["row"]](options, note))


if __name__ == "__main__":
    main(json.loads(sys.argv[1]))
