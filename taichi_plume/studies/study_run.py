"""Execute a parameter study: lock its folder, execute missing runs, write the tables and the report page."""

from collections import Counter
from collections.abc import Collection, Sequence
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

from pydantic import Field

from taichi_plume.assembly.own_code import not_allowed
from taichi_plume.execution.signals import SignalRequests, handling_signals
from taichi_plume.files.own_class import Permission
from taichi_plume.files.own_folder import LOCK
from taichi_plume.files.run_folder import RunFolderError
from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.terminal import LONGEST_VALUE, say, show, visible
from taichi_plume.scenario.loading import ScenarioError, load_part, scenario_of
from taichi_plume.studies.messages import Options
from taichi_plume.studies.outcomes import not_left
from taichi_plume.studies.shards import Shard, log_of, parts_of, shards_with
from taichi_plume.studies.store import DONE, FAILED, KEPT_FOLDER, Store, StoreError

if TYPE_CHECKING:
    from taichi_plume.studies.messages import Request
    from taichi_plume.studies.plan import Plan
    from taichi_plume.studies.progress import Display
    from taichi_plume.studies.workers import Workers

MOST_FAILED = 3  # failed runs that are listed
WORKERS = Annotated[int, Field(ge=1, le=4096, strict=True)] | None
RESUME = "started again, the study resumes"


class Settings(NamedTuple):
    """Settings of a study's execution. out: the study's folder; workers: their number, by default one per core.

    scheduler: address of a Dask scheduler, whose workers are used instead, or its scheduler file; retry: execute failed
    runs again; force: remove runs that the study does not have; progress: show the progress; report: write the report
    page; shard: execute only this shard's runs, and write no tables; merge: execute no runs, only write the tables.
    """

    out: Path
    workers: int | None = None
    scheduler: str | None = None
    retry: bool = False
    force: bool = False
    progress: bool = True
    allow_code: Permission = False
    allow_outside: bool = False
    dashboard: bool = False
    report: bool = True
    shard: Shard | None = None
    merge: bool = False

    def check(self) -> None:
        """Raise ScenarioError if the number of workers is no whole number, or if settings exclude one another."""
        load_part(self.workers, "workers", WORKERS)
        if self.workers is not None and self.scheduler is not None:
            raise ScenarioError(["workers: are processes of this machine; they cannot go with a scheduler"])
        alone = {
            "shard": ("merge", "scheduler", "force"),
            "merge": ("workers", "scheduler", "retry", "force"),
        }
        for key, others in alone.items():
            given = [name for name in others if getattr(self, name)]
            if getattr(self, key) and given:
                raise ScenarioError([f"{key}: cannot go with {given[0]}"])


class End(NamedTuple):
    """End of a study's execution. runs, done: number of its runs, and of those that are finished without an error.

    status: "completed", "failed" (runs have failed, or the workers were lost) or "interrupted"; notes: lines on what is
    missing, and why; error: the exception that ended the execution early.
    """

    folder: Path
    status: str
    runs: int = 0
    done: int = 0
    notes: list[str] = []  # noqa: RUF012  never changed
    error: BaseException | None = None


def execute(plan: "Plan", settings: Settings) -> End:
    """Execute the missing runs of a study, then write its tables and its report page.

    Raises ScenarioError, RunFolderError, InputError if the scheduler's workers cannot be used, and OSError.
    """
    settings.check()
    _require_allowed(plan, settings)
    part = parts_of(plan, settings.shard.count)[settings.shard.number - 1] if settings.shard else None
    requests, common = part or (plan.requests, frozenset())
    try:
        with handling_signals() as signals, Store(settings.out, settings.shard, common) as store:
            errors, shards = [], None
            if settings.merge:
                shards = store.merge(plan)
            else:
                store.begin(plan, settings.force)
                errors += _work(plan, requests, store, settings, signals)
            signals.running, signals.hasty = True, not signals.stopped  # a first signal waits for the tables
            try:
                if part is None:
                    publish(store.folder, settings.report)
            except OSError as fault:  # such as a full disk, which has ended the runs as well
                errors.append(fault)
            end = _end(requests, store, bool(signals.stopped), errors)
            return _with_shards(end, plan, store, shards) if shards else end
    except KeyboardInterrupt as error:
        notes = [f"interrupted; finished runs are kept; {RESUME}"]
        return End(settings.out, "interrupted", notes=notes, error=error)
    except StoreError as error:
        raise RunFolderError(str(error)) from None


def _work(
    plan: "Plan", requests: "Sequence[Request]", store: Store, settings: Settings, signals: SignalRequests
) -> list[Exception]:
    """Execute the missing runs among `requests` on workers; return the error that ended this, such as lost workers."""
    missing = missing_runs(plan, store, settings.retry, requests)
    if settings.retry:
        store.forget_failures({request.air for request in missing})
    total, before = len(requests), len(requests) - len(missing)
    from taichi_plume.studies.progress import Display

    with Display(total, before, settings.progress) as display:
        made = f", {before:,} of them finished already" if before else ""
        display.note(visible(f"{total:,} runs{made}; writing to {settings.out}"))
        error = _schedule(plan, store, settings, signals, missing, display) if missing else None
        return [error] if error is not None else []


def _schedule(
    plan: "Plan", store: Store, settings: Settings, signals: SignalRequests, missing: "list[Request]",
    display: "Display",
) -> Exception | None:  # fmt: skip
    from taichi_plume.studies.scheduler import Scheduler
    from taichi_plume.studies.workers import WorkersError

    study, out = plan.study, settings.out.resolve()
    paths = {path: path for path in study.outcomes.values()}  # names of columns may change later
    options = Options(
        out, tuple(study.keep), paths, settings.allow_code, settings.allow_outside, plan.classes
    )
    try:
        with closing(_workers(plan, settings, signals, len(missing), display)) as workers:
            signals.hasty = True  # a first signal ends the scheduler in order, a second one at once
            scheduler = Scheduler(plan, store, workers, options, missing, display, signals)
            scheduler.run()
    except WorkersError as error:
        if error.code == 2:
            raise InputError(str(error)) from None
        return error
    except OSError as error:
        return error
    display.note(scheduler.totals.line())
    return None


def _workers(
    plan: "Plan", settings: Settings, signals: SignalRequests, most: int, display: "Display"
) -> "Workers":
    """Return the workers of the given Dask scheduler, else at most `most` local processes. Raises WorkersError."""
    from taichi_plume.studies.workers import DaskWorkers, LocalWorkers, cores

    if not settings.scheduler:
        signals.running = True
        log = settings.out / log_of(settings.shard.lock if settings.shard else LOCK)
        return LocalWorkers(min(settings.workers or cores(), most), log)
    workers = DaskWorkers(settings.scheduler, plan, settings.out, signals)
    if settings.dashboard:
        display.note(visible(f"Dask's dashboard: {workers.client.dashboard_link}"))
    return workers


def _end(requests: "Sequence[Request]", store: Store, interrupted: bool, errors: Sequence[Exception]) -> End:
    """Return the end of an execution of `requests`, with notes on its errors, on failed runs and on missing runs."""
    notes, known = [], store.statuses()
    statuses = {request.run: known[request.run] for request in requests if request.run in known}
    for error in errors:
        if isinstance(error, OSError):
            notes.append(f"{error.strerror or error}" + (f": {error.filename}" if error.filename else ""))
        else:
            notes += [str(error), f"finished runs are kept in {store.folder}"]
    failed = sum(status == "failed" for status in statuses.values())
    done = len(statuses) - failed
    missing = len(requests) - len(statuses)
    if failed:
        notes += _failed(store, failed, statuses)
    if missing:
        notes.append(f"{missing:,} runs are missing; {RESUME}")
    status = "interrupted" if interrupted else "failed" if notes else "completed"
    first = errors[0] if errors else None
    return End(store.folder, status, len(requests), done, list(map(visible, notes)), first)


def _with_shards(end: End, plan: "Plan", store: Store, count: int) -> End:
    """Return the end of a merge of `count` shards, with a note on the shards that have missing runs."""
    missing = missing_runs(plan, store, False)
    return end._replace(notes=[*end.notes, *shards_with(plan, count, missing)])


def publish(folder: Path, page: bool = True) -> Path | None:
    """Write the tables and, if `page` is true, the report page of the study in a folder; return the page's path.

    Raises RunFolderError if the folder holds no study or damaged files, and OSError.
    """
    from taichi_plume.studies import tables

    if not (folder / tables.PLAN).is_file():
        raise RunFolderError(f"{folder}: is not the folder of a study")
    try:
        tables.publish(folder, Store(folder).table)
        if not page:
            return None
        from taichi_plume.studies import page as pages

        return pages.write(folder)
    except ValueError as error:  # StoreError, or an error of Arrow for damaged files
        raise RunFolderError(str(error)) from None


def _failed(store: Store, failed: int, runs_of_part: "Collection[str]") -> list[str]:
    """Return lines on the failed runs of a study: their number, where they are, and the messages of the first."""
    table = store.table(("run", "status", "message")).sort_by("run").to_pylist()
    rows = (row for row in table if row["status"] == "failed" and row["run"] in runs_of_part)
    messages = [(row["run"], row["message"]) for row in rows]
    runs = "1 run has failed" if failed == 1 else f"{failed:,} runs have failed"
    listed = "all are listed in runs.parquet" + " after --merge" * (store.shard is not None)
    where = f"{listed} and lie in {store.folder / FAILED}"
    lines = [f"{runs}; {where}; --retry (in Python: retry=True) executes them again"]
    lines += [f"  {run}: {message}" for run, message in messages[:MOST_FAILED]]
    return lines + ["  ..."] * (failed > MOST_FAILED)


# ---------------------------------------------------------------- before the first run


def _require_allowed(plan: "Plan", settings: Settings) -> None:
    """Raise ScenarioError if runs would execute Python files of scenarios and the option --allow-code is not given."""
    if settings.allow_code or settings.merge:
        return
    files = _own_files([plan.base, *(request.changes for request in plan.requests)])
    if files:
        raise ScenarioError([not_allowed(visible(file)) for file in sorted(files)])


def _own_files(data: object) -> set[str]:
    """Return the paths of Python files with users' algorithms in the data of a scenario (nested dicts and lists)."""
    if isinstance(data, dict):
        here = {str(data["file"])} if data.get("kind") == "own" and data.get("file") else set()
        return here.union(*map(_own_files, data.values()))
    return set().union(*map(_own_files, data)) if isinstance(data, list | tuple) else set()


def missing_runs(
    plan: "Plan", store: Store, retry: bool, requests: "Sequence[Request] | None" = None
) -> "list[Request]":
    """Return the runs of a study's plan to execute: runs without a record, failed runs if `retry`, and incomplete runs.

    requests: the runs to look at, by default all. A finished run is incomplete if the study has requested more outcomes
    or files since then: neither is part of a run's id. Raises StoreError.
    """
    statuses, incomplete = store.statuses(), _incomplete(plan, store)
    return [
        request
        for request in (plan.requests if requests is None else requests)
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

    from taichi_plume.studies.plan import LISTED

    requests = plan.requests
    runs_of_air = Counter(request.air for request in requests)
    runs_of_point = Counter(request.point for request in requests)
    points = {request.point: request for request in reversed(requests)}
    several = sum(count for count in runs_of_air.values() if count > 1)
    shared = f"; {several:,} runs share their air with other runs" if several else ""
    structures = len({request.structure for request in requests})
    say(visible(f"study {plan.study.name} ({plan.study.kind}) of {plan.study.base}, into {out}"))
    say(f"runs: {plan.runs:,}, at {plan.points:,} points")
    if plan.checked < plan.points:
        say(
            f"checked: {plan.checked:,} of these points, with the ends of each axis; a study checks all before its "
            "first run. Of the points checked:"
        )
    say(f"airs: {len(runs_of_air):,}{shared}")
    say(f"structures, in which runs differ in numbers alone: {structures:,}")
    heads = (f"{axis.name} [{axis.unit}]" if axis.unit else axis.name for axis in plan.axes)
    table = Table("point", "runs", *heads)
    for point, request in sorted(points.items())[:LISTED]:
        values = (request.values.get(axis.name) for axis in plan.axes)
        shown = (f"{v:.6g}" if isinstance(v, float) else visible(v, LONGEST_VALUE) for v in values)
        table.add_row(str(point), str(runs_of_point[point]), *shown)
    show(table)
    if plan.points > LISTED:
        say(f"... and {plan.points - LISTED:,} points more")
