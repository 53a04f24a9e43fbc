"""Recorded readings in the place of a swarm, for maps that are made afterwards."""

from typing import Any

import numpy as np
import taichi as ti


class RecordedTeam:
    """What maps see of a swarm: at any time one team of at most `most` robots, with the names of `Swarm`."""

    def __init__(self, most: int):
        self.most = most
        self.believed_position: Any = ti.Vector.field(2, ti.f32, most)
        self.wind: Any = ti.Vector.field(2, ti.f32, most)
        self.wind_known = ti.field(ti.i32, most)
        self.reading = ti.field(ti.f32, most)
        self.members = ti.field(ti.i32, (1, most))
        self.team_size = ti.field(ti.i32, 1)
        self.members.from_numpy(np.arange(most, dtype=np.int32)[None])

    def show(self, place: np.ndarray, wind: np.ndarray, reading: np.ndarray) -> None:
        """Let so many robots be at places (n, 2) [m] and read (n,) [ppm] in winds (n, 2) [m/s], zero if unknown."""
        self.believed_position.from_numpy(self._padded(place))
        self.wind.from_numpy(self._padded(wind))
        self.wind_known.from_numpy((self._padded(wind) != 0.0).any(axis=1).astype(np.int32))
        self.reading.from_numpy(self._padded(reading))
        self.team_size.fill(len(reading))

    def _padded(self, values: np.ndarray) -> np.ndarray:
        result = np.zeros((self.most, *values.shape[1:]), np.float32)
        result[: len(values)] = values
        return result
