"""The log of PlumeSim (Cabrita, Sousa & Marques, "Player/Stage simulation of olfactory experiments", IROS 2010), which
its robots and `kind: plumesim_log` play back.

A log is text: a line ``period_ms,numFrames,cellSize``; then per frame a line ``+number nPoints`` and so many lines
``x,y,z,windSpeed,windDirection,chemical``. Frames last one period each, in their order; their numbers ascend. Lengths
are in m, the speed in m/s, the direction is where the air goes, in rad; chemical is in percent of a full scale.
"""

import os
import re
from math import ceil, inf
from pathlib import Path
from typing import BinaryIO

import numpy as np

from taichi_plume.files import disk
from taichi_plume.files.point_frames import MOST_FRAMES, PointFileError, PointFrames, points_of
from taichi_plume.files.run_folder import cut
from taichi_plume.files.tables import Table, TextFile, is_number, shown
from taichi_plume.grid.fields import ppm_at, velocity_at
from taichi_plume.scenario.outputs import PlumeLog
from taichi_plume.simulation import Every, Simulation

COLUMNS = ("x", "y", "z", "wind speed", "wind direction", "chemical")
FASTEST = 1e3  # m/s
POINT = "%.5g,%.5g,0,%.4g,%.4g,%.4g\n"  # as COLUMNS
DECIMALS = 6  # of chemical, so that clean air is a plain 0
DIGITS = 9  # of the number of frames: room for any

_HEADER = re.compile(r"\s*(\d{1,9})\s*,\s*(\d{1,9})\s*,([^,]+)", re.ASCII)
_FRAME = re.compile(r"\+(\d{1,9})\s+(\d{1,9})\s*", re.ASCII)

# ---------------------------------------------------------------- reading


def read_log(path: Path) -> PointFrames:
    """The frames of a PlumeSim log. Raises PointFileError."""
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
    """Period [s] and cell [m], where each frame begins among the points, and all of them end, and the points' lines."""
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


# ---------------------------------------------------------------- writing


class PlumeLogger:
    """Writes the log `path`. Raises OSError as soon as the disk has no room.

    Nodes lie in the middle of square cells; those within obstacles are left out. Of several gases the sum of their
    mole fractions is written. The first line is kept right, so the file is whole after every frame. `start()` begins
    it, `go_on()` continues that of a run that was resumed.
    """

    STATE = ("frames", "size")

    file: BinaryIO

    def __init__(self, sim: Simulation, path: Path, model: PlumeLog):
        self.path, self.model = path, model
        self.dt = sim.dt
        self.ticks = max(1, round(1 / (model.rate * sim.dt)))  # per frame
        self.first = ceil(model.start / sim.dt - 1e-9)
        self.place = nodes(sim, model)
        self.frames = self.size = self.whole = 0  # bytes

    def start(self) -> None:
        disk.require_room(self.path)
        self.file = self.path.open("wb")
        self._write_header()

    def go_on(self) -> None:
        """Cut off the frames after the last `flush`. Raises RunFolderError where not so many are left."""
        cut(self.path, self.size)
        self.file = self.path.open("r+b")
        self._write_header()

    def observer(self) -> Every:
        """What the simulation has to call."""
        return Every(self.dt, self.add, warm_up=True)

    def add(self, sim: Simulation) -> None:
        """Add a frame, if it is time for one."""
        if sim.tick < self.first or (sim.tick - self.first) % self.ticks:
            return
        u = velocity_at(sim.wind, self.place, sim.t)
        percent = 100.0 / self.model.full_scale_ppm * ppm_at(sim.gas, self.place, sim.t).sum(axis=-1)
        table = np.stack(
            [
                self.place[:, 0],
                self.place[:, 1],
                np.hypot(u[:, 0], u[:, 1]),
                np.arctan2(u[:, 1], u[:, 0]),
                np.maximum(percent, 0.0).round(DECIMALS),
            ],
            axis=-1,
        )
        text = f"+{self.frames + 1} {len(table)}\n" + POINT * len(table) % tuple(table.ravel())
        disk.require_room(self.path, len(text))
        self.file.write(text.encode("ascii"))
        self.frames += 1
        self._write_header()

    def _write_header(self) -> None:
        """Period, number of frames and cell, in the same number of characters every time."""
        header = f"{round(1000 * self.dt * self.ticks)},{self.frames:{DIGITS}d},{self.model.cell:.9g}\n"
        self.file.seek(0)
        self.file.write(header.encode("ascii"))
        self.whole = self.file.seek(0, 2)
        self.file.flush()

    def flush(self) -> None:
        os.fsync(self.file.fileno())
        self.size = self.whole

    def close(self) -> None:
        """Close the file, without a frame that is not whole."""
        if hasattr(self, "file"):
            with self.file:
                self.file.truncate(self.whole)


def shorten(path: Path) -> int:
    """Cut off what comes after as many frames as the first line of a log of ours says; returns how many these are.

    Raises OSError, and ValueError where it is none.
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


def nodes(sim: Simulation, model: PlumeLog) -> np.ndarray:
    """Places (n, dim) of the log's nodes [m] in the air."""
    extent = sim.grid.extent
    axes = [(np.arange(int(width / model.cell + 1e-9)) + 0.5) * model.cell for width in extent[:2]]
    flat = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    place = np.column_stack([flat, np.full(len(flat), model.height)]) if sim.grid.dim == 3 else flat
    solid = np.zeros(len(place), bool)
    for one in sim.obstacles:
        solid |= one.inside(place)
    return place[~solid]
