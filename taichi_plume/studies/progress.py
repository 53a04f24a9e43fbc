"""Progress display of a study: a bar at a terminal or in a notebook, else a line per minute; totals of its runs."""

import time
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, suppress
from typing import TYPE_CHECKING, Self, TypeVar

from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    SpinnerColumn,
    TextColumn,
    TimeRemainingColumn,
)

from taichi_plume.execution.progress import NotebookBar
from taichi_plume.guard.terminal import notebook_display, say, terminal
from taichi_plume.studies.messages import AirRecord, Result
from taichi_plume.studies.results import duration

if TYPE_CHECKING:
    from taichi_plume.studies.scheduler import Scheduler

FIRST_S, LINE_S = 10.0, 60.0  # time until the first line, and between further lines
QUIET_S = 1.0  # time of other work until its progress is shown
T = TypeVar("T")


class Display:
    """Progress display of a study's runs (context): a bar at a terminal or in a notebook, else a line per minute.

    total: all runs; done: runs done at the start; shown: False for no output; what: plural of what is counted.
    """

    def __init__(self, total: int, done: int, shown: bool = True, what: str = "runs"):
        self.total, self.done, self.shown, self.what = total, done, shown, what
        self._began = time.monotonic()
        self._first = done
        self._next = self._began + FIRST_S
        self._bar: Progress | None = None
        self._notebook: NotebookBar | None = None
        console, notebook = terminal(error=True), notebook_display()
        if not shown:
            return
        if notebook is not None:
            self._notebook = NotebookBar(notebook, f"{what} ...")
        elif console.is_terminal:
            self._bar = Progress(
                SpinnerColumn(),
                TextColumn(what),
                BarColumn(),
                MofNCompleteColumn(),
                TextColumn("{task.fields[more]}"),
                TimeRemainingColumn(),
                console=console,
                transient=True,
                speed_estimate_period=600,
            )
            self._task = self._bar.add_task("", total=total, completed=done, more="")

    def __enter__(self) -> Self:
        if self._bar is not None:
            self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            with suppress(OSError):  # the terminal may be gone
                self._bar.stop()
        if self._notebook is not None:
            self._notebook.close()

    def advance(self, runs: int) -> None:
        """Add a number of finished runs to the progress display."""
        self.done += runs
        if self._bar is not None:
            self._bar.update(self._task, completed=self.done)

    def update(self, scheduler: "Scheduler | None" = None) -> None:
        """Refresh the bar, or print a progress line each minute, with the state of a study's execution if given."""
        if not self.shown:
            return
        if self._bar is not None:
            self._bar.update(self._task, more=_facts(scheduler))
        elif self._notebook is not None:
            self._notebook.draw(self.done, self.total, lambda: self._line(scheduler))
        elif time.monotonic() > self._next:
            self._next = time.monotonic() + LINE_S
            self.note(self._line(scheduler))

    def note(self, line: str) -> None:
        """Print a line: above the bar, in a notebook to stdout, else to stderr."""
        if self._bar is not None:
            self._bar.console.print(line, soft_wrap=True, markup=False, highlight=False)
        elif self.shown:
            say(line, error=self._notebook is None)

    def _line(self, scheduler: "Scheduler | None") -> str:
        facts = _facts(scheduler)
        return f"{self.done:,} of {self.total:,} {self.what}{self._left()}" + f"; {facts}" * bool(facts)

    def _left(self) -> str:
        """Return the remaining time of the study in words, at the mean rate so far; "" if unknown."""
        done = self.done - self._first
        if not done:
            return ""
        seconds = (self.total - self.done) * (time.monotonic() - self._began) / done
        return f", about {seconds / 60:.0f} min left" if seconds > 90 else f", about {seconds:.0f} s left"


def watched(parts: Iterable[T], total: int, what: str, shown: bool) -> Iterator[T]:
    """Yield the parts of an iterable, and show the progress from the time on when they have taken more than a second.

    total: their number; what: words behind the number, such as "points are checked".
    """
    began, display = time.monotonic(), None
    with ExitStack() as stack:
        for done, part in enumerate(parts):
            if display is None and shown and time.monotonic() > began + QUIET_S:
                display = stack.enter_context(Display(total, done, True, what))
            if display is not None:
                display.advance(done - display.done)
                display.update()
            yield part


def _facts(scheduler: "Scheduler | None") -> str:
    if scheduler is None:
        return ""
    queue, workers = scheduler.queue, len(scheduler.worker_names)
    facts = []
    if queue.airs:
        facts.append(f"{queue.airs - len(queue.left)} of {queue.airs} airs")
    if scheduler.failed:
        facts.append(f"{scheduler.failed} failed")
    facts.append(f"{len(scheduler.tasks)} of {workers} workers busy" if workers else "no workers")
    return ", ".join(facts)


class Totals:
    """Totals of a study's execution: runs, airs, the largest number of workers, and times summed over workers [s]."""

    def __init__(self) -> None:
        self.runs = self.airs = self.workers = 0
        self.busy_s = self.simulation_s = 0.0
        self._began = time.perf_counter()

    def add(self, result: Result) -> None:
        """Add a worker's result to the totals: run records, or the record of a filmed flow."""
        if isinstance(result, AirRecord):
            self.airs += 1
            self.busy_s += result.seconds
            self.simulation_s += result.seconds
            return
        self.runs += len(result)
        self.busy_s += sum(record.cost.total_s for record in result)
        self.simulation_s += sum(record.cost.simulation_s for record in result)

    def line(self) -> str:
        """Return runs, wall time, number of workers and their utilisation in one line."""
        wall = time.perf_counter() - self._began
        worker_s = wall * self.workers
        airs = f" and {self.airs:,} airs" * bool(self.airs)
        busy = min(1.0, self.busy_s / worker_s) if worker_s else 0.0
        beyond = (worker_s - self.simulation_s) / max(1, self.runs)
        return (
            f"{self.runs:,} runs{airs} in {duration(wall)} by {self.workers} worker{'s' * (self.workers != 1)}, "
            f"busy {100 * busy:.0f} % of that; {beyond:.3g} s per run beyond the simulation"
        )
