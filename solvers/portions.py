"""When a source lets go of puffs, where, and what is in them."""

from math import ceil

import numpy as np

from taichi_plume.grid.fields import Wind
from taichi_plume.grid.rng import generator
from taichi_plume.scenario.gases import PuffGas
from taichi_plume.scenario.sources import Source
from taichi_plume.solvers.emission import Emission


class Portions:
    """The puffs of a source: each holds what it has emitted since the one before."""

    STATE = ("emission", "rng", "pending", "_next")

    def __init__(self, name: str, wind: Wind):
        """name: of the random streams; wind: over a dish. To be begun by its owner."""
        self.name = name
        self.emission = Emission(name, wind)

    def begin(self, source: Source, gas: PuffGas, t: float, seed: int) -> None:
        """t: begin of the run [s]."""
        self.source = source
        self.rate, self.poisson = gas.release_rate, gas.poisson
        self.emission.begin(source, t, seed, gas.vapour)
        self.rng = generator(seed, f"{self.name} puffs")
        self.pending = 0.0  # kg, emitted but not yet in a puff
        self._next = t + self._intervals(1)[0]

    def _intervals(self, n: int) -> np.ndarray:
        return self.rng.exponential(1.0 / self.rate, n) if self.poisson else np.full(n, 1.0 / self.rate)

    def _moments(self, end: float) -> np.ndarray:
        """When puffs are let go up to `end` [s]."""
        moments = [np.empty(0)]
        while self._next <= end:
            intervals = self._intervals(ceil((end - self._next) * self.rate) + 1)
            ahead = self._next + np.cumsum(np.concatenate([[0.0], intervals]))
            due = int(np.searchsorted(ahead, end, side="right"))
            moments.append(ahead[:due])
            self._next = ahead[min(due, len(intervals))]
            if due > len(intervals):
                moments[-1] = moments[-1][:-1]  # it is the first of the next lot
        return np.concatenate(moments)

    def puffs(self, t: float, dt: float) -> tuple[np.ndarray, np.ndarray, float]:
        """Moments [s] and masses [kg] of the puffs between t and t + dt, and all that is emitted meanwhile [kg]."""
        moments = self._moments(t + dt)
        emitted = self.emission.masses(np.concatenate([[t], moments, [t + dt]]))
        masses = emitted[:-1].copy()
        if len(masses):
            masses[0] += self.pending
            self.pending = 0.0
        self.pending += emitted[-1]
        return moments[masses > 0.0], masses[masses > 0.0], float(emitted.sum())

    def places(self, n: int, dim: int) -> np.ndarray:
        """Random places in the ball [m], (n, dim)."""
        direction = self.rng.standard_normal((n, dim))
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        radius = self.source.radius * self.rng.random((n, 1)) ** (1 / dim)
        return np.array(self.source.position) + radius * direction
