"""The command: ``python -m taichi_plume.envs TASK.yaml --out bank.zarr`` records the airs that learners meet.

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
    args = _arguments(argv)
    return exit_code(lambda: _record(args), "interrupted: no bank was written", args.debug, args.out)


def _record(args: argparse.Namespace) -> int:
    from taichi_plume.assembly.prepare import load

    prepared = load(args.task, args.set, args.allow_outside)
    from taichi_plume.envs import bank
    from taichi_plume.files.disk import require_room
    from taichi_plume.grid import kernels

    out, folder = args.out or Path(f"{prepared.scenario.name}_bank.zarr"), args.task.resolve().parent
    bank.check(prepared.scenario)
    if os.path.lexists(out):
        bank.require_bank(out)
    out.parent.mkdir(parents=True, exist_ok=True)
    require_room(out.parent / out.name)
    kernels.start(args.arch)
    made = bank.record(prepared.scenario, folder, True, None if args.quiet else _told)
    made.write(out)
    if not args.quiet:
        films, frames, nx, ny, channels = made.values.shape
        say(
            f"{out}: {films} films of {frames} frames, {made.frame:g} s apart, of {nx} x {ny} cells: wind and "
            f"{channels - 2} gases, {made.values.nbytes / 1e6:.3g} MB in memory"
        )
    return 0


def _told(done: int, films: int) -> None:
    if done < films:
        say(f"film {done + 1} of {films} ...", error=True)


def _arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = Parser(
        prog="python -m taichi_plume.envs",
        description="Record the airs of a scenario's task, so that environments need not solve for them.",
    )
    parser.add_argument(
        "task", type=Path, help="YAML file of a scenario; its section `task` tells of the films"
    )
    add(parser, "--out", metavar="BANK.zarr", help="where to (default: NAME_bank.zarr)")
    add(parser, "--arch", "--set", "--allow-outside", "--quiet", "--debug")
    return parser.parse_args(argv)
