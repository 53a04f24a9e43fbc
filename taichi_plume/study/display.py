"""How far a study is: a bar on a terminal, else a line now and then."""

import time
from contextlib import suppress
from types import TracebackType
from typing import TYPE_CHECKING, Self

from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    SpinnerColumn,
    TextColumn,
    TimeRemainingColumn,
)

from taichi_plume.guard.terminal import say, terminal

if TYPE_CHECKING:
    from taichi_plume.study.campaign import Campaign

FIRST_S, LINE_S = 10.0, 60.0  # until the first line, and between the others


class Display:
    """A context that shows how many of `total` runs are done; `done` were before. quiet: it shows nothing."""

    def __init__(self, total: int, done: int, quiet: bool = False):
        self.total, self.done, self.quiet = total, done, quiet
        self._began = time.monotonic()
        self._first = done
        self._next = self._began + FIRST_S
        self._bar: Progress | None = None
        console = terminal(error=True)
        if not quiet and console.is_terminal:
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

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            with suppress(OSError):  # the terminal may be gone
                self._bar.stop()

    def advance(self, runs: int) -> None:
        """So many runs more are done."""
        self.done += runs
        if self._bar is not None:
            self._bar.update(self._task, completed=self.done)

    def update(self, campaign: "Campaign") -> None:
        """Show how the campaign is."""
        if self.quiet:
            return
        if self._bar is not None:
            self._bar.update(self._task, more=_facts(campaign))
        elif time.monotonic() > self._next:
            self._next = time.monotonic() + LINE_S
            self.note(f"{self.done:,} of {self.total:,} runs{self._left()}; {_facts(campaign)}")

    def note(self, line: str) -> None:
        """Show a line above the bar."""
        if self._bar is not None:
            self._bar.console.print(line, soft_wrap=True)
        elif not self.quiet:
            say(line, error=True)

    def _left(self) -> str:
        """How long the others will take, at the pace so far."""
        done = self.done - self._first
        if not done:
            return ""
        seconds = (self.total - self.done) * (time.monotonic() - self._began) / done
        return f", about {seconds / 60:.0f} min left" if seconds > 90 else f", about {seconds:.0f} s left"


def _facts(campaign: "Campaign") -> str:
    agenda, workers = campaign.agenda, len(campaign.lanes)
    facts = []
    if agenda.airs:
        facts.append(f"{agenda.airs - len(agenda.left)} of {agenda.airs} airs")
    if campaign.failed:
        facts.append(f"{campaign.failed} failed")
    busy = sum(lane.tasks > 0 for lane in campaign.lanes.values())
    facts.append(f"{busy} of {workers} workers busy" if workers else "no workers")
    return ", ".join(facts)
