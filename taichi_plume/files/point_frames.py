"""Plumes as frames of points in the plane, as PlumeSim (Cabrita, Sousa & Marques, "Player/Stage simulation of olfactory
experiments", IROS 2010) reads them: see `plumesim_log` and `fluent`.

All of a file is read and checked before anything is made of it.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from taichi_plume.files.tables import Table
from taichi_plume.scenario.played import PlumeSimWind
from taichi_plume.scenario.plumesim import FluentGas, PlumeSimGas

MOST_FRAMES = 100_000
FARTHEST = 1e5  # m: beyond, f32 no longer tells cells of a centimetre apart
LARGEST_PERCENT = 1e6


class PointFileError(ValueError):
    """A file of points that cannot be used; the message begins with its path, and its line where there is one."""


@dataclass(frozen=True)
class PointFrames:
    """Frames of points in the plane.

    path: of the file, or of the first one; period: time that each frame is shown [s]; cell: points count up to this
    distance [m]. Of all points, frame after frame: place (n, 2) [m], wind (n, 2) [m/s], percent (n,) of the full scale;
    frame k has the points begin[k] to begin[k + 1].
    """

    path: Path
    period: float
    cell: float
    place: np.ndarray
    wind: np.ndarray
    percent: np.ndarray
    begin: np.ndarray

    def __len__(self) -> int:
        return len(self.begin) - 1

    def frame(self, k: int) -> slice:
        """Where the points of frame k are."""
        return slice(int(self.begin[k]), int(self.begin[k + 1]))


def frames_of(model: PlumeSimWind | PlumeSimGas | FluentGas, folder: Path) -> PointFrames:
    """What a scenario's plume or wind plays back; `folder` is where its files lie. Raises PointFileError."""
    from taichi_plume.files.fluent import read_fluent
    from taichi_plume.files.plumesim_log import read_log

    if model.kind == "fluent":
        return read_fluent(folder / model.files, model.frames, model.period, model.cell, model.largest)
    return read_log(folder / model.file)


def points_of(table: Table, columns: tuple[str, ...], most: dict[str, float]) -> dict[str, np.ndarray]:
    """The columns by these names: finite, x and y within reason, chemical and those of `most` between 0 and that."""
    known = dict(zip(columns, table.numbers(*range(len(columns))).T, strict=True))
    finite = np.isfinite(np.stack(list(known.values()))).all(axis=0)
    table.refuse(~finite, lambda row: f"must be finite numbers, got {table.shown(row)}")
    for name in ("x", "y"):
        table.refuse(
            np.abs(known[name]) > FARTHEST,
            lambda row, name=name: f"{name} must be within {FARTHEST:g} m, got {table.shown(row)}",
        )
    for name, limit in ({"chemical": LARGEST_PERCENT} | most).items():
        values = known[name]
        table.refuse(values < 0, lambda row: f"{name} must be not negative, got {values[row]:g}")
        table.refuse(values > limit, lambda row: f"{name} must be at most {limit:g}, got {values[row]:g}")
    return known
