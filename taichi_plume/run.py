"""The command: ``python -m taichi_plume.run scenario.yaml`` runs a scenario into a run directory.

Exit code 0: done; 1: stopped by an error, what there was is kept; 2: the scenario or the command line is
wrong, or there is no such device; 130: interrupted. Heavy imports wait until the scenario has been checked.
"""

import argparse
import errno
import gc
import os
import signal
import sys
import textwrap
import threading
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from taichi_plume.guard.terminal import Parser, say, terminal, visible

if TYPE_CHECKING:
    from taichi_plume.map_scores import MapScores
    from taichi_plume.prepare import Prepared
    from taichi_plume.scenario.scenario import Scenario
    from taichi_plume.simulation import Simulation

FULL = (errno.ENOSPC, errno.EFBIG, errno.EDQUOT)
LONGEST_MESSAGE = 300  # characters of an unexpected error


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv` (without the program's name) and return its exit code."""
    args = _arguments(argv)
    os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")
    gc.disable()  # until the run begins: a start takes 7 % more where what it makes is looked through
    from taichi_plume.own_code import execute
    from taichi_plume.prepare import load
    from taichi_plume.scenario.loading import ScenarioError

    overrides = list(args.set)
    for key in ("seed", "duration"):
        if getattr(args, key) is not None:
            overrides.append(f"{key}={getattr(args, key)}")
    try:
        prepared = load(args.scenario, overrides, args.allow_outside)
        if args.check:
            with _reader_may_leave():
                _print_check(prepared.scenario)
            return 0
        execute(prepared, args.allow_code, ask=True)
        return _run(prepared, args)
    except ScenarioError as error:
        say(error, error=True)
        return 2
    except KeyboardInterrupt:
        say("interrupted before the run began", error=True)
        return 130
    finally:
        gc.enable()


def _arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = Parser(
        prog="python -m taichi_plume.run",
        description="Run a scenario: air flow, gas, robots, maps. The results go to a folder.",
    )
    parser.add_argument("scenario", type=Path, help="YAML file")
    parser.add_argument("--out", type=Path, metavar="DIR", help="run directory (default: runs/NAME-N)")
    parser.add_argument(
        "--arch",
        choices=("auto", "cpu", "cuda", "vulkan", "metal"),
        default="cpu",
        help="where to compute; auto takes a GPU if there is one (default: cpu)",
    )
    parser.add_argument("--seed", metavar="N", help="instead of the scenario's")
    parser.add_argument("--duration", metavar="S", help="seconds, instead of the scenario's")
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="PATH=VALUE",
        help="change any key, such as robots.0.count=3; may be repeated",
    )
    parser.add_argument(
        "--check", action="store_true", help="only check, print the resolved scenario and its size"
    )
    parser.add_argument("--no-recording", action="store_true", help="write no recording.rrd")
    parser.add_argument("--quiet", action="store_true", help="no progress bar, no summary")
    parser.add_argument("--force", action="store_true", help="overwrite an earlier run in --out")
    parser.add_argument(
        "--allow-code", action="store_true", help="execute Python files that the scenario names (kind: own)"
    )
    parser.add_argument(
        "--allow-outside", action="store_true", help="read files that lie outside the scenario's folder"
    )
    parser.add_argument("--debug", action="store_true", help="show where an unexpected error came from")
    return parser.parse_args(argv)


@contextmanager
def _reader_may_leave() -> Iterator[None]:
    """What is printed may go to a reader such as `head` that closes the pipe early: no error."""
    try:
        yield
        sys.stdout.flush()
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # Python flushes again at its end


def _print_check(scenario: "Scenario") -> None:
    from taichi_plume.files.run_folder import to_yaml
    from taichi_plume.scenario.size import estimate

    size = estimate(scenario)
    say(to_yaml(scenario), longest=None, end="")
    say(f"# cells: {size['cells']:,}, about {size['bytes'] / 1e6:,.0f} MB of memory")
    say(f"# flow steps: about {size['steps']:,}, about {_duration(size['wall_s'])} on a few CPU cores")


def _duration(seconds: float) -> str:
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 6000 else f"{seconds / 3600:.0f} h"


# ---------------------------------------------------------------- the run


def _run(prepared: "Prepared", args: argparse.Namespace) -> int:
    """Assemble and run; keep what there is, whatever ends it."""
    from taichi_plume import summary
    from taichi_plume.files import result, run_folder
    from taichi_plume.grid import kernels
    from taichi_plume.map_scores import MapScores
    from taichi_plume.scenario.loading import ScenarioError

    console = terminal(error=True)
    try:
        backend = kernels.start(args.arch)
        out = run_folder.run_folder(prepared.scenario.name, args.out, args.force)
    except (RuntimeError, run_folder.RunFolderError) as error:
        say(visible(error), error=True)
        return 2
    try:
        if console.is_terminal and not args.quiet:
            console.print("compiling ...", end="\r")
        sim = _build(prepared)
    except BaseException as error:
        _remove_if_empty(out)
        if isinstance(error, (ScenarioError, KeyboardInterrupt)):
            raise
        if args.debug:
            say(traceback.format_exc(), error=True)
        say(f"failed before the run began: {visible(_explain(error)[1])}", error=True)
        return 1
    map_scores = MapScores(sim)
    status, message, code = _simulate(sim, map_scores, backend, out, args, console)
    try:
        content = result.result(sim, status, message, backend, map_scores)
    except Exception as error:  # a simulation too broken to tell
        if not code:
            (status, message), code = _explain(error), 1
        content = {"name": prepared.scenario.name, "status": status, "message": message}
    try:
        result.write_result(out, content)
    except OSError as error:
        say(f"result.json could not be written: {visible(error)}", error=True)
        code = code or 1
    if code:
        kept = ", ".join(sorted(file.name for file in out.iterdir())) or "nothing"
        say(f"{status}: {visible(message)}\nkept in {visible(out)}: {kept}", error=True)
    elif not args.quiet:
        with _reader_may_leave():
            summary.print_summary(content, out)
    return code


def _build(prepared: "Prepared") -> "Simulation":
    from taichi_plume.assemble import build

    sim = build(prepared)
    gc.enable()
    return sim


def _simulate(
    sim: "Simulation",
    map_scores: "MapScores",
    backend: str,
    out: Path,
    args: argparse.Namespace,
    console: Any,
) -> tuple[str, str, int]:
    """Run to the end and close all files. Returns status, message and exit code."""
    status, message, code = "completed", "", 0
    closers: list[Callable[[], None]] = []
    with _terminable():
        try:
            _watch(sim, map_scores, backend, out, args, closers)
            with ExitStack() as stack:
                if console.is_terminal and not args.quiet:
                    from taichi_plume.progress import ProgressBar

                    bar = stack.enter_context(ProgressBar(sim, console))
                    sim.observers.append(bar.observer())
                sim.run()
            if sim.tick < sim.last_tick:
                status, message = "stopped", f"every robot had found a source at t = {sim.t:.1f} s"
        except KeyboardInterrupt:
            status, message, code = "interrupted", f"at t = {sim.t:.2f} s", 130
        except Exception as error:
            if args.debug:
                say(traceback.format_exc(), error=True)
            (status, message), code = _explain(error), 1
        with _deaf():
            for close in closers:
                try:
                    close()
                except Exception as error:  # the others have to be closed all the same
                    if not code:
                        (status, message), code = _explain(error), 1
    return status, message, code


def _watch(
    sim: "Simulation",
    map_scores: "MapScores",
    backend: str,
    out: Path,
    args: argparse.Namespace,
    closers: list[Callable[[], None]],
) -> None:
    """Open the run's files and let the simulation feed them."""
    from taichi_plume.files import forces_table, robots_table, run_folder

    run_folder.write_scenario(out, sim.scenario, args.scenario.resolve().parent, backend)
    sim.observers.append(map_scores.observer())
    if sim.swarm.count:
        table = robots_table.RobotTable(sim, out / "robots.parquet")
        closers.append(table.close)
        sim.observers.append(table.observer())
    if sim.forces is not None:
        forces = forces_table.ForceTable(sim, out / "forces.csv")
        closers.append(forces.close)
        sim.observers.append(forces.observer())
    if sim.scenario.fields is not None:
        from taichi_plume.files.filming import Filming

        sim.observers.append(Filming(sim, out / "fields.zarr", sim.scenario.fields).observer())
    if sim.scenario.plumesim_log is not None:
        from taichi_plume.files.plumesim_log import PlumeLogger

        log = PlumeLogger(sim, out / "plume.pslog", sim.scenario.plumesim_log)
        closers.append(log.close)
        sim.observers.append(log.observer())
    if not args.no_recording:
        from taichi_plume.record.recorder import Recorder

        recorder = Recorder(sim, out / "recording.rrd", backend, map_scores)
        closers.append(recorder.close)
        sim.observers += recorder.observers()


def _explain(error: BaseException) -> tuple[str, str]:
    """Status and one line for an exception."""
    from taichi_plume.files.own_class import OwnAlgorithmError
    from taichi_plume.simulation import UnstableError

    if isinstance(error, UnstableError):
        return "unstable", str(error)
    if isinstance(error, OwnAlgorithmError):
        return "failed", str(error)
    if isinstance(error, OSError) and error.errno in FULL:
        return "disk_full", f"{error.strerror}: {error.filename}" if error.filename else str(error)
    frames = traceback.extract_tb(error.__traceback__)
    ours = [frame for frame in frames if "taichi_plume" in frame.filename] or frames
    where = f" ({Path(ours[-1].filename).name}:{ours[-1].lineno})" if ours else ""
    message = textwrap.shorten(str(error), LONGEST_MESSAGE, placeholder=" ...")
    return "failed", f"{type(error).__name__}: {message}{where}"


def _remove_if_empty(folder: Path) -> None:
    if folder.is_dir() and not any(folder.iterdir()):
        folder.rmdir()


# ---------------------------------------------------------------- signals


@contextmanager
def _terminable() -> Iterator[None]:
    """SIGTERM (a batch system's or container's stop) ends the run as Ctrl-C does."""
    with _handling(signal.SIGTERM, signal.default_int_handler):
        yield


@contextmanager
def _deaf() -> Iterator[None]:
    """Further Ctrl-C do not disturb the closing of files."""
    with _handling(signal.SIGINT, signal.SIG_IGN), _handling(signal.SIGTERM, signal.SIG_IGN):
        yield


@contextmanager
def _handling(number: signal.Signals, handler: Any) -> Iterator[None]:
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(number, handler)
    try:
        yield
    finally:
        signal.signal(number, before)


if __name__ == "__main__":
    sys.exit(main())
