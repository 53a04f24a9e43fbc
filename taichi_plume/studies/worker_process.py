"""Worker process of a study: start of Taichi on one thread, and the open files of the last run."""

from collections.abc import Hashable

from taichi_plume.assembly.preparation import Prepared, checked
from taichi_plume.engine import program
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.studies.messages import Task


class WorkerProcess:
    """Taichi and the open files of this process. backend: of Taichi, "" before the start."""

    def __init__(self):
        self.backend = ""
        self._last: tuple[Hashable, Prepared | None] = (None, None)

    def start(self) -> None:
        """Start Taichi unless it runs: on one thread, as every core has a worker process of its own."""
        self.backend = program.start("cpu", threads=1)

    def prepared(self, scenario: Scenario, task: Task) -> Prepared:
        """Check a scenario of a task; files that the last run has opened too stay open. Raises ScenarioError."""
        key = task.requests[0].structure, task.folder  # with the content of the files
        known = self._last[1] if self._last[0] == key else None
        prepared = checked(scenario, task.folder, task.options.allow_outside, known=known)
        self._last = key, prepared
        return prepared


PROCESS = WorkerProcess()
"""This process as a worker."""
