"""Recorded readings in place of a swarm, for gas maps computed after a run."""

import numpy as np

from taichi_plume.engine import ti


class RecordedTeam:
    """Stand-in for a swarm: feeds recorded readings of at most `most` robots to a gas map (see `gas_map.Readers`)."""

    flies = False
    altitude = None

    def __init__(self, most: int):
        self.believed_position = ti.vector_field(2, ti.f32, most)
        self.wind = ti.vector_field(2, ti.f32, most)
        self.wind_known = ti.field(ti.i32, most)
        self.reading = ti.field(ti.f32, most)
        self.members = ti.filled(np.arange(most)[None])
        self.team_size = ti.field(ti.i32, 1)

    def show(
        self, place: np.ndarray, wind: np.ndarray, reading: np.ndarray, robot: np.ndarray | None = None
    ) -> None:
        """Set the n robots' positions (n, 2) [m], winds (n, 2) [m/s], zero if unknown, and readings (n,) [ppm].

        robot: numbers of these robots, (n,) below `most`; by default the first n.
        """
        n = len(reading)
        rows = np.arange(n) if robot is None else robot
        self.team_size[0] = n
        self.members[0, :n] = rows
        self.believed_position[rows], self.wind[rows], self.reading[rows] = place, wind, reading
        self.wind_known[rows] = np.any(np.asarray(wind, np.float32) != 0.0, axis=1)
