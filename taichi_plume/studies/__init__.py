"""Studies: many runs from one file, on all cores or a cluster, and tables with confidence intervals."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    from taichi_plume.studies.results import Results

MAY_IMPORT: tuple[str, ...] = (
    "assembly",
    "files",
    "grid",
    "guard",
    "report",
    "execution",
    "scenario",
    "scoring",
    "time_loop",
    "solvers",
)


def open(folder: "Path | str") -> "Results":
    """Return the results in a study's output folder as tables, see `study/results.py`.

    Raises RunFolderError if the folder is not a study, is damaged or comes from another version.
    """
    from taichi_plume.studies.results import open_study

    return open_study(folder)
