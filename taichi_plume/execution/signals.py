"""Signal handlers of a run: a signal ends the run after the current time step, so that it can be resumed."""

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
    """Requests that operating-system signals made to a run: to end, or to write a checkpoint.

    running: whether files are open; a signal then waits for the end of the time step, before that it ends the run at
    once. hasty: whether a second signal ends the run at once; a third is ignored while files close. stopped: name of
    the signal that asked to end. asked: whether a checkpoint is requested.
    """

    def __init__(self) -> None:
        self.running = self.hasty = False
        self.stopped = ""
        self.asked = False
        self.terminal = _terminal_streams()

    def handle(self, number: int, _: FrameType | None = None) -> None:
        """Note the request of a signal, or raise KeyboardInterrupt if the run must end at once."""
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
    """Context that handles signals to end or checkpoint a run; signals ignored before, as by nohup, stay ignored."""
    signals = SignalRequests()
    with _handling((*ENDING, *ASKING), signals.handle):
        yield signals


@contextmanager
def ignoring_signals() -> Iterator[None]:
    """Context that ignores all signals that end a run, such as Ctrl-C, while files are being closed."""
    with _handling((*ENDING, *ASKING), signal.SIG_IGN):
        yield


def leave(code: int) -> NoReturn:
    """Exit with a code, ignoring a late Ctrl-C, which would print a traceback while Python cleans up."""
    if signal.getsignal(signal.SIGINT) is not None:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    sys.exit(code)


@contextmanager
def reader_may_leave() -> Iterator[None]:
    """Context for printing to a pipe or terminal that may be closed early (as by `head`), without an error."""
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
    """Return the file descriptors of those standard streams that are a terminal."""
    streams = []
    for stream in (sys.stdin, sys.stdout, sys.stderr):
        try:
            if os.isatty(stream.fileno()):
                streams.append(stream.fileno())
        except (AttributeError, OSError, ValueError):  # closed, or no file
            continue
    return streams


def _redirect_to_null(streams: list[int]) -> None:
    """Redirect these file descriptors to the null device, as writing to a closed terminal is an error."""
    nowhere = os.open(os.devnull, os.O_RDWR)
    for stream in streams:
        os.dup2(nowhere, stream)
    os.close(nowhere)
