"""Writer of `plume.pslog`, a log of wind and gas in PlumeSim's format; see `files/plumesim_log.py`."""

import os
from contextlib import ExitStack
from math import ceil
from pathlib import Path
from typing import Literal

import numpy as np

from taichi_plume.files import disk
from taichi_plume.files.plumesim_log import frame, header
from taichi_plume.files.run_folder import cut
from taichi_plume.grid.fields import excess_at, velocity_at
from taichi_plume.scenario.outputs import PlumeLog
from taichi_plume.time_loop import Every, TimeLoop


class PlumeLogger:
    """Writer of a PlumeSim log: wind and gas on a plane grid. Raises OSError as soon as the disk is full.

    Grid nodes lie in the middle of square cells; nodes inside obstacles are left out. The log holds the sum of the
    mole fractions of all gases. The first line is updated with each frame, so the file is complete after every frame.
    """

    STATE = ("frames", "size")

    def __init__(self, sim: TimeLoop, path: Path, model: PlumeLog):
        self.path, self.model = path, model
        self.dt = sim.dt
        self.ticks = max(1, round(1 / (model.rate * sim.dt)))  # per frame
        self.first = ceil(model.start / sim.dt - 1e-9)
        self.place = nodes(sim, model)
        self.frames = self.size = self.whole = 0  # size, whole: bytes
        self.closing = ExitStack()

    def start(self) -> None:
        disk.require_room(self.path)
        self._open("xb")

    def resume(self) -> None:
        """Resume the log: cut off frames after the last `flush`. Raises RunFolderError if frames are missing."""
        cut(self.path, self.size)
        self._open("r+b")

    def _open(self, mode: Literal["xb", "r+b"]) -> None:
        self.file = self.closing.enter_context(self.path.open(mode))
        self.closing.callback(lambda: self.file.truncate(self.whole))
        self._write_header()

    def observer(self) -> Every:
        return Every(self.dt, self.add, warm_up=True)

    def add(self, sim: TimeLoop) -> None:
        """Write wind and gas at all grid nodes as a frame of the log, if a frame is due."""
        if sim.tick < self.first or (sim.tick - self.first) % self.ticks:
            return
        u = velocity_at(sim.wind, self.place, sim.t)
        percent = 100.0 / self.model.full_scale_ppm * excess_at(sim.gas, self.place, sim.t).sum(axis=-1)
        text = frame(self.frames + 1, self.place[:, :2], u, percent)
        disk.require_room(self.path, len(text))
        self.file.write(text.encode("ascii"))
        self.frames += 1
        self._write_header()

    def _write_header(self) -> None:
        """Rewrite the first line: period, number of frames, cell size, in a fixed number of characters."""
        self.file.seek(0)
        line = header(self.dt * self.ticks, self.frames, self.model.cell)
        self.file.write(line.encode("ascii"))
        self.whole = self.file.seek(0, 2)
        self.file.flush()

    def flush(self) -> None:
        os.fsync(self.file.fileno())
        self.size = self.whole

    def close(self) -> None:
        """Close the log, and cut off an incomplete frame."""
        self.closing.close()


def nodes(sim: TimeLoop, model: PlumeLog) -> np.ndarray:
    """Return the positions (n, dim) [m] of the log's grid nodes; nodes inside obstacles are left out."""
    extent = sim.grid.extent
    axes = [(np.arange(int(width / model.cell + 1e-9)) + 0.5) * model.cell for width in extent[:2]]
    flat = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    place = np.column_stack([flat, np.full(len(flat), model.height)]) if sim.grid.dim == 3 else flat
    solid = np.zeros(len(place), bool)
    for obstacle in sim.obstacles:
        solid |= obstacle.inside(place)
    return place[~solid]
