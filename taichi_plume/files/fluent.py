"""ASCII exports of Fluent, as PlumeSim takes them: one file per frame, numbered from 1, each a line of titles and then
lines ``index,x,y,chemical`` with lengths in m.
"""

from math import inf
from pathlib import Path

import numpy as np

from taichi_plume.files.point_frames import MOST_FRAMES, PointFileError, PointFrames, points_of
from taichi_plume.files.tables import Table, TextFile
from taichi_plume.guard.opening import unopenable

LARGEST = 1e4  # of what counts as 100 percent
COLUMNS = ("index", "x", "y", "chemical")


def read_fluent(
    pattern: Path, frames: int | None, period: float, cell: float, largest: float | None
) -> PointFrames:
    """The frames of the files that a pattern such as ``plume%03d.txt`` stands for: `frames` of them or all there are.

    period [s], cell [m]; largest: value that counts as 100 percent, unless given the largest of all files.
    Raises PointFileError.
    """
    begin, place, chemical = [0], [], []
    paths = _files(pattern, frames)
    for path in paths:
        file = TextFile(path, PointFileError)
        table = Table(file, range(1, len(file.lines)), len(COLUMNS), form=",".join(COLUMNS))
        known = points_of(table, COLUMNS, {"chemical": LARGEST * (largest or inf)})
        place.append(np.column_stack([known["x"], known["y"]]))
        chemical.append(known["chemical"])
        begin.append(begin[-1] + len(table))
    percent = np.concatenate(chemical)
    if not len(percent):
        raise PointFileError(f"{paths[0]}: holds no points")
    full = percent.max() if largest is None else largest
    if full > 0:
        percent = 100.0 * (percent / full)
    wind = np.zeros((len(percent), 2))
    return PointFrames(paths[0], period, cell, np.concatenate(place), wind, percent, np.array(begin))


def _files(pattern: Path, frames: int | None) -> list[Path]:
    """The files of a pattern. Raises PointFileError where one is missing."""
    found: list[Path] = []
    while len(found) < (frames or MOST_FRAMES):
        path = pattern.with_name(pattern.name % (len(found) + 1))
        if unopenable(path):
            after = pattern.with_name(pattern.name % (len(found) + 2))
            if frames is not None or not found:
                raise PointFileError(f"{path}: does not exist; files are numbered from 1")
            if not unopenable(after):
                raise PointFileError(f"{path}: does not exist, but {after.name} does")
            break
        found.append(path)
    return found
