"""``python -m taichi_plume.run scenario.yaml`` runs a scenario into a run directory.

Exit code 0: done; 1: stopped by an error, the files written so far are kept; 2: the scenario or the command line is
wrong, or there is no such device; 130: interrupted. Heavy imports wait until the scenario has been checked.
"""

import argparse
import gc
import sys
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from taichi_plume.cli.exit_codes import exit_code
from taichi_plume.cli.options import add, flag, option, overrides_of
from taichi_plume.execution.signals import reader_may_leave
from taichi_plume.guard.terminal import Parser, say

if TYPE_CHECKING:
    from taichi_plume.execution.execute import Outcome


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv` (without the program's name) and return its exit code."""
    args = _arguments(argv)
    gc.disable()  # until the run begins: garbage collection makes a start 7 % slower
    try:
        work = _resume if args.resume else _new
        return exit_code(lambda: work(args), "interrupted before the run began", args.debug, args.out)
    finally:
        gc.enable()


def _new(args: argparse.Namespace) -> int:
    """Check the scenario of a new run and, without --check, execute the run; return the exit code."""
    from taichi_plume.assembly.preparation import load

    prepared = load(args.scenario, overrides_of(args, "seed", "duration"), args.allow_outside)
    at_the_end = args.check and sys.stdout.isatty()  # after the output, where notes would scroll away
    for warning in () if args.quiet or at_the_end else prepared.resources.warnings:
        say(f"note: {warning}", error=True)
    if args.check:
        from taichi_plume.cli.check import print_check

        with reader_may_leave():
            print_check(prepared, args.out, args.all)
        return 0
    from taichi_plume.execution.execute import new_run

    return carry_out(
        lambda: new_run(
            prepared, args.out, args.arch or "cpu", force=args.force, recording=not args.no_recording,
            live=args.live, report=not args.no_report, progress=False if args.quiet else None,
            allow_code=args.allow_code or args.allow_sha256, ask=True, watch=args.watch,
        ), args.quiet, args.debug,
    )  # fmt: skip


def _resume(args: argparse.Namespace) -> int:
    """Resume an interrupted run from the checkpoint in its folder; return the exit code."""
    from taichi_plume.assembly.own_code import execute
    from taichi_plume.assembly.preparation import load
    from taichi_plume.engine import program
    from taichi_plume.execution.checkpoint_reading import require_same, saved
    from taichi_plume.execution.execute import Job, inputs_of, run
    from taichi_plume.files.run_folder import RunFolder
    from taichi_plume.record.live import open_viewer

    with RunFolder.again(args.resume) as folder:
        checkpoint = saved(folder.path)
        prepared = load(folder.path / "scenario.yaml", (), args.allow_outside)
        require_same(folder.path, checkpoint["inputs"], inputs_of(prepared)[1:])
        execute(prepared, args.allow_code or args.allow_sha256, ask=True)
        arch, recording = args.arch or checkpoint["arch"], checkpoint["recording"]
        backend = program.start(arch)
        viewer = open_viewer() if args.live and recording else None
        job = Job(
            prepared, folder, arch, backend, recording, checkpoint, viewer, not args.no_report,
            progress=False if args.quiet else None,
        )  # fmt: skip
        return carry_out(lambda: run(job), args.quiet, args.debug)


def carry_out(run: "Callable[[], Outcome]", quiet: bool, debug: bool) -> int:
    """Execute a run, print its summary or how it ended, and return the exit code."""
    from taichi_plume.execution.execute import RunError
    from taichi_plume.execution.summary import print_summary

    try:
        folder, result = run()
    except RunError as error:
        if debug and error.__cause__ is not None:
            say(*"".join(traceback.format_exception(error.__cause__)).splitlines(), error=True)
        say(*error.lines, error=True, longest=None)
        return error.code
    if not quiet:
        with reader_may_leave():
            print_summary(result, folder)
    return 0


def _arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = Parser(
        prog="python -m taichi_plume.run",
        description="Run a scenario: air flow, gas, robots, maps. The results go to a folder.",
    )
    parser.add_argument("scenario", type=Path, nargs="?", help="YAML file")
    add(parser, "--out")
    add(parser, "--arch", default=None)  # with --resume: the device of the run
    option(parser, "--seed", str, "N", "instead of the scenario's")
    add(parser, "--engine", "--duration", "--set")
    check = "only check: print the scenario, derived quantities, unlikely settings and the size, and draw the scene"
    flag(parser, "--check", check)
    flag(parser, "--all", "with --check: print all keys, with their defaults and meanings")
    flag(parser, "--live", "open the viewer during the run (on this machine alone)")
    watch = (
        "write progress, gas, wind and robots to this file during the run, for a program that shows the run"
    )
    option(parser, "--watch", Path, "FILE.npz", watch)
    add(parser, "--no-recording", "--no-report", "--quiet", "--force")
    option(parser, "--resume", Path, "RUN", "resume an interrupted run from its checkpoint")
    add(parser, "--allow-code", "--allow-outside", "--debug")
    code = "execute a Python file that the scenario names if the file has this SHA-256; may be repeated"
    option(parser, "--allow-sha256", str.lower, "HEX", code, action="append", default=[])
    args = parser.parse_args(argv)
    if args.resume is None and args.scenario is None:
        parser.error("the following arguments are required: scenario")
    if args.live and args.no_recording:
        parser.error("--live shows the recording; it cannot go with --no-recording")
    if args.all and not args.check:
        parser.error("--all goes with --check")
    fixed = [
        f"--{key}" for key in ("out", "seed", "duration", "set", "check", "force", "watch") if vars(args)[key]
    ]
    if args.resume is not None and (args.scenario or args.no_recording or fixed):
        what = fixed[0] if fixed else args.scenario or "--no-recording"
        parser.error(f"--resume continues the run unchanged; it cannot go with {what}")
    return args
