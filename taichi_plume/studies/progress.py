"""Progress display of a study: a bar at a terminal or in a notebook, else a line per minute; totals of its runs."""

import time
from contextlib import suppress
from typing import TYPE_CHECKING, Self

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


class Display:
    """Progress display of a study's runs (context): a bar at a terminal or in a notebook, else a line per minute.

    total: all runs; done: runs done at the start; shown: False for no output.
    """

    def __init__(self, total: int, done: int, shown: bool = True):
        self.total, self.done, self.shown = total, done, shown
        self._began = time.monotonic()
        self._first = done
        self._next = self._began + FIRST_S
        self._bar: Progress | None = None
        self._notebook: NotebookBar | None = None
        console, notebook = terminal(error=True), notebook_display()
        if not shown:
            return
        if notebook is not None:
            self._notebook = NotebookBar(notebook, "starting workers ...")
        elif console.is_terminal:
            self._bar = Progress(
                SpinnerColumn(),
                TextColumn("runs"),
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

    def update(self, scheduler: "Scheduler") -> None:
        """Refresh the bar, or print a progress line each minute, from the state of a study's execution."""
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

    def _line(self, scheduler: "Scheduler") -> str:
        return f"{self.done:,} of {self.total:,} runs{self._left()}; {_facts(scheduler)}"

    def _left(self) -> str:
        """Return the remaining time of the study in words, at the mean rate so far; "" if unknown."""
        done = self.done - self._first
        if not done:
            return ""
        seconds = (self.total - self.done) * (time.monotonic() - self._began) / done
        return f", about {seconds / 60:.0f} min left" if seconds > 90 else f", about {seconds:.0f} s left"


def _facts(scheduler: "Scheduler") -> str:
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
