"""``python -m taichi_plume.study study.yaml`` executes all runs of a study, on all cores or a Dask cluster.

``python -m taichi_plume.study report DIR`` writes tables and page of a study's folder again. Exit code 0: all is done;
1: some runs have failed, or the workers were lost, existing results are kept; 2: the study or the command line is
wrong; 130: interrupted. Errors of the input are reported before Taichi or Dask are imported.
"""

import argparse
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from taichi_plume.cli.exit_codes import exit_code
from taichi_plume.cli.options import add, flag, option, whole_number
from taichi_plume.execution.signals import reader_may_leave
from taichi_plume.guard.terminal import Parser, say, visible

if TYPE_CHECKING:
    from taichi_plume.studies.study_run import End

EXIT_CODES = {"completed": 0, "failed": 1, "interrupted": 130}


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv` (without the program's name) and return its exit code."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    if arguments[:1] == ["report"]:
        return _report(arguments[1:])
    args = _arguments(arguments)
    return exit_code(lambda: _study(args), debug=args.debug, out=args.out)


def _study(args: argparse.Namespace) -> int:
    from taichi_plume.studies.plan import MOST_RUNS, SAMPLE, load_plan

    most = SAMPLE if args.check else MOST_RUNS
    plan = load_plan(args.study, args.allow_outside, not args.quiet, most)
    out = args.out or plan.default_out
    if args.check:
        from taichi_plume.studies.study_run import print_check

        with reader_may_leave():
            print_check(plan, out)
        return 0
    from taichi_plume.studies.study_run import Settings, execute

    settings = Settings(
        out, args.workers, args.scheduler, args.retry, args.force, not args.quiet, args.allow_code, args.allow_outside,
        args.dashboard, not args.no_report,
    )  # fmt: skip
    return print_end(execute(plan, settings), args.quiet, args.debug, settings.report)


def print_end(end: "End", quiet: bool, debug: bool = False, report: bool = True) -> int:
    """Print how a study's execution ended, and return the exit code. report: whether it has written the report page."""
    if debug and isinstance(end.error, OSError):
        say(*"".join(traceback.format_exception(end.error)).splitlines(), error=True)
    say(*end.notes, error=True, longest=None)
    if not quiet and end.runs:
        made = "runs.parquet, trials/" + ", report.html" * report
        with reader_may_leave():
            say(visible(f"{end.done:,} of {end.runs:,} runs are done; {made} in {end.folder}"))
    return EXIT_CODES[end.status]


def _report(argv: Sequence[str]) -> int:
    """Run the command line of `study report`, which writes a study's tables and page again; return the exit code."""
    description = "Write the tables and the page of a study again, of all runs that are done."
    parser = Parser(prog="python -m taichi_plume.study report", description=description)
    parser.add_argument("out", type=Path, metavar="DIR", help="the study's folder, such as studies/NAME")
    args = parser.parse_args(argv)

    def write() -> int:
        from taichi_plume.studies.study_run import publish

        say(visible(publish(args.out)))
        return 0

    return exit_code(write, out=args.out)


def _arguments(argv: Sequence[str]) -> argparse.Namespace:
    parser = Parser(
        prog="python -m taichi_plume.study",
        description="Execute all runs of a study and write tables of them. Started again, continue with the rest.",
        epilog="python -m taichi_plume.study report DIR: write the tables and the page of a study again",
    )
    parser.add_argument("study", type=Path, help="YAML file")
    add(parser, "--out", help="the study's folder (default: studies/NAME)")
    processes = "processes on this machine (default: one per core)"
    option(parser, "--workers", whole_number(1, 4096), "N", processes)
    scheduler = "Dask scheduler, such as tcp://host:8786, whose workers execute the runs"
    option(parser, "--scheduler", str, "ADDRESS", scheduler)
    add(parser, "--force", help="drop runs in the folder that the study does not ask for")
    flag(parser, "--check", "only check: print the runs of the study")
    flag(parser, "--dashboard", "print the address of the scheduler's page")
    add(parser, "--retry", "--quiet", "--allow-code", "--allow-outside", "--no-report", "--debug")
    args = parser.parse_args(argv)
    if args.workers and args.scheduler:
        parser.error("--workers is for this machine; it cannot go with --scheduler")
    if args.dashboard and not args.scheduler:
        parser.error("--dashboard needs a Dask scheduler: start `dask scheduler` and add --scheduler ADDRESS")
    return args
