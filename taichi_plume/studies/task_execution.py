"""Worker side of a study: execute runs one after another."""

import os
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path

from taichi_plume.assembly.assemble import build
from taichi_plume.assembly.own_code import execute
from taichi_plume.assembly.preparation import Prepared
from taichi_plume.engine import program
from taichi_plume.execution.execute import End, explain, report, whole
from taichi_plume.execution.outputs import About, Outputs
from taichi_plume.execution.result import result, write_result
from taichi_plume.execution.signals import SignalRequests
from taichi_plume.files import disk, run_folder
from taichi_plume.scenario.input_files import input_paths
from taichi_plume.scenario.loading import ScenarioError, scenario_of
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scoring.maps import MapScores
from taichi_plume.studies import shared_air
from taichi_plume.studies.given_classes import load_given
from taichi_plume.studies.messages import Cost, Outcomes, Record, Request, Row, Task
from taichi_plume.studies.store import KEPT_FOLDER, forget_failed, leave_failed
from taichi_plume.studies.table_rows import outcomes_of, probed, trial_rows
from taichi_plume.studies.worker_process import PROCESS
from taichi_plume.time_loop import TimeLoop

UNFINISHED = "unfinished"  # beside KEPT_FOLDER, so that paths relative to a run folder stay valid
ALWAYS = ("scenario.yaml", "result.json")  # files that every kept run folder holds
PLAYED = "wind and gas come from a film of the study: flow, gas budget and forces are unknown"


def execute_task(task: Task) -> list[Record]:
    """Execute runs of a task until its time limit. A failed run yields a record; the remaining runs continue."""
    began, records = time.perf_counter(), []
    for request in task.requests:
        records.append(_Run(task, request).record())
        if time.perf_counter() - began > task.limit_s:
            break
    return records


class _Run:
    """Execution of one run of a study in a worker process, with its timing."""

    def __init__(self, task: Task, request: Request):
        self.task, self.request = task, request
        self.begun, self.clock = time.time(), time.perf_counter()
        self.compiled = program.compiled()
        self.simulated = 0.0

    def record(self) -> Record:
        """Execute the run and return the record of status, trials, outcomes and cost, even if the run fails."""
        trials: list[Row] = []
        outcomes: Outcomes = dict.fromkeys(self.task.options.outcomes)
        try:
            scenario = scenario_of(self.task.base, self.request.changes)
            prepared, sim = self._built(scenario)
            end, outcomes = self._simulate(prepared, sim)
            trials = trial_rows(sim)
            forget_failed(self.task, self.request)
        except (Exception, SystemExit) as error:  # users' code may raise anything
            end = self._failed(error)
        return Record(self.request.run, end.status, end.message, trials, outcomes, self._cost())

    def _built(self, scenario: Scenario) -> tuple[Prepared, TimeLoop]:
        """Return the checked scenario with its files, and its simulation."""
        task = self.task
        prepared = PROCESS.prepared(scenario, task)
        execute(prepared, task.options.allow_code)
        load_given(prepared, task.options.classes)
        film = None
        if task.film is not None:
            film = shared_air.played(shared_air.opened(task.film), prepared.scenario)
        PROCESS.start()
        return prepared, build(prepared, film)

    def _simulate(self, prepared: Prepared, sim: TimeLoop) -> tuple[End, Outcomes]:
        outcomes = self.task.options.outcomes
        try:
            if self.task.options.keep or probed(outcomes):
                return _run_with_files(prepared, sim, self.task, self.request)
            map_scores = MapScores(sim) if sim.maps and outcomes else None
            if map_scores is not None:
                sim.observers.append(map_scores.observer())
            sim.run()
        finally:
            self.simulated = sim.wall_s
        end = whole(sim)
        content = result(sim, end.status, end.message, PROCESS.backend, map_scores) if outcomes else {}
        return end, outcomes_of(outcomes, content)

    def _failed(self, error: BaseException) -> End:
        """Write the files to repeat a failed run, and return the run's end."""
        message = "; ".join(error.faults) if isinstance(error, ScenarioError) else explain(error)[1]
        message = " ".join(message.split())
        with suppress(OSError):
            leave_failed(self.task, self.request, message)
        return End("failed", message, 1)

    def _cost(self) -> Cost:
        total = time.perf_counter() - self.clock
        return Cost(self.begun, total, self.simulated, max(0, program.compiled() - self.compiled), _worker())


def _worker() -> str:
    """Return the address of this worker on a Dask cluster, else the id of this process."""
    distributed = sys.modules.get("distributed")
    if distributed:
        with suppress(ValueError):  # not in a worker
            return distributed.get_worker().address
    return str(os.getpid())


# ---------------------------------------------------------------- run folders that a study keeps


def _run_with_files(prepared: Prepared, sim: TimeLoop, task: Task, request: Request) -> tuple[End, Outcomes]:
    """Execute a run in a temporary folder that is renamed to kept/RUN; return the run's end and outcomes.

    The final folder holds only the files that the study keeps. The folder is removed if the run raises an error or the
    study keeps no files.
    """
    keep = set(task.options.keep)
    final = task.options.out / KEPT_FOLDER / request.run
    unfinished = task.options.out / UNFINISHED
    for parent in (final.parent, unfinished):
        parent.mkdir(parents=True, exist_ok=True)
    for left in unfinished.glob(f"{request.run}.*"):  # from a worker that was killed
        disk.discard(left)
    folder = Path(tempfile.mkdtemp(prefix=f"{request.run}.", dir=unfinished))
    try:
        folder.chmod(0o755)
        files = keep | ({"probes.parquet"} if probed(task.options.outcomes) else set())
        files |= {*run_folder.FILES} if "report.html" in keep else set()
        run_folder.write_scenario(folder, sim.scenario, task.folder.resolve(), PROCESS.backend, final)
        inputs = input_paths(sim.scenario, task.folder / "base.yaml", prepared.resources.files)[1:]
        recorded = bool({"recording.rrd", "pictures.zarr"} & files)
        about = About(folder, "cpu", PROCESS.backend, recorded, inputs, files=files)
        outputs = Outputs(sim, about, SignalRequests())
        try:
            outputs.start()
            sim.run()
        finally:
            faults = outputs.close()
        if faults:
            raise faults[0]
        end = whole(sim)
        content = result(sim, end.status, end.message, PROCESS.backend, outputs.map_scores)
        played = [PLAYED] if task.film is not None else []
        content |= {"remarks": prepared.resources.warnings + outputs.remarks + played}
        write_result(folder, content)
        outcomes = outcomes_of(task.options.outcomes, content, folder / "probes.parquet")
        if keep:
            if "report.html" in keep:
                report(folder)
            for file in run_folder.files_in(folder):
                if file.name not in (*ALWAYS, *keep):
                    disk.remove(file)
            outputs.seal(end.status)
            disk.remove(final)
            folder.rename(final)
        return end, outcomes
    finally:
        disk.discard(folder)
