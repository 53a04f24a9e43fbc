"""Report of a run, written again: `report(folder)` of this module is ``taichi-plume report``."""

from pathlib import Path


def report(run: str | Path, *, allow_outside: bool = False) -> Path:
    """Write report.html of a run again, from the files in its folder alone. Return the path.

    run: the run's folder. allow_outside: read maps and meshes outside the run's folder that are not those of the run.

    Raises RunFolderError and OSError.
    """
    from taichi_plume.guard.safe_open import as_path
    from taichi_plume.report.page import write
    from taichi_plume.results.run import Run

    return write(Run(as_path(run, "run"), lenient=True, allow_outside=allow_outside))
