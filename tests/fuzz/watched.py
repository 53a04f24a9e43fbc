"""Jobs in a child process that is watched: one that crashes, hangs or takes much memory is reported and replaced."""

import multiprocessing
import os
import resource
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

PATIENCE = 4  # times the limit, which is of CPU time, as other processes may hold the machine
GOOD = ("accepted", "refused")
LONGEST_LINE = 2000  # characters
OURS = "taichi_plume"


@dataclass(frozen=True)
class Outcome:
    """kind: accepted, refused (what is meant to happen), raw, lines, printed, slow, warned, crash or hang; text: what
    was said; place: of a raw error, by which equal ones are counted together.
    """

    kind: str
    text: str = ""
    place: str = ""
    large: bool = False
    """Whether the job may take longer."""

    @property
    def good(self) -> bool:
        return self.kind in GOOD


def tried(call: Callable[[], Any], allowed: tuple[type[BaseException], ...]) -> Outcome:
    """What comes of a call: accepted, refused with clean lines by an error of the allowed types, or a fault."""
    try:
        with warnings.catch_warnings(record=True) as reported:
            warnings.simplefilter("always")
            warnings.simplefilter("ignore", DeprecationWarning)
            result = call()
    except allowed as error:
        lines = getattr(error, "faults", [str(error)])
        odd = [line for line in lines if not line or "\n" in line or len(line) > LONGEST_LINE]
        if odd or not lines:
            return Outcome("lines", repr(odd[:1])[:600], type(error).__name__)
        return Outcome("refused", lines[0], type(error).__name__)
    except BaseException as error:
        frames = traceback.extract_tb(error.__traceback__)
        ours = [frame for frame in frames if OURS in frame.filename] or frames
        place = f"{ours[-1].filename.rpartition('/')[2]}:{ours[-1].name}" if ours else ""
        text = "".join(traceback.format_exception(error)[-8:])[-3000:]
        return Outcome("raw", text, f"{type(error).__name__} in {place}")
    if reported:
        one = reported[0]
        return Outcome(
            "warned", str(one.message), f"{one.category.__name__} in {one.filename.rpartition('/')[2]}"
        )
    return result if isinstance(result, Outcome) else Outcome("accepted")


def _serve(pipe: Any, make: Callable[[], Callable[[Any], Outcome]], memory: int | None) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with tempfile.TemporaryFile() as printed:
        os.dup2(printed.fileno(), sys.stderr.fileno())
        work = make()
        if memory is not None:
            held = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
            resource.setrlimit(resource.RLIMIT_AS, (held + memory, held + memory))
        pipe.send("ready")
        while True:
            try:
                job = pipe.recv()
            except EOFError:
                return
            printed.truncate(0)
            begin = time.process_time()
            outcome = work(job)
            took = time.process_time() - begin
            printed.seek(0)
            said = printed.read(5000).decode(errors="replace").strip("\0")
            pipe.send((Outcome("printed", said) if said and outcome.good else outcome, took))


class Worker:
    """A watched process. make: called in it once, gives what does a job; memory: bytes a job may take beyond that."""

    def __init__(
        self, make: Callable[[], Callable[[Any], Outcome]], limit: float = 10.0, memory: int | None = None
    ):
        self.make, self.limit, self.memory = make, limit, memory
        self.process: Any = None

    def start(self) -> None:
        """Start the process, unless it runs."""
        if self.process is not None:
            return
        context = multiprocessing.get_context("spawn")
        self.pipe, other = context.Pipe()
        self.process = context.Process(target=_serve, args=(other, self.make, self.memory), daemon=True)
        self.process.start()
        other.close()
        assert self.pipe.poll(120)
        assert self.pipe.recv() == "ready"

    def do(self, job: Any) -> Outcome:
        """The outcome of a job."""
        self.start()
        try:
            self.pipe.send(job)
            if not self.pipe.poll(PATIENCE * self.limit):
                self.process.kill()
                self.close()
                return Outcome("hang", f"no answer within {PATIENCE * self.limit:g} s")
            outcome, took = self.pipe.recv()
        except (EOFError, OSError):
            self.process.join(10)
            code = self.process.exitcode
            self.close()
            return Outcome("crash", f"exit code {code}", f"exit code {code}")
        if outcome.good and took > self.limit and not outcome.large:
            return Outcome("slow", f"{took:.1f} s: {outcome.kind} {outcome.text}")
        return outcome

    def close(self) -> None:
        """End the process; the next job starts another."""
        if self.process is not None:
            self.pipe.close()
            self.process.join(5)
            self.process.kill()
            self.process.join()
            self.process = None


def reported(outcomes: Iterable[tuple[str, Outcome]]) -> Iterator[str]:
    """What came of jobs by these names: how many of each kind, and of each fault how many and the first."""
    kinds, faults, first = Counter(), Counter(), {}
    for name, outcome in outcomes:
        kinds[f"{outcome.kind} {outcome.place}" if outcome.good and outcome.place else outcome.kind] += 1
        if not outcome.good:
            key = (outcome.kind, outcome.place)
            faults[key] += 1
            first.setdefault(key, (name, outcome.text))
    yield ", ".join(f"{count} {kind}" for kind, count in kinds.most_common()) or "nothing"
    for key, count in faults.most_common():
        name, text = first[key]
        yield f"\n{count} x {key[0]} {key[1]}, first {name}:\n{text}"
