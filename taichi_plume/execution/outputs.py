"""Output files of a run: their writers, when data are flushed to the disk, and checkpoints for resuming."""

import errno
import time
from collections.abc import Callable, Collection, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple, Protocol

from taichi_plume.agents.own_algorithm import OwnAlgorithm
from taichi_plume.engine.choice import chosen
from taichi_plume.execution import forces_table, maps_output, result, robots_table
from taichi_plume.execution.signals import SignalRequests
from taichi_plume.files import checkpoint, disk, manifest, pictures_file
from taichi_plume.files.own_class import OwnAlgorithmError
from taichi_plume.files.run_folder import LARGEST_JSON, LISTED, RunFolderError
from taichi_plume.grid.state import State
from taichi_plume.guard.safe_open import read_regular
from taichi_plume.guard.terminal import say
from taichi_plume.observed.observer import Observer
from taichi_plume.observed.store import PictureStore
from taichi_plume.observed.views import output_views, views
from taichi_plume.scenario.loading import ScenarioError
from taichi_plume.scenario.outputs import Checkpoint
from taichi_plume.scoring.beliefs import BeliefScores
from taichi_plume.scoring.declarations import Json
from taichi_plume.scoring.maps import MapScores
from taichi_plume.time_loop import Every, EveryStep, TimeLoop
from taichi_plume.version import __version__

FLUSH_PERIOD = 10.0  # wall-clock time [s] between flushes
PICTURES_PERIOD = 30.0  # the same of the pictures, whose first flush takes half a second (import of zarr)
USUAL = 300.0  # wall-clock time [s] between checkpoints
OVER = ("completed", "stopped")


class Writer(Protocol):
    """Interface of a writer of one output file. Its STATE holds the length of the file at the last `flush`."""

    def start(self) -> None:
        """Create the output file."""
        ...

    def resume(self) -> None:
        """Continue the file of a resumed run: cut off all data after the length in STATE."""
        ...

    def flush(self) -> None:
        """Write all data recorded so far to the disk."""
        ...

    def close(self) -> None:
        """Finish the file, so that readers can open it even after an error in the run."""
        ...


class Table(Writer, Protocol):
    """Interface of an output file's writer that records through an observer, a callback of the time loop."""

    def observer(self) -> Every | EveryStep:
        """Return the observer (periodic callback) that the simulation has to call."""
        ...


class About(NamedTuple):
    """Facts on a run: folder, requested and actual device, input files, and whether it is recorded for the viewer.

    live: address of a viewer that shows the run. files: names of the output files to write, which rules out
    checkpoints; None: all of them.
    """

    folder: Path
    arch: str
    backend: str
    recording: bool
    inputs: Sequence[Path]
    live: str | None = None
    files: Collection[str] | None = None

    def wants(self, name: str) -> bool:
        return self.files is None or name in self.files


class Outputs:
    """All output files and the checkpoints of a run. The constructor adds the observers that record data to `sim`.

    `start()` creates the files, `resume(saved)` continues those of an interrupted run, `close()` finishes them. Raises
    OSError as soon as the disk is full, ScenarioError if requested checkpoints are impossible.
    """

    STATE = ("sim", "observers", "step_observers", "map_scores", "belief_scores", "tables", "recorder")

    def __init__(self, sim: TimeLoop, about: About, signals: SignalRequests):
        self.sim, self.about, self.signals = sim, about, signals
        self.map_scores = MapScores(sim)
        self.belief_scores = BeliefScores(sim)
        sim.observers += [self.map_scores.observer(), self.belief_scores.observer()]
        self.tables = self._tables()
        self.recorder = None
        observer = Observer(sim, [*(views(sim) if about.recording else ()), *output_views(sim)])
        if observer.views and (about.recording or about.wants(pictures_file.NAME)):
            sim.observers += observer.observers()
            self.tables.append(PictureStore(observer, about.folder / pictures_file.NAME, self._origin()))
        if about.recording:
            self.recorder = self._recorder(observer)
        sim.observers.append(Every(sim.dt, self.keep, warm_up=True))
        self.observers, self.step_observers = list(sim.observers), list(sim.step_observers)
        self._state: State | None = None
        self.remarks: list[str] = []
        self._remarks_printed = False
        self._every, self._wall = self._periods()
        self._flushed = self._pictured = self._checked = time.monotonic()
        self._digests: Future[Json] = Future()
        self._begun = time.monotonic()

    def _tables(self) -> list[Writer]:
        sim, folder, scenario, wants = self.sim, self.about.folder, self.sim.scenario, self.about.wants
        tables: list[Table] = []
        if sim.swarm.count and wants("robots.parquet"):
            tables.append(robots_table.RobotTable(sim, folder / "robots.parquet"))
        if sim.forces is not None and wants("forces.csv"):
            tables.append(forces_table.ForceTable(sim, folder / "forces.csv"))
        if scenario.probes is not None and wants("probes.parquet"):
            from taichi_plume.execution.probes_table import ProbeTable

            tables.append(ProbeTable(sim, folder / "probes.parquet", scenario.probes))
        if scenario.fields is not None and wants("fields.zarr"):
            from taichi_plume.execution.film_output import Filming

            tables.append(Filming(sim, folder / "fields.zarr", scenario.fields))
        if scenario.plumesim_log is not None and wants("plume.pslog"):
            from taichi_plume.execution.plume_log import PlumeLogger

            tables.append(PlumeLogger(sim, folder / "plume.pslog", scenario.plumesim_log))
        for table in tables:
            observer = table.observer()
            if isinstance(observer, EveryStep):
                sim.step_observers.append(observer)
            else:
                sim.observers.append(observer)
        if (sim.maps or self.belief_scores.groups) and wants("maps.zarr"):
            return [*tables, maps_output.MapsFile(sim, folder / "maps.zarr", self.map_scores)]
        return [*tables]

    def _origin(self) -> Json:
        """Return attributes that tell from which run a file is."""
        scenario = self.sim.scenario
        return {
            "title": f"Pictures of {scenario.name}",
            "source": f"taichi_plume {__version__}",
            **scenario.seeds,
        }

    def _recorder(self, observer: Observer) -> Writer:
        from taichi_plume.record.recorder import Recorder

        path = self.about.folder / "recording.rrd"
        recorder = Recorder(self.sim, path, self.about.backend, self.map_scores, self.about.live, observer)
        self.sim.observers += recorder.observers()
        return recorder

    def _periods(self) -> tuple[int | None, float | None]:
        """Return the interval between checkpoints in time steps and in wall-clock seconds; an unused one is None."""
        scenario = self.sim.scenario
        model = scenario.checkpoint
        if model is None or self.about.files is not None:
            return None, None
        faults = [f"{path}: {fault}" for path, fault in _without_state(self.sim)]
        if faults and (model.wall or model.every):
            raise ScenarioError(faults)
        if faults:
            self._give_up(faults)
            return None, None
        if model.every is not None:
            return max(1, round(model.every / self.sim.dt)), None
        return None, model.wall or USUAL

    @property
    def resumable(self) -> bool:
        """Whether the run writes checkpoints, from which it can be resumed."""
        return self._every is not None or self._wall is not None

    @property
    def _writers(self) -> list[Writer]:
        return [*self.tables, *([self.recorder] if self.recorder else [])]

    # ------------------------------------------------------------ the run

    def start(self) -> None:
        """Create all output files of a new run."""
        self._start_digests()
        for writer in self._writers:
            writer.start()
        self._write_progress()

    def resume(self, saved: Json) -> None:
        """Restore the state from a checkpoint and continue the files. Raises RunFolderError if either does not fit."""
        self._state = State(self)
        fault = self._state.unlike(saved["state"])
        if fault:
            path = self.about.folder / checkpoint.NAME
            raise RunFolderError(f"{path}: is of another version: {fault}")
        self._state.restore(saved["state"])
        self.sim.wall_s = saved["wall_s"]
        self._digests.set_result(saved["inputs"])
        path = self.about.folder / "result.json"
        before = read_regular(path, LARGEST_JSON) if path.exists() else None
        self._write_progress()  # first, so that an interruption can be repaired
        try:
            (self.about.folder / manifest.NAME).unlink(missing_ok=True)
            for writer in self._writers:
                writer.resume()
        except BaseException:
            if not self.close() and before is not None:
                with disk.written_whole(path) as fresh:
                    fresh.write_bytes(before)
            raise

    def _start_digests(self) -> None:
        """Start to hash the input files in a thread, as recorded films are large."""
        pool = ThreadPoolExecutor(1)
        self._digests = pool.submit(manifest.digests, self.about.folder, self.about.inputs)
        pool.shutdown(wait=False)

    def keep(self, sim: TimeLoop) -> None:
        """Flush the files or write a checkpoint if due. Raises KeyboardInterrupt if a signal asked to end the run."""
        now = time.monotonic()
        if self.signals.stopped:
            if self.resumable:
                self.checkpoint()
            raise KeyboardInterrupt(self.signals.stopped)
        due = self._wall is not None and now - self._checked >= self._wall
        due |= self._every is not None and (sim.tick - sim.scenario.first_tick) % self._every == 0
        if self.remarks and not self._remarks_printed and now - self._begun >= USUAL:
            self._remarks_printed = True
            for remark in self.remarks:
                say(f"note: {remark}", error=True)
        if self.resumable and (due or self.signals.asked):
            self.checkpoint()
        elif self.signals.asked or now - self._flushed >= FLUSH_PERIOD:
            self._flush(self.signals.asked)

    def _flush(self, whole: bool = False) -> None:
        """Write what has been recorded to the disk; whole: also pictures that are not due."""
        now = time.monotonic()
        whole |= now - self._pictured >= PICTURES_PERIOD
        folder = self.about.folder
        if not folder.is_dir():
            raise FileNotFoundError(errno.ENOENT, "the run's directory has been removed", str(folder))
        for table in self.tables:
            if whole or not isinstance(table, PictureStore):
                table.flush()
        self._pictured = now if whole else self._pictured
        self._write_progress()
        self.signals.asked = False
        self._flushed = time.monotonic()

    def checkpoint(self) -> None:
        """Flush all files and write a checkpoint of the present time step."""
        self._flush(whole=True)
        if self.recorder:
            self.recorder.flush()
        self._state = self._state or State(self)
        about = {"version": __version__, "engine": chosen(), "arch": self.about.arch}
        about |= {"backend": self.about.backend}
        about |= {"recording": self.about.recording, "t": self.sim.t, "wall_s": self.sim.wall_so_far}
        about |= {"scenario": scenario_digest(self.about.folder), "inputs": self._inputs()}
        try:
            about["state"] = self._state.save()
        except OwnAlgorithmError as error:
            if self.sim.scenario.checkpoint != Checkpoint():
                raise
            self._every = self._wall = None  # only a default checkpoint: the run goes on without
            self._give_up([str(error)])
            return
        checkpoint.write(self.about.folder / checkpoint.NAME, about)
        self._checked = time.monotonic()

    def _give_up(self, faults: Sequence[str]) -> None:
        """Add remarks on why the run makes no checkpoints; a long run prints them."""
        self.remarks += [f"{fault}; this run makes no checkpoint" for fault in faults]

    def _write_progress(self) -> None:
        """Write the status "running" and the simulated time to result.json."""
        content = result.partial_result(self.sim, "running", f"t = {self.sim.t:.2f} s", self.about.backend)
        result.write_result(self.about.folder, content)

    # ------------------------------------------------------------ the end

    def close(self) -> list[Exception]:
        """Finish all files and return the errors that occurred."""
        return [error for writer in self._writers if (error := _tried(writer.close))]

    def seal(self, status: str) -> None:
        """Write the manifest (checksums of all files), and remove the checkpoint if the run has finished."""
        folder = self.about.folder
        manifest.write(folder, self._inputs(), [folder / name for name in LISTED])
        if status in OVER:
            (folder / checkpoint.NAME).unlink(missing_ok=True)

    def _inputs(self) -> Json:
        """Return the digests of the input files at the start of the run; empty if a file could not be read."""
        try:
            return self._digests.result()
        except OSError:
            return {}


def scenario_digest(folder: Path) -> str:
    """Return the SHA-256 of scenario.yaml in a run folder."""
    return manifest.digest(folder / "scenario.yaml")["sha256"]


def _tried(function: Callable[[], None]) -> Exception | None:
    try:
        function()
    except Exception as error:
        return error
    return None


def _without_state(sim: TimeLoop) -> list[tuple[str, str]]:
    """Return (scenario path, reason) of each robot group whose user-written algorithm cannot be checkpointed."""
    return [
        (
            f"robots[{number}].algorithm",
            "has no state() and restore(), without which a run cannot be resumed: add them, or set checkpoint: null",
        )
        for team in sim.teams
        if isinstance(team.algorithm, OwnAlgorithm) and not team.algorithm.can_be_saved
        for number in team.numbers
    ]
