"""Completes what a killed run has left: ``python -m taichi_plume.repair RUN``; see `taichi_plume.running.repair`."""

import argparse
from collections.abc import Sequence

from taichi_plume.cli.exit_codes import exit_code
from taichi_plume.cli.options import add
from taichi_plume.guard.terminal import Parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv` (without the program's name) and return its exit code."""
    parser = Parser(
        prog="python -m taichi_plume.repair", description="Complete the files of a run that was killed."
    )
    add(parser, "run")
    parser.add_argument(
        "--verify", action="store_true", help="only tell which files are no longer as their run left them"
    )
    add(parser, "--no-report")
    args = parser.parse_args(argv)
    return exit_code(lambda: _repair(args), out=args.run)


def _repair(args: argparse.Namespace) -> int:
    from taichi_plume.files.run_folder import RunFolder
    from taichi_plume.running.repair import complete, verify

    if args.verify:
        return verify(args.run)
    with RunFolder.again(args.run) as folder:
        return complete(folder, not args.no_report)
