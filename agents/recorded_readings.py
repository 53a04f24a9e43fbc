"""Recorded readings in place of a swarm, for gas maps computed after a run."""

import numpy as np

from taichi_plume.engine import ti
from taichi_plume.grid.transfer import uploader


class RecordedTeam:
    """Stand-in for a swarm: feeds recorded readings of at most `most` robots to a gas map (see `gas_map.Readers`)."""

    def __init__(self, most: int):
        self.believed_position = ti.vector_field(2, ti.f32, most)
        self.wind = ti.vector_field(2, ti.f32, most)
        self.wind_known = ti.field(ti.i32, most)
        self.reading = ti.field(ti.f32, most)
        self.members = ti.field(ti.i32, (1, most))
        self.team_size = ti.field(ti.i32, 1)
        uploader(self.members)(np.arange(most)[None])

    def show(self, place: np.ndarray, wind: np.ndarray, reading: np.ndarray) -> None:
        """Set the n robots' positions (n, 2) [m], winds (n, 2) [m/s], zero if unknown, and readings (n,) [ppm]."""
        rows = np.zeros((max(1, len(reading)), 5), np.float32)  # Taichi accepts no empty arrays
        rows[: len(reading)] = np.column_stack([place, wind, reading])
        self._show(rows, len(reading))

    @ti.kernel
    def _show(self, rows: ti.types.ndarray(), count: int):
        self.team_size[0] = count
        for n in range(count):
            self.believed_position[n] = ti.Vector([rows[n, 0], rows[n, 1]])
            self.wind[n] = ti.Vector([rows[n, 2], rows[n, 3]])
            self.wind_known[n] = ti.cast(rows[n, 2] != 0.0 or rows[n, 3] != 0.0, ti.i32)
            self.reading[n] = rows[n, 4]
