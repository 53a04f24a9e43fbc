"""Workers of a study: processes on this machine, or the workers of a Dask scheduler.

Each worker is a `concurrent.futures.Executor` with a single task at a time, so that the task that killed a worker is
known. A worker keeps its compiled kernels between tasks. Processes on this machine end with the command and open no
socket.
"""

import asyncio
import json
import multiprocessing
import os
import re
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from functools import partial
from math import ceil
from multiprocessing import resource_tracker
from multiprocessing.connection import wait
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, TypeAlias

from taichi_plume.engine.choice import VARIABLE, chosen
from taichi_plume.execution.signals import SignalRequests, ignoring_signals
from taichi_plume.guard.safe_open import content_of, read_regular
from taichi_plume.guard.terminal import LONGEST_VALUE, visible
from taichi_plume.studies.shards import LOG
from taichi_plume.version import __version__

if TYPE_CHECKING:
    from taichi_plume.studies.messages import Result, Task
    from taichi_plume.studies.plan import Plan

    Work: TypeAlias = Callable[[Task], Result]

CONNECT_S = 10.0  # timeout of the connection to a scheduler, and of its file
LARGEST_FILE = 1 << 20  # bytes of a scheduler file
END_S = 10.0  # longest wait for idle worker processes to end
LOOK_S = 1.0  # interval between checks of a scheduler's workers
ENVIRONMENT = {
    **dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"),
    "PYTHONSAFEPATH": "1",  # workers do not import modules of the working folder, such as one named socket
    # a killed worker leaves semaphores, which the process that removes them would report to the user
    "PYTHONWARNINGS": "ignore::UserWarning:multiprocessing.resource_tracker",
}

_TAICHI = threading.Lock()  # only one thread of a process at a time can use Taichi
_SPAWN = (
    threading.Lock()
)  # the start of a process changes the environment and hides the main module meanwhile


class WorkersError(Exception):
    """Error of missing or lost workers of a study; the message is one line. code: exit code of the command."""

    def __init__(self, message: str, code: int = 1):
        super().__init__(visible(message))
        self.code = code


def work(task: "Task") -> "Result":
    """Execute a task in a worker: run simulations, or film wind and gas that runs share. Threads take turns.

    Called in workers. Taichi is imported only here: the command itself does not need Taichi.
    """
    with _TAICHI:
        if task.solve:
            from taichi_plume.studies.shared_air import solve_air

            return solve_air(task)
        from taichi_plume.studies.task_execution import execute_task

        return execute_task(task)


# ---------------------------------------------------------------- on this machine


class LocalWorkers:
    """Worker processes on this machine, each an executor of one process. Their output goes to the file `log`.

    death: type of the exception of a task whose worker died; remarks: notes to print to the user.
    """

    death: type[BaseException] = BrokenProcessPool

    def __init__(self, count: int, log: Path):
        self.remarks: list[str] = []
        self._log = log.resolve()
        self._names = [str(n) for n in range(count)]
        self._executors: dict[str, ProcessPoolExecutor] = {}

    def workers(self) -> list[str]:
        """Return the names of the workers. The next task of a dead worker starts a new process."""
        return self._names

    def submit(self, worker: str, function: "Work", task: "Task") -> "Future[Result]":
        """Submit the call `function(task)` to a worker process, started if needed; return the result's future."""
        with suppress(KeyError, BrokenProcessPool):
            return self._executors[worker].submit(function, task)
        context = multiprocessing.get_context("spawn")
        with _SPAWN, _environment(), _blocked_signals(), _without_main():
            self._executors[worker] = ProcessPoolExecutor(1, context, _begin_process, (self._log,))
            return self._executors[worker].submit(function, task)

    def close(self) -> None:
        """End all worker processes, those in the middle of a run at once, and delete the log if empty.

        Idle workers end by themselves, and thereby store the kernels that they have compiled.
        """
        with ignoring_signals():
            processes = []
            for executor in self._executors.values():
                inner = vars(executor)
                own = list((inner["_processes"] or {}).values())  # `kill_workers` of Python 3.14
                if inner["_pending_work_items"]:
                    for process in own:
                        process.kill()
                executor.shutdown(wait=False, cancel_futures=True)
                processes += own
            end = time.monotonic() + END_S
            for process in processes:
                if not wait([process.sentinel], max(0.0, end - time.monotonic())):
                    process.kill()
                    wait([process.sentinel])
            with suppress(OSError):
                if not self._log.stat().st_size:
                    self._log.unlink()


Workers: TypeAlias = "LocalWorkers | DaskWorkers"


def cores() -> int:
    """Return the number of CPU cores for this process, from CPU affinity and, on Linux, the control group's quota."""
    count = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    with suppress(OSError, ValueError):  # the quota may be "max"
        quota, period = map(int, Path("/sys/fs/cgroup/cpu.max").read_text().split())
        count = min(count, max(1, ceil(quota / period)))
    return count


def _begin_process(log: Path) -> None:
    """Initialise a study's worker process: redirect output to the log, and exit when the study's command ends."""
    file = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND | getattr(os, "O_NOFOLLOW", 0), 0o644)
    for stream in (1, 2):
        os.dup2(file, stream)
    os.close(file)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


@contextmanager
def _blocked_signals() -> Iterator[None]:
    """Context whose new processes block SIGINT (Ctrl-C) and SIGHUP, which the terminal sends to the whole group."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    ignored = {signal.SIGINT, signal.SIGHUP}
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ignored)
    try:
        resource_tracker.ensure_running()  # unblocks SIGINT
        signal.pthread_sigmask(signal.SIG_BLOCK, ignored)
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _environment() -> Iterator[None]:
    """Context that adds ENVIRONMENT to the environment of new processes; restores the environment at the end."""
    before = {name: os.environ[name] for name in ENVIRONMENT if name in os.environ}
    os.environ.update(ENVIRONMENT)
    try:
        yield
    finally:
        for name in ENVIRONMENT.keys() - before.keys():
            del os.environ[name]
        os.environ.update(before)


@contextmanager
def _without_main() -> Iterator[None]:
    """Context whose new processes do not execute the user's program again: workers need nothing of it."""
    main, sys.modules["__main__"] = sys.modules["__main__"], ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main


# ---------------------------------------------------------------- of a Dask scheduler


def _address(scheduler: str) -> str:
    """Return the address of a Dask scheduler. A scheduler file (.json) is waited for, and read. Raises WorkersError."""
    if not scheduler.endswith(".json"):
        return scheduler
    file, end = Path(scheduler), time.monotonic() + CONNECT_S
    while not file.exists() and time.monotonic() < end:
        time.sleep(LOOK_S)
    try:
        return str(json.loads(content_of(file, LARGEST_FILE, ValueError))["address"])
    except (ValueError, TypeError, LookupError, RecursionError) as error:
        reason = error if str(error).startswith(str(file)) else f"{file}: is no scheduler file of Dask"
    raise WorkersError(f"--scheduler {reason}", 2)


class DaskWorkers:
    """Workers of the Dask scheduler at a network address, or of a scheduler file. Raises WorkersError without it.

    Once the scheduler has answered, a first signal does not interrupt the command but is noted in `signals`.
    """

    def __init__(self, address: str, plan: "Plan", out: Path, signals: SignalRequests):
        try:
            _log_to(out / LOG)
            from distributed import Client
            from distributed.scheduler import KilledWorker
        except ImportError:
            raise WorkersError(
                "--scheduler needs the packages dask and distributed: pip install 'taichi_plume[cluster]'", 2
            ) from None
        address = _address(address)
        _require_scheduler(address)
        signals.running = True
        try:
            self.client: Any = Client(address, timeout=CONNECT_S, set_as_default=False)
        except OSError:
            raise WorkersError(f"--scheduler {address}: the scheduler does not answer", 2) from None
        self.death: type[BaseException] = KilledWorker
        self.remarks: list[str] = []
        content = read_regular(out / "study.yaml")
        self._why_unusable = partial(
            why_unusable, __version__, chosen(), out.resolve(), content, plan.folder.resolve()
        )
        self._executors: dict[str, Executor] = {}
        self._looked = float("-inf")
        self._lonely = False

    def workers(self) -> list[str]:
        """Return the addresses of the Dask workers. Raises WorkersError, also if a worker cannot be used."""
        if time.monotonic() - self._looked > LOOK_S:
            self._looked = time.monotonic()
            with suppress(OSError, RuntimeError, ValueError):  # if the scheduler is gone, see `status`
                self._look(dict(self.client.nthreads()))
            if self.client.status not in ("running", "connecting"):
                raise WorkersError("the scheduler is gone")
        return list(self._executors)

    def _look(self, threads: dict[str, int]) -> None:
        fresh = threads.keys() - self._executors.keys()
        if fresh:
            self._require_fit(fresh)
        several = [address for address in fresh if threads[address] > 1]
        if several:
            self.remarks.append(
                f"note: {len(several)} workers have several threads ({min(several)}), but use only one: "
                "start them with --nthreads 1, and --nworkers as many as there are cores"
            )
        for address in fresh:
            self._executors[address] = self.client.get_executor(workers=[address], pure=False)
        for address in self._executors.keys() - threads.keys():
            del self._executors[address]
        if not threads and not self._lonely:
            self._lonely = True
            scheduler = self.client.scheduler.address
            self.remarks.append(f"no workers there; start one by: dask worker {scheduler} --nthreads 1")

    def _require_fit(self, addresses: set[str]) -> None:
        """Raise WorkersError if a Dask worker has another version or cannot access the study's files."""
        answers = self.client.run(self._why_unusable, workers=list(addresses), on_error="return")
        for address, answer in sorted(answers.items()):
            if not answer or isinstance(answer, OSError):  # OSError: the worker is gone
                continue
            if re.search(r"(ModuleNotFound|Import|Attribute)Error", repr(answer)):
                why = visible(answer, LONGEST_VALUE)
                answer = f"has no taichi_plume {__version__} ({why}): install it there"
            raise WorkersError(f"worker {address}: {answer}", 2)

    def submit(self, worker: str, function: "Work", task: "Task") -> "Future[Result]":
        """Submit the call `function(task)` to a Dask worker; return the future of the result."""
        return self._executors[worker].submit(function, task)

    def close(self) -> None:
        """Disconnect from the Dask scheduler, which then drops tasks that have not started."""
        with ignoring_signals(), suppress(Exception):
            self.client.close(timeout=2)
        self.client.status = "closed"  # otherwise the client's finalizer would wait for an answer again


def why_unusable(version: str, engine: str, out: Path, content: bytes, folder: Path) -> str:
    """Return why the worker process that runs this call cannot be used for a study, in a line; "" if usable.

    version, engine: of the command; out: folder of the study; content: of study.yaml; folder: folder of the base
    scenario.
    """
    if version != __version__:
        return f"has taichi_plume {__version__}, the command has {version}: install the same version there"
    if engine != chosen():
        return f"computes with {chosen()}, the command with {engine}: set {VARIABLE}={engine} there"
    try:
        same = read_regular(out / "study.yaml") == content
    except OSError:
        same = False
    if not same:
        return f"does not see the study's folder {out}: it must lie on a disk that all workers share"
    if not folder.is_dir():
        return f"does not see the scenario's folder {folder}: it must lie on a disk that all workers share"
    return ""


def _require_scheduler(address: str) -> None:
    """Raise WorkersError unless a Dask scheduler answers at an address."""
    try:
        with ThreadPoolExecutor(1) as thread:  # a notebook has a running event loop in this one
            kind = thread.submit(lambda: asyncio.run(asyncio.wait_for(_kind(address), CONNECT_S))).result()
    except (OSError, ValueError, TypeError, LookupError, ImportError, RuntimeError, AssertionError) as error:
        # with a tls:// address the error may state what is wrong with a certificate
        refused = isinstance(error, OSError) and not address.startswith("tls:")
        silent = refused or not str(error)
        kind = "nothing answers" if silent else f"{type(error).__name__}: {error}"
    if kind != "Scheduler":
        raise WorkersError(
            f"--scheduler {address}: no Dask scheduler there ({kind}); start one by: dask scheduler", 2
        )


async def _kind(address: str) -> str:
    """Return the kind of the Dask server at an address: "Scheduler", "Worker" or "Nanny". Raises many error types.

    For a tls:// address, certificate and key come from Dask's configuration, as for `Client`.
    """
    from distributed.core import rpc
    from distributed.security import Security

    async with rpc(address, connection_args=Security().get_connection_args("client")) as there:
        identity: Any = await there.identity()
        return str(identity["type"])


def _log_to(log: Path) -> None:
    """Redirect the log messages of Dask to a file. Must be called before the package distributed is imported."""
    warnings.filterwarnings("ignore", module=r"(distributed|dask)\b")
    import dask.config

    handlers = {"file": {"class": "logging.FileHandler", "filename": str(log), "delay": True}}
    quiet = {"level": "WARNING", "handlers": ["file"], "propagate": False}
    loggers = dict.fromkeys(("distributed", "tornado", "asyncio", "bokeh"), quiet)
    config = {"version": 1, "disable_existing_loggers": False, "handlers": handlers, "loggers": loggers}
    dask.config.set({"logging": config})
