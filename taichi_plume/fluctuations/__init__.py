"""Plume statistics from the files of runs: profiles, intermittency, whiffs and blanks, spectra; and their page.

`taichi_plume.statistics` returns them as a `result.Statistics`.
"""

MAY_IMPORT: tuple[str, ...] = ("agents", "engine", "files", "grid", "guard", "report", "results", "scenario")
