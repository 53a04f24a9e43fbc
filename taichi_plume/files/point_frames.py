"""Plumes as frames of points in a plane, in the formats of PlumeSim: ASCII files of Fluent, and `plumesim_log`.

PlumeSim: Cabrita, Sousa & Marques, "Player/Stage simulation of olfactory experiments", IROS 2010. Fluent exports one
file per frame, numbered from 1: a line of titles, then lines ``index,x,y,chemical``. Titles that name x and y decide
where these stand and, "x-coordinate (mm)", their unit; the gas is then the only other column, but for those that are
none. Otherwise the order is that of PlumeSim, with lengths in m.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import inf
from pathlib import Path

import numpy as np

from taichi_plume.files.conventions import ConventionError, FileFacts, spans, split_unit
from taichi_plume.files.named_columns import Column, Picked, pick, read_columns
from taichi_plume.files.tables import Table, TextFile, cells_of, delimiter_of, is_number, listed
from taichi_plume.guard.safe_open import unopenable
from taichi_plume.scenario.playback import PlumeSimWind
from taichi_plume.scenario.plumesim import FluentGas, PlumeSimGas

MOST_FRAMES = 100_000
FARTHEST = 1e5  # m: beyond, f32 cannot resolve cells of a centimetre
LARGEST_PERCENT = 1e6
LARGEST_FLUENT = 1e4  # times the value that counts as 100 percent
FLUENT = ("index", "x", "y", "chemical")
COLUMNS = {
    **{
        axis: Column((axis, f"{axis}-coordinate", f"points:{n}", f"coordinates:{n}"), "m")
        for n, axis in enumerate("xy")
    },
    "chemical": Column(("chemical",)),
}
NO_GAS = re.compile(
    r"z$|z-coordinate|points:2|coordinates:2|index|id$|node|cell|[xyz]-velocity|velocity|[uvw]$|pressure|temperature|"
    "density|turb|enthalpy|vorticity|time"
)
"""Names of columns of an export that are no concentration."""
MOST_REMARKS = 10


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
        columns = {str(key): name for key, name in model.columns.items()}
        return read_fluent(
            folder / model.files, model.frames, model.period, model.cell, model.largest, columns
        )
    frames = read_log(folder / model.file)
    return replace(frames, facts=FileFacts(described(frames)))


def read_fluent(
    pattern: Path,
    frames: int | None,
    period: float,
    cell: float,
    largest: float | None,
    columns: Mapping[str, str] | None = None,
) -> PointFrames:
    """Read a plume from numbered Fluent files, such as ``plume%03d.txt``: the first `frames` files, or all (None).

    period, cell: as in PointFrames; largest: value that counts as 100 percent, by default the maximum; columns: names
    of the columns for x, y and chemical. Raises PointFileError.
    """
    begin, place, chemical, remarks, named = [0], [], [], [], ""
    paths = _numbered(pattern, frames)
    for path in paths:
        known, table, named, more = _fluent_frame(path, columns or {})
        negative = known["chemical"] < 0
        if negative.any():
            more = (*more, f"{negative.sum()} concentrations below 0 count as 0")
            known["chemical"] = np.where(negative, 0.0, known["chemical"])
        known = _checked(table, known, {"chemical": LARGEST_FLUENT * (largest or inf)})
        remarks += [f"{path.name}: {remark}" for remark in more]
        place.append(np.column_stack([known["x"], known["y"]]))
        chemical.append(known["chemical"])
        begin.append(begin[-1] + len(table))
    percent = np.concatenate(chemical)
    if not len(percent):
        raise PointFileError(f"{paths[0]}: holds no points")
    full = percent.max() if largest is None else largest
    scale = f"100 percent is {full:.4g}" + ("" if largest else " (assumed: largest)")
    if full > 0:
        percent = 100.0 * (percent / full)
    wind = np.zeros((len(percent), 2))
    plume = PointFrames(paths[0], period, cell, np.concatenate(place), wind, percent, np.array(begin))
    left_out = [f"{len(remarks) - MOST_REMARKS} more remarks"] * (len(remarks) > MOST_REMARKS)
    facts = FileFacts(f"{described(plume)}, {named}, {scale}", (*remarks[:MOST_REMARKS], *left_out))
    return replace(plume, facts=facts)


def _fluent_frame(
    path: Path, columns: Mapping[str, str]
) -> tuple[dict[str, np.ndarray], Table, str, tuple[str, ...]]:
    """Return x, y [m] and the concentration of a frame, its table, a text on its columns, and remarks.

    columns: names of columns that the user gives for x, y and chemical.
    """
    file = TextFile(path, PointFileError)
    names = cells_of(file.lines[0], delimiter_of(file.lines[0]))
    is_named = any(key in columns for key in "xy") or len(_places(file, names)) == 2
    if not is_named and len(file.lines) > 1:  # the order of PlumeSim, below a line of titles
        first = 0 if len(names) == len(FLUENT) and all(map(is_number, names)) else 1
        table = Table(file, range(first, len(file.lines)), len(FLUENT), form=",".join(FLUENT))
        known: dict[str, np.ndarray] = dict(zip(FLUENT[1:], table.numbers(1, 2, 3).T, strict=True))
        return known, table, "columns index, x, y, chemical, lengths in m (assumed)", ()
    if not is_named:
        return {key: np.empty(0) for key in FLUENT[1:]}, Table(file, [], len(FLUENT)), "", ()
    left = [name for name in names if name.strip() and not NO_GAS.match(split_unit(name)[0])]
    others = [
        name for name in left if split_unit(name)[0] not in {split_unit(n)[0] for n in _places(file, names)}
    ]
    if len(others) != 1 and "chemical" not in columns:
        what = f"several columns that may be the gas, {listed(others)}" if others else "no column of a gas"
        raise file.wrong(
            1, f"names {what}; give columns, such as {{chemical: {others[0] if others else 'molef'}}}"
        )
    named = read_columns(file, COLUMNS, {"chemical": others[0], **columns} if len(others) == 1 else columns)
    units = ", ".join(f"{key} in {named.picked[key].unit or 'm (assumed)'}" for key in "xy")
    text = f"gas of column {named.picked['chemical'].name}, {units}"
    return {key: named.values[key] for key in FLUENT[1:]}, named.table, text, named.remarks


def _places(file: TextFile, names: Sequence[str]) -> dict[str, Picked]:
    """Return the columns of x and y, by their header cells, if a header names them."""
    try:
        found = pick(names, {key: COLUMNS[key] for key in "xy"})
    except ConventionError as error:
        raise file.wrong(1, str(error)) from None
    return {column.name: column for column in found.values()}


def described(frames: PointFrames) -> str:
    """Return a text on the number, period and places of frames of points."""
    box = spans(frames.place.min(axis=0), frames.place.max(axis=0))
    return f"{len(frames)} frames, {frames.period:g} s apart, {len(frames.place)} points, {box}"


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
