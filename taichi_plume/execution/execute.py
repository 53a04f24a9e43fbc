"""Execution of a run from its assembly to its end. However a run ends, its files stay and the reason is printed."""

import errno
import gc
import textwrap
import traceback
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple, Protocol

from rich.console import Console

from taichi_plume.assembly.preparation import Prepared
from taichi_plume.execution import result, summary
from taichi_plume.execution.outputs import About, Outputs
from taichi_plume.execution.signals import (
    SignalRequests,
    handling_signals,
    ignoring_signals,
    reader_may_leave,
)
from taichi_plume.files import checkpoint, manifest, run_folder
from taichi_plume.files.own_class import OwnAlgorithmError
from taichi_plume.files.run_folder import RunFolder
from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.terminal import say, terminal
from taichi_plume.scoring.declarations import Json
from taichi_plume.time_loop import TimeLoop, UnstableError

FULL = (errno.ENOSPC, errno.EFBIG, errno.EDQUOT)
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

    source: the scenario's file; inputs: all files that the run reads, the scenario first; arch, backend: the requested
    device, and the actual one; saved: content of the checkpoint if the run is resumed; live: address of a viewer;
    report: whether to write the report; service: connection of external robots.
    """

    prepared: Prepared
    folder: RunFolder
    source: Path
    inputs: Sequence[Path]
    arch: str
    backend: str
    recording: bool
    saved: Json | None = None
    live: str | None = None
    report: bool = True
    service: Service | None = None


class End(NamedTuple):
    """End of a run: status such as "completed", message, and exit code of the command."""

    status: str
    message: str
    code: int


def simulate(job: Job, quiet: bool = False, debug: bool = False) -> int:
    """Assemble and execute a run with its output files; return the exit code. Raises InputError, KeyboardInterrupt."""
    console = terminal(error=True)
    with handling_signals() as signals:
        try:
            if console.is_terminal and not quiet:
                console.print("compiling ...", end="\r")
            sim = _build(job)
            outputs = _begin(job, sim, signals)
        except (InputError, KeyboardInterrupt):
            raise
        except BaseException as error:
            _print_traceback(debug)
            say(f"failed before the run began: {explain(error)[1]}", error=True)
            return 1
        end = _to_the_end(job, sim, outputs, signals, None if quiet else console, debug)
        with ignoring_signals():
            content, end = _conclude(job, sim, outputs, end)
    if end.code:
        _print_files(job.folder.path, end)
    elif not quiet:
        with reader_may_leave():
            summary.print_summary(content, job.folder.path)
    return end.code


def _build(job: Job) -> TimeLoop:
    from taichi_plume.assembly.assemble import build

    sim = build(job.prepared, driven=job.service is not None)
    if job.service is not None:
        job.service.warm(sim)
    gc.enable()
    return sim


def _begin(job: Job, sim: TimeLoop, signals: SignalRequests) -> Outputs:
    """Create the output files, or resume them; an earlier run is removed only after all new files were created."""
    folder = job.folder
    about = About(folder.path, job.arch, job.backend, job.recording, job.inputs, job.live)
    outputs = Outputs(sim, about, signals)
    signals.running = True
    if job.saved is not None:
        outputs.resume(job.saved)
        return outputs
    folder.clear()
    stands = False
    try:
        run_folder.write_scenario(folder.path, sim.scenario, job.source.resolve().parent, job.backend)
        outputs.start()
        stands = True
    finally:
        if not stands:
            outputs.close()
        folder.settle(stands)
    return outputs


def _to_the_end(
    job: Job, sim: TimeLoop, outputs: Outputs, signals: SignalRequests, console: Console | None, debug: bool
) -> End:
    """Run the simulation to its end and close all files; return status, message and exit code, also of errors."""
    try:
        signals.hasty = True
        end = _run(job, sim, signals, console, debug)
        signals.hasty = False
    except KeyboardInterrupt as error:  # a second signal, after a first one has ended the run
        end = _interrupted(sim, error)
    if not outputs.about.folder.is_dir():
        end = End("failed", f"its folder has been removed, at t = {sim.t:.2f} s or before", 1)
    with ignoring_signals():
        for error in outputs.close():
            if not end.code:
                end = End(*explain(error), 1)
    return end


def _run(job: Job, sim: TimeLoop, signals: SignalRequests, console: Console | None, debug: bool) -> End:
    """Run the simulation, and return how it ended; a failure or an interruption is returned, not raised."""
    try:
        with ExitStack() as stack:
            if console is not None and console.is_terminal:
                from taichi_plume.execution.progress import ProgressBar

                bar = stack.enter_context(ProgressBar(sim, console))
                sim.observers.append(bar.observer())
            if job.service is not None:
                stack.callback(job.service.close)
                job.service.attach(sim, signals)
            sim.run()
    except KeyboardInterrupt as error:
        return _interrupted(sim, error)
    except Exception as error:
        _print_traceback(debug)
        return End(*explain(error), 1)
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
    return End("interrupted", f"{by}at t = {sim.t:.2f} s", 130)


def _conclude(job: Job, sim: TimeLoop, outputs: Outputs, end: End) -> tuple[Json, End]:
    """Write result.json, the report and the manifest; return the result, and the end with any error of writing."""
    folder = job.folder.path
    scores = outputs.map_scores, outputs.belief_scores
    content: Json
    try:
        content = result.result(sim, end.status, end.message, job.backend, *scores)
    except Exception as error:  # the simulation is no longer usable
        end = end if end.code else End(*explain(error), 1)
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
        end = end if end.code else End(*explain(error), 1)
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


def _print_traceback(debug: bool) -> None:
    if debug:
        say(*traceback.format_exc().splitlines(), error=True)


def _print_files(folder: Path, end: End) -> None:
    files = sorted(file.name for file in run_folder.files_in(folder) if file.name != run_folder.LOCK)
    say(f"{end.status}: {end.message}", f"kept in {folder}: {', '.join(files) or 'nothing'}", error=True)
    if checkpoint.NAME in files:
        say(f"to resume: {run_folder.resuming(folder)}", error=True, longest=None)


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
