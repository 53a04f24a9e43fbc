"""The files that a study keeps of a run."""

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from taichi_plume.files import run_folder
from taichi_plume.running.job import End, report, whole
from taichi_plume.running.outputs import About, Outputs
from taichi_plume.running.result import result, write_result
from taichi_plume.running.signals import Ears
from taichi_plume.scenario.input_files import input_paths
from taichi_plume.study.messages import Request, Task
from taichi_plume.study.rows import probed
from taichi_plume.study.warm import Kept

KEPT = "kept"
UNFINISHED = "unfinished"  # beside them, so that paths relative to a run folder stay what they are
ALWAYS = ("scenario.yaml", "result.json")  # of a run that is kept
PLAYED = "wind and gas were played from a film of the study: nothing is told of flow, gas budget and forces"
Told = tuple[End, dict[str, Any], Path | None]
"""How a run ended, its result, and its table of probes."""


@contextmanager
def run_with_files(one: Kept, task: Task, request: Request, backend: str) -> Iterator[Told]:
    """Run with a run folder, which keeps what the study wants of it, once the context is left, and takes its name.

    Raises what the run raises; nothing is left then, nor where the study keeps nothing.
    """
    keep = set(task.options.keep)
    final = task.options.out / KEPT / request.run
    unfinished = task.options.out / UNFINISHED
    for parent in (final.parent, unfinished):
        parent.mkdir(parents=True, exist_ok=True)
    for left in unfinished.glob(f"{request.run}.*"):  # by a worker that was killed
        shutil.rmtree(left, ignore_errors=True)
    folder = Path(tempfile.mkdtemp(prefix=f"{request.run}.", dir=unfinished))
    try:
        folder.chmod(0o755)
        files = keep | ({"probes.parquet"} if probed(task.options.outcomes) else set())
        files |= {*run_folder.FILES} if "report.html" in keep else set()
        outputs = _outputs(one, task, files, Where(folder, final), backend)
        try:
            outputs.start()
            one.sim.run()
        finally:
            faults = outputs.close()
        if faults:
            raise faults[0]
        end = whole(one.sim)
        content = result(one.sim, end.status, end.message, backend, outputs.map_scores)
        played = [PLAYED] if one.reel is not None else []
        content |= {"remarks": one.prepared.resources.remarks + outputs.remarks + played}
        write_result(folder, content)
        probes = folder / "probes.parquet"
        yield end, content, probes if probes.exists() else None
        if keep:
            if "report.html" in keep:
                report(folder)
            for file in run_folder.files_in(folder):
                if file.name not in (*ALWAYS, *keep):
                    run_folder.remove(file)
            outputs.seal(end.status)
            _replace(folder, final)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


class Where(NamedTuple):
    """A folder, and what it will be called."""

    folder: Path
    final: Path


def _outputs(one: Kept, task: Task, files: set[str], where: Where, backend: str) -> Outputs:
    """The files of a run, which are not begun yet."""
    scenario = one.sim.scenario
    run_folder.write_scenario(where.folder, scenario, task.folder.resolve(), backend, where.final)
    inputs = input_paths(scenario, task.folder / "base.yaml", one.prepared.resources.files)[1:]
    about = About(where.folder, "cpu", backend, "recording.rrd" in files, inputs, files=files)
    return Outputs(one.sim, about, Ears())


def _replace(folder: Path, final: Path) -> None:
    """Let a folder that is whole take its name."""
    if final.exists():
        shutil.rmtree(final)
    folder.rename(final)
