"""``python -m taichi_plume.repair RUN`` completes the files of a killed run, see `taichi_plume.execution.repair`."""

import argparse
from collections.abc import Sequence

from taichi_plume.cli.exit_codes import exit_code
from taichi_plume.cli.options import add, flag
from taichi_plume.guard.terminal import Parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv` (without the program's name) and return its exit code."""
    description = "Complete the files of a run that was killed."
    parser = Parser(prog="python -m taichi_plume.repair", description=description)
    add(parser, "run")
    flag(parser, "--verify", "only report which files have changed since the run wrote them")
    add(parser, "--no-report")
    args = parser.parse_args(argv)
    return exit_code(lambda: _repair(args), out=args.run)


def _repair(args: argparse.Namespace) -> int:
    from taichi_plume.execution.repair import complete, verify
    from taichi_plume.files.run_folder import RunFolder

    if args.verify:
        return verify(args.run)
    with RunFolder.again(args.run) as folder:
        return complete(folder, not args.no_report)
