"""Execute a parameter study: lock its folder, execute missing runs, write the tables and the report page."""

import traceback
from collections import Counter
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from taichi_plume.execution.signals import SignalRequests, handling_signals, reader_may_leave
from taichi_plume.files.run_folder import RunFolderError
from taichi_plume.guard.terminal import LONGEST_VALUE, say, show, visible
from taichi_plume.scenario.loading import ScenarioError, scenario_of
from taichi_plume.studies.messages import Options
from taichi_plume.studies.outcomes import not_left
from taichi_plume.studies.store import DONE, FAILED, KEPT_FOLDER, Store, StoreError

if TYPE_CHECKING:
    from taichi_plume.studies.messages import Request
    from taichi_plume.studies.plan import Plan
    from taichi_plume.studies.workers import Workers

MOST_FAILED = 3  # failed runs that are listed
MOST_POINTS = 10  # points that `--check` lists
GOES_ON = "the same command resumes the study"


class Wishes(NamedTuple):
    """Options of the study command. out: the study's folder; workers: number of workers, None for all cores."""

    out: Path
    workers: int | None = None
    scheduler: str | None = None
    retry: bool = False
    force: bool = False
    quiet: bool = False
    allow_code: bool = False
    allow_outside: bool = False
    dashboard: bool = False
    report: bool = True
    debug: bool = False


def carry_out(plan: "Plan", wishes: Wishes) -> int:
    """Execute the missing runs of a study, then write its tables and its report page. Return the command's exit code.

    Raises ScenarioError, RunFolderError, OSError.
    """
    _require_allowed(plan, wishes)
    try:
        with handling_signals() as signals, Store(wishes.out) as store:
            store.begin(plan, wishes.force)
            code = _work(plan, store, wishes, signals)
            if code == 2:
                return code
            signals.running, signals.hasty = True, not signals.stopped  # a first signal waits for the tables
            code = _conclude(plan, store, wishes, code)
            return 130 if signals.stopped else code
    except KeyboardInterrupt:
        say(f"interrupted; finished runs are kept, and {GOES_ON}", error=True)
        return 130
    except StoreError as error:
        raise RunFolderError(str(error)) from None


def _work(plan: "Plan", store: Store, wishes: Wishes, signals: SignalRequests) -> int:
    """Execute the missing runs of a study on workers; return exit code 0, or 1 or 2 if workers or files fail."""
    missing = missing_runs(plan, store, wishes.retry)
    total, before = len(plan.requests), len(plan.requests) - len(missing)
    if not wishes.quiet:
        made = f", {before:,} of them finished already" if before else ""
        say(visible(f"{total:,} runs{made}; writing to {wishes.out}"), error=True)
    if not missing:
        return 0
    from taichi_plume.studies.progress import Display
    from taichi_plume.studies.scheduler import Scheduler
    from taichi_plume.studies.workers import WorkersError

    study = plan.study
    paths = {path: path for path in study.outcomes.values()}  # names of columns may change later
    options = Options(wishes.out.resolve(), tuple(study.keep), paths, wishes.allow_code, wishes.allow_outside)
    try:
        with (
            closing(_workers(plan, wishes, signals, len(missing))) as workers,
            Display(total, before, wishes.quiet) as display,
        ):
            signals.hasty = True  # a first signal ends the scheduler in order, a second one at once
            scheduler = Scheduler(plan, store, workers, options, missing, display, signals)
            scheduler.run()
    except WorkersError as error:
        say(visible(error), error=True)
        if error.code == 1:
            say(visible(f"finished runs are kept in {wishes.out}; {GOES_ON}"), error=True)
        return error.code
    except OSError as error:
        if wishes.debug:
            say(*traceback.format_exc().splitlines(), error=True)
        at = f": {error.filename}" if error.filename else ""
        say(visible(f"{error.strerror or error}{at}"), error=True)
        return 1
    if not wishes.quiet:
        say(scheduler.totals.line(), error=True)
    return 0


def _workers(plan: "Plan", wishes: Wishes, signals: SignalRequests, most: int) -> "Workers":
    """Return the workers of the given Dask scheduler, else at most `most` local processes. Raises WorkersError."""
    from taichi_plume.studies.workers import DaskWorkers, LocalWorkers, cores

    if not wishes.scheduler:
        signals.running = True
        return LocalWorkers(min(wishes.workers or cores(), most), wishes.out)
    workers = DaskWorkers(wishes.scheduler, plan, wishes.out, signals)
    if wishes.dashboard:
        say(visible(f"Dask's dashboard: {workers.client.dashboard_link}"), error=True)
    return workers


def _conclude(plan: "Plan", store: Store, wishes: Wishes, code: int) -> int:
    """Write a study's tables and page, print the numbers of finished, failed and missing runs; return the exit code."""
    publish(store.folder, wishes.report, quiet=True)
    statuses = store.statuses()
    failed = sum(status == "failed" for status in statuses.values())
    done = sum(statuses.get(request.run) in DONE for request in plan.requests)
    missing = len(plan.requests) - done - failed
    if failed:
        _report_failed(store, failed)
    if missing:
        say(visible(f"{missing:,} runs are missing; {GOES_ON}"), error=True)
    if not wishes.quiet:
        made = "runs.parquet, trials/" + ", report.html" * wishes.report
        with reader_may_leave():
            say(visible(f"{done:,} of {len(plan.requests):,} runs are done; {made} in {store.folder}"))
    return max(code, 1 if failed or missing else 0)


def publish(folder: Path, page: bool = True, quiet: bool = False) -> int:
    """Write the tables and, if `page` is true, the report page of the study in a folder; return exit code 0.

    Raises RunFolderError if the folder holds no study or damaged files, and OSError.
    """
    from taichi_plume.studies import tables

    if not (folder / tables.PLAN).is_file():
        raise RunFolderError(f"{folder}: is not the folder of a study")
    try:
        tables.publish(folder, Store(folder).table)
        if not page:
            return 0
        from taichi_plume.studies import page as pages

        path = pages.write(folder)
    except ValueError as error:  # StoreError, or an error of Arrow for damaged files
        raise RunFolderError(str(error)) from None
    if not quiet:
        say(visible(path))
    return 0


def _report_failed(store: Store, failed: int) -> None:
    table = store.table(("run", "status", "message")).sort_by("run").to_pylist()
    messages = [(row["run"], row["message"]) for row in table if row["status"] == "failed"]
    runs = "1 run has failed" if failed == 1 else f"{failed:,} runs have failed"
    where = store.folder / FAILED
    listed = f"all are listed in runs.parquet and lie in {where}; --retry executes them again"
    say(visible(f"{runs}; {listed}"), error=True)
    for run, message in messages[:MOST_FAILED]:
        say(visible(f"  {run}: {message}"), error=True)
    if failed > MOST_FAILED:
        say("  ...", error=True)


# ---------------------------------------------------------------- before the first run


def _require_allowed(plan: "Plan", wishes: Wishes) -> None:
    """Raise ScenarioError if the study's scenarios name Python files and the option --allow-code is not given."""
    if wishes.allow_code:
        return
    files = _own_files([plan.base, *(request.changes for request in plan.requests)])
    if files:
        what = "holds Python code, which runs with all your rights; check the code, then add --allow-code"
        raise ScenarioError([f"{visible(file)}: {what}" for file in sorted(files)])


def _own_files(data: object) -> set[str]:
    """Return the paths of Python files with users' algorithms in the data of a scenario (nested dicts and lists)."""
    if isinstance(data, dict):
        here = {str(data["file"])} if data.get("kind") == "own" and data.get("file") else set()
        return here.union(*map(_own_files, data.values()))
    return set().union(*map(_own_files, data)) if isinstance(data, list | tuple) else set()


def missing_runs(plan: "Plan", store: Store, retry: bool) -> "list[Request]":
    """Return the runs of a study's plan to execute: runs without a record, failed runs if `retry`, and incomplete runs.

    A finished run is incomplete if the study has requested more outcomes or files since then: neither is part of a
    run's id. Raises StoreError.
    """
    statuses, incomplete = store.statuses(), _incomplete(plan, store)
    return [
        request
        for request in plan.requests
        if request.run not in statuses
        or request.run in incomplete
        or (retry and statuses[request.run] not in DONE)
    ]


def _incomplete(plan: "Plan", store: Store) -> set[str]:
    """Return the ids of finished runs that lack an outcome or a file that the study requests."""
    paths, keep = set(plan.study.outcomes.values()), plan.study.keep
    if not paths and not keep:
        return set()
    incomplete, lacking = set(), {}
    for record in store.records():
        if record.status in DONE:
            if not paths <= record.outcomes.keys():
                incomplete.add(record.run)
            folder = store.folder / KEPT_FOLDER / record.run
            lacking[record.run] = [name for name in keep if not (folder / name).exists()]
    left: dict[tuple[int, str], bool] = {}  # by point and file: whether runs of the point leave the file
    for request in plan.requests:
        for name in lacking.get(request.run, ()):
            key = request.point, name
            if key not in left:
                left[key] = not_left(name, scenario_of(plan.base, request.changes)) is None
            if left[key]:
                incomplete.add(request.run)
    return incomplete


def print_check(plan: "Plan", out: Path) -> None:
    """Print a study's numbers of runs, points and airs (flow realisations) and its first points, as `--check` shows."""
    from rich.table import Table

    requests = plan.requests
    runs_of_air = Counter(request.air for request in requests)
    runs_of_point = Counter(request.point for request in requests)
    points = {request.point: request for request in reversed(requests)}
    several = sum(count for count in runs_of_air.values() if count > 1)
    shared = f"; {several:,} runs share their air with other runs" if several else ""
    structures = len({request.structure for request in requests})
    say(visible(f"study {plan.study.name} ({plan.study.kind}) of {plan.study.base}, into {out}"))
    say(f"runs: {len(requests):,}, at {len(points):,} points")
    say(f"airs: {len(runs_of_air):,}{shared}")
    say(f"structures, each compiled once by a worker: {structures:,}")
    heads = (f"{axis.name} [{axis.unit}]" if axis.unit else axis.name for axis in plan.axes)
    table = Table("point", "runs", *heads)
    for point, request in sorted(points.items())[:MOST_POINTS]:
        values = (request.values.get(axis.name) for axis in plan.axes)
        shown = (f"{v:.6g}" if isinstance(v, float) else visible(v, LONGEST_VALUE) for v in values)
        table.add_row(str(point), str(runs_of_point[point]), *shown)
    show(table)
    if len(points) > MOST_POINTS:
        say(f"... and {len(points) - MOST_POINTS:,} points more")
