"""Studies: many runs from one file, on all cores or a cluster, and tables with intervals over airs."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    from taichi_plume.study.results import Results

MAY_IMPORT: tuple[str, ...] = (
    "assembly",
    "files",
    "grid",
    "guard",
    "report",
    "running",
    "scenario",
    "scoring",
    "simulation",
    "solvers",
)


def open(folder: "Path | str") -> "Results":
    """The results of a study's folder as tables, see `study/results.py`.

    Raises RunFolderError, in a line, where it is none, damaged or of another version.
    """
    from taichi_plume.study.results import open_study

    return open_study(folder)
