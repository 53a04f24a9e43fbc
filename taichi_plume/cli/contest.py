"""``python -m taichi_plume.contest`` compares all search algorithms, and your own, in the same realisations of the air.

Exit code 0: all is done; 1: some runs have failed, the others' results are there; 2: the command line is wrong;
130: interrupted, and the same command continues. Errors of the input are reported before Taichi or Dask are imported.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

from taichi_plume.cli.exit_codes import exit_code
from taichi_plume.cli.options import add, flag, option, whole_number
from taichi_plume.execution.signals import reader_may_leave
from taichi_plume.guard.terminal import Parser, say


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv` (without the program's name) and return its exit code."""
    args = _arguments(argv)
    interrupted = "interrupted; finished runs are kept, and the same command continues"
    return exit_code(lambda: _contest(args), interrupted, out=args.out)


def _contest(args: argparse.Namespace) -> int:
    from taichi_plume.cli.study import print_end
    from taichi_plume.contests.execution import Choice, chosen, contest_of, play, settings_of
    from taichi_plume.contests.standings import conclude, show_table
    from taichi_plume.files.run_folder import RunFolderError

    choice = Choice(
        args.out, chosen(args.algorithms), args.algorithm, args.policy, chosen(args.scenarios), args.quick, args.seed,
        args.airs, args.searches, args.allow_code,
    )  # fmt: skip
    settings = settings_of(choice, args.workers, args.retry, args.force, not args.quiet)
    contest = contest_of(choice)
    code = max(print_end(end, args.quiet, report=False) for end in play(contest, settings))
    try:
        standings = conclude(contest, choice.repetition())
    except RunFolderError:
        if code == 130:  # before any run
            return code
        raise
    for row in standings.rows:
        if row.failed:
            failed = f"{row.failed} of {row.runs} runs have failed"
            say(f"{row.scenario}: {row.algorithm}: {failed}: {row.message}", error=True)
    if not args.quiet:
        with reader_may_leave():
            show_table(standings.rows)
            say(f"{standings.page}, contest.csv, contest.parquet")
    return code


def _arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    from taichi_plume.contests import AIRS, QUICK_AIRS, SEARCHES

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
