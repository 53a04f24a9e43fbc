"""``python -m taichi_plume.contest`` compares all search algorithms, and your own, in the same realisations of the air.

Exit code 0: all is done; 1: some runs have failed, the others' results are there; 2: the command line is wrong;
130: interrupted, and the same command continues. Errors of the input are reported before Taichi or Dask are imported.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from taichi_plume.cli.exit_codes import exit_code
from taichi_plume.cli.options import add, flag, option, whole_number
from taichi_plume.execution.signals import reader_may_leave
from taichi_plume.guard.terminal import Parser, say

if TYPE_CHECKING:
    from taichi_plume.contests.execution import Contest

AIRS, SEARCHES = 8, 8
QUICK_AIRS, QUICK_SEARCHES = 2, 4


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv` (without the program's name) and return its exit code."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    args = _arguments(arguments)
    interrupted = "interrupted; finished runs are kept, and the same command continues"
    return exit_code(lambda: _contest(args, arguments), interrupted, out=args.out)


def _contest(args: argparse.Namespace, arguments: Sequence[str]) -> int:
    from taichi_plume.contests import execution
    from taichi_plume.contests.entrants import entrants, scenarios
    from taichi_plume.contests.fixed_scenarios import NAMES, QUICK, fixed

    names = scenarios(execution.chosen(args.scenarios), QUICK if args.quick else NAMES)
    entries = entrants(execution.chosen(args.algorithms), args.algorithm, args.policy)
    _require_allowed(args)
    searches = args.searches or (QUICK_SEARCHES if args.quick else SEARCHES)
    chosen = tuple(fixed(name, args.seed, searches) for name in names)
    airs = args.airs or (QUICK_AIRS if args.quick else AIRS)
    contest = execution.Contest(args.out, chosen, tuple(entries), airs)
    from taichi_plume.studies.study_run import Wishes

    wishes = Wishes(
        args.out, args.workers, retry=args.retry, force=args.force, quiet=args.quiet, allow_code=bool(args.algorithm),
        allow_outside=True, report=False,
    )  # fmt: skip
    code = execution.play(contest, wishes)
    _conclude(args, contest, ["python", "-m", "taichi_plume.contest", *arguments])
    return code


def _conclude(args: argparse.Namespace, contest: "Contest", command: Sequence[str]) -> None:
    """Write the contest table and the HTML page of the finished runs, and print the results."""
    from taichi_plume.contests import page, standings

    rows = standings.rows(contest)
    standings.write(contest, rows)
    path = page.write(contest, rows, command)
    for row in rows:
        if row.failed:
            failed = f"{row.failed} of {row.runs} runs have failed"
            say(f"{row.scenario}: {row.algorithm}: {failed}: {row.message}", error=True)
    if not args.quiet:
        with reader_may_leave():
            page.show_table(rows)
            say(f"{path}, contest.csv, contest.parquet")


def _require_allowed(args: argparse.Namespace) -> None:
    """Raise ScenarioError if the user has not allowed the execution of Python files with algorithms."""
    from taichi_plume.assembly.own_code import has_permission
    from taichi_plume.files.own_class import OwnFile
    from taichi_plume.scenario.loading import ScenarioError

    refused = [
        f"{path}: holds Python code, which runs with all your rights; look at it, then add --allow-code"
        for path in args.algorithm
        if not args.allow_code and not has_permission(str(path), OwnFile.read(path, None).digest)
    ]
    if refused:
        raise ScenarioError(refused)


def _arguments(argv: Sequence[str]) -> argparse.Namespace:
    count = whole_number(1, 4096)
    parser = Parser(
        prog="python -m taichi_plume.contest",
        description="All search algorithms, and your own, in the same fixed scenarios, airs and starts: one table and "
        "one page. Started again, the command continues with the rest.",
    )
    several = {"action": "append", "default": []}
    option(parser, "--algorithm", Path, "FILE.py", "your own; may be repeated", **several)
    policy = "a learnt policy: an ONNX file, or a scenario whose robots run one; may be repeated"
    option(parser, "--policy", Path, "FILE", policy, **several)
    add(parser, "--allow-code", help="execute the files of --algorithm")
    add(parser, "--out", default=Path("contest"), help="the contest's folder (default: contest)")
    option(parser, "--scenarios", str, "NAMES", "only these scenarios, separated by commas")
    option(parser, "--algorithms", str, "NAMES", "only these shipped algorithms, separated by commas")
    flag(parser, "--quick", f"one scenario, {QUICK_AIRS} airs: a preview of about a minute")
    seed = "seed of airs, starts and noise (default: the scenarios')"
    option(parser, "--seed", whole_number(0, (1 << 32) - 1), "N", seed)
    option(parser, "--airs", count, "N", f"of each scenario (default: {AIRS})")
    option(parser, "--searches", count, "N", f"in each air (default: {SEARCHES})")
    option(parser, "--workers", count, "N", "processes (default: one per core)")
    add(parser, "--force", help="drop runs in the folder that this contest does not ask for")
    add(parser, "--retry", "--quiet")
    return parser.parse_args(argv)
