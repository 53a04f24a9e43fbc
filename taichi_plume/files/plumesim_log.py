"""PlumeSim logs of wind and gas (see `point_frames`), which PlumeSim and `kind: plumesim_log` play back.

A log is text: a line ``period_ms,numFrames,cellSize``; then per frame a line ``+number nPoints`` and so many lines
``x,y,z,windSpeed,windDirection,chemical``. Each frame lasts one period; the numbers of frames ascend. Lengths are in
m, the speed in m/s, the direction is where the air goes, in rad; chemical is in percent of a full scale.
"""

import re
from math import inf
from pathlib import Path

import numpy as np

from taichi_plume.files.point_frames import MOST_FRAMES, PointFileError, PointFrames, points_of
from taichi_plume.files.tables import Table, TextFile, is_number, shown

COLUMNS = ("x", "y", "z", "wind speed", "wind direction", "chemical")
FASTEST = 1e3  # m/s
POINT = "%.5g,%.5g,0,%.4g,%.4g,%.4g\n"  # as COLUMNS
DECIMALS = 6  # decimals of chemical, so that clean air is a plain 0
DIGITS = 9  # digits of the number of frames

_HEADER = re.compile(r"\s*(\d{1,9})\s*,\s*(\d{1,9})\s*,([^,]+)", re.ASCII)
_FRAME = re.compile(r"\+(\d{1,9})\s+(\d{1,9})\s*", re.ASCII)


def read_log(path: Path) -> PointFrames:
    """Return the frames (points with wind and gas) of a PlumeSim log. Raises PointFileError."""
    file = TextFile(path, PointFileError)
    period, cell, begin, rows = _frames(file)
    table = Table(file, rows, len(COLUMNS), form=",".join(COLUMNS))
    known = points_of(table, COLUMNS, {"wind speed": FASTEST})
    if not rows:
        raise PointFileError(f"{path}: holds no points")
    z, speed, direction = known["z"], known["wind speed"], known["wind direction"]
    table.refuse(z != z[0], lambda row: f"z = {z[row]:g}, others {z[0]:g}; a log is of one height")
    place = np.column_stack([known["x"], known["y"]])
    wind = speed[:, None] * np.column_stack([np.cos(direction), np.sin(direction)])
    return PointFrames(path, period, cell, place, wind, known["chemical"], np.array(begin))


def _frames(file: TextFile) -> tuple[float, float, list[int], list[int]]:
    """Return frame period [s], cell size [m], first point of each frame and the end, line indices of the points."""
    lines = file.lines
    header = _HEADER.fullmatch(lines[0])
    if header is None or not is_number(header[3]):
        raise file.wrong(1, f"must be period_ms,numFrames,cellSize, got {shown(lines[0])}")
    period, count, cell = int(header[1]), int(header[2]), float(header[3])
    for name, value in (("period", period), ("number of frames", count), ("cell size", cell)):
        if not 0 < value < inf:
            raise file.wrong(1, f"the {name} must be above 0, got {value:g}")
    if count > MOST_FRAMES:
        raise file.wrong(1, f"{count} frames are more than {MOST_FRAMES}")
    begin, rows, last = [0], [], -1
    at = 1  # index of the next line
    for n in range(1, count + 1):
        if at >= len(lines):
            raise PointFileError(f"{file.path}: ends after {n - 1} of {count} frames, at line {len(lines)}")
        head = _FRAME.fullmatch(lines[at])
        if head is None:
            raise file.wrong(at + 1, f"must begin frame {n} with '+number points', got {shown(lines[at])}")
        number, points = int(head[1]), int(head[2])
        if number <= last:
            raise file.wrong(at + 1, f"frame +{number} comes after +{last}; numbers of frames must ascend")
        within = range(at + 1, min(at + 1 + points, len(lines)))
        early = next((k for k in within if lines[k][:1] == "+" and _FRAME.fullmatch(lines[k])), None)
        if early is not None:
            held = f"{early - at - 1} of {points} points, by {shown(lines[early])}"
            raise file.wrong(early + 1, f"frame +{number} ends here, with {held}")
        if len(within) < points:
            held = f"{len(within)} of the {points} points of frame +{number}"
            raise PointFileError(f"{file.path}: ends at line {len(lines)}, with {held}")
        rows += within
        last, at = number, at + 1 + points
        begin.append(len(rows))
    if at < len(lines):
        raise file.wrong(at + 1, f"must be the end after {count} frames, got {shown(lines[at])}")
    return period / 1000, cell, begin, rows


def header(period: float, frames: int, cell: float) -> str:
    """Return the first line of a log, as wide for any number of frames; period: of a frame [s]; cell [m]."""
    return f"{round(1000 * period)},{frames:{DIGITS}d},{cell:.9g}\n"


def frame(number: int, place: np.ndarray, wind: np.ndarray, percent: np.ndarray) -> str:
    """Return frame `number` of a log as text: points (n, 2) [m] with wind (n, 2) [m/s] and percent (n,)."""
    speed, toward = np.hypot(wind[:, 0], wind[:, 1]), np.arctan2(wind[:, 1], wind[:, 0])
    columns = (*place.T, speed, toward, np.maximum(percent, 0.0).round(DECIMALS))
    table = np.stack(columns, axis=-1)
    return f"+{number} {len(table)}\n" + POINT * len(table) % tuple(table.ravel())


def shorten(path: Path) -> int:
    """Cut a PlumeSim log to the number of frames that its first line states, and return this number.

    Raises OSError, and ValueError if the file is no such log.
    """
    with path.open("rb+") as file:
        frames = int(file.readline().split(b",")[1])
        left = frames
        while left >= 0:
            begin = file.tell()
            line = file.readline()
            if not line:
                break
            left -= line.startswith(b"+")
        else:
            file.truncate(begin)
    return frames
