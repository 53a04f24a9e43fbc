"""Scheduler of a study: distribute the missing runs of a plan to workers; store each finished run, despite failures."""

import errno
import shutil
import time
from collections.abc import Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from typing import TYPE_CHECKING

from taichi_plume.execution.signals import SignalRequests
from taichi_plume.guard.terminal import visible
from taichi_plume.studies.air_plan import shared_airs
from taichi_plume.studies.job_queue import Job, JobQueue
from taichi_plume.studies.messages import AirRecord, Cost, Options, Record, Request, Result, Task
from taichi_plume.studies.progress import Totals
from taichi_plume.studies.store import DONE, Store, leave_failed
from taichi_plume.studies.workers import LOG, Workers, WorkersError, work

if TYPE_CHECKING:
    from taichi_plume.studies.plan import Plan
    from taichi_plume.studies.progress import Display

FULL = (errno.ENOSPC, errno.EFBIG, errno.EDQUOT)
TICK_S = 0.2  # polling interval of workers, clock and signals
TASK_S = 4.0  # time limit of a task: hides Dask's overhead; little is lost if a worker dies
PER_WORKER_S = 0.04  # least time limit per worker: the scheduler handles the other workers' tasks meanwhile
FILMS = 1  # films at a time beyond the number of workers
SPARE = 2.0  # free disk space, in films, that starting another film requires


class Scheduler:
    """Scheduler that lets workers execute the missing runs of a study and stores the results.

    requests: runs to execute. `run` ends when all runs are done or when a signal requests a stop.
    """

    def __init__(
        self,
        plan: "Plan",
        store: Store,
        workers: Workers,
        options: Options,
        requests: Sequence[Request],
        display: "Display",
        signals: SignalRequests,
    ):
        self.plan, self.store, self.workers, self.options = plan, store, workers, options
        self.display, self.signals = display, signals
        self.worker_names = workers.workers()
        self.totals = Totals()
        self.largest = max((record.bytes for record in store.air_records()), default=0)  # film so far, bytes
        films = FILMS + max(1, len(self.worker_names))
        shared, common = shared_airs(plan, requests), store.claims.common if store.claims else frozenset()
        shared |= common & {request.air for request in requests}
        self.queue = JobQueue(requests, shared, store.film, films, self._room, store.claims)
        self.tasks: dict[Future[Result], tuple[str, Job]] = {}  # worker and job
        self.structures: dict[str, str] = {}  # last structure of each worker
        self.failed = 0

    def run(self) -> None:
        """Execute the study's missing runs. Raises WorkersError if all workers are lost; OSError: disk full."""
        while not self.signals.stopped:
            self.store.beat()
            self._look()
            self._give()
            if not self.tasks and not self._waits():
                break
            self._collect(TICK_S)
            self.display.update(self)
        else:
            self._collect(0.0)  # tasks that have finished before the signal

    def _waits(self) -> bool:
        """Return whether runs remain in the queue. Raises OSError if the next shared film does not fit the disk."""
        unsolved = self.queue.unsolved is not None
        if unsolved and not self.queue.solving and self.worker_names and not self._room():
            raise OSError(
                errno.ENOSPC, "the disk has no room for another film of an air", str(self.store.airs)
            )
        return bool(self.queue.open)

    def _room(self) -> bool:
        """Return whether the disk has room for another film, from the size of the largest film so far and a margin."""
        coming = 1 + len(self.queue.solving)
        return shutil.disk_usage(self.store.airs).free > SPARE * self.largest * coming

    def _look(self) -> None:
        """Update the list of workers; queue the jobs of vanished workers again. Raises WorkersError."""
        self.worker_names = self.workers.workers()
        self.totals.workers = max(self.totals.workers, len(self.worker_names))
        while self.workers.remarks:
            self.display.note(self.workers.remarks.pop(0))
        for future, (worker, job) in list(self.tasks.items()):
            if worker not in self.worker_names and not future.done():
                del self.tasks[future]
                future.cancel()
                self._died(job)

    def _give(self) -> None:
        """Give each idle worker a job."""
        busy = {worker for worker, _ in self.tasks.values()}
        for worker in self.worker_names:
            if worker in busy:
                continue
            job = self.queue.next(self.structures.get(worker, ""), len(self.worker_names))
            if job is None:
                return
            failure = self.store.failure(job.air) if job.solve else ""
            if failure:
                self._fail(job, failure)
                continue
            self.tasks[self.workers.submit(worker, work, self._task(job))] = worker, job
            self.structures[worker] = job.structure

    def _task(self, job: Job) -> Task:
        limit = max(TASK_S, PER_WORKER_S * len(self.worker_names))
        folder = self.plan.folder.resolve()
        return Task(self.plan.base, folder, job.requests, self.options, job.film, job.solve, limit)

    # ------------------------------------------------------------ results

    def _collect(self, seconds: float) -> None:
        """Wait for finished worker tasks; store results and handle errors. Raises WorkersError, OSError."""
        if not self.tasks:
            time.sleep(seconds)
            return
        for future in wait(self.tasks, seconds, FIRST_COMPLETED).done:
            worker, job = self.tasks.pop(future)
            try:
                result = future.result()
            except self.workers.death:
                self.structures.pop(worker, None)
                self._died(job)
            except CancelledError:
                raise WorkersError("the scheduler is gone") from None
            except Exception as error:
                self._wrong(job, error)
            else:
                self.totals.add(result)
                self._take(job, result)

    def _take(self, job: Job, result: Result) -> None:
        """Store a worker's result (run records or a film's record), update the queue and remove unneeded films."""
        if not isinstance(result, AirRecord):
            self._store_runs(result)
            for air in self.queue.executed(job, len(result)):
                if self._unneeded(air):
                    self.store.forget_air(air)
            return
        claims = self.store.claims
        if result.message and claims is not None and not claims.owns(job.air):
            self.queue.lost(job.air)
            return
        self.store.add_air(result)
        if result.message:
            self.store.forget_air(job.air)
            runs = self.queue.without(job.air)
            self._store_runs([_failure(request, f"its air: {result.message}") for request in runs])
        else:
            self.largest = max(self.largest, result.bytes)
            self.queue.solved(job.air)

    def _unneeded(self, air: str) -> bool:
        """Return whether no shard needs the film of an air: all runs that share the air have finished."""
        if self.store.claims is None or air not in self.store.claims.common:
            return True
        statuses = self.store.statuses()
        return all(statuses.get(each.run) in DONE for each in self.plan.requests if each.air == air)

    def _store_runs(self, records: list[Record]) -> None:
        self.store.add(records)
        self.failed += sum(record.status == "failed" for record in records)
        self.display.advance(len(records))

    def _died(self, job: Job) -> None:
        """Queue a dead worker's job again, or record a failure if a single run or film has killed several workers."""
        if self.queue.died(job):
            self._fail(job, f"worker died {job.deaths + 1} times: too little memory? see {LOG}")

    def _wrong(self, job: Job, error: Exception) -> None:
        """Handle an error of a task: record a failure or queue the runs singly. Raises WorkersError, OSError."""
        if isinstance(error, ImportError):
            raise WorkersError(f"a worker cannot import the package: {error}")
        if isinstance(error, OSError) and error.errno in FULL:
            raise error
        if job.solve or len(job.requests) == 1:
            self._fail(job, visible(f"{type(error).__name__}: {error}"))
        else:
            self.queue.apart(job)

    def _fail(self, job: Job, message: str) -> None:
        """Record that the film or the single run of a job has failed. A failed film fails all runs that share it."""
        if job.solve:
            self._take(job, AirRecord(job.air, 0.0, 0, 0, message))
        else:
            leave_failed(self._task(job), job.requests[0], message)
            self._take(job, [_failure(job.requests[0], message)])


def _failure(request: Request, message: str) -> Record:
    return Record(request.run, "failed", message, [], {}, Cost(time.time(), 0.0, 0.0, 0, ""))
