"""Plumes as frames of points: the log of PlumeSim and ASCII exports of Fluent, as PlumeSim (Cabrita, Sousa & Marques,
"Player/Stage simulation of olfactory experiments", IROS 2010) reads them.

A log is text: a line ``period_ms,numFrames,cellSize``; then per frame a line ``+number nPoints`` and so many lines
``x,y,z,windSpeed,windDirection,chemical``. Frames last one period each, in their order; their numbers ascend. Lengths
are in m, the speed in m/s, the direction is where the air goes, in rad; chemical is in percent of a full scale.

Fluent exports are one file per frame, numbered from 1: a line of titles, then lines ``index,x,y,chemical``.

All of a file is read and checked before anything is made of it.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from taichi_plume.scenario.played import PlumeSimLog
from taichi_plume.scenario.plumesim import FluentGas

LARGEST_FILE = 128 << 20  # bytes of a log, or of all files of an export
MOST_FRAMES = 100_000
FARTHEST = 1e5  # m: beyond, f32 no longer tells cells of a centimetre apart
FASTEST = 1e3  # m/s
LARGEST_PERCENT = 1e6
LONGEST_TEXT = 40  # characters shown of a wrong line
LOG_COLUMNS = ("x", "y", "z", "wind speed", "wind direction", "chemical")
FLUENT_COLUMNS = ("index", "x", "y", "chemical")

_HEADER = re.compile(r"\s*(\d{1,9})\s*,\s*(\d{1,9})\s*,([^,]+)")
_FRAME = re.compile(r"\+(\d{1,9})\s+(\d{1,9})\s*")


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


def frames_of(model: PlumeSimLog | FluentGas, folder: Path) -> PointFrames:
    """What a scenario's plume or wind plays back; `folder` is where its files lie. Raises PointFileError."""
    if isinstance(model, FluentGas):
        return read_fluent(folder / model.files, model.frames, model.period, model.cell, model.largest)
    return read_log(folder / model.file)


# ---------------------------------------------------------------- logs


def read_log(path: Path) -> PointFrames:
    """The frames of a PlumeSim log. Raises PointFileError."""
    lines = _lines(path, LARGEST_FILE)
    header = _HEADER.fullmatch(lines[0])
    cell = _number(header[3]) if header else None
    if header is None or cell is None:
        raise _wrong(path, 1, f"must be period_ms,numFrames,cellSize, got {_shown(lines[0])}")
    period, count = int(header[1]), int(header[2])
    for name, value in (("period", period), ("number of frames", count), ("cell size", cell)):
        if not 0 < value < np.inf:
            raise _wrong(path, 1, f"the {name} must be above 0, got {value:g}")
    if count > MOST_FRAMES:
        raise _wrong(path, 1, f"{count} frames are more than {MOST_FRAMES}")
    heads = [n for n, line in enumerate(lines) if line.startswith("+") and _FRAME.fullmatch(line)]
    begin, rows, last = [0], [], -1
    at = 1  # index of the next line
    for n in range(1, count + 1):
        if at >= len(lines):
            raise PointFileError(f"{path}: ends after {n - 1} of {count} frames, at line {len(lines)}")
        head = _FRAME.fullmatch(lines[at])
        if head is None:
            raise _wrong(path, at + 1, f"must begin frame {n} with '+number points', got {_shown(lines[at])}")
        number, points = int(head[1]), int(head[2])
        if number <= last:
            raise _wrong(path, at + 1, f"frame +{number} comes after +{last}; numbers of frames must ascend")
        held = len(lines) - at - 1
        if held < points:
            raise PointFileError(
                f"{path}: ends at line {len(lines)}, with {held} of the {points} points of frame +{number}"
            )
        after = heads[n] if n < len(heads) else len(lines)  # all heads before were where they had to be
        if after <= at + points:
            held = after - at - 1
            raise _wrong(
                path,
                after + 1,
                f"frame +{number} ends here, with {held} of {points} points, by {_shown(lines[after])}",
            )
        rows += range(at + 1, at + 1 + points)
        last, at = number, at + 1 + points
        begin.append(len(rows))
    if at < len(lines):
        raise _wrong(path, at + 1, f"must be the end after {count} frames, got {_shown(lines[at])}")
    table = _table(path, lines, rows, LOG_COLUMNS)
    if not len(table):
        raise PointFileError(f"{path}: holds no points")
    _check(path, rows, table[:, 3], "wind speed", FASTEST)
    _check(path, rows, table[:, 5], "chemical", LARGEST_PERCENT)
    heights = table[:, 2]
    if np.ptp(heights) > 0:
        other = int(np.argmax(heights != heights[0]))
        raise _wrong(
            path, rows[other] + 1, f"z = {heights[other]:g}, others {heights[0]:g}; a log is of one height"
        )
    speed, direction = table[:, 3, None], table[:, 4]
    wind = speed * np.stack([np.cos(direction), np.sin(direction)], axis=-1)
    return PointFrames(path, period / 1000, cell, table[:, :2], wind, table[:, 5], np.array(begin))


# ---------------------------------------------------------------- Fluent


def fluent_files(pattern: Path, frames: int | None) -> list[Path]:
    """The files that a pattern such as ``plume%03d.txt`` stands for, numbered from 1: `frames` or all there are.

    Raises PointFileError where one is missing.
    """
    found: list[Path] = []
    while len(found) < (frames or MOST_FRAMES):
        path = pattern.with_name(pattern.name % (len(found) + 1))
        if not _is_file(path):
            after = pattern.with_name(pattern.name % (len(found) + 2))
            if frames is not None or not found:
                raise PointFileError(f"{path}: does not exist; files are numbered from 1")
            if _is_file(after):
                raise PointFileError(f"{path}: does not exist, but {after.name} does")
            break
        found.append(path)
    return found


def read_fluent(
    pattern: Path, frames: int | None, period: float, cell: float, largest: float | None
) -> PointFrames:
    """The frames of Fluent exports.

    period [s], cell [m]; largest: value that counts as 100 percent, unless given the largest of all files.
    Raises PointFileError.
    """
    paths = fluent_files(pattern, frames)
    begin, tables, room = [0], [], LARGEST_FILE
    for path in paths:
        lines = _lines(path, room)
        room -= sum(map(len, lines))
        tables.append(_table(path, lines, range(1, len(lines)), FLUENT_COLUMNS))
        _check(
            path,
            range(1, len(lines)),
            tables[-1][:, 3],
            "chemical",
            0.01 * LARGEST_PERCENT * (largest or np.inf),
        )
        begin.append(begin[-1] + len(tables[-1]))
    table = np.concatenate(tables)
    if not len(table):
        raise PointFileError(f"{paths[0]}: holds no points")
    full = table[:, 3].max() if largest is None else largest
    percent = 100.0 * (table[:, 3] / full) if full > 0 else table[:, 3]
    return PointFrames(
        paths[0], period, cell, table[:, 1:3], np.zeros((len(table), 2)), percent, np.array(begin)
    )


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # a name that is too long, a folder that may not be read
        return False


# ---------------------------------------------------------------- lines and numbers


def _lines(path: Path, room: int) -> list[str]:
    """The lines of a text file, without empty ones at its end."""
    try:
        with path.open("rb") as file:
            content = file.read(room + 1)
    except (OSError, ValueError) as error:  # of a name with a zero byte
        raise PointFileError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    if len(content) > room:
        raise PointFileError(f"{path}: is too large; {LARGEST_FILE >> 20} MiB in all are read")
    try:
        text = content.decode("ascii")
    except UnicodeDecodeError as error:
        raise _wrong(path, content.count(b"\n", 0, error.start) + 1, "is not plain text (ASCII)") from None
    lines = text.rstrip().replace("\r\n", "\n").split("\n")
    if lines == [""]:
        raise PointFileError(f"{path}: is empty")
    return lines


def _table(path: Path, lines: list[str], rows: Sequence[int], columns: tuple[str, ...]) -> np.ndarray:
    """The numbers on the lines of these indices; all finite, places within reason."""
    table = _parsed([lines[row] for row in rows], len(columns))
    if table is None:
        good, bad = 0, len(rows)  # lines that can be read, and with how many they no longer can
        while bad - good > 1:
            middle = (good + bad) // 2
            if _parsed([lines[row] for row in rows[good:middle]], len(columns)) is None:
                bad = middle
            else:
                good = middle
        row = rows[bad - 1]
        raise _wrong(path, row + 1, f"must be {','.join(columns)}, got {_shown(lines[row])}")
    if not np.isfinite(table).all():
        row = rows[int(np.argmin(np.isfinite(table).all(axis=1)))]
        raise _wrong(path, row + 1, f"must be finite numbers, got {_shown(lines[row])}")
    for name in ("x", "y"):
        beyond = np.abs(table[:, columns.index(name)]) > FARTHEST
        if beyond.any():
            row = rows[int(np.argmax(beyond))]
            raise _wrong(path, row + 1, f"{name} must be within {FARTHEST:g} m, got {_shown(lines[row])}")
    return table


def _parsed(lines: list[str], columns: int) -> np.ndarray | None:
    """The numbers of lines with so many columns; None where one is not so."""
    if not lines:
        return np.empty((0, columns))
    if not all(map(str.strip, lines)):  # loadtxt leaves out empty ones
        return None
    try:
        table = np.loadtxt(lines, delimiter=",", comments=None, ndmin=2)
    except ValueError:
        return None
    return table if table.shape[1] == columns else None


def _check(path: Path, rows: Sequence[int], values: np.ndarray, name: str, most: float) -> None:
    """Values of the lines of these indices have to be between 0 and `most`."""
    wrong = (values < 0) | (values > most)
    if wrong.any():
        first = int(np.argmax(wrong))
        limit = f"at most {most:g}" if values[first] > most else "not negative"
        raise _wrong(path, rows[first] + 1, f"{name} must be {limit}, got {values[first]:g}")


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


def _wrong(path: Path, line: int, what: str) -> PointFileError:
    return PointFileError(f"{path}: line {line}: {what}")


def _shown(text: str) -> str:
    return repr(text if len(text) <= LONGEST_TEXT else text[: LONGEST_TEXT - 3] + "...")
