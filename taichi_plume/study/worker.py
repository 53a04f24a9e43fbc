"""What a Dask worker does for a study; imported there, so it brings nothing heavy until there is a task."""

import threading
import time
from pathlib import Path
from pkgutil import resolve_name
from typing import NamedTuple

from taichi_plume import __version__
from taichi_plume.study.messages import AirRecord, Record, Task

CHUNKS = 8  # of a task, between which its worker looks at the clock

_ALONE = threading.Lock()  # Taichi can be used by one thread of a process at a time


class Done(NamedTuple):
    """What a task has brought back. busy_s: the worker was at it; worker: its address."""

    records: list[Record]
    air: AirRecord | None
    busy_s: float
    worker: str


class UnfitError(Exception):
    """A worker that cannot do anything for this study; the message is one line."""


def unfit(version: str, out: Path, content: bytes, folder: Path) -> str:
    """Why this worker cannot do anything for a study, in a line; "" where it can.

    version: of the command; out: the study's folder; content: of its study.yaml; folder: of the base scenario.
    """
    if version != __version__:
        return f"has taichi_plume {__version__}, and this is {version}: install the same there"
    try:
        same = (out / "study.yaml").read_bytes() == content
    except OSError:
        same = False
    if not same:
        return f"does not see the study's folder {out}: it has to lie on a disk that all workers share"
    if not folder.is_dir():
        return f"does not see the scenario's folder {folder}: it has to lie on a disk that all workers share"
    return ""


def play(perform: str, task: Task, limit_s: float) -> Done:
    """Do the runs of a task, or the first of them, as many as `limit_s` seconds allow, but one at least.

    What is done then is brought home; the others go to whoever is free. perform: name of the function that does them,
    such as "package.module:function". Raises UnfitError.
    """
    with _ALONE:
        _require_fit(task)
        began = time.perf_counter()
        does = resolve_name(perform)
        records: list[Record] = []
        some = 1
        while len(records) < len(task.requests):
            first = len(records)
            records += does(task._replace(requests=task.requests[first : first + some]))
            if len(records) == first:
                raise RuntimeError("nothing came of a run")
            spent = time.perf_counter() - began
            if spent > limit_s:
                break
            some = max(1, min(2 * some, int(len(records) / max(spent, 1e-6) * limit_s / CHUNKS)))
        return Done(records, None, time.perf_counter() - began, _address())


def film(solve: str, task: Task) -> Done:
    """Solve the air that the runs of a task share, for a film; solve: name of the function. Raises UnfitError."""
    with _ALONE:
        _require_fit(task)
        began = time.perf_counter()
        record = resolve_name(solve)(task)
        return Done([], record, time.perf_counter() - began, _address())


def _require_fit(task: Task) -> None:
    if task.options.version != __version__:
        raise UnfitError(f"has taichi_plume {__version__}, and this is {task.options.version}")


def _address() -> str:
    from distributed import get_worker

    try:
        return get_worker().address
    except ValueError:  # no worker of Dask's, as in a test
        return ""
