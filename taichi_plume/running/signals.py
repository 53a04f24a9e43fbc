"""Signal handlers of a run: a signal ends the run at the end of the tick, so that the run can be resumed."""

import errno
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from types import FrameType
from typing import NoReturn

Handler = Callable[[int, FrameType | None], object] | signal.Handlers
KNOWN = signal.Signals.__members__  # of this system
ENDING = tuple(KNOWN[name] for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGXCPU") if name in KNOWN)
"""Ctrl-C, the stop of a batch system or container, a closed terminal, a limit on the CPU time."""
ASKING = tuple(KNOWN[name] for name in ("SIGUSR1",) if name in KNOWN)
"""Signal that batch systems can send some time before they end a job."""


class SignalRequests:
    """Requests that signals made to a run: to end, or to write a checkpoint.

    running: whether files are open; a signal then waits for the end of the tick, before that it ends the run at once.
    hasty: whether a second signal ends the run at once; only one does, so that closing the files is not disturbed.
    stopped: name of the signal that asked to end. asked: whether a checkpoint is requested.
    """

    def __init__(self) -> None:
        self.running = self.hasty = False
        self.stopped = ""
        self.asked = False
        self.terminal = _terminal_streams()

    def handle(self, number: int, _: FrameType | None = None) -> None:
        """Handle a signal."""
        name = signal.Signals(number).name
        if number in ASKING:
            self.asked = True
            return
        if name == "SIGHUP":
            _redirect_to_null(self.terminal)
        if not self.running:
            raise KeyboardInterrupt(name)
        if self.stopped and self.hasty and name != "SIGXCPU":  # SIGXCPU comes every second
            self.hasty = False
            raise KeyboardInterrupt(name)
        self.stopped = self.stopped or name


@contextmanager
def handling_signals() -> Iterator[SignalRequests]:
    """Context that handles signals; signals that are ignored, as under nohup, stay ignored."""
    signals = SignalRequests()
    with _handling((*ENDING, *ASKING), signals.handle):
        yield signals


@contextmanager
def ignoring_signals() -> Iterator[None]:
    """Context that ignores signals, while files are being closed."""
    with _handling((*ENDING, *ASKING), signal.SIG_IGN):
        yield


def leave(code: int) -> NoReturn:
    """End the process, ignoring a Ctrl-C that comes while Python cleans up: it would print a traceback."""
    if signal.getsignal(signal.SIGINT) is not None:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    sys.exit(code)


@contextmanager
def reader_may_leave() -> Iterator[None]:
    """Context whose output may go to a reader such as `head` that closes the pipe early, without an error."""
    try:
        yield
        sys.stdout.flush()
    except OSError as error:
        if error.errno not in (errno.EPIPE, errno.EIO):  # or the terminal has been closed
            raise
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # Python flushes again at its end


@contextmanager
def _handling(numbers: tuple[signal.Signals, ...], handler: Handler) -> Iterator[None]:
    with ExitStack() as stack:
        if threading.current_thread() is threading.main_thread():
            for number in numbers:
                before = signal.getsignal(number)
                if before not in (signal.SIG_IGN, None):
                    signal.signal(number, handler)
                    stack.callback(signal.signal, number, before)
        yield


def _terminal_streams() -> list[int]:
    """Return the standard streams of this process that are a terminal, before the terminal may be closed."""
    streams = []
    for stream in (sys.stdin, sys.stdout, sys.stderr):
        try:
            if os.isatty(stream.fileno()):
                streams.append(stream.fileno())
        except (AttributeError, OSError, ValueError):  # closed, or no file
            continue
    return streams


def _redirect_to_null(streams: list[int]) -> None:
    """Discard further output to these streams, as writing to a closed terminal is an error."""
    nowhere = os.open(os.devnull, os.O_RDWR)
    for stream in streams:
        os.dup2(nowhere, stream)
    os.close(nowhere)
