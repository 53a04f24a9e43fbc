"""``python -m taichi_plume.report RUN`` writes the report of a run again from the files in its folder."""

import argparse
from collections.abc import Sequence

from taichi_plume.cli.exit_codes import exit_code
from taichi_plume.cli.options import OTHER_MAPS, add
from taichi_plume.guard.terminal import Parser, say


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv` (without the program's name) and return its exit code."""
    description = "Write report.html of a run again, from the files in its folder alone."
    parser = Parser(prog="python -m taichi_plume.report", description=description)
    add(parser, "run")
    add(parser, "--allow-outside", help=OTHER_MAPS)
    args = parser.parse_args(argv)
    return exit_code(lambda: _report(args), out=args.run)


def _report(args: argparse.Namespace) -> int:
    from taichi_plume.report.page import write
    from taichi_plume.results.run import Run

    path = write(Run(args.run, lenient=True, allow_outside=args.allow_outside))
    say(f"{path}: {path.stat().st_size / 1e3:,.0f} kB")
    return 0
