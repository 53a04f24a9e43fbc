"""From a plan to its tables: workers do what is not done yet, and whatever happens, what is done is kept."""

import errno
import shutil
import time
from contextlib import suppress
from pathlib import Path
from pkgutil import resolve_name
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any, NamedTuple

from taichi_plume import __version__
from taichi_plume.guard.terminal import visible
from taichi_plume.running.signals import Ears
from taichi_plume.study import worker
from taichi_plume.study.agenda import Agenda, Job
from taichi_plume.study.cluster import Cluster, ClusterError
from taichi_plume.study.figures import Figures
from taichi_plume.study.messages import AirRecord, Cost, Options, Record, Request, Task
from taichi_plume.study.store import Store

if TYPE_CHECKING:
    from taichi_plume.study.display import Display
    from taichi_plume.study.plan import Plan

FULL = (errno.ENOSPC, errno.EFBIG, errno.EDQUOT)
AHEAD = 2  # tasks per worker: one that it does, one that waits there
LONG_S = 10.0  # behind a task that takes longer none waits: another worker may be free before
LOOK_S = 1.0  # between looks at which workers there are
TICK_S = 0.2  # between looks at the clock and at signals
SLACK = 3.0  # a task brings home what it has when it has taken so many times what was meant
FILMS = 1  # films at a time beyond the number of workers
SPARE = 2.0  # films that the disk has to have room for, before another one is begun


class Labour(NamedTuple):
    """Names of the functions that do the work, for `pkgutil.resolve_name`: workers import them, the command does not.

    why_not, leave_failed: called by the command itself, where it has to know.
    """

    perform: str = "taichi_plume.study.perform:perform"
    solve_air: str = "taichi_plume.study.shared_air:solve_air"
    why_not: str = "taichi_plume.study.sharing:why_not"
    leave_failed: str = "taichi_plume.study.failures:leave_failed"
    scenario_of: str = "taichi_plume.scenario.loading:scenario_of"


class Lane(NamedTuple):
    """What a worker has been given: tasks that are not done, the structure of the last; alone: it gets no other."""

    tasks: int = 0
    structure: str = ""
    alone: bool = False
    long: bool = False


class Campaign:
    """The runs of a plan that are not done, on a cluster.

    requests: what is to be done; shared: ids of airs that are filmed for them. Its `run` ends when all is done or when
    `ears` have heard a signal.
    """

    def __init__(
        self,
        plan: "Plan",
        store: Store,
        cluster: Cluster,
        options: Options,
        labour: Labour,
        requests: list[Request],
        shared: set[str],
        display: "Display",
        ears: Ears,
    ):
        self.plan, self.store, self.cluster, self.options = plan, store, cluster, options
        self.labour, self.display, self.ears = labour, display, ears
        self.figures = Figures()
        self.films = [one.bytes for one in store.air_records()]  # of those that were made
        self.agenda = Agenda(
            requests, shared, store.film, FILMS + max(1, len(cluster.threads() or ())), self._room
        )
        self.lanes: dict[str, Lane] = {}
        self.given: dict[Any, tuple[Job, str]] = {}  # by future; the worker that was meant
        self.done: SimpleQueue[Any] = SimpleQueue()
        self.failed = 0
        self._looked = float("-inf")
        self._adrift: set[str] = set()
        self._told = False  # that there is no worker

    def run(self) -> None:
        """Do it. Raises ClusterError where the workers are lost, and OSError where the disk is full."""
        self._look()
        self.figures.begin(len(self.lanes))
        try:
            while not self.ears.stopped:
                if time.monotonic() - self._looked > LOOK_S:
                    self._look()
                self._feed()
                if not self.given and not self._waits():
                    break
                self._collect(TICK_S)
                self.display.update(self)
            else:
                while not self.done.empty():  # what was done by then
                    self._collect(0.0)
        finally:
            self.figures.end()
            self._cancel()

    def _waits(self) -> bool:
        """Whether something is left that no worker has. Raises OSError where it waits for room on the disk alone."""
        if self.agenda.unsolved and not self.agenda.solving and self.lanes and not self._room():
            raise OSError(
                errno.ENOSPC, "no room on the disk for another film of an air", str(self.store.airs)
            )
        return bool(self.agenda.open or self.agenda.suspects or self.agenda.unsolved)

    def _look(self) -> None:
        """See which workers there are. Raises ClusterError where the scheduler has gone, or a worker is of no use."""
        self._looked = time.monotonic()
        there = self.cluster.threads()
        if self.cluster.lost:
            raise ClusterError("the scheduler is gone")
        if there is None:
            return
        fresh = there.keys() - self.lanes.keys()
        if fresh:
            self.cluster.require_fit(self.plan, self.store.folder, fresh)
            many = [address for address in fresh if there[address] > 1]
            if many:
                self.display.note(
                    f"note: {len(many)} workers have several threads ({min(many)}), of which one is used: start them "
                    "with --nthreads 1, and --nworkers as many as there are cores"
                )
        self.lanes = {address: self.lanes.get(address, Lane()) for address in there}
        self.figures.workers(len(self.lanes))
        self._rescue()
        if not self.lanes and not self.cluster.local and not self._told:
            self._told = True
            address = self.cluster.client.scheduler.address
            self.display.note(f"no workers there; one is started by: dask worker {address} --nthreads 1")

    def _rescue(self) -> None:
        """Take back tasks that nobody does: Dask lets them wait for ever where the worker they were meant for went just
        before they came, and no other one was there.
        """
        lost = {
            future.key: future for future, (_, address) in self.given.items() if address not in self.lanes
        }
        if lost:
            held = {key for keys in self.cluster.held().values() for key in keys}
            lost = {
                key: future for key, future in lost.items() if key not in held and future.status == "pending"
            }
        for key in self._adrift & lost.keys():  # for a second time: nothing of them is on its way
            future = lost.pop(key)
            job, _ = self.given.pop(future)
            future.cancel()
            self.agenda.back(job)
        self._adrift = set(lost)

    # ------------------------------------------------------------ giving

    def _feed(self) -> None:
        """Give each worker what it can take: first a task for each, then one that waits there."""
        for ahead in range(AHEAD):
            reserved = sum(lane.alone for lane in self.lanes.values())
            for address, lane in sorted(self.lanes.items(), key=lambda one: one[1].tasks):
                suspects = len(self.agenda.suspects)
                if (
                    suspects
                    and not lane.alone
                    and reserved < suspects + sum(one.alone for one in self.lanes.values())
                ):
                    reserved += 1
                    if lane.tasks == 0:
                        self._give(self.agenda.suspects.popleft(), address)
                    continue  # nothing more until it has nothing
                if lane.alone or lane.long or lane.tasks != ahead:
                    continue
                job = self.agenda.next(lane.structure, len(self.lanes))
                if job is None:
                    return
                self._give(job, address)

    def _give(self, job: Job, address: str) -> None:
        task = self._task(job)
        # each call has a key of its own, which no other study on the scheduler has
        how = {"workers": [address], "allow_other_workers": True, "pure": False}
        if job.solve:
            future = self.cluster.client.submit(worker.film, self.labour.solve_air, task, **how)
        else:
            limit = SLACK * self.agenda.target(len(self.lanes))
            future = self.cluster.client.submit(worker.play, self.labour.perform, task, limit, **how)
        self.given[future] = (job, address)
        lane = self.lanes[address]
        long = job.solve or job.expected_s is None or job.expected_s > LONG_S
        self.lanes[address] = Lane(lane.tasks + 1, job.structure, job.alone, long)
        future.add_done_callback(self.done.put)

    def _task(self, job: Job) -> Task:
        return Task(self.plan.base, self.plan.folder.resolve(), job.requests, self.options, job.film)

    # ------------------------------------------------------------ taking

    def _collect(self, seconds: float) -> None:
        """Take in what has been done, waiting so long for it."""
        try:
            future = self.done.get(timeout=seconds) if seconds else self.done.get_nowait()
        except Empty:
            return
        if future not in self.given:
            return
        job, address = self.given.pop(future)
        lane = self.lanes.get(address)
        if lane is not None:
            left = max(0, lane.tasks - 1)
            self.lanes[address] = lane._replace(
                tasks=left, alone=lane.alone and left > 0, long=lane.long and left > 0
            )
        if future.status == "finished":
            self._take(job, future.result())
        elif future.status == "error":
            self._wrong(job, future.exception())
        else:  # cancelled: by nobody but a scheduler that is gone
            raise ClusterError("the scheduler is gone")

    def _take(self, job: Job, done: worker.Done) -> None:
        """Keep what a task has brought back."""
        self.figures.took(done)
        if done.air is not None:
            self._air(job, done.air)
            return
        self._keep(done.records)
        for record, request in zip(done.records, job.requests, strict=False):
            self.agenda.took(request.structure, record.cost.total_s)
        self.agenda.again(job, job.requests[len(done.records) :])
        self._over(job.requests[: len(done.records)])

    def _keep(self, records: list[Record]) -> None:
        self.store.add(records)
        self.failed += sum(record.status == "failed" for record in records)
        self.display.advance(len(records))

    def _over(self, requests: tuple[Request, ...] | list[Request]) -> None:
        """These runs are done: films that none needs any more go."""
        for request in requests:
            air = self.agenda.done(request)
            if air is not None:
                shutil.rmtree(self.store.film(air), ignore_errors=True)

    def _air(self, job: Job, record: AirRecord) -> None:
        """Keep what solving an air brought: a film, or the end of the runs that would have played it."""
        self.store.add_air(record)
        if not record.message:
            self.films.append(record.bytes)
            self.agenda.solved(job.air)
            return
        runs = self.agenda.without(job.air)
        self._keep([_failure(request.run, f"its air: {record.message}") for request in runs])

    def _wrong(self, job: Job, error: BaseException | None) -> None:
        """A task has no result. Raises ClusterError where none could have one."""
        from distributed.scheduler import KilledWorker

        if isinstance(error, KilledWorker):
            self._looked = float("-inf")
            if self.agenda.killed(job, error.allowed_failures + 1):
                self._blame(
                    job,
                    f"killed its worker {job.deaths + error.allowed_failures + 1} times: too little memory?",
                )
        elif isinstance(error, worker.UnfitError | ImportError):
            raise ClusterError(f"a worker is of no use: {error}")
        elif isinstance(error, OSError) and error.errno in FULL:
            raise error
        elif job.solve or len(job.requests) == 1:
            self._blame(job, visible(f"{type(error).__name__}: {error}"))
        else:
            self.agenda.apart(job)

    def _blame(self, job: Job, message: str) -> None:
        """A job cannot be done: what it stands for has failed."""
        if job.solve:
            self._air(job, AirRecord(job.air, 0.0, 0, 0, message))
            return
        task = self._task(job)
        with suppress(ValueError):  # no scenario: then the message alone
            for request in job.requests:
                scenario = resolve_name(self.labour.scenario_of)(task.base, request.changes)
                resolve_name(self.labour.leave_failed)(task, request, scenario, message)
        self._keep([_failure(request.run, message) for request in job.requests])
        self._over(job.requests)

    # ------------------------------------------------------------ other

    def _room(self) -> bool:
        """Whether the disk has room for another film, as far as is known from others."""
        expected = max(self.films, default=0)
        coming = 1 + len(self.agenda.solving)
        return shutil.disk_usage(self.store.airs).free > SPARE * expected * coming

    def _cancel(self) -> None:
        """Let the workers of others drop what they have not begun."""
        if self.given and not self.cluster.local and not self.cluster.lost:
            self.cluster.client.cancel(list(self.given), force=True)


def options_of(plan: "Plan", out: Path, allow_code: bool, allow_outside: bool) -> Options:
    """What goes for all runs of a plan."""
    study = plan.study
    paths = {path: path for path in study.outcomes.values()}  # columns may be named anew
    return Options(out.resolve(), tuple(study.keep), paths, allow_code, allow_outside, __version__)


def _failure(run: str, message: str) -> Record:
    return Record(run, "failed", message, [], {}, Cost(time.time(), 0.0, 0.0, 0, ""))
