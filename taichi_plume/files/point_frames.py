"""Plumes as frames of points in a plane, in the formats of PlumeSim: ASCII files of Fluent, and `plumesim_log`.

PlumeSim: Cabrita, Sousa & Marques, "Player/Stage simulation of olfactory experiments", IROS 2010. Fluent exports one
file per frame, numbered from 1: a line of titles, then lines ``index,x,y,chemical``. Titles that name x and y decide
where these stand and, "x-coordinate (mm)", their unit; otherwise the order is that of PlumeSim, with lengths in m.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import inf
from pathlib import Path

import numpy as np

from taichi_plume.files.conventions import ConventionError, FileFacts, in_si, span
from taichi_plume.files.named_columns import Column, pick
from taichi_plume.files.tables import Table, TextFile, cells_of, listed
from taichi_plume.guard.safe_open import unopenable
from taichi_plume.scenario.playback import PlumeSimWind
from taichi_plume.scenario.plumesim import FluentGas, PlumeSimGas

MOST_FRAMES = 100_000
FARTHEST = 1e5  # m: beyond, f32 cannot resolve cells of a centimetre
LARGEST_PERCENT = 1e6
LARGEST_FLUENT = 1e4  # times the value that counts as 100 percent
FLUENT = ("index", "x", "y", "chemical")
PLACES = re.compile(r"z|z-coordinate.*|index|id|node.*|cell.*")  # columns beside x, y and the concentration


class PointFileError(ValueError):
    """Error: a file of plume points cannot be used; the message begins with the path and, if known, the line."""


@dataclass(frozen=True)
class PointFrames:
    """Plume as a sequence of frames of points in a plane.

    path: of the file, or of the first one; period: duration of each frame [s]; cell: points count up to this distance
    [m]. Of all points, frame after frame: place (n, 2) [m], wind (n, 2) [m/s], percent (n,) of the full scale; frame k
    has the points begin[k] to begin[k + 1]. facts: what was read and assumed.
    """

    path: Path
    period: float
    cell: float
    place: np.ndarray
    wind: np.ndarray
    percent: np.ndarray
    begin: np.ndarray
    facts: FileFacts = field(default=FileFacts(""))

    def __len__(self) -> int:
        return len(self.begin) - 1

    def frame(self, k: int) -> slice:
        """Return the slice of frame k in the arrays of all points."""
        return slice(int(self.begin[k]), int(self.begin[k + 1]))


def frames_of(model: PlumeSimWind | PlumeSimGas | FluentGas, folder: Path) -> PointFrames:
    """Read the point frames that a wind or gas of the scenario plays back, from `folder`. Raises PointFileError."""
    from taichi_plume.files.plumesim_log import read_log

    if model.kind == "fluent":
        return read_fluent(folder / model.files, model.frames, model.period, model.cell, model.largest)
    frames = read_log(folder / model.file)
    return replace(frames, facts=FileFacts(described(frames)))


def read_fluent(
    pattern: Path, frames: int | None, period: float, cell: float, largest: float | None
) -> PointFrames:
    """Read a plume from numbered Fluent files, such as ``plume%03d.txt``: the first `frames` files, or all (None).

    period, cell: as in PointFrames; largest: value that counts as 100 percent, by default the maximum. Raises
    PointFileError.
    """
    begin, place, chemical, unit, negative = [0], [], [], "", 0
    paths = _numbered(pattern, frames)
    for path in paths:
        file = TextFile(path, PointFileError)
        columns, unit = _fluent_columns(file)
        width = max(len(FLUENT), len(cells_of(file.lines[0], ",")))
        table = Table(file, range(1, len(file.lines)), width, form=",".join(FLUENT))
        values = table.numbers(*columns)
        values[:, :2] = in_si(values[:, :2], unit, "m")
        negative += int((values[:, 2] < 0).sum())
        values[:, 2] = np.where(values[:, 2] < 0, 0.0, values[:, 2])
        known = _checked(
            table,
            dict(zip(FLUENT[1:], values.T, strict=True)),
            {"chemical": LARGEST_FLUENT * (largest or inf)},
        )
        place.append(np.column_stack([known["x"], known["y"]]))
        chemical.append(known["chemical"])
        begin.append(begin[-1] + len(table))
    percent = np.concatenate(chemical)
    if not len(percent):
        raise PointFileError(f"{paths[0]}: holds no points")
    full = percent.max() if largest is None else largest
    assumed = f"lengths in {unit or 'm (assumed)'}, 100 percent is {full:.4g}" + (
        "" if largest else " (assumed: largest)"
    )
    if full > 0:
        percent = 100.0 * (percent / full)
    wind = np.zeros((len(percent), 2))
    remarks = (f"{negative} concentrations below 0 count as 0",) if negative else ()
    plume = PointFrames(paths[0], period, cell, np.concatenate(place), wind, percent, np.array(begin))
    return replace(plume, facts=FileFacts(f"{described(plume)}, {assumed}", remarks))


def _fluent_columns(file: TextFile) -> tuple[list[int], str]:
    """Return the indices of x, y and the concentration in a Fluent file, and the unit of lengths, "" if not stated."""
    names = cells_of(file.lines[0], ",")
    try:
        found = pick(names, {axis: Column((axis, f"{axis}-coordinate"), "m") for axis in "xy"})
    except ConventionError as error:
        raise file.wrong(1, str(error)) from None
    if len(found) < 2:
        return [1, 2, 3], ""
    taken = {found["x"].index, found["y"].index}
    others = [n for n, name in enumerate(names) if n not in taken and not PLACES.match(name.strip().lower())]
    if not others:
        raise file.wrong(1, f"names no concentration; it has {listed(names)}")
    return [found["x"].index, found["y"].index, others[-1]], found["x"].unit


def described(frames: PointFrames) -> str:
    """Return a text on the number, period and places of frames of points."""
    (x, y), count = frames.place.T, len(frames)
    return (
        f"{count} frames, {frames.period:g} s apart, {len(frames.place)} points, "
        f"{span('x', x.min(), x.max())}, {span('y', y.min(), y.max())}"
    )


def _numbered(pattern: Path, frames: int | None) -> list[Path]:
    """Return the numbered files that match a pattern. Raises PointFileError if one is missing."""
    files: list[Path] = []
    while len(files) < (frames or MOST_FRAMES):
        path, after = (pattern.with_name(pattern.name % (len(files) + n)) for n in (1, 2))
        if unopenable(path):
            if frames is not None or not files:
                raise PointFileError(f"{path}: does not exist; files are numbered from 1")
            if not unopenable(after):
                raise PointFileError(f"{path}: does not exist, but {after.name} does")
            break
        files.append(path)
    return files


def points_of(table: Table, columns: tuple[str, ...], most: Mapping[str, float]) -> dict[str, np.ndarray]:
    """Return a table's columns by name; checks: finite, |x|, |y| <= FARTHEST, chemical and `most` from 0 to limit."""
    return _checked(table, dict(zip(columns, table.numbers(*range(len(columns))).T, strict=True)), most)


def _checked(table: Table, known: dict[str, np.ndarray], most: Mapping[str, float]) -> dict[str, np.ndarray]:
    finite = np.isfinite(np.stack(list(known.values()))).all(axis=0)
    table.refuse(~finite, lambda row: f"must be finite numbers, got {table.shown(row)}")
    for name in ("x", "y"):
        table.refuse(
            np.abs(known[name]) > FARTHEST,
            lambda row, name=name: f"{name} must be within {FARTHEST:g} m, got {table.shown(row)}",
        )
    for name, limit in {"chemical": LARGEST_PERCENT, **most}.items():
        values = known[name]
        table.refuse(values < 0, lambda row: f"{name} must be not negative, got {values[row]:g}")
        table.refuse(values > limit, lambda row: f"{name} must be at most {limit:g}, got {values[row]:g}")
    return known
