"""Completion of the files of a killed run: ``tp.repair(folder)`` is ``taichi-plume repair``."""

from pathlib import Path


def repair(run: str | Path, *, verify: bool = False, report: bool = True) -> bool:
    """Complete the files of a run that was killed. Print what was done, and return whether all files are in order.

    run: the run's folder. verify: only report which files have changed since the run wrote them. report: write
    report.html.

    Raises RunFolderError and OSError.
    """
    from taichi_plume.execution import repair
    from taichi_plume.files.run_folder import RunFolder
    from taichi_plume.guard.safe_open import as_path

    if verify:
        return not repair.verify(as_path(run, "run"))
    with RunFolder.again(as_path(run, "run")) as folder:
        return not repair.complete(folder, report)
