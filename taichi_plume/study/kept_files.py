"""Run folders that a study keeps (`keep` of study.yaml)."""

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from taichi_plume.files import run_folder
from taichi_plume.running.job import End, report, whole
from taichi_plume.running.outputs import About, Outputs
from taichi_plume.running.result import result, write_result
from taichi_plume.running.signals import SignalRequests
from taichi_plume.scenario.input_files import input_paths
from taichi_plume.study.messages import Data, Request, Task
from taichi_plume.study.rows import probed
from taichi_plume.study.simulation_cache import CachedSimulation
from taichi_plume.study.store import KEPT_FOLDER

UNFINISHED = "unfinished"  # beside KEPT_FOLDER, so that paths relative to a run folder stay valid
ALWAYS = ("scenario.yaml", "result.json")  # files that every kept run folder holds
PLAYED = "wind and gas come from a film of the study: flow, gas budget and forces are unknown"
Ended = tuple[End, Data, Path | None]
"""End of a run, its result, and the path of its table of probes."""


@contextmanager
def run_with_files(cached: CachedSimulation, task: Task, request: Request, backend: str) -> Iterator[Ended]:
    """Execute a run in a temporary folder; on leaving the context, rename the folder to kept/RUN.

    The final folder holds only the files that the study keeps. The folder is removed if the run raises an error or the
    study keeps no files.
    """
    keep = set(task.options.keep)
    final = task.options.out / KEPT_FOLDER / request.run
    unfinished = task.options.out / UNFINISHED
    for parent in (final.parent, unfinished):
        parent.mkdir(parents=True, exist_ok=True)
    for left in unfinished.glob(f"{request.run}.*"):  # from a worker that was killed
        shutil.rmtree(left, ignore_errors=True)
    folder = Path(tempfile.mkdtemp(prefix=f"{request.run}.", dir=unfinished))
    try:
        folder.chmod(0o755)
        files = keep | ({"probes.parquet"} if probed(task.options.outcomes) else set())
        files |= {*run_folder.FILES} if "report.html" in keep else set()
        scenario = cached.sim.scenario
        run_folder.write_scenario(folder, scenario, task.folder.resolve(), backend, final)
        inputs = input_paths(scenario, task.folder / "base.yaml", cached.prepared.resources.files)[1:]
        about = About(folder, "cpu", backend, "recording.rrd" in files, inputs, files=files)
        outputs = Outputs(cached.sim, about, SignalRequests())
        try:
            outputs.start()
            cached.sim.run()
        finally:
            faults = outputs.close()
        if faults:
            raise faults[0]
        end = whole(cached.sim)
        content = result(cached.sim, end.status, end.message, backend, outputs.map_scores)
        played = [PLAYED] if cached.player is not None else []
        content |= {"remarks": cached.prepared.resources.remarks + outputs.remarks + played}
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
            if final.exists():
                shutil.rmtree(final)
            folder.rename(final)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
