"""Figures of a GPU: one command of some minutes that is useful even if cut off.

    python -m taichi_plume.validation.benchmark gpu [--arch ARCH] [--minutes M] [--rows ROW ...] [--json FILE]
                                                    [--checkout FOLDER]

Each row is measured in its own process with a time limit. A row that crashes, needs too much memory or is too slow is
reported with the reason, and the next one starts. The most important rows come first. Each row is printed and written
to FILE, in a line of JSON, as soon as its figures are known. Rows for which no time is left are dropped and named. At
the end, all figures are printed as a table in Markdown. A row ``NAME@ENGINE`` is measured with the other engine.
"""

import argparse
import contextlib
import importlib.util
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from taichi_plume.engine.choice import chosen
from taichi_plume.execution.signals import handling_signals
from taichi_plume.guard.terminal import Parser, say

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
LEAST = 5.0  # s, for which a row is still started
Figures = dict[str, Any]


@dataclass(frozen=True)
class Row:
    """Row: kind in gpu_rows.py with its options, time limit [s], and the target of the figure on a large card."""

    about: str
    kind: str
    limit: float
    options: Figures = field(default_factory=dict)
    target: str = ""


def _steps(shape: tuple[int, int, int], target: str = "") -> Row:
    cells = shape[0] * shape[1] * shape[2]
    return Row(f"steps, {cells:,} cells", "steps", 60.0, {"shape": shape, "seconds": 4.0}, target)


def _counts(shape: tuple[int, int, int]) -> Row:
    cells = shape[0] * shape[1] * shape[2]
    return Row(f"launches of a step, {cells:,} cells", "counts", 90.0, {"shape": shape, "steps": 20})


def _scenario(about: str, config: str, span: tuple[float, float], *settings: str) -> Row:
    return Row(about, "scenario", 60.0, {"config": config, "span": span, "set": settings})


def _environments(count: int) -> Row:
    options = {"count": count, "seconds": 3.0}
    return Row(f"{count:,} environments", "environments", 40.0, options, "10 M environment steps/s")


ROWS: dict[str, Row] = {
    "device": Row("device and engine", "device", 60.0),
    "steps_750k": _steps((200, 150, 25), "150 M cell-steps/s"),
    "counts_750k": _counts((200, 150, 25)),
    "steps_6M": _steps((400, 300, 50), "300 M cell-steps/s with 8 M cells"),
    "steps_48k": _steps((80, 60, 10)),
    "counts_48k": _counts((80, 60, 10)),
    "arena_3d": _scenario("`arena_3d`", "arena_3d", (6.0, 16.0), "warm_up=2.0"),
    "casting_room": _scenario("`casting_room`", "casting_room", (6.0, 16.0), "warm_up=2.0"),
    "robots_beside_air": Row(
        "1,000 robots in `arena_3d`",
        "beside_air",
        90.0,
        {"config": "arena_3d", "span": (2.0, 6.0), "robots": 1000, "set": ["warm_up=1.0"]},
        "no cost",
    ),
    "agreement": Row("differences from the CPU", "agreement", 100.0, {"steps": 30, "robots": 1000}),
    "robots_1e5": Row("100,000 robots", "robots", 40.0, {"robots": 100_000}),
    "environments_4096": _environments(4096),
    "steps_20M": _steps((600, 450, 75)),
    "counts_6M": _counts((400, 300, 50)),
    "robots_1e6": Row("1,000,000 robots", "robots", 40.0, {"robots": 1_000_000}),
    "environments_65536": _environments(65536),
    "tests": Row(
        "tests of solvers, grid and agents", "tests", 150.0, {"tests": ("solvers", "grid", "agents")}
    ),
    "arena_3d_2cm": _scenario(
        "`arena_3d`, 2 cm", "arena_3d", (0.6, 2.0), "warm_up=0.2", "domain.spacing=0.02"
    ),
    "arena_3d_1cm": _scenario(
        "`arena_3d`, 1 cm", "arena_3d", (0.3, 0.6), "warm_up=0.1", "domain.spacing=0.01"
    ),
}
TWICE = ("device", "steps_750k", "steps_6M", "steps_48k")
"""Rows that are also measured with the other engine, where it is installed."""
COLD = ("steps_48k", "arena_3d", "casting_room", "robots_1e5", "environments_4096")
"""Rows that together compile all kernels. On a machine of many cores they are started at once before the others."""
MANY_CORES = 8


def rows() -> dict[str, Row]:
    """Return all rows, with those of the other engine if it is installed."""
    other = "quadrants" if chosen() == "taichi" else "taichi"
    if importlib.util.find_spec(other) is None:
        return ROWS
    return ROWS | {f"{name}@{other}": ROWS[name] for name in TWICE}


class Process:
    """Process of a row, which prints figures in lines of JSON."""

    def __init__(self, name: str, row: Row, args: argparse.Namespace, limit: float, **more: Any):
        options = {"kind": row.kind, "arch": args.arch, "limit": limit, "checkout": str(args.checkout)}
        environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(args.checkout), *_search_path()])}
        if "@" in name:
            environment["TAICHI_PLUME_ENGINE"] = name.partition("@")[2]
        self.limit = limit
        self.shown, self.errors = tempfile.TemporaryFile("w+"), tempfile.TemporaryFile("w+")  # noqa: SIM115
        self.process = subprocess.Popen(
            [sys.executable, "-P", str(HERE / "gpu_rows.py"), json.dumps(options | row.options | more)],
            env=environment,
            stdout=self.shown,
            stderr=self.errors,
            start_new_session=True,
        )

    def figures(self) -> Figures:
        """Wait at most for the limit, and return the figures; `error` holds the reason if not all are known."""
        figures: Figures = {}
        try:
            code: int | None = self.process.wait(self.limit)
        except subprocess.TimeoutExpired:
            code = None
        finally:
            self.end()
        for file in (self.shown, self.errors):
            file.seek(0)
        for line in self.shown:
            if line.startswith("{") and line.endswith("\n"):
                figures |= json.loads(line)
        if code is None:
            figures["error"] = f"cut off after {self.limit:.0f} s"
        elif code:
            last = ([line.strip() for line in self.errors if line.strip()] or ["no message"])[-1]
            reason = f"signal {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"
            figures.setdefault("error", f"{reason}: {last[:200]}")
        return figures

    def end(self) -> None:
        """Kill the process and its children."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()


def _search_path() -> list[str]:
    return [path for path in os.environ.get("PYTHONPATH", "").split(os.pathsep) if path]


def _compile_all(args: argparse.Namespace, limit: float) -> None:
    """Start the rows of COLD at once, so that their kernels are in the cache."""
    short = {"seconds": 0.1, "span": (0.1, 0.3), "robots": 1000}
    started = [Process(name, ROWS[name], args, limit, **short) for name in COLD]
    end = time.monotonic() + limit
    try:
        for process in started:
            process.limit = max(0.0, end - time.monotonic())
            process.figures()
    finally:
        for process in started:
            process.end()


def measure(args: argparse.Namespace, results: dict[str, Figures]) -> None:
    """Measure the rows one after the other, print and write each, and add the figures by row to `results`."""
    known, begin = rows(), time.monotonic()
    names = args.rows or list(known)

    def left() -> float:
        return 60.0 * args.minutes - (time.monotonic() - begin)

    with open(args.json, "w") as file:
        for n, name in enumerate(names):
            if n == 1 and args.arch != "cpu" and not args.rows and (os.cpu_count() or 1) >= MANY_CORES:
                _compile_all(args, min(100.0, left()))
                say(f"[{60.0 * args.minutes - left():.0f} s] kernels compiled", flush=True)
            if left() < LEAST:
                say(f"no time left for {', '.join(names[n:])}", flush=True)
                break
            row, started = known[name], time.monotonic()
            results[name] = Process(name, row, args, min(row.limit, left())).figures()
            took = time.monotonic() - started
            say(*_lines(name, results[name], took), longest=None, flush=True)
            line = {"row": name, "arch": args.arch, "seconds": round(took, 1)}
            file.write(json.dumps(line | results[name]) + "\n")
            file.flush()


def _lines(name: str, figures: Figures, took: float) -> list[str]:
    """Return the lines of a row for the terminal: its figures, and those of its kernels or tests."""
    lines = [f"{name:20} {took:4.0f} s  {_text(figures)}"]
    kernels = figures.get("kernels", {})
    width = max(map(len, kernels), default=0)
    lines += [f"    {kernel:{width}} {_text(values)}" for kernel, values in kernels.items()]
    return lines + [f"    {test}" for test in figures.get("failed", [])]


def _text(figures: Figures) -> str:
    """Return figures in a line."""

    def phrase(key: str, value: Any) -> str:
        if isinstance(value, bool) or not isinstance(value, int | float):
            return f"{key}: {value}"
        return f"{value:,} {key}" if isinstance(value, int) else f"{value:.3g} {key}"

    return ", ".join(phrase(*item) for item in figures.items() if not isinstance(item[1], dict | list))


def table(results: dict[str, Figures]) -> list[str]:
    """Return the figures as a table in Markdown, beside the targets for a large card."""
    known = rows()
    lines = ["| | measured | to reach on a large card |", "|---|---|---|"]
    for name, figures in results.items():
        engine = f" ({name.partition('@')[2]})" if "@" in name else ""
        text = _text(figures).replace("|", "/")
        lines.append(f"| {known[name].about}{engine} | {text} | {known[name].target} |")
    return lines


def main(arguments: Sequence[str]) -> int:
    """Measure the rows of the GPU benchmark and return the exit code: 1 if a row has failed, 130 if interrupted."""
    parser = Parser(
        prog="python -m taichi_plume.validation.benchmark gpu",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog="\n".join(f"{name:20} {row.about}" for name, row in ROWS.items()),
    )
    parser.add_argument("--arch", default="cuda", choices=("cpu", "cuda", "vulkan", "metal"))
    parser.add_argument("--minutes", type=float, default=8.0, help="for all rows together (default: 8)")
    parser.add_argument("--rows", nargs="+", metavar="ROW", help="rows listed below (default: all)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="default: gpu_ARCH.jsonl")
    parser.add_argument("--checkout", type=Path, default=ROOT, metavar="FOLDER", help="what is measured")
    args = parser.parse_args(arguments)
    unknown = [name for name in args.rows or () if name not in rows()]
    if unknown:
        parser.error(f"argument --rows: unknown row {unknown[0]!r}; known: {', '.join(rows())}")
    if not args.minutes > 0.0:
        parser.error(f"argument --minutes: {args.minutes:g} is not above 0")
    args.json = args.json or Path(f"gpu_{args.arch}.jsonl")
    args.checkout = args.checkout.resolve()
    if args.checkout != ROOT and not (args.checkout / "taichi_plume" / "__init__.py").is_file():
        parser.error(f"argument --checkout: {args.checkout} holds no package taichi_plume")
    results: dict[str, Figures] = {}
    try:
        with handling_signals():
            measure(args, results)
        interrupted = False
    except KeyboardInterrupt:
        interrupted = True
    except OSError as error:
        parser.error(f"argument --json: {args.json} cannot be written ({error.strerror})")
    say(*table(results), longest=None)
    if interrupted:
        say("interrupted", error=True)
        return 130
    return int(any("error" in figures for figures in results.values()))
