"""Writer of a run's log in PlumeSim's format, see `files/plumesim_log.py`."""

import os
from math import ceil
from pathlib import Path
from typing import BinaryIO

import numpy as np

from taichi_plume.files import disk
from taichi_plume.files.plumesim_log import DECIMALS, DIGITS, POINT
from taichi_plume.files.run_folder import cut
from taichi_plume.grid.fields import ppm_at, velocity_at
from taichi_plume.scenario.outputs import PlumeLog
from taichi_plume.simulation import Every, Simulation


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
        """Begin the log."""
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
        """All is on the disk after every frame."""
        os.fsync(self.file.fileno())
        self.size = self.whole

    def close(self) -> None:
        """Close the file, without a frame that is not whole."""
        if hasattr(self, "file"):
            with self.file:
                self.file.truncate(self.whole)


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
