"""``taichi-plume study study.yaml`` executes all runs of a study, on all cores or a Dask cluster, as `study` does.

``taichi-plume study report DIR`` writes tables and page of a study's folder again. Exit code 0: all is done; 1: some
runs have failed, or the workers were lost, existing results are kept; 2: the study or the command line is wrong; 130:
interrupted. Errors of the input are reported before Taichi or Dask are imported.
"""

import sys
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from taichi_plume.api.study import held, study
from taichi_plume.cli.exit_codes import exit_code
from taichi_plume.cli.options import parser_of
from taichi_plume.execution.signals import reader_may_leave
from taichi_plume.guard.terminal import say, visible

if TYPE_CHECKING:
    from taichi_plume.studies.study_run import End

EXIT_CODES = {"completed": 0, "failed": 1, "interrupted": 130}


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv` (without the program's name) and return its exit code."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    again = arguments[:1] == ["report"]
    end = "taichi-plume study report DIR: write the tables and the page of a study again"
    parser = parser_of("study report", report) if again else parser_of("study", run, study, epilog=end)
    given = vars(parser.parse_args(arguments[1:] if again else arguments))
    if "workers" in given and "scheduler" in given:
        parser.error("--workers is for this machine; it cannot go with --scheduler")
    if "dashboard" in given and "scheduler" not in given:
        parser.error("--dashboard needs a Dask scheduler: start `dask scheduler` and add --scheduler ADDRESS")
    debug = given.pop("debug")
    work = (lambda: report(**given)) if again else lambda: run(**given, debug=debug)
    return exit_code(work, debug=debug, out=given.get("out"))


def run(
    source: Annotated[Path, "STUDY"], *, out: Path | None = None, check: bool = False, **options: Any
) -> int:
    """Execute all runs of a study and write tables of them. Started again, continue with the rest.

    source: YAML file. out: the study's folder, by default studies/NAME. check: only check: print the runs of the study.

    Other options are those of `study`.
    """
    debug, progress = options.pop("debug"), options.get("progress", True)
    if check:
        from taichi_plume.studies.plan import SAMPLE, load_plan
        from taichi_plume.studies.study_run import print_check

        plan = load_plan(source, options.get("allow_outside", False), progress, SAMPLE)
        with reader_may_leave():
            print_check(plan, out or plan.default_out)
        return 0
    end = held(source, out, **options)
    if "shard" in options:
        options["report"] = None  # the tables are those of all shards
    return print_end(end, not progress, debug, options.get("report", True))


def print_end(end: "End", quiet: bool, debug: bool = False, report: bool | None = True) -> int:
    """Print how a study's execution ended, and return the exit code.

    report: whether it has written the report page; None for a shard, which has written no tables either.
    """
    if debug and isinstance(end.error, OSError):
        say(*"".join(traceback.format_exception(end.error)).splitlines(), error=True)
    say(*end.notes, error=True, longest=None)
    if not quiet and end.runs:
        made = "records" if report is None else "runs.parquet, trials/" + ", report.html" * report
        of_shard = " of the shard" * (report is None)
        with reader_may_leave():
            say(visible(f"{end.done:,} of {end.runs:,} runs{of_shard} are done; {made} in {end.folder}"))
    return EXIT_CODES[end.status]


def report(out: Annotated[Path, "DIR"]) -> int:
    """Write the tables and the page of a study again, of all runs that are done.

    out: the study's folder, such as studies/NAME.
    """
    from taichi_plume.studies.study_run import publish

    say(visible(publish(out)))
    return 0
