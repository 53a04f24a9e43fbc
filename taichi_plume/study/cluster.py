"""The workers of a study: processes on this machine, or those of any Dask scheduler.

Worker processes on this machine listen on loopback alone and speak TLS with a key that exists only in their memory:
whoever has no such key can neither give tasks nor read results. Nothing is left running, however the command ends.
"""

import asyncio
import importlib.util
import logging
import os
import re
import shutil
import signal
import time
import warnings
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from multiprocessing import active_children
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

from taichi_plume import __version__
from taichi_plume.guard.terminal import LONGEST_VALUE, visible
from taichi_plume.running.signals import Ears, deaf

if TYPE_CHECKING:
    from taichi_plume.study.plan import Plan

LOG = "dask.log"  # what Dask and the workers print
SCRATCH = ".dask"
CONNECT_S = 10.0  # for a scheduler to answer
START_S = 120.0  # for the first worker of our own to be there
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
TRACKER = "ignore::UserWarning:multiprocessing.resource_tracker"
DASHBOARD_ROUTES = ["distributed.http.scheduler.info", "distributed.http.statics"]
SETTINGS = {
    "distributed.worker.multiprocessing-method": "spawn",
    "distributed.worker.daemon": True,
    "distributed.worker.preload": [],
    "distributed.worker.profile.enabled": False,  # it would take the GIL from a run a hundred times a second
    "distributed.worker.use-file-locking": False,
    "distributed.worker.http.routes": [],
    "distributed.nanny.preload": [],
    "distributed.scheduler.preload": [],
    # a page of another site opened in the user's browser may not read the dashboard
    "distributed.scheduler.dashboard.bokeh-application.allow_websocket_origin": ["127.0.0.1"],
    "distributed.scheduler.worker-ttl": None,  # a worker that compiles does not answer
    "distributed.scheduler.worker-saturation": float(
        "inf"
    ),  # the command knows how many tasks a worker should have
    "distributed.admin.system-monitor.gil.enabled": False,
    "distributed.diagnostics.nvml": False,
}


class ClusterError(Exception):
    """Workers that cannot be had, or were lost; the message is one line. code: the command's exit code."""

    def __init__(self, message: str, code: int = 1):
        super().__init__(visible(message))
        self.code = code


class Cluster:
    """Workers, as a context. `client` and, where they are our own, `processes` are Dask's."""

    def __init__(self, client: Any, processes: Any = None, scratch: Path | None = None):
        self.client, self.processes, self._scratch = client, processes, scratch

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def local(self) -> bool:
        """Whether the workers are our own processes on this machine."""
        return self.processes is not None

    @property
    def lost(self) -> bool:
        """Whether the scheduler has gone."""
        return self.client.status not in ("running", "connecting")

    def threads(self) -> dict[str, int] | None:
        """The addresses of the workers that are there, and how many threads each has; None where nobody tells."""
        try:
            return dict(self.client.nthreads())
        except Exception:  # the scheduler is gone, or going; `lost` tells
            return None

    def held(self) -> dict[str, Any]:
        """The keys of the tasks that each worker has."""
        try:
            return dict(self.client.processing())
        except Exception:
            return {}

    def close(self) -> None:
        """End our own workers, at once and whatever they do; what others have given stays with them."""
        with deaf():
            self._close()

    def _close(self) -> None:
        with suppress(Exception):
            if self.processes is not None:
                for nanny in list(self.processes.workers.values()):
                    nanny.auto_restart = False
                    if nanny.process is not None and nanny.process.pid:
                        os.kill(nanny.process.pid, signal.SIGTERM if os.name == "nt" else signal.SIGKILL)
        with suppress(Exception):
            self.client.close(timeout=2)
        with suppress(AttributeError):
            self.client.status = "closed"  # also without an answer, for which its finalizer would wait again
        with suppress(Exception):
            if self.processes is not None:
                self.processes.close(timeout=5)
        for process in active_children() if self.processes is not None else ():
            process.kill()  # a worker that its nanny has just restarted ignores SIGTERM, as we do here
        if self._scratch is not None:
            shutil.rmtree(self._scratch, ignore_errors=True)
            with suppress(OSError):
                log = self._scratch.with_name(LOG)
                if not log.stat().st_size:
                    log.unlink()

    def require_fit(self, plan: "Plan", out: Path, addresses: Collection[str]) -> None:
        """Raise ClusterError where a worker is of another version or does not see the study's files."""
        from taichi_plume.study.worker import unfit

        content = (out / "study.yaml").read_bytes()
        told = self.client.run(
            unfit, __version__, out.resolve(), content, plan.folder.resolve(),
            workers=list(addresses), on_error="return",
        )  # fmt: skip
        for address, answer in sorted(told.items()):
            if isinstance(answer, Exception) and re.search(
                r"(ModuleNotFound|Import|Attribute)Error", repr(answer)
            ):
                why = visible(answer, LONGEST_VALUE)
                raise ClusterError(
                    f"worker {address}: has no taichi_plume {__version__} ({why}): install it there", 2
                )
            if isinstance(answer, Exception) and not isinstance(answer, OSError):  # OSError: it is gone
                raise ClusterError(f"worker {address}: {type(answer).__name__}: {answer}", 2)
            if isinstance(answer, str) and answer:
                raise ClusterError(f"worker {address}: {answer}", 2)


def local(workers: int | None, most: int, out: Path, ears: Ears, dashboard: bool = False) -> Cluster:
    """As many worker processes on this machine, or as many as it has cores for us, each with one thread.

    most: that there is something to do for. out: the study's folder, where Dask logs. Raises ClusterError where none
    begins. From then on signals wait to be looked at; where `ears` have heard one, it waits for no worker.
    """
    if dashboard and importlib.util.find_spec("bokeh") is None:
        raise ClusterError("--dashboard needs the package bokeh: pip install 'bokeh>=3.1'", 2)
    log, scratch = out / LOG, out / SCRATCH
    _quiet(log)
    import dask.config

    settings = SETTINGS | {
        f"distributed.nanny.pre-spawn-environ.{name}": one for name, one in ONE_THREAD.items()
    }
    os.environ["PYTHONSAFEPATH"] = "1"  # no new process imports a socket.py of the working folder
    settings["distributed.scheduler.http.routes"] = DASHBOARD_ROUTES if dashboard else []
    dask.config.set(settings)
    from dask.system import cpu_count  # of this process, as cgroups and its affinity allow
    from distributed import Client, LocalCluster
    from distributed.security import Security

    from taichi_plume.study.local_worker import LocalWorker

    shutil.rmtree(scratch, ignore_errors=True)
    count = min(workers or cpu_count(), most)
    page: dict[str, Any] = {"dashboard_address": "127.0.0.1:8787" if dashboard else None}
    one = Cluster(None, scratch=scratch)
    ears.running = True  # what of Dask is made by half cannot be closed
    try:
        with _deaf_children():
            one.processes = LocalCluster(
                n_workers=0,
                threads_per_worker=1,
                processes=True,
                host="127.0.0.1",
                memory_limit=None,
                **page,
                security=Security.temporary(),
                silence_logs=logging.WARNING,
                local_directory=str(scratch),
                scheduler_kwargs={"allowed_failures": 0},  # the command itself tells who is to blame
            )
        one.client = Client(one.processes, timeout=CONNECT_S, set_as_default=False)
        one.processes.scale(count)
        _await_worker(one, ears, log)
        one.client.register_plugin(LocalWorker(log.resolve()))
    except BaseException:
        one.close()
        raise
    return one


def remote(address: str, out: Path, ears: Ears) -> Cluster:
    """The workers of a Dask scheduler. Raises ClusterError where there is none at the address.

    Once it has answered, signals wait to be looked at, as with `local`.
    """
    _quiet(out / LOG)
    from distributed import Client

    try:
        kind = asyncio.run(asyncio.wait_for(_kind(address), CONNECT_S))
    except (OSError, ValueError, TypeError, LookupError, ImportError, RuntimeError, AssertionError) as error:
        # on the way to a tls:// address a certificate may be wrong, which the error says
        refused = isinstance(error, OSError) and not address.startswith("tls:")
        silent = refused or not str(error)
        kind = "nothing answers" if silent else f"{type(error).__name__}: {error}"
    if kind != "Scheduler":
        raise ClusterError(
            f"--scheduler {address}: no Dask scheduler there ({kind}); one is started by: dask scheduler", 2
        )
    ears.running = True
    try:
        return Cluster(Client(address, timeout=CONNECT_S, set_as_default=False))
    except OSError:
        raise ClusterError(f"--scheduler {address}: the scheduler does not answer", 2) from None


async def _kind(address: str) -> str:
    """Kind of the Dask server at an address: "Scheduler", "Worker" or "Nanny". Raises all sorts of errors.

    A tls:// address takes the certificate and key of Dask's configuration, as `Client` does.
    """
    from distributed.core import rpc
    from distributed.security import Security

    async with rpc(address, connection_args=Security().get_connection_args("client")) as there:
        told: Any = await there.identity()
        return str(told["type"])


def _await_worker(cluster: Cluster, ears: Ears, log: Path) -> None:
    """Wait for the first one, or a signal. Raises ClusterError."""
    until = time.monotonic() + START_S
    while not ears.stopped and not cluster.threads():
        if time.monotonic() > until:
            raise ClusterError(f"no worker has begun within {START_S:.0f} s; see {log}")
        time.sleep(0.05)


def _quiet(log: Path) -> None:
    """What Dask tells goes to a file: the terminal is the command's."""
    warnings.filterwarnings("ignore", module=r"(distributed|dask)\b")
    import dask.config

    handlers = {"file": {"class": "logging.FileHandler", "filename": str(log), "delay": True}}
    quiet = {"level": "WARNING", "handlers": ["file"], "propagate": False}
    names = ("distributed", "tornado", "asyncio", "bokeh")
    told = {"version": 1, "disable_existing_loggers": False, "handlers": handlers}
    dask.config.set({"logging": told | {"loggers": dict.fromkeys(names, quiet)}})


@contextmanager
def _deaf_children() -> Iterator[None]:
    """What is started here, and what that starts, is deaf to Ctrl-C and to the end of the terminal, which sends both to
    all of its processes.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    deaf_to = {signal.SIGINT, signal.SIGHUP}
    before = signal.pthread_sigmask(signal.SIG_BLOCK, deaf_to)
    try:
        _start_tracker()
        signal.pthread_sigmask(signal.SIG_BLOCK, deaf_to)
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _start_tracker() -> None:
    """Start multiprocessing's process that cleans up after others: it unblocks signals where it is started.

    It would warn of each lock that a worker held when it was ended.
    """
    from multiprocessing import resource_tracker

    name = "PYTHONWARNINGS"
    before = os.environ.get(name)
    os.environ[name] = ",".join(filter(None, (before, TRACKER)))
    resource_tracker.ensure_running()
    if before is None:
        del os.environ[name]
    else:
        os.environ[name] = before
