"""A study from its begin to its end: folder, workers, campaign, tables, page, and what the user is told."""

import traceback
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from taichi_plume.files.run_folder import RunFolderError
from taichi_plume.guard.terminal import say, visible
from taichi_plume.running.signals import Ears, listening, reader_may_leave
from taichi_plume.scenario.loading import ScenarioError
from taichi_plume.study.store import DONE, Store, StoreError

if TYPE_CHECKING:
    from taichi_plume.study.messages import Request
    from taichi_plume.study.plan import Plan
    from taichi_plume.study.workers import Workers

SHOWN = 3  # failed runs that are shown


class Wishes(NamedTuple):
    """What the command line asks for besides the study; out: the study's folder; workers: None for all cores."""

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
    """Execute the runs of a plan that are not done, then write tables and page. Return the command's exit code.

    Raises ScenarioError, RunFolderError, OSError.
    """
    _require_allowed(plan, wishes)
    try:
        with listening() as ears, Store(wishes.out) as store:
            store.begin(plan, wishes.force)
            code = _work(plan, store, wishes, ears)
            if code == 2:
                return code
            ears.running, ears.hasty = (
                True,
                not ears.stopped,
            )  # a first signal waits until the tables are there
            code = _conclude(plan, store, wishes, code)
            return 130 if ears.stopped else code
    except KeyboardInterrupt:
        say("interrupted; what is done is kept, and the same command goes on", error=True)
        return 130
    except StoreError as error:
        raise RunFolderError(str(error)) from None


def _work(plan: "Plan", store: Store, wishes: Wishes, ears: Ears) -> int:
    """Do what is not done; returns the exit code so far."""
    from taichi_plume.study.todo import todo

    missing = todo(plan, store, wishes.retry)
    _tell_begin(len(plan.requests), len(missing), wishes)
    if not missing:
        return 0
    from taichi_plume.study.workers import DaskWorkers, LocalWorkers, WorkersError, cores

    try:
        if wishes.scheduler:
            workers: Workers = DaskWorkers(wishes.scheduler, plan, wishes.out, ears)
            if wishes.dashboard:
                say(visible(f"Dask's dashboard: {workers.client.dashboard_link}"), error=True)
        else:
            ears.running = True
            workers = LocalWorkers(min(wishes.workers or cores(), len(missing)), wishes.out)
        with closing(workers):
            return _campaign(plan, store, workers, wishes, ears, missing)
    except WorkersError as error:
        say(visible(error), error=True)
        if error.code == 1:
            say(visible(f"what is done is kept in {wishes.out}; the same command goes on"), error=True)
        return error.code


def _campaign(
    plan: "Plan", store: Store, workers: "Workers", wishes: Wishes, ears: Ears, missing: "list[Request]"
) -> int:
    from taichi_plume.study.campaign import Campaign, options_of
    from taichi_plume.study.progress import Display
    from taichi_plume.study.sharing import shared_airs

    shared = shared_airs(plan, missing)
    options = options_of(plan, wishes.out, wishes.allow_code, wishes.allow_outside)
    total = len(plan.requests)
    ears.hasty = True  # a first signal ends it in order, a second one at once
    try:
        with Display(total, total - len(missing), wishes.quiet) as display:
            campaign = Campaign(plan, store, workers, options, missing, shared, display, ears)
            campaign.run()
    except OSError as error:
        if wishes.debug:
            say(*traceback.format_exc().splitlines(), error=True)
        at = f": {error.filename}" if error.filename else ""
        say(visible(f"{error.strerror or error}{at}"), error=True)
        return 1
    if not wishes.quiet:
        say(campaign.totals.line(), error=True)
    return 0


def _conclude(plan: "Plan", store: Store, wishes: Wishes, code: int) -> int:
    """Write tables and page, and tell what there is and what is not."""
    publish(store.folder, wishes.report, quiet=True)
    statuses = store.statuses()
    failed = sum(one == "failed" for one in statuses.values())
    done = sum(statuses.get(one.run) in DONE for one in plan.requests)
    missing = len(plan.requests) - done - failed
    if failed:
        _tell_failed(store, failed)
    if missing:
        say(visible(f"{missing:,} runs are not done yet; the same command goes on"), error=True)
    if not wishes.quiet:
        made = "runs.parquet, trials/" + ", report.html" * wishes.report
        with reader_may_leave():
            say(visible(f"{done:,} of {len(plan.requests):,} runs are done; {made} in {store.folder}"))
    return max(code, 1 if failed or missing else 0)


def publish(folder: Path, page: bool = True, quiet: bool = False) -> int:
    """Write the tables and, where wanted, the page of a study's folder; returns the exit code.

    Raises RunFolderError where it is none, and OSError.
    """
    from taichi_plume.study import tables

    if not (folder / "plan.parquet").is_file():
        raise RunFolderError(f"{folder}: is not the folder of a study")
    try:
        tables.publish(folder, Store(folder).records())
        if not page:
            return 0
        from taichi_plume.study import page as pages

        path = pages.write(folder)
    except ValueError as error:  # StoreError, or of Arrow: what lies there is damaged
        raise RunFolderError(str(error)) from None
    if not quiet:
        say(visible(path))
    return 0


# ---------------------------------------------------------------- what the user is told


def _tell_begin(total: int, todo: int, wishes: Wishes) -> None:
    if wishes.quiet:
        return
    before = f", {total - todo:,} of them made before" if todo < total else ""
    say(visible(f"{total:,} runs{before}; into {wishes.out}"), error=True)


def _tell_failed(store: Store, failed: int) -> None:
    told = [(one.run, one.message) for one in store.records() if one.status == "failed"]
    runs = "1 run has failed" if failed == 1 else f"{failed:,} runs have failed"
    where = store.folder / "failed"
    say(
        visible(f"{runs}; all are listed in runs.parquet and lie in {where}; --retry makes them again"),
        error=True,
    )
    for run, message in sorted(told)[:SHOWN]:
        say(visible(f"  {run}: {message}"), error=True)
    if failed > SHOWN:
        say("  ...", error=True)


def _require_allowed(plan: "Plan", wishes: Wishes) -> None:
    """Refuse code that scenarios name, unless it is wanted. Raises ScenarioError."""
    if wishes.allow_code:
        return
    named = [_own(plan.base), *(_own(request.changes) for request in plan.requests)]
    files = sorted({file for some in named for file in some})
    if files:
        what = "holds Python code, which runs with all your rights; look at it, then add --allow-code"
        raise ScenarioError([f"{visible(file)}: {what}" for file in files])


def _own(data: object) -> set[str]:
    """Files of own algorithms that are named in a part of a scenario."""
    if isinstance(data, dict):
        here = {str(data["file"])} if data.get("kind") == "own" and data.get("file") else set()
        return here.union(*map(_own, data.values()))
    return set().union(*map(_own, data)) if isinstance(data, list | tuple) else set()
