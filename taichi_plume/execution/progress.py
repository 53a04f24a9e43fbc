"""Progress bar of a run on a terminal."""

from contextlib import suppress
from math import ceil
from typing import Self

from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeRemainingColumn

from taichi_plume.time_loop import Every, TimeLoop

COMPILED = 3  # ticks until every kernel has run once


class ProgressBar:
    """Context manager that draws a progress bar on `console` during `sim`: simulated time, speed, time left."""

    def __init__(self, sim: TimeLoop, console: Console):
        self.first = -ceil(sim.scenario.warm_up / sim.dt - 1e-9)
        self.dt = sim.dt
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
        total = sim.last_tick - self.first
        self.task = self.bar.add_task("compiling", total=total, clock="", speed="")

    def __enter__(self) -> Self:
        self.bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        with suppress(OSError):  # the terminal may have been closed
            self.bar.stop()

    def observer(self) -> Every:
        return Every(self.dt, self.update, warm_up=True)

    def update(self, sim: TimeLoop) -> None:
        """Update the bar with the simulated time and the speed relative to real time."""
        done = sim.tick - self.first
        speed = self.bar.tasks[0].speed  # ticks per second over the last moments
        self.bar.update(
            self.task,
            completed=done,
            description="compiling" if done < COMPILED else "warm-up" if sim.tick < 0 else "running",
            clock=f"{sim.t:.1f} of {sim.scenario.duration:g} s",
            speed=f"{speed * self.dt:.3g} x real time" if speed else "",
        )
