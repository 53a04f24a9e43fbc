"""Plume statistics from the files of runs: profiles, intermittency, whiffs and blanks, spectra; and their page.

from taichi_plume import fluctuations

found = fluctuations.of("runs/arena-1", threshold=2.0)
found.points       pandas.DataFrame: a row per point, units in attrs["units"]
found.durations    pandas.DataFrame: a row per whiff and blank
found.spectra      pandas.DataFrame
found.maps         xarray.Dataset of a film: mean, rms, maximum, intensity, intermittency
found.summary      dict: exponents, fits, profiles, lengths, whiffs that sensors keep
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pathlib import Path

    from taichi_plume.fluctuations.result import Statistics

MAY_IMPORT: tuple[str, ...] = ("agents", "files", "grid", "guard", "report", "results", "scenario")


def of(source: "Path | str", **options: Any) -> "Statistics":
    """Compute the statistics of a run's folder or of a film; options: of `computation.of`. Raises InputError."""
    from taichi_plume.fluctuations import computation as made

    return made.of(source, **options)
