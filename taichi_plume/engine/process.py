"""Faults of the engine: a device's fields after a restart of Taichi, two threads at a time, and a forked process."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import RLock

from taichi_plume.engine.library import CompilationError, Runtime, impl


class EngineError(CompilationError, RuntimeError):
    """Error of access to a simulation on a device whose fields no longer exist, because Taichi was restarted."""

    MESSAGE = (
        "the fields of this simulation or environment no longer exist: Taichi was restarted or reset after they "
        "were made; assemble the simulation, or make the environment, again"
    )

    def __init__(self, *_: object):  # Taichi raises errors within kernels again, with the place in the kernel
        super().__init__(self.MESSAGE)


class TurnError(EngineError):
    """Error of stepping a simulation while another thread does: Taichi compiles in one thread at a time."""

    MESSAGE = (
        "another thread steps a simulation or environment: only one thread of a process may do so at a time; use a "
        "threading.Lock, or processes, as a study does"
    )


class ForkError(EngineError):
    """Error of using Taichi in a process that was forked after Taichi was started."""

    MESSAGE = (
        "this process was forked from one in which Taichi runs, and cannot use it: start processes with the method "
        "'spawn', or make the first simulation after the fork"
    )


def _materialize(runtime: Runtime, plain: Callable = Runtime.materialize) -> None:
    """Prepare Taichi for a new kernel. Raises ForkError."""
    require_no_fork()
    plain(runtime)


def _reset(plain: Callable = impl.reset) -> None:
    """Reset Taichi."""
    plain()
    impl.get_runtime().print_full_traceback = False  # read by failing kernels, set only by `init`


def require_no_fork() -> None:
    """Raise ForkError in a process that was forked after Taichi was started."""
    if forked:
        raise ForkError


_turn = RLock()


@contextmanager
def one_thread() -> Iterator[None]:
    """Context or decorator that keeps other threads from compiling and launching kernels. Raises TurnError."""
    if not _turn.acquire(blocking=False):
        raise TurnError
    try:
        yield
    finally:
        _turn.release()


def _after_fork() -> None:
    global forked
    forked = impl.get_runtime().prog is not None


forked = False
if "register_at_fork" in vars(os):  # not on Windows
    os.register_at_fork(after_in_child=_after_fork)
impl.reset = _reset
Runtime.materialize = _materialize
