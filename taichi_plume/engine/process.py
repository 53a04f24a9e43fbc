"""Lifetime of Taichi's program: fields raise EngineError after a restart, unused kernels and SNode trees are freed.

Taichi frees all fields when Taichi is restarted or reset. Access to such a field would crash the process.
"""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import RLock, get_ident

from taichi.lang import impl
from taichi.lang.exception import TaichiCompilationError
from taichi.lang.impl import PyTaichi


class EngineError(TaichiCompilationError, RuntimeError):
    """Error of access to a simulation whose fields no longer exist, because Taichi was restarted or reset."""

    MESSAGE = (
        "the fields of this simulation or environment no longer exist: Taichi was restarted or reset after they "
        "were made; assemble the simulation, or make the environment, again"
    )

    def __init__(self, *_: object):  # Taichi raises errors within kernels again, with the place in the kernel
        super().__init__(self.MESSAGE)


class ThreadError(EngineError):
    """Error of making a simulation in another thread than that of a simulation in use."""

    MESSAGE = (
        "a simulation or environment of another thread is in use: make all of them in the same thread, or in processes "
        "of their own, as a study does"
    )


class TurnError(ThreadError):
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


def _materialize(runtime: PyTaichi, plain: Callable = PyTaichi.materialize) -> None:
    """Place new fields in memory, as each launch of a kernel does first. Raises EngineError if Taichi was reset."""
    if _process.forked:
        raise ForkError
    if runtime.prog is None:
        raise EngineError
    plain(runtime)


def _reset(plain: Callable = impl.reset) -> None:
    """Reset Taichi."""
    plain()
    impl.get_runtime().print_full_traceback = False  # read by failing kernels, set only by `init`


class _Process:
    """State of the process.

    thread: number of the thread in which Taichi was started, None if that was before this module was imported;
    forked: whether the process was forked after Taichi was started.
    """

    thread: int | None = None
    forked = False

    def in_other_thread(self) -> bool:
        """Return whether Taichi was started in another thread than the calling one."""
        return self.thread is not None and self.thread != get_ident()


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


def require_usable(in_use: bool) -> None:
    """Raise ForkError in a forked process, and ThreadError if fields of another thread are `in_use`."""
    if _process.forked:
        raise ForkError
    if in_use and _process.in_other_thread():
        raise ThreadError


def _create_program(runtime: PyTaichi, plain: Callable = PyTaichi.create_program) -> None:
    """Start Taichi's program, as Taichi does, and note the thread, outside of which it places no fields."""
    _process.thread = get_ident()
    plain(runtime)


def _after_fork() -> None:
    _process.forked = impl.get_runtime().prog is not None


_process = _Process()
if "register_at_fork" in vars(os):  # not on Windows
    os.register_at_fork(after_in_child=_after_fork)
impl.reset = _reset
PyTaichi.materialize = _materialize
PyTaichi.create_program = _create_program
