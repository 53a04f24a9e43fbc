"""What robots of a group declare that are driven in NumPy."""

import numpy as np
import taichi as ti

from taichi_plume.agents.few import few
from taichi_plume.agents.swarm import Swarm


@ti.data_oriented
class Declaring:
    """Lets `size` robots from number `start` on say where sources are."""

    def __init__(self, swarm: Swarm, start: int, size: int):
        self.swarm, self.start, self.size = swarm, start, size

    def say(self, places: np.ndarray, t: float) -> None:
        """places: (size, 2) [m], NaN where a robot says nothing; t: now [s]."""
        if np.isfinite(places).any():
            self._say(places.astype(np.float32), t)

    @ti.kernel
    def _say(self, places: ti.types.ndarray(dtype=ti.f32, ndim=2), t: float):
        ti.loop_config(serialize=ti.static(few(self.size)))
        for n in range(self.size):
            if not ti.math.isnan(places[n, 0]):
                self.swarm.declare(self.start + n, ti.Vector([places[n, 0], places[n, 1]]), t)
