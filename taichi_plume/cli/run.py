"""The command: ``python -m taichi_plume.run scenario.yaml`` runs a scenario into a run directory.

Exit code 0: done; 1: stopped by an error, what there was is kept; 2: the scenario or the command line is
wrong, or there is no such device; 130: interrupted. Heavy imports wait until the scenario has been checked.
"""

import argparse
import gc
import sys
from collections.abc import Sequence
from pathlib import Path

from taichi_plume.cli.exit_codes import exit_code
from taichi_plume.cli.options import add
from taichi_plume.guard.terminal import Parser, say
from taichi_plume.running.signals import reader_may_leave


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv` (without the program's name) and return its exit code."""
    args = _arguments(argv)
    gc.disable()  # until the run begins: a start takes 7 % more where what it makes is looked through
    try:
        work = _resume if args.resume else _new
        return exit_code(lambda: work(args), "interrupted before the run began", args.debug, args.out)
    finally:
        gc.enable()


def _new(args: argparse.Namespace) -> int:
    """Check the scenario and, unless that is all, run it."""
    from taichi_plume.assembly.prepare import load

    overrides = list(args.set)
    for key in ("seed", "duration"):
        if getattr(args, key) is not None:
            overrides.append(f"{key}={getattr(args, key)}")
    prepared = load(args.scenario, overrides, args.allow_outside)
    told_below = args.check and sys.stdout.isatty()  # where the notes would have scrolled away
    for remark in () if args.quiet or told_below else prepared.resources.remarks:
        say(f"note: {remark}", error=True)
    if args.check:
        from taichi_plume.cli.check import print_check

        with reader_may_leave():
            print_check(prepared, args.out, args.all)
        return 0
    from taichi_plume.assembly.own_code import execute
    from taichi_plume.files.run_folder import RunFolder
    from taichi_plume.grid import kernels
    from taichi_plume.running.job import Job, simulate
    from taichi_plume.scenario.input_files import input_paths

    execute(prepared, args.allow_code, ask=True)
    backend = kernels.start(args.arch or "cpu")
    inputs = input_paths(prepared.scenario, args.scenario, prepared.resources.files)
    with RunFolder(prepared.scenario.name, args.out, args.force, inputs=inputs) as folder:
        arch, recording = args.arch or "cpu", not args.no_recording
        shown = {"live": _viewer(args), "report": not args.no_report}
        job = Job(prepared, folder, args.scenario, inputs, arch, backend, recording, **shown)
        return simulate(job, args.quiet, args.debug)


def _resume(args: argparse.Namespace) -> int:
    """Go on with a run that was cut off."""
    from taichi_plume.assembly.own_code import execute
    from taichi_plume.assembly.prepare import load
    from taichi_plume.files.run_folder import RunFolder
    from taichi_plume.grid import kernels
    from taichi_plume.running.job import Job, simulate
    from taichi_plume.running.resume import require_same, saved
    from taichi_plume.scenario.input_files import input_paths

    with RunFolder.again(args.resume) as folder:
        told = saved(folder.path)
        file = folder.path / "scenario.yaml"
        prepared = load(file, (), args.allow_outside)
        inputs = input_paths(prepared.scenario, file, prepared.resources.files)
        require_same(folder.path, told["inputs"], inputs[1:])
        execute(prepared, args.allow_code, ask=True)
        backend = kernels.start(args.arch or told["arch"])
        arch = args.arch or told["arch"]
        shown = {"live": _viewer(args) if told["recording"] else None, "report": not args.no_report}
        job = Job(prepared, folder, file, inputs, arch, backend, told["recording"], told, **shown)
        return simulate(job, args.quiet, args.debug)


def _viewer(args: argparse.Namespace) -> str | None:
    """The address of a viewer, opened where it is asked for."""
    if not args.live:
        return None
    from taichi_plume.record.live import open_viewer

    return open_viewer()


def _arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = Parser(
        prog="python -m taichi_plume.run",
        description="Run a scenario: air flow, gas, robots, maps. The results go to a folder.",
    )
    parser.add_argument("scenario", type=Path, nargs="?", help="YAML file")
    add(parser, "--out")
    add(parser, "--arch", default=None)  # of --resume: that of the run
    parser.add_argument("--seed", metavar="N", help="instead of the scenario's")
    parser.add_argument("--duration", metavar="S", help="seconds, instead of the scenario's")
    add(parser, "--set")
    parser.add_argument(
        "--check",
        action="store_true",
        help="only check: print the scenario, what follows from it, what is unlikely and its size, and draw it",
    )
    parser.add_argument(
        "--all", action="store_true", help="with --check: print all keys, with their defaults and meanings"
    )
    parser.add_argument(
        "--live", action="store_true", help="open the viewer while the run goes on (on this machine alone)"
    )
    add(parser, "--no-recording", "--no-report", "--quiet", "--force")
    parser.add_argument(
        "--resume", type=Path, metavar="RUN", help="go on with a run that was cut off, from its checkpoint"
    )
    add(parser, "--allow-code", "--allow-outside", "--debug")
    args = parser.parse_args(argv)
    if args.resume is None and args.scenario is None:
        parser.error("the following arguments are required: scenario")
    if args.live and args.no_recording:
        parser.error("--live shows the recording: it has no place beside --no-recording")
    if args.all and not args.check:
        parser.error("--all goes with --check")
    fixed = [f"--{key}" for key in ("out", "seed", "duration", "set", "check", "force") if getattr(args, key)]
    if args.resume is not None and (args.scenario or args.no_recording or fixed):
        what = fixed[0] if fixed else args.scenario or "--no-recording"
        parser.error(f"--resume goes on with the run as it was: {what} has no place beside it")
    return args
