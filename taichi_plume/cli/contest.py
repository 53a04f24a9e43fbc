"""``taichi-plume contest`` compares all search algorithms, and your own, in the same realisations of the air.

Exit code 0: all is done; 1: some runs have failed, the others' results are there; 2: the command line is wrong;
130: interrupted, and the same command continues. Errors of the input are reported before Taichi or Dask are imported.
"""

import shlex
import sys
from collections.abc import Sequence
from typing import Any

from taichi_plume.api.contest import contest, held
from taichi_plume.cli.exit_codes import exit_code
from taichi_plume.cli.options import parser_of
from taichi_plume.cli.study import print_end
from taichi_plume.execution.signals import reader_may_leave
from taichi_plume.files.run_folder import RunFolderError
from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.terminal import say

INTERRUPTED = "interrupted; finished runs are kept, and the same command continues"


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv` (without the program's name) and return its exit code."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    given = vars(parser_of("contest", contest).parse_args(arguments))
    debug, again = given.pop("debug"), shlex.join(["taichi-plume", "contest", *arguments])
    return exit_code(lambda: _contest(again, **given), INTERRUPTED, debug, given.get("out"))


def _contest(again: str, **options: Any) -> int:
    for key in {"algorithms", "scenarios"} & options.keys():
        options[key] = [name.strip() for name in options[key].split(",")]
        if not all(options[key]):
            raise InputError(f"--{key}: give names with commas between, such as open_2d,meandering")
    quiet, codes = options.get("progress") is False, [0]
    try:
        standings = held(
            lambda end: codes.append(print_end(end, quiet, report=False)), again=again, **options
        )
    except RunFolderError:
        if max(codes) == 130:  # before any run
            return 130
        raise
    for row in standings.rows:
        if row.failed:
            failed = f"{row.failed} of {row.runs} runs have failed"
            say(f"{row.scenario}: {row.algorithm}: {failed}: {row.message}", error=True)
    if standings.rows and not quiet:
        from taichi_plume.contests.standings import show_table

        with reader_may_leave():
            show_table(standings.rows)
            say(f"{standings.page}, contest.csv, contest.parquet")
    return max(codes)
