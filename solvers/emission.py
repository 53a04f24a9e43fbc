"""Emission of sources: rate over time, pulses, evaporation from dishes, and release of puffs."""

from collections.abc import Sequence
from itertools import pairwise
from math import ceil

import numpy as np

from taichi_plume.grid.fields import Wind
from taichi_plume.grid.rng import generator
from taichi_plume.scenario.gases import PuffGas
from taichi_plume.scenario.sources import Source
from taichi_plume.scenario.species import Species
from taichi_plume.solvers.evaporation import Evaporation, speed_over

INTERVAL = 0.1  # s: interval at which a dish samples the wind


class Emission:
    """Emission of a source over time: start, stop, pulses of random length, and evaporation if it is a dish."""

    STATE = ("pulses", "rng", "_dish_rate", "_due")

    def __init__(
        self,
        name: str,
        source: Source,
        t: float,
        seed: int,
        species: Species | None = None,
        wind: Wind | None = None,
    ):
        """name: of the random stream; t: start of the run [s]; species: the liquid in a dish; wind: over a dish."""
        self.name, self.source, self.wind = name, source, wind
        self.evaporation = None
        if source.dish is not None:
            assert species is not None, f"{self.name} is a dish of nothing"
            self.evaporation = Evaporation(source.dish, species)
        self._dish_rate, self._due = 0.0, -np.inf
        self.start = t if source.start is None else source.start
        self.stop = np.inf if source.stop is None else source.stop
        self.rng = generator(seed, self.name)
        self.pulses = [(self.start, self.stop)] if source.puffing is None else []

    def _draw_until(self, t: float) -> None:
        puffing = self.source.puffing
        while puffing is not None and (not self.pulses or self.pulses[-1][1] < t):
            pause, pulse = (1.0 + puffing.spread * self.rng.uniform(-1.0, 1.0, 2)).tolist()
            begin = self.pulses[-1][1] + puffing.pause * pause if self.pulses else self.start
            self.pulses.append((begin, begin + puffing.pulse * pulse))

    def mass(self, t: float, dt: float) -> float:
        """Return the mass emitted between t and t + dt [kg]."""
        return self.masses((t, t + dt))[0]

    def masses(self, times: Sequence[float]) -> list[float]:
        """Return the mass [kg] emitted between each two consecutive of these ascending times [s]."""
        self._draw_until(times[-1])
        while len(self.pulses) > 1 and self.pulses[0][1] < times[0]:
            self.pulses.pop(0)
        on = [
            sum(max(min(end, self.stop, after) - max(begin, before), 0.0) for begin, end in self.pulses)
            for before, after in pairwise(times)
        ]
        rate = self._rate(times[0]) if any(on) else 0.0
        return [rate * span for span in on]

    def _rate(self, t: float) -> float:
        """Return the emission rate [kg/s] at time t [s] while the source is on."""
        if self.evaporation is None or self.source.dish is None:
            return self.source.rate or 0.0
        if t >= self._due - 1e-9:
            speed = self.source.dish.air_speed
            if speed is None:
                assert self.wind is not None, f"{self.name} is a dish in no air"
                speed = speed_over(self.source, self.wind, t)
            self._dish_rate = self.evaporation.rate(speed)
            self._due = t + INTERVAL
        return self._dish_rate


class Portions:
    """Release of a source's emission in puffs: each puff holds the mass emitted since the previous one."""

    STATE = ("emission", "rng", "pending", "_next")

    def __init__(self, name: str, source: Source, gas: PuffGas, wind: Wind, t: float, seed: int):
        """name: of the random streams; wind: wind over a dish; t: start of the run [s]."""
        self.source = source
        self.rate, self.poisson = gas.release_rate, gas.poisson
        self.emission = Emission(name, source, t, seed, gas.vapour, wind)
        self.rng = generator(seed, f"{name} puffs")
        self.pending = 0.0  # kg, emitted but not yet in a puff
        self._next = t + self._intervals(1)[0]

    def _intervals(self, n: int) -> np.ndarray:
        return self.rng.exponential(1.0 / self.rate, n) if self.poisson else np.full(n, 1.0 / self.rate)

    def _moments(self, end: float) -> np.ndarray:
        """Return the release times of puffs up to time `end` [s]."""
        moments = [np.empty(0)]
        while self._next <= end:
            intervals = self._intervals(ceil((end - self._next) * self.rate) + 1)
            ahead = self._next + np.cumsum(np.concatenate([[0.0], intervals]))
            due = int(np.searchsorted(ahead, end, side="right"))
            moments.append(ahead[:due])
            self._next = ahead[min(due, len(intervals))]
            if due > len(intervals):
                moments[-1] = moments[-1][:-1]  # it is the first of the next batch
        return np.concatenate(moments)

    def puffs(self, t: float, dt: float) -> tuple[np.ndarray, np.ndarray, float]:
        """Return release times [s] and masses [kg] of the puffs between t and t + dt, and the total emission [kg]."""
        moments = self._moments(t + dt)
        emitted = self.emission.masses([t, *moments.tolist(), t + dt])
        masses = np.array(emitted[:-1])
        if len(masses):
            masses[0] += self.pending
            self.pending = 0.0
        self.pending += emitted[-1]
        return moments[masses > 0.0], masses[masses > 0.0], sum(emitted)

    def places(self, n: int, dim: int, middle: np.ndarray) -> np.ndarray:
        """Return n random positions (n, dim) [m] in the source's ball around `middle`, (dim,) or (n, dim) [m]."""
        direction = self.rng.standard_normal((n, dim))
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        radius = self.source.radius * self.rng.random((n, 1)) ** (1 / dim)
        return middle + radius * direction
