"""``taichi-plume contest`` compares all search algorithms, and your own, in the same realisations of the air.

Exit code 0: all is done; 1: some runs have failed, the others' results are there; 2: the command line is wrong;
130: interrupted, and the same command continues. Errors of the input are reported before Taichi or Dask are imported.
"""

from collections.abc import Sequence
from typing import Any

from taichi_plume.api.contest import contest
from taichi_plume.cli.exit_codes import exit_code
from taichi_plume.cli.options import parser_of
from taichi_plume.execution.signals import reader_may_leave
from taichi_plume.guard.terminal import say


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv` (without the program's name) and return its exit code."""
    given = vars(parser_of("contest", contest).parse_args(argv))
    debug, interrupted = (
        given.pop("debug"),
        "interrupted; finished runs are kept, and the same command continues",
    )
    return exit_code(lambda: _contest(**given), interrupted, debug, given.get("out"))


def _contest(**options: Any) -> int:
    from taichi_plume.cli.study import print_end
    from taichi_plume.contests.execution import Choice, chosen, contest_of, play, settings_of
    from taichi_plume.contests.standings import conclude, show_table
    from taichi_plume.files.run_folder import RunFolderError

    progress, workers = options.pop("progress", True), options.pop("workers", None)
    retry, force = options.pop("retry", False), options.pop("force", False)
    options |= {key: chosen(options[key]) for key in ("algorithms", "scenarios") if key in options}
    choice, quiet = Choice(**options), not progress
    settings = settings_of(choice, workers, retry, force, progress)
    settings.check()
    contest = contest_of(choice)
    code = max(print_end(end, quiet, report=False) for end in play(contest, settings))
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
    if not quiet:
        with reader_may_leave():
            show_table(standings.rows)
            say(f"{standings.page}, contest.csv, contest.parquet")
    return code
