"""Wall-clock benchmark: wall time per simulated second and rates, beside their targets.

    python -m taichi_plume.validation.benchmark clock [ROW ...] [--checkout FOLDER ...] [--repeats N] [--jax PYTHON]
                                                      [--openfoam [BASHRC] | --openfoam-seconds S S S S]
                                                      [--arch ARCH] [--json]

Each row is measured in its own process, one after the other; several checkouts in turns, row by row. A run is timed in
its steady state, past its first seconds; only `first_command` and the first ticks include the start. `triad` is the
memory bandwidth of the same minute, `load` the load average before. With --jax and --openfoam the same work is measured
with jax-cfd and with OpenFOAM's pimpleFoam on the same machine, in the arena with the obstacles and without; the
verdict is on the second: beside obstacles pimpleFoam only takes shorter steps. The two
processes of pimpleFoam wait for each other: under other load it takes ten times as long. Pass times of a quiet machine
with --openfoam-seconds instead.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

from taichi_plume.guard.terminal import Parser, say
from taichi_plume.validation.benchmark import openfoam, start

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
Figures = dict[str, float]
COSTS = ("s/s", "s")  # less is better; of other figures more
JAX, FOAM, EMPTY = "x jax-cfd", "x OpenFOAM", "x OpenFOAM in the empty arena"


@dataclass(frozen=True)
class Row:
    """Row of the wall-clock benchmark: main figure, and least value and aim of the figure `judged`.

    measure: returns the figures of a checkout. beside: returns the values of other programs in units of `figure`, by
    the name of the ratio to them.
    """

    about: str
    figure: str
    measure: Callable[[str, Path, argparse.Namespace], Figures]
    least: float | None = None
    aim: float | None = None
    judged: str = ""
    beside: Callable[[argparse.Namespace], Figures] = lambda args: {}


@dataclass(frozen=True)
class Timing:
    """Figures of a benchmark row and a checkout. figure: main unit; least and aim hold for the figure `judged`."""

    row: str
    checkout: str
    figure: str
    figures: Figures
    judged: str
    least: float | None
    aim: float | None

    @property
    def verdict(self) -> str:
        """Verdict on the judged figure as text: aim reached, enough, or how many times too slow."""
        value = self.figures.get(self.judged)
        if value is None or self.least is None or self.aim is None:
            return ""
        if _better(self.judged, value, self.aim) >= 1.0:
            return "aim reached"
        share = _better(self.judged, value, self.least)
        return "enough" if share >= 1.0 else f"{1.0 / share:.1f} times too slow"

    def __str__(self) -> str:
        rest = ", ".join(f"{value:.3g} {unit}" for unit, value in self.figures.items() if unit != self.figure)
        goal = f">= {self.least:g}, aim {self.aim:g} {self.judged}" if self.least is not None else ""
        if self.judged in COSTS:
            goal = goal.replace(">=", "<=")
        main = f"{self.figures[self.figure]:7.3g} {self.figure:15}"
        return f"{self.row:18} {self.checkout:12} {main} {goal:32} {self.verdict:20} {rest}".rstrip()


def _better(unit: str, value: float, than: float) -> float:
    """Return how many times better a figure of this unit is than another."""
    return than / value if unit in COSTS else value / than


# ---------------------------------------------------------------- ways to measure


def _apart(name: str, checkout: Path, args: argparse.Namespace) -> Figures:
    """Run clock_rows.py in a process and return its figures. Raises RuntimeError if the process fails."""
    options = {key: vars(args)[key] for key in ("arch", "seconds", "robots")}
    options |= {"row": name, "checkout": str(checkout)}
    command = [sys.executable, "-P", str(HERE / "clock_rows.py"), json.dumps(options)]
    return json.loads(_output(command, checkout))


def _first_command(name: str, checkout: Path, args: argparse.Namespace) -> Figures:
    """Return the wall and CPU time of the README's first command with an empty kernel cache."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "taichi_plume.run", "configs/casting_room.yaml", "--arch", args.arch]
        begin, cpu = time.perf_counter(), _cpu_of_children()
        _output(
            [*command, "--out", f"{folder}/run"], checkout, **dict.fromkeys(start.CACHES, f"{folder}/cache")
        )
        return {"s": time.perf_counter() - begin, "CPU s": _cpu_of_children() - cpu}


def _first_tick(config: str, name: str, checkout: Path, args: argparse.Namespace) -> Figures:
    """Return the time from the start of a process to the first tick, with cached kernels, and other figures."""
    cold, warm = start.starts([checkout], [config], arch=args.arch)
    return {"s": warm.seconds, "CPU s": warm.cpu_seconds, "s cold": cold.seconds, "kernels": warm.kernels}


def _jax_box(n: int, dim: int, args: argparse.Namespace) -> Figures:
    """Return the speed of jax-cfd in M cell-steps/s; nothing without its interpreter."""
    if args.jax is None:
        return {}
    return {
        JAX: float(_output([args.jax, str(HERE / "jax_box.py"), str(n), str(dim), str(args.seconds)], HERE))
    }


def _openfoam(dx: float, steps: int, args: argparse.Namespace) -> Figures:
    """Return the wall time of OpenFOAM per simulated second, with obstacles and without; nothing if not requested."""
    if args.openfoam_seconds is not None:
        first = 2 * SPACINGS.index(dx)
        return dict(zip((FOAM, EMPTY), args.openfoam_seconds[first : first + 2], strict=True))
    if args.openfoam is None:
        return {}
    return {
        name: openfoam.arena(dx, steps, obstacles, args.openfoam)
        for name, obstacles in ((FOAM, True), (EMPTY, False))
    }


def _output(command: Sequence[str], folder: Path, **environment: str) -> str:
    """Run a process with PYTHONPATH set to `folder` and return its last line. Raises RuntimeError if it fails."""
    environment = os.environ | {"PYTHONPATH": str(folder), "ENABLE_TAICHI_HEADER_PRINT": "0"} | environment
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"exit code {done.returncode}: {done.stderr.strip()[-2000:]}")
    return (done.stdout.strip().splitlines() or [""])[-1]


def _cpu_of_children() -> float:
    return sum(os.times()[2:4])


# ---------------------------------------------------------------- the table

SPACINGS = 0.05, 0.02  # m, of the arena
COMMAND, RATE, ROBOTS = "s/s", "M cell-steps/s", "M robot-steps/s"
ROWS: dict[str, Row] = {
    "arena_3d": Row(
        "configs/arena_3d.yaml with recording, 5 cm", COMMAND, _apart, 3.0, 5.0, EMPTY,
        partial(_openfoam, SPACINGS[0], 50),
    ),
    "arena_3d_2cm": Row(
        "the same with 2 cm, 750,000 cells, without recording", COMMAND, _apart, 4.0, 8.0, EMPTY,
        partial(_openfoam, SPACINGS[1], 6),
    ),
    "casting_room": Row(
        "configs/casting_room.yaml with recording", COMMAND, _apart, 0.15, 0.08, COMMAND
    ),
    "casting_room_bare": Row("the same without recording", COMMAND, _apart),
    "first_command": Row(
        "the README's first command, nothing compiled yet, to its end", "s", _first_command, 20.0, 10.0, "s"
    ),
    "arena_2d": Row(
        "flow and gas on 200 x 150 cells with obstacles", RATE, _apart, 8.0, 12.0, RATE
    ),
    "box_2d": Row(
        "flow in a periodic box, 256²", RATE, _apart, 0.5, 1.0, JAX, partial(_jax_box, 256, 2)
    ),
    "box_3d": Row(
        "flow in a periodic box, 64³", RATE, _apart, 1.5, 2.0, JAX, partial(_jax_box, 64, 3)
    ),
    "tick_casting_room": Row(
        "first tick of casting_room, compiled before", "s", partial(_first_tick, "casting_room"), 2.0, 1.0, "s"
    ),
    "tick_arena_3d": Row(
        "first tick of arena_3d, compiled before", "s", partial(_first_tick, "arena_3d"), 4.0, 2.0, "s"
    ),
    "robots": Row("robots casting in 3-D gas", ROBOTS, _apart, 8.0, 10.0, ROBOTS),
}  # fmt: skip


def measured(name: str, args: argparse.Namespace) -> Iterator[Timing]:
    """Yield the figures of a row for each checkout in turns, `repeats` times. Raises RuntimeError on failure."""
    row = ROWS[name]
    for _ in range(args.repeats):
        others = row.beside(args)
        for checkout in args.checkout:
            figures = row.measure(name, checkout.resolve(), args)
            for ratio, other in others.items():
                figures[ratio] = _better(row.figure, figures[row.figure], other)
                figures[f"{row.figure} of {ratio[2:]}"] = other
            yield Timing(name, checkout.resolve().name, row.figure, figures, row.judged, row.least, row.aim)


def compared(timings: Sequence[Timing], checkouts: Sequence[Path]) -> Iterator[str]:
    """Yield lines with the speed-up of each checkout over the first and the ratio of CPU times, by the best runs."""
    figure = timings[0].figure
    cpu = next((unit for unit in timings[0].figures if unit.startswith("CPU")), None)
    names = [checkout.resolve().name for checkout in checkouts]
    for name in names[1:]:
        times = _better(figure, *(_best(timings, checkout, figure) for checkout in (name, names[0])))
        line = f"{timings[0].row:18} {name} is {times:.2f} times as fast as {names[0]}"
        if cpu is not None:
            share = _best(timings, name, cpu) / _best(timings, names[0], cpu)
            line += f", with {share:.2f} of its CPU time"
        yield line


def _best(timings: Sequence[Timing], checkout: str, unit: str) -> float:
    """Return a checkout's best figure in a unit."""
    values = [timing.figures[unit] for timing in timings if timing.checkout == checkout]
    return min(values) if unit in COSTS or unit.startswith("CPU") else max(values)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark with these command-line arguments; return 0, 1 if a row failed, 2 if a row is unknown."""
    args = _arguments(argv)
    unknown = [name for name in args.rows if name not in ROWS]
    if unknown:
        say(f"unknown row {unknown[0]!r}; known: {', '.join(ROWS)}", error=True)
        return 2
    rows: list[Timing] = []
    failed = False
    for name in args.rows or ROWS:
        timings: list[Timing] = []
        if not args.json:
            say(f"{name}: {ROWS[name].about}", flush=True)
        try:
            for timing in measured(name, args):
                timings.append(timing)
                if not args.json:
                    say(timing, flush=True)
        except RuntimeError as error:
            failed = True
            say(f"{name}: {error}", error=True)
        else:
            for line in () if args.json else compared(timings, args.checkout):
                say(line, flush=True)
        rows += timings
    if args.json:
        say(
            *json.dumps([asdict(row) | {"verdict": row.verdict} for row in rows], indent=2).splitlines(),
            longest=None,
        )
    return int(failed)


def _arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = Parser(
        prog="python -m taichi_plume.validation.benchmark clock",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog="\n".join(f"{name:18} {row.about}" for name, row in ROWS.items()),
    )
    parser.add_argument("rows", nargs="*", metavar="ROW", help="rows listed below (default: all)")
    parser.add_argument("--checkout", nargs="+", type=Path, default=[ROOT], metavar="FOLDER")
    parser.add_argument("--repeats", type=int, default=1, metavar="N", help="runs per row (default: 1)")
    parser.add_argument("--jax", metavar="PYTHON", help="Python interpreter with jax-cfd")
    foam = parser.add_mutually_exclusive_group()
    foam.add_argument(
        "--openfoam",
        nargs="?",
        const="",
        metavar="BASHRC",
        help="measure pimpleFoam too; BASHRC sets its paths",
    )
    foam.add_argument(
        "--openfoam-seconds",
        nargs=4,
        type=float,
        metavar="S",
        help="wall time of pimpleFoam per simulated second of the arena with obstacles and of the empty one, with 5 cm "
        "and then with 2 cm",
    )
    parser.add_argument("--arch", default="cpu", choices=("auto", "cpu", "cuda", "vulkan", "metal"))
    parser.add_argument("--seconds", type=float, default=8.0, help="seconds per rate of steps (default: 8)")
    parser.add_argument("--robots", type=int, default=100_000, metavar="N", help="default: 100,000")
    parser.add_argument("--json", action="store_true", help="print JSON")
    return parser.parse_args(argv)
