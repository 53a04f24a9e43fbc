"""A child process (sandbox) for libraries that read foreign files, with limits on computing time, memory and files.

A library cannot be interrupted from Python while it computes: a network with an endless loop would run for ever, and a
compressed bag could fill the memory. In a child process the operating system enforces limits (`setrlimit`), and a file
can at worst end that process. Without such limits, as on Windows, the wall clock ends the process.
"""

import math
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
import weakref
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from typing import IO, Any, NoReturn

if sys.platform == "win32":
    resource = None
else:
    import resource

MIB = 1 << 20
WALL_CLOCK = 6.0  # wall-clock limit over the limit on computing time, for shared machines
SLICE = 0.2  # s between two looks at the clock; not a deadline, for the sake of stopped processes (Ctrl-Z)
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
IGNORED = {"SIGINT", "SIGTERM", "SIGHUP", "SIGUSR1", "SIGUSR2"}  # the parent handles them and ends the child


@dataclass(frozen=True)
class Limits:
    """Limits of a call in a child process. seconds: computing time; memory: bytes beyond those in use when the first
    limited call began; opens: whether files may be opened. No file may be written.
    """

    seconds: float
    memory: int
    opens: bool = False


class ConfinedError(Exception):
    """A call in a child process exceeded a limit or made the process end; the message gives the reason."""


class ConfinedProcess:
    """A Python child process (sandbox) that executes function calls for its parent, one at a time.

    modules: imported at once, without limits.
    """

    def __init__(self, *modules: str):
        boot = f"import sys; sys.path[:] = {sys.path!r}; from {__name__} import serve; serve()"
        self._process = subprocess.Popen(
            [sys.executable, "-c", boot],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**os.environ, **ONE_THREAD},
        )
        self._lock = threading.Lock()
        self._clock = _Clock(self._process)
        self.close = weakref.finalize(self, _end, self._process, os.getpid())
        self.call(_import, modules)

    def call(self, function: Callable[..., Any], *args: Any, limits: Limits | None = None) -> Any:
        """Call a module's function in the child process; return its result, or raise its exception.

        Raises ConfinedError at a limit; the child process has ended then.
        """
        if not self.close.alive:
            raise ConfinedError("its process has ended")
        calls, answers = self._process.stdin, self._process.stdout
        assert calls is not None
        assert answers is not None
        try:
            with self._lock, self._clock.running(limits):
                pickle.dump((function, args, limits), calls, pickle.HIGHEST_PROTOCOL)
                calls.flush()
                is_result, answer = pickle.load(answers)
        except (EOFError, OSError, pickle.UnpicklingError):
            self.close()
            raise ConfinedError(self._reason(limits)) from None
        except BaseException:  # such as Ctrl-C: otherwise the next call would get this answer
            self.close()
            raise
        if is_result:
            return answer
        raise answer

    def _reason(self, limits: Limits | None) -> str:
        """Return the reason why the child process has ended, as the end of an error message."""
        ended = -(self._process.returncode or 0)
        name = signal.Signals(ended).name if ended in set(signal.Signals) else f"exit code {-ended}"
        if limits is not None and (self._clock.is_over or name == "SIGXCPU"):
            return f"takes more than {limits.seconds:.0f} s of computing time"
        if limits is not None and name == "SIGABRT":
            return f"needs more than {limits.memory // MIB} MiB of memory, or makes the library that reads it fail"
        return f"makes the library that reads it fail ({name})"


class _Clock:
    """Watchdog thread that kills a child process whose function call takes too much wall-clock time."""

    def __init__(self, process: "subprocess.Popen[bytes]"):
        self.process, self.left, self.is_over = process, math.inf, False
        threading.Thread(target=self._watch, daemon=True).start()

    def running(self, limits: Limits | None) -> "_Clock":
        """Return a context manager in which the child process is killed after a multiple of the time limit."""
        self.left = math.inf if limits is None else WALL_CLOCK * limits.seconds
        return self

    def __enter__(self) -> None:
        pass

    def __exit__(self, *_: object) -> None:
        self.left = math.inf

    def _watch(self) -> None:
        while self.process.poll() is None:
            time.sleep(SLICE)
            self.left -= SLICE
            if self.left < 0.0:
                self.is_over = True
                self.process.kill()
                return


def _end(process: "subprocess.Popen[bytes]", owner: int) -> None:
    """End a child process and wait for it; do nothing in a fork, whose process id is not `owner`."""
    if os.getpid() != owner:
        return
    for stream in (process.stdin, process.stdout):
        with suppress(OSError):
            assert stream
            stream.close()
    with suppress(subprocess.TimeoutExpired):
        process.wait(SLICE)  # the process ends when the pipe is closed, or has ended at a limit
    process.kill()
    process.wait()


# ---------------------------------------------------------------- in the child


def serve() -> None:
    """Child side: execute the function calls of the parent, until the parent closes the pipe or ends."""
    calls, answers = (os.fdopen(os.dup(n), mode) for n, mode in ((0, "rb"), (1, "wb")))
    for number, flag in ((0, os.O_RDONLY), (1, os.O_WRONLY)):  # a library may print
        os.dup2(os.open(os.devnull, flag), number)
    for name in IGNORED & signal.Signals.__members__.keys():
        signal.signal(signal.Signals[name], signal.SIG_IGN)
    threading.Thread(target=_end_with, args=[os.getppid()], daemon=True).start()
    if resource is not None:
        signal.signal(signal.SIGXCPU, signal.SIG_DFL)
        signal.pthread_sigmask(signal.SIG_SETMASK, ())
        _limit("RLIMIT_CORE", 0)
    _answer(calls, answers)


def _import(modules: tuple[str, ...]) -> None:
    for module in modules:
        import_module(module)


def _answer(calls: IO[bytes], answers: IO[bytes]) -> NoReturn:
    confined = False
    while True:
        try:
            function, args, limits = pickle.load(calls)
        except EOFError:
            os._exit(0)
        if limits is not None and resource is not None:
            used = resource.getrusage(resource.RUSAGE_SELF)
            _limit("RLIMIT_CPU", math.ceil(used.ru_utime + used.ru_stime + limits.seconds))
            if not confined:
                confined = True
                _confine(limits)
        try:
            answer = pickle.dumps((True, function(*args)), pickle.HIGHEST_PROTOCOL)
        except MemoryError:
            most = limits.memory // MIB if limits else 0
            answer = pickle.dumps((False, ConfinedError(f"needs more than {most} MiB of memory")))
        except Exception as error:
            try:
                answer = pickle.dumps((False, error))
                pickle.loads(answer)
            except Exception:
                answer = pickle.dumps((False, ConfinedError(f"{type(error).__name__}: {error}")))
        answers.write(answer)
        answers.flush()


def _confine(limits: Limits) -> None:
    """Limit memory, file size and opening of files for the rest of this process, by setrlimit."""
    with suppress(OSError), open("/proc/self/statm", encoding="ascii") as file:
        _limit("RLIMIT_AS", int(file.read().split()[0]) * os.sysconf("SC_PAGE_SIZE") + limits.memory)
    _limit("RLIMIT_FSIZE", 0)
    if not limits.opens:
        _limit("RLIMIT_NOFILE", 0)


def _limit(name: str, most: int) -> None:
    assert resource is not None
    with suppress(OSError, ValueError):  # a limit that this system does not know, or keeps lower already
        number = vars(resource)[name]
        hard = resource.getrlimit(number)[1]
        resource.setrlimit(number, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard))


def _end_with(parent: int) -> NoReturn:
    """End this process once its parent has ended, even if a fork of the parent keeps the pipe open."""
    while os.getppid() == parent:
        time.sleep(1.0)
    os._exit(1)
