"""The command: ``python -m taichi_plume.study study.yaml`` makes all runs of a study, on all cores or a Dask cluster.

``python -m taichi_plume.study report DIR`` writes tables and page of a study's folder again. Exit code 0: all is done;
1: some runs have failed, or the workers were lost, what there is is kept; 2: the study or the command line is wrong;
130: interrupted. What is wrong is told before Taichi or Dask are imported.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from taichi_plume.cli.exit_codes import exit_code
from taichi_plume.cli.options import add, whole_number
from taichi_plume.guard.terminal import Parser
from taichi_plume.running.signals import reader_may_leave


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv` (without the program's name) and return its exit code."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    report = arguments[:1] == ["report"]
    args = _report_arguments(arguments[1:]) if report else _arguments(arguments)
    work, debug = (_report, None) if report else (_study, args.debug)
    return exit_code(lambda: work(args), debug=debug, out=args.out)


def _study(args: argparse.Namespace) -> int:
    from taichi_plume.study.plan import load_plan

    plan = load_plan(args.study, args.allow_outside)
    out = args.out or Path("studies") / plan.study.name
    if args.check:
        from taichi_plume.study.study_run import print_check

        with reader_may_leave():
            print_check(plan, out)
        return 0
    from taichi_plume.study.study_run import Wishes, carry_out

    wishes = Wishes(
        out, args.workers, args.scheduler, args.retry, args.force, args.quiet, args.allow_code, args.allow_outside,
        args.dashboard, not args.no_report, args.debug,
    )  # fmt: skip
    return carry_out(plan, wishes)


def _report(args: argparse.Namespace) -> int:
    """Make the tables of a study's folder of what its runs have left, and the page."""
    from taichi_plume.study.study_run import publish

    return publish(args.out)


def _report_arguments(argv: Sequence[str]) -> argparse.Namespace:
    parser = Parser(
        prog="python -m taichi_plume.study report",
        description="Write the tables and the page of a study again, of all runs that are done.",
    )
    parser.add_argument("out", type=Path, metavar="DIR", help="the study's folder, such as studies/NAME")
    return parser.parse_args(argv)


def _arguments(argv: Sequence[str]) -> argparse.Namespace:
    parser = Parser(
        prog="python -m taichi_plume.study",
        description="Make all runs of a study, and tables of them. Started again, it goes on with what is not done.",
        epilog="python -m taichi_plume.study report DIR: write the tables and the page of a study again",
    )
    parser.add_argument("study", type=Path, help="YAML file")
    add(parser, "--out", help="the study's folder (default: studies/NAME)")
    parser.add_argument(
        "--workers",
        type=whole_number(1, 4096),
        metavar="N",
        help="processes on this machine (default: one per core)",
    )
    parser.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="of a Dask scheduler, such as tcp://host:8786, whose workers do the runs",
    )
    add(parser, "--force", help="drop runs in the folder that the study does not ask for")
    parser.add_argument("--check", action="store_true", help="only check: say which runs it makes")
    parser.add_argument("--dashboard", action="store_true", help="print the address of the scheduler's page")
    add(parser, "--retry", "--quiet", "--allow-code", "--allow-outside", "--no-report", "--debug")
    args = parser.parse_args(argv)
    if args.workers and args.scheduler:
        parser.error("--workers is of this machine: it has no place beside --scheduler")
    if args.dashboard and not args.scheduler:
        parser.error(
            "--dashboard is the page of a Dask scheduler: start `dask scheduler` and add --scheduler ADDRESS"
        )
    return args
