"""Rows of the wall-clock benchmark: ``python clock_rows.py OPTIONS``, OPTIONS in JSON, prints the figures in JSON.

The script is run by its path, with PYTHONPATH set to the measured checkout. As it imports only long-established parts
of the package, it can measure checkouts older than itself.
"""

import json
import os
import sys
import tempfile
import time
from importlib import import_module
from math import prod
from pathlib import Path
from typing import Any

Figures = dict[str, float]
# Rows of scenarios: file, timed span (from, to) [s], and further arguments of the command. The span starts after the
# first window of the maps, which compiles the last kernels. At 2 cm, where a second takes minutes, the span is seven
# ticks after the compiling ticks.
SCENARIOS: dict[str, tuple[str, tuple[float, float], tuple[str, ...]]] = {
    "arena_3d": ("arena_3d", (6.0, 16.0), ()),
    "arena_3d_2cm": (
        "arena_3d",
        (0.2, 0.9),
        ("--no-recording", "--set", "domain.spacing=0.02", "--set", "warm_up=0.2"),
    ),
    "casting_room": ("casting_room", (6.0, 26.0), ()),
    "casting_room_bare": ("casting_room", (6.0, 26.0), ("--no-recording",)),
}
STEPS = {"arena_2d": "arena_2d", "box_2d": "box_2d", "box_3d": "box_3d"}
"""Rows that are cases of steps.py."""


def scenario(checkout: Path, arch: str, config: str, span: tuple[float, float], *more: str) -> Figures:
    """Run the command on a scenario and return timings of a span [s] of it, with recording, tables and maps."""
    from taichi_plume.__main__ import main

    ti = import_module(os.environ.get("TAICHI_PLUME_ENGINE") or "taichi")

    try:
        from taichi_plume.time_loop import Every, TimeLoop
    except ImportError:  # checkouts before the time loop got this name
        from taichi_plume.simulation import Every  # pyright: ignore[reportMissingImports]
        from taichi_plume.simulation import Simulation as TimeLoop  # pyright: ignore[reportMissingImports]

    notes: list[tuple[float, int, float, float]] = []
    cells: list[int] = []

    def note(sim: TimeLoop) -> None:
        ti.sync()
        notes.append((sim.t, sim.steps, time.perf_counter(), time.process_time()))

    to_its_end = TimeLoop.run

    def noting(sim: TimeLoop) -> None:
        cells.append(prod(sim.grid.shape))
        sim.observers.append(Every(sim.dt, note))  # last, so that the tick includes all observers
        to_its_end(sim)

    TimeLoop.run = noting
    path = checkout / "configs" / f"{config}.yaml"
    with tempfile.TemporaryDirectory() as folder:
        args = [str(path), "--out", f"{folder}/run", "--quiet", "--arch", arch, "--duration", str(span[1])]
        code = main(["run", *args, "--set", "stop_early=false", *more])
    if code:
        raise RuntimeError(f"{config} ended with exit code {code}")
    first, last = (min(notes, key=lambda entry: abs(entry[0] - t)) for t in span)
    simulated, steps, wall, cpu = (b - a for a, b in zip(first, last, strict=True))
    return {
        "s/s": wall / simulated,
        "CPU s/s": cpu / simulated,
        "steps/s": steps / simulated,
        "ms/step": 1e3 * wall / steps,
        "M cell-steps/s": 1e-6 * cells[0] * steps / wall,
    }


def steps(case: str, arch: str, seconds: float) -> Figures:
    """Return the figures of a case of steps.py, run for about `seconds`."""
    from taichi_plume.validation.benchmark.steps import measure

    row = vars(measure(case, arch, seconds))
    columns = {
        "M cell-steps/s": "Mcell_steps_per_s",
        "ms/step": "ms_per_step",
        "s/s": "wall_per_simulated",  # missing in older checkouts
        "iterations": "pressure_iterations",
    }
    return {unit: row[key] for unit, key in columns.items() if key in row}


def robots(arch: str, count: int) -> Figures:
    """Return the timings of ticks of `count` casting robots."""
    from taichi_plume.validation.benchmark.robots import ticks

    row = ticks("robots", arch, "casting", count)
    return {
        "M robot-steps/s": row.Mrobot_steps_per_s,
        "measure ms": row.measure_ms,
        "act ms": row.act_ms,
        "move ms": row.move_ms,
        "CPU us": row.cpu_us,
    }


def figures(name: str, options: dict[str, Any]) -> Figures:
    """Return the figures of the row `name`, with the memory bandwidth [GB/s] and the load of the same minute."""
    from taichi_plume.validation.benchmark.steps import bandwidth

    arch, load = options["arch"], os.getloadavg()[0]
    triad = bandwidth()
    if name in SCENARIOS:
        config, span, more = SCENARIOS[name]
        values = scenario(Path(options["checkout"]), arch, config, span, *more)
    elif name in STEPS:
        values = steps(STEPS[name], arch, options["seconds"])
    else:
        values = robots(arch, options["robots"])
    return values | {"triad GB/s": triad, "load": load}


if __name__ == "__main__":
    options = json.loads(sys.argv[1])
    print(json.dumps(figures(options["row"], options)), flush=True)
