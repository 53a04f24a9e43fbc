"""Progress bar of a run, at a terminal or in a notebook."""

import time
from collections.abc import Callable
from contextlib import suppress
from html import escape
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeRemainingColumn

from taichi_plume.guard.terminal import notebook_display, terminal

if TYPE_CHECKING:
    from taichi_plume.time_loop import TimeLoop

COMPILED = 3  # ticks until every kernel has run once
PAUSE = 0.2  # wall-clock time between updates in a notebook [s]


def progress_bar(requested: bool | None = None) -> "TerminalBar | NotebookBar | None":
    """Return a progress bar, which shows that kernels are compiled; None if there is neither terminal nor notebook.

    requested: False for none; True for one on stderr even if that is no terminal.
    """
    if requested is False:
        return None
    notebook = notebook_display()
    if notebook is not None:
        return NotebookBar(notebook)
    console = terminal(error=True, **({"force_terminal": True} if requested else {}))
    return TerminalBar(console) if console.is_terminal else None


class TerminalBar:
    """Progress bar at a terminal: simulated time, speed, time left."""

    def __init__(self, console: Console):
        self.bar = Progress(
            SpinnerColumn(),
            TextColumn("{task.description:<9}"),
            BarColumn(),
            TextColumn("{task.fields[clock]}"),
            TextColumn("{task.fields[speed]}"),
            TimeRemainingColumn(),
            console=console,
            transient=True,
        )
        console.print("compiling ...", end="\r")

    def begin(self, sim: "TimeLoop") -> None:
        """Start the bar of a simulation's time steps."""
        total = sim.last_tick - sim.scenario.first_tick
        self.task = self.bar.add_task("compiling", total=total, clock="", speed="")
        self.bar.start()

    def update(self, sim: "TimeLoop") -> None:
        """Update the bar with the simulated time and the speed relative to real time."""
        done = sim.tick - sim.scenario.first_tick
        speed = self.bar.tasks[0].speed  # ticks per second over the last moments
        self.bar.update(
            self.task,
            completed=done,
            description=phase(sim),
            clock=clock(sim),
            speed=f"{speed * sim.dt:.3g} x real time" if speed else "",
        )

    def close(self) -> None:
        """Remove the bar."""
        with suppress(OSError):  # the terminal may have been closed
            self.bar.stop()


class NotebookBar:
    """Progress bar in the output of a notebook's cell. display: the module IPython.display; first: text at first."""

    def __init__(self, display: Any, first: str = "compiling ..."):
        self.html = display.HTML
        self.shown = display.display(self.html(first), display_id=True)
        self.updated = 0.0

    def begin(self, sim: "TimeLoop") -> None:
        """Start the bar of a simulation's time steps."""
        self.began = time.monotonic()

    def update(self, sim: "TimeLoop") -> None:
        """Update the bar with the simulated time and the speed relative to real time."""

        def text() -> str:
            speed = done * sim.dt / max(time.monotonic() - self.began, 1e-9)
            return f"{phase(sim)} {clock(sim)}, {speed:.3g} x real time"

        first = sim.scenario.first_tick
        done = sim.tick - first
        self.draw(done, sim.last_tick - first, text)

    def draw(self, done: int, total: int, text: Callable[[], str]) -> None:
        """Draw the bar with a text to its right, unless it has just been drawn."""
        now = time.monotonic()
        if now < self.updated + PAUSE:
            return
        self.updated = now
        bar = f'<progress max="{total}" value="{done}"></progress>'
        self.shown.update(self.html(f"{bar} {escape(text())}"))

    def close(self) -> None:
        """Remove the bar."""
        self.shown.update(self.html(""))


def phase(sim: "TimeLoop") -> str:
    """Return what a simulation does at present: compiling, warm-up or running."""
    if sim.tick - sim.scenario.first_tick < COMPILED:
        return "compiling"
    return "warm-up" if sim.tick < 0 else "running"


def clock(sim: "TimeLoop") -> str:
    """Return the present and the last simulated time as text."""
    return f"{sim.t:.1f} of {sim.scenario.duration:g} s"
