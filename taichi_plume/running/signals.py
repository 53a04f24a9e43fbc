"""What signals do to a run: those that end it wait for the end of the tick, so that it can be resumed from there."""

import errno
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any, NoReturn

ENDING = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGXCPU") if hasattr(signal, name)
)
"""Ctrl-C, a batch system's or container's stop, a terminal that was closed, a limit on the time of the CPU."""
ASKING = tuple(getattr(signal, name) for name in ("SIGUSR1",) if hasattr(signal, name))
"""Batch systems can send it some time before they end a job."""


class Ears:
    """What signals have asked of a run.

    running: whether files are open, so that the end of a tick is waited for; until then signals end all at once.
    hasty: whether a second one does so too; it comes but once, so that the end that follows is not disturbed. stopped:
    name of the one that asked to end. asked: whether a checkpoint is wanted.
    """

    def __init__(self) -> None:
        self.running = self.hasty = False
        self.stopped = ""
        self.asked = False
        self.terminal = _terminal()

    def hear(self, number: int, _: Any = None) -> None:
        """Handle a signal."""
        name = signal.Signals(number).name
        if number in ASKING:
            self.asked = True
            return
        if name == "SIGHUP":
            _leave(self.terminal)
        if not self.running:
            raise KeyboardInterrupt(name)
        if self.stopped and self.hasty and name != "SIGXCPU":  # this one comes every second
            self.hasty = False
            raise KeyboardInterrupt(name)
        self.stopped = self.stopped or name


@contextmanager
def listening() -> Iterator[Ears]:
    """A context in which signals are heard; those that are ignored, as under nohup, stay so."""
    ears = Ears()
    with _handling((*ENDING, *ASKING), ears.hear):
        yield ears


@contextmanager
def deaf() -> Iterator[None]:
    """A context that no signal disturbs: files are being closed."""
    with _handling((*ENDING, *ASKING), signal.SIG_IGN):
        yield


def leave(code: int) -> NoReturn:
    """End the process: a Ctrl-C that comes while Python cleans up is no fault to be told with a traceback."""
    if signal.getsignal(signal.SIGINT) is not None:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    sys.exit(code)


@contextmanager
def reader_may_leave() -> Iterator[None]:
    """What is printed may go to a reader such as `head` that closes the pipe early: no error."""
    try:
        yield
        sys.stdout.flush()
    except OSError as error:
        if error.errno not in (errno.EPIPE, errno.EIO):  # or the terminal has been closed
            raise
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # Python flushes again at its end


@contextmanager
def _handling(numbers: tuple[signal.Signals, ...], handler: Any) -> Iterator[None]:
    with ExitStack() as stack:
        if threading.current_thread() is threading.main_thread():
            for number in numbers:
                before = signal.getsignal(number)
                if before not in (signal.SIG_IGN, None):
                    signal.signal(number, handler)
                    stack.callback(signal.signal, number, before)
        yield


def _terminal() -> list[int]:
    """Which of this process's streams are a terminal; of one that has been closed it can no longer be told."""
    found = []
    for stream in (sys.stdin, sys.stdout, sys.stderr):
        try:
            if os.isatty(stream.fileno()):
                found.append(stream.fileno())
        except (AttributeError, OSError, ValueError):  # closed, or no file
            continue
    return found


def _leave(streams: list[int]) -> None:
    """What is printed there from now on goes nowhere, as writing to a closed terminal is an error."""
    nowhere = os.open(os.devnull, os.O_RDWR)
    for stream in streams:
        os.dup2(nowhere, stream)
    os.close(nowhere)
