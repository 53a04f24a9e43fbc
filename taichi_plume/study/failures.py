"""What is left of a run that has failed: its scenario, to repeat it, and why; written without Taichi."""

import shutil

from taichi_plume.files import disk, run_folder
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.study.messages import Request, Task

FAILED = "failed"


def leave_failed(task: Task, request: Request, scenario: Scenario | None, message: str) -> None:
    """Leave what repeats a run that failed: its scenario, and why. Raises OSError."""
    folder = task.options.out / FAILED / request.run
    folder.mkdir(parents=True, exist_ok=True)
    if scenario is not None:
        run_folder.write_scenario(folder, scenario, task.folder.resolve(), "cpu")
    with disk.written_whole(folder / "message.txt") as fresh:
        fresh.write_text(message + "\n", encoding="utf-8")


def forget_failed(task: Task, request: Request) -> None:
    """Remove what an earlier try has left that failed, as the run did not fail now."""
    shutil.rmtree(task.options.out / FAILED / request.run, ignore_errors=True)
