"""When and how much a source emits."""

import numpy as np

from taichi_plume.gases import Source
from taichi_plume.rng import generator


class Emission:
    """When a source emits: its start and stop, and pulses of random length."""

    def __init__(self, source: Source, begin: float, seed: int, name: str):
        self.source = source
        self.start = begin if source.start is None else source.start
        self.stop = np.inf if source.stop is None else source.stop
        self.rng = generator(seed, name)
        self.pulses = [(self.start, self.stop)] if source.puffing is None else []

    def _draw_until(self, t: float) -> None:
        puffing = self.source.puffing
        while puffing is not None and (not self.pulses or self.pulses[-1][1] < t):
            spread = 1.0 + puffing.spread * self.rng.uniform(-1.0, 1.0, 2)
            begin = self.pulses[-1][1] + puffing.pause * spread[0] if self.pulses else self.start
            self.pulses.append((begin, begin + puffing.pulse * spread[1]))

    def mass(self, t: float, dt: float) -> float:
        """Mass emitted between t and t + dt [kg]."""
        return float(self.masses(np.array([t, t + dt]))[0])

    def masses(self, times: np.ndarray) -> np.ndarray:
        """Mass emitted between each two of the ascending times (n,): (n - 1,) [kg]."""
        self._draw_until(times[-1])
        while len(self.pulses) > 1 and self.pulses[0][1] < times[0]:
            self.pulses.pop(0)
        on = np.zeros(len(times) - 1)
        for begin, end in self.pulses:
            on += np.maximum(np.minimum(min(end, self.stop), times[1:]) - np.maximum(begin, times[:-1]), 0.0)
        return self.source.rate * on
