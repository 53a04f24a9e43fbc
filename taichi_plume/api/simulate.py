"""Run of a scenario from Python: ``run = tp.simulate("casting_room")`` is ``python -m taichi_plume.run``."""

from pathlib import Path

from taichi_plume.assembly.preparation import Source, load
from taichi_plume.execution.execute import INTERRUPTED, RunError, new_run
from taichi_plume.guard.safe_open import as_path
from taichi_plume.report.scene import all_shapes
from taichi_plume.results.run import Run
from taichi_plume.scenario.loading import Overrides, values_of


def simulate(
    scenario: Source,
    *,
    seed: int | None = None,
    overrides: Overrides | None = None,
    duration: float | str | None = None,
    out: str | Path | None = None,
    arch: str = "cpu",
    force: bool = False,
    progress: bool | None = None,
    allow_code: bool = False,
    allow_outside: bool = False,
) -> Run:
    """Run a scenario to its end and return the run, whose folder has the files of ``python -m taichi_plume.run``.

    scenario: YAML file, name of a bundled scenario, dict with the keys of a file, or `Scenario`. overrides: changes
    such as ``{"robots.0.count": 6}``, or as texts, ``["robots.0.count=6"]``. duration [s]: instead of the scenario's,
    as `seed`. out: the run's folder, by default the first free runs/NAME-N. arch: auto, cpu, cuda, vulkan or metal.
    force: rename the folder of an earlier run to `out`.old, `out`.old-2 and so on. progress: whether to show a progress
    bar; by default in a notebook and at a terminal. allow_code: whether Python files that the scenario names are
    executed. allow_outside: whether its files may lie outside its folder.

    Raises InputError (ScenarioError, RunFolderError, DeviceError) before anything is written, RunError if the run did
    not reach its end, and KeyboardInterrupt; the files written so far are kept, and the message names them.

    >>> import taichi_plume as tp
    >>> run = tp.simulate("plumesim_casting", duration=2, out=folder)
    >>> run.status
    'completed'
    """
    prepared = load(scenario, given(overrides, seed, duration), allow_outside)
    try:
        out = None if out is None else as_path(out, "out")
        folder, _ = new_run(prepared, out, arch, force=force, progress=progress, allow_code=allow_code)
    except RunError as error:
        if error.status == INTERRUPTED:
            raise KeyboardInterrupt(str(error)) from None
        raise
    return Run(folder, shapes=all_shapes(prepared))


def given(overrides: Overrides | None, seed: int | None, duration: float | str | None) -> Overrides:
    """Return overrides together with the seed and the duration, where these are given."""
    more = {key: value for key, value in (("seed", seed), ("duration", duration)) if value is not None}
    return more if overrides is None else values_of(overrides) | more
