"""Run of a scenario from Python: ``run = tp.simulate("casting_room")`` is ``taichi-plume run``.

Imports wait for the call: the command reads the options from the signatures.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from taichi_plume.engine.choice import Arch

if TYPE_CHECKING:
    from taichi_plume.assembly.preparation import Source
    from taichi_plume.results.run import Run
    from taichi_plume.scenario.loading import Overrides


def simulate(
    scenario: "Source",
    *,
    out: Annotated[str | Path | None, "DIR"] = None,
    arch: Arch = "cpu",
    seed: Annotated["int | None", "N"] = None,
    duration: Annotated[float | str | None, "S"] = None,
    overrides: Annotated["Overrides | None", "--set PATH=VALUE ..."] = None,
    live: bool = False,
    watch: Annotated[str | Path | None, "FILE.npz"] = None,
    recording: bool = True,
    report: bool = True,
    progress: bool | None = None,
    force: bool = False,
    allow_code: bool = False,
    allow_sha256: Annotated[Sequence[str], "--allow-sha256 HEX ..."] = (),
    allow_outside: bool = False,
) -> "Run":
    """Run a scenario to its end and return the run, whose folder has the files of ``taichi-plume run``.

    scenario: YAML file, name of a bundled scenario, dict with the keys of a file, or `Scenario`. out: the run's folder,
    by default the first free runs/NAME-N. arch: where to compute; auto takes a GPU if there is one. seed: instead of
    the scenario's. duration: seconds, instead of the scenario's. overrides: change any key, such as robots.0.count=3;
    in Python ``["robots.0.count=3"]`` or ``{"robots.0.count": 3}``.

    live: open the viewer during the run, on this machine alone. watch: write progress, gas, wind and robots to this
    file during the run, for a program that shows the run. recording: write recording.rrd and pictures.zarr. report:
    write report.html. progress: show a progress bar; by default in a notebook and at a terminal. force: rename the
    folder of an earlier run to `out`.old, `out`.old-2 and so on.

    allow_code: execute Python files that the scenario names (kind: own). allow_sha256: execute a Python file that the
    scenario names if the file has this SHA-256; may be repeated. allow_outside: read files that lie outside the
    scenario's folder.

    Raises InputError (ScenarioError, RunFolderError, DeviceError) before anything is written, RunError if the run did
    not reach its end, and KeyboardInterrupt; the files written so far are kept, and the message names them.

    >>> import taichi_plume as tp
    >>> run = tp.simulate("plumesim_casting", duration=2, out=folder)
    >>> run.status
    'completed'
    """
    from taichi_plume.assembly.preparation import load
    from taichi_plume.execution.execute import INTERRUPTED, RunError, new_run
    from taichi_plume.guard.safe_open import as_path
    from taichi_plume.report.scene import all_shapes
    from taichi_plume.results.run import Run

    prepared = load(scenario, given(overrides, seed, duration), allow_outside)
    try:
        folder, _ = new_run(
            prepared,
            None if out is None else as_path(out, "out"),
            arch,
            force=force,
            recording=recording,
            live=live,
            report=report,
            progress=progress,
            allow_code=allow_code or tuple(allow_sha256),
            watch=None if watch is None else as_path(watch, "watch"),
        )
    except RunError as error:
        if error.status == INTERRUPTED:
            raise KeyboardInterrupt(str(error)) from None
        raise
    return Run(folder, shapes=all_shapes(prepared))


def given(overrides: "Overrides | None", seed: int | str | None, duration: float | str | None) -> "Overrides":
    """Return overrides together with the seed and the duration, where these are given."""
    from taichi_plume.scenario.loading import values_of

    more = {key: value for key, value in (("seed", seed), ("duration", duration)) if value is not None}
    return more if overrides is None else values_of(overrides) | more
