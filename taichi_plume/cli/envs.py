"""``python -m taichi_plume.envs TASK.yaml --out bank.zarr`` records the flow realisations (airs) that learners meet.

Exit code 0: done; 1: stopped by an error, nothing is kept; 2: the scenario or the command line is wrong, or there is no
such device; 130: interrupted.
"""

import argparse
import os
from collections.abc import Sequence
from pathlib import Path

from taichi_plume.cli.exit_codes import exit_code
from taichi_plume.cli.options import add
from taichi_plume.guard.terminal import Parser, say


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv` (without the program's name) and return its exit code."""
    description = "Record the airs of a scenario's task, so that environments need not solve for them."
    parser = Parser(prog="python -m taichi_plume.envs", description=description)
    parser.add_argument("task", type=Path, help="YAML file of a scenario; its section `task` sets the films")
    add(parser, "--out", metavar="BANK.zarr", help="file to write (default: NAME_bank.zarr)")
    add(parser, "--arch", "--engine", "--set", "--allow-outside", "--quiet", "--debug")
    args = parser.parse_args(argv)
    return exit_code(lambda: _record(args), "interrupted: no bank was written", args.debug, args.out)


def _record(args: argparse.Namespace) -> int:
    from taichi_plume.assembly.preparation import load

    prepared = load(args.task, args.set, args.allow_outside)
    from taichi_plume.engine import program
    from taichi_plume.envs import bank
    from taichi_plume.files.disk import require_room

    out, folder = args.out or Path(f"{prepared.scenario.name}_bank.zarr"), args.task.resolve().parent
    bank.check(prepared.scenario)
    for warning in () if args.quiet else bank.warnings(prepared.scenario, folder, True):
        say(f"note: {warning}", error=True)
    if os.path.lexists(out):
        bank.require_bank(out)
    out.parent.mkdir(parents=True, exist_ok=True)
    require_room(out.parent / out.name)
    program.start(args.arch)
    recorded = bank.record(prepared.scenario, folder, True, None if args.quiet else _print_progress)
    recorded.write(out)
    if not args.quiet:
        films, frames, nx, ny, channels = recorded.values.shape
        say(
            f"{out}: {films} films of {frames} frames, {recorded.frame:g} s apart, of {nx} x {ny} cells: wind and "
            f"{channels - 2} gases, {recorded.values.nbytes / 1e6:.3g} MB in memory"
        )
    return 0


def _print_progress(done: int, films: int) -> None:
    if done < films:
        say(f"film {done + 1} of {films} ...", error=True)
