"""What a campaign has cost: how busy its workers were, and what came on top of the simulations."""

import json
import time
from pathlib import Path
from typing import Any

from taichi_plume.files.disk import written_whole
from taichi_plume.guard.opening import read_regular
from taichi_plume.study.store import LARGEST_TEXT, Store
from taichi_plume.study.worker import Done

NAME = "figures.json"


class Figures:
    """Of one campaign, from the first task that is given to the last that is done.

    runs: done; wall_s; worker_s: the time that workers were there, summed over them; busy_s: that they were at a task;
    simulation_s: that simulated time went by.
    """

    def __init__(self) -> None:
        self.runs = self.airs = self.tasks = 0
        self.wall_s = self.worker_s = self.busy_s = self.simulation_s = 0.0
        self.most = 0
        self._count = 0
        self._began = self._last = 0.0

    def begin(self, workers: int) -> None:
        """The first task is given."""
        self._began = self._last = time.perf_counter()
        self._count = self.most = workers

    def workers(self, count: int) -> None:
        """From now on there are so many workers."""
        now = time.perf_counter()
        if self._last:
            self.worker_s += self._count * (now - self._last)
        self._last, self._count, self.most = now, count, max(self.most, count)

    def took(self, done: Done) -> None:
        """A task is done."""
        self.tasks += 1
        self.runs += len(done.records)
        self.busy_s += done.busy_s
        self.simulation_s += sum(record.cost.simulation_s for record in done.records)
        if done.air is not None:
            self.airs += 1
            self.simulation_s += done.air.seconds

    def end(self) -> None:
        """The last task is done."""
        self.workers(self._count)
        self.wall_s = time.perf_counter() - self._began

    @property
    def utilisation(self) -> float:
        """Share of the workers' time in which they were at a task."""
        return min(1.0, self.busy_s / self.worker_s) if self.worker_s else 0.0

    @property
    def beyond_s(self) -> float:
        """Seconds of workers per run beyond the simulation: waiting, starting, compiling, reading and writing."""
        return (self.worker_s - self.simulation_s) / max(1, self.runs)

    def told(self) -> dict[str, Any]:
        """All of it, for a file."""
        names = (
            "runs",
            "airs",
            "tasks",
            "wall_s",
            "worker_s",
            "busy_s",
            "simulation_s",
            "utilisation",
            "beyond_s",
        )
        return {name: getattr(self, name) for name in names} | {"workers": self.most}

    def line(self) -> str:
        """All of it, for a reader."""
        airs = f" and {self.airs:,} airs" * bool(self.airs)
        return (
            f"{self.runs:,} runs{airs} in {_span(self.wall_s)} by {self.most} worker{'s' * (self.most != 1)}, busy "
            f"{100 * self.utilisation:.0f} % of that; {self.beyond_s:.3g} s per run beyond the simulation"
        )


def _span(seconds: float) -> str:
    if seconds < 100:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes // 60} h {minutes % 60:02d} min" if minutes >= 60 else f"{minutes} min {rest:02d} s"


def write(store: Store, figures: Figures) -> None:
    """Write figures.json: of the campaign, and of the airs that were filmed.

    Where nothing was done, the figures of the last one stay. Raises OSError, StoreError.
    """
    path = store.folder / NAME
    told = figures.told() if figures.tasks else earlier(path).get("campaign", {})
    airs = [one._asdict() for one in store.air_records()]
    with written_whole(path) as fresh:
        fresh.write_text(json.dumps({"campaign": told, "airs": airs}, indent=1), encoding="utf-8")


def earlier(path: Path) -> dict[str, Any]:
    """The figures that lie there; nothing where there are none."""
    try:
        told = json.loads(read_regular(path, LARGEST_TEXT) or b"")
    except (OSError, ValueError, RecursionError):
        return {}
    return told if isinstance(told, dict) else {}
