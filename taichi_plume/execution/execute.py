"""Execution of a run from its assembly to its end. However a run ends, its files stay and the reason is printed."""

import errno
import gc
import textwrap
import traceback
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from taichi_plume.assembly import own_code
from taichi_plume.assembly.preparation import Prepared, load
from taichi_plume.engine import program
from taichi_plume.execution import checkpoint_reading, result
from taichi_plume.execution.latest_instant import InstantFile
from taichi_plume.execution.outputs import About, Outputs
from taichi_plume.execution.progress import NotebookBar, TerminalBar, progress_bar
from taichi_plume.execution.rehearsal import rehearse
from taichi_plume.execution.signals import (
    SignalRequests,
    handling_signals,
    ignoring_signals,
)
from taichi_plume.files import checkpoint, manifest, run_folder
from taichi_plume.files.own_class import OwnAlgorithmError, Permission
from taichi_plume.files.run_folder import RunFolder
from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.terminal import say, visible
from taichi_plume.record.live import open_viewer
from taichi_plume.scenario.input_files import input_paths
from taichi_plume.scoring.declarations import Json
from taichi_plume.time_loop import Every, TimeLoop, UnstableError

Bar = TerminalBar | NotebookBar

FULL = (errno.ENOSPC, errno.EFBIG, errno.EDQUOT)
INTERRUPTED = "interrupted"  # status
LONGEST_MESSAGE = 300  # characters of an unexpected error


class Service(Protocol):
    """Interface of the service that connects external robots and viewers to a run; see `taichi_plume.serve`."""

    def warm(self, sim: TimeLoop) -> None:
        """Compile the kernels of the service, and leave the simulation in its initial state."""
        ...

    def attach(self, sim: TimeLoop, signals: SignalRequests) -> None:
        """Add the observers of the service to the simulation. Raises RunFolderError if that is impossible."""
        ...

    def close(self) -> None:
        """Disconnect external robots and viewers."""
        ...

    def summary(self) -> Json:
        """Return the statistics of the service for result.json."""
        ...


class Job(NamedTuple):
    """A run to be started or resumed.

    arch, backend: the requested device, and the actual one; saved: content of the checkpoint if the run is resumed;
    live: address of a viewer; report: whether to write the report; service: connection of external robots; progress:
    whether to show a progress bar, by default at a terminal and in a notebook; watch: file of `InstantFile`.
    """

    prepared: Prepared
    folder: RunFolder
    arch: str
    backend: str
    recording: bool = True
    saved: Json | None = None
    live: str | None = None
    report: bool = True
    service: Service | None = None
    progress: bool | None = None
    watch: Path | None = None


class End(NamedTuple):
    """End of a run: status such as "completed", message, exit code of the command, and the error that ended the run."""

    status: str
    message: str
    code: int
    error: BaseException | None = None


class Outcome(NamedTuple):
    """Folder and result (content of result.json) of a run that reached its end."""

    folder: Path
    result: Json


class RunError(RuntimeError):
    """Error of a run that did not reach its end; the files written so far are kept.

    status: "unstable", "disk_full", "failed" or "interrupted". lines: what happened, what is kept and how to resume.
    folder: of the run; None if the run had not begun.

    >>> import taichi_plume as tp
    >>> class Broken:
    ...     def act(self, robots):
    ...         raise ValueError("no idea")
    >>> try:
    ...     run = tp.simulate("plumesim_casting", overrides={"robots.0.algorithm": tp.Own(Broken)}, out=folder)
    ... except tp.RunError as error:
    ...     print(error.status, error.folder == folder)
    failed True
    """

    def __init__(self, status: str, lines: Sequence[str], folder: Path | None = None):
        self.status, self.lines, self.folder = status, list(lines), folder
        super().__init__("\n".join(self.lines))

    @property
    def code(self) -> int:
        """Exit code of the command."""
        return 130 if self.status == INTERRUPTED else 1


def inputs_of(prepared: Prepared) -> list[Path]:
    """Return the files that a run of the scenario reads: its YAML file, if it has one, and those that it names."""
    origin = prepared.scenario.origin
    paths = input_paths(
        prepared.scenario, origin.file or origin.folder / "scenario", prepared.resources.files
    )
    return paths if origin.file else paths[1:]


def new_run(
    prepared: Prepared,
    out: Path | None = None,
    arch: str = "cpu",
    *,
    force: bool = False,
    live: bool = False,
    allow_code: Permission = False,
    ask: bool = False,
    **options: Any,
) -> Outcome:
    """Execute a checked scenario into a run folder, `out` or the first free runs/NAME-N. Raises as `run`.

    force: rename the folder of an earlier run. live: show the recording in a viewer. ask: ask at a terminal whether
    the scenario's Python files may be executed, unless `allow_code`. options: of `Job`.
    """
    own_code.execute(prepared, allow_code, ask)
    backend = program.start(arch)
    with RunFolder(prepared.scenario.name, out, force, inputs=inputs_of(prepared)) as folder:
        return run(Job(prepared, folder, arch, backend, live=open_viewer() if live else None, **options))


def resumed(
    path: Path,
    arch: str | None = None,
    *,
    live: bool = False,
    allow_code: Permission = False,
    allow_outside: bool = False,
    **options: Any,
) -> Outcome:
    """Resume an interrupted run from the checkpoint in its folder; options: of `Job`. Raises as `run`."""
    with RunFolder.again(path) as folder:
        saved = checkpoint_reading.saved(folder.path)
        prepared = load(folder.path / "scenario.yaml", (), allow_outside)
        checkpoint_reading.require_same(folder.path, saved["inputs"], inputs_of(prepared)[1:])
        own_code.execute(prepared, allow_code, ask=True)
        arch, recording = str(arch or saved["arch"]), saved["recording"]
        backend = program.start(arch)
        viewer = open_viewer() if live and recording else None
        return run(Job(prepared, folder, arch, backend, recording, saved, viewer, **options))


def run(job: Job) -> Outcome:
    """Assemble and execute a run with its output files. Raises InputError, RunError, and KeyboardInterrupt before."""
    with handling_signals() as signals, ExitStack() as stack:
        try:
            bar = progress_bar(job.progress)
            if bar is not None:
                stack.callback(bar.close)
            sim = _build(job)
            outputs = _begin(job, sim, signals)
        except (InputError, KeyboardInterrupt):
            raise
        except BaseException as error:
            status, message = explain(error)
            raise RunError(status, [f"failed before the run began: {message}"]) from error
        end = _to_the_end(job, sim, outputs, signals, bar)
        with ignoring_signals():
            content, end = _conclude(job, sim, outputs, end)
    if end.code:
        raise RunError(end.status, _ending(job.folder.path, end), job.folder.path) from end.error
    return Outcome(job.folder.path, content)


def _build(job: Job) -> TimeLoop:
    from taichi_plume.assembly.assemble import build

    sim = build(job.prepared, driven=job.service is not None)
    if job.service is not None:
        job.service.warm(sim)
        rehearse(sim)
    gc.enable()
    return sim


def _begin(job: Job, sim: TimeLoop, signals: SignalRequests) -> Outputs:
    """Prepare the output files, or resume them. An earlier run is renamed just before the first file is written."""
    folder = job.folder
    about = About(folder.path, job.arch, job.backend, job.recording, inputs_of(job.prepared), job.live)
    outputs = Outputs(sim, about, signals)
    signals.running = True
    if job.saved is not None:
        outputs.resume(job.saved)
        return outputs
    folder.start()
    source = job.prepared.scenario.origin.folder
    run_folder.write_scenario(folder.path, sim.scenario, source.resolve(), job.backend)
    return outputs


def _to_the_end(job: Job, sim: TimeLoop, outputs: Outputs, signals: SignalRequests, bar: Bar | None) -> End:
    """Run the simulation to its end and close all files; return status, message and exit code, also of errors."""
    try:
        signals.hasty = True
        end = _run(job, sim, outputs, signals, bar)
        signals.hasty = False
    except KeyboardInterrupt as error:  # a second signal, after a first one has ended the run
        end = _interrupted(sim, error)
    if not outputs.about.folder.is_dir():
        end = End("failed", f"its folder has been removed, at t = {sim.t:.2f} s or before", 1)
    with ignoring_signals():
        for error in outputs.close():
            if not end.code:
                end = End(*explain(error), 1, error)
    return end


def _run(job: Job, sim: TimeLoop, outputs: Outputs, signals: SignalRequests, bar: Bar | None) -> End:
    """Run the simulation, and return how it ended; a failure or an interruption is returned, not raised."""
    try:
        with ExitStack() as stack:
            if job.saved is None:
                outputs.start()
            if bar is not None:
                bar.begin(sim)
                sim.observers.append(Every(sim.dt, bar.update, warm_up=True))
            if job.watch is not None:
                sim.observers.append(Every(sim.dt, InstantFile(sim, job.watch).update, warm_up=True))
            if job.service is not None:
                stack.callback(job.service.close)
                job.service.attach(sim, signals)
            sim.run()
    except KeyboardInterrupt as error:
        return _interrupted(sim, error)
    except Exception as error:
        return End(*explain(error), 1, error)
    return whole(sim)


def whole(sim: TimeLoop) -> End:
    """Return the end of an uninterrupted run: "completed", or "stopped" early as no robot searches any more."""
    if sim.tick < sim.last_tick:
        all_found = bool(sim.swarm.snapshot()["found"].all())
        why = "every robot had found a source" if all_found else "no robot searched any more"
        return End("stopped", f"{why} at t = {sim.t:.1f} s", 0)
    return End("completed", "", 0)


def _interrupted(sim: TimeLoop, error: KeyboardInterrupt) -> End:
    by = "" if str(error) in ("", "SIGINT") else f"by {error} "
    return End(INTERRUPTED, f"{by}at t = {sim.t:.2f} s", 130)


def _conclude(job: Job, sim: TimeLoop, outputs: Outputs, end: End) -> tuple[Json, End]:
    """Write result.json, the report and the manifest; return the result, and the end with any error of writing."""
    folder = job.folder.path
    scores = outputs.map_scores, outputs.belief_scores
    content: Json
    try:
        content = result.result(sim, end.status, end.message, job.backend, *scores)
    except Exception as error:  # the simulation is no longer usable
        end = end if end.code else End(*explain(error), 1, error)
        content = {"name": sim.scenario.name, "status": end.status, "message": end.message}
        content |= sim.scenario.seeds
    if job.service is not None:
        content |= {"service": job.service.summary()}
    content |= {"remarks": job.prepared.resources.warnings + outputs.remarks}
    if "flow" in content:
        try:
            content["flow"] |= sim.wind.mixing()
        except Exception as error:  # without this diagnostic the result is still written
            content["remarks"].append(f"how fast the air mixes could not be measured: {explain(error)[1]}")
    if not folder.is_dir():
        return content, end
    try:
        result.write_result(folder, content)
        if job.report:
            report(folder, job.prepared)
        outputs.seal(end.status)
    except OSError as error:
        end = end if end.code else End(*explain(error), 1, error)
        say(f"result.json or {manifest.NAME} could not be written: {error.strerror or error}", error=True)
    return content, end


def report(folder: Path, prepared: Prepared | None = None) -> None:
    """Write report.html of a finished run, or print why that failed. prepared: the scenario and its opened files."""
    try:
        from taichi_plume.report import page, scene  # import matplotlib only at the end
        from taichi_plume.results.run import Run

        shapes = scene.all_shapes(prepared) if prepared else None
        page.write(Run(folder, lenient=True, shapes=shapes), tolerant=True)
    except Exception as error:  # the run itself has not failed
        say(f"note: report.html could not be written: {explain(error)[1]}", error=True)


def _ending(folder: Path, end: End) -> list[str]:
    """Return lines on how a run ended, which files are kept, and how to resume the run."""
    files = sorted(file.name for file in run_folder.files_in(folder) if file.name != run_folder.LOCK)
    lines = [f"{end.status}: {end.message}", f"kept in {folder}: {', '.join(files) or 'nothing'}"]
    lines = [visible(line) for line in lines]
    return lines + [f"to resume: {run_folder.resuming(folder)}"] * (checkpoint.NAME in files)


def explain(error: BaseException) -> tuple[str, str]:
    """Return the run's status ("unstable", "disk_full" or "failed") and one line of text for an exception."""
    if isinstance(error, UnstableError):
        return "unstable", str(error)
    if isinstance(error, OwnAlgorithmError):
        return "failed", str(error)
    if isinstance(error, OSError) and error.errno in FULL:
        return "disk_full", f"{error.strerror}: {error.filename}" if error.filename else str(error)
    frames = traceback.extract_tb(error.__traceback__)
    ours = [frame for frame in frames if "taichi_plume" in frame.filename] or frames
    where = f" ({Path(ours[-1].filename).name}:{ours[-1].lineno})" if ours else ""
    message = textwrap.shorten(str(error), LONGEST_MESSAGE, placeholder=" ...")
    return "failed", f"{type(error).__name__}: {message}{where}"
