"""Unsteady release of heat: the disturbance that makes the plume above a heater turbulent.

Warm air that rises from rest is unstable, but on a grid nothing disturbs it: above a heater that warms its cells evenly
the plume stays laminar for metres and entrains too little air. Above real heat sources the warm air leaves in puffs,
which follow one another about as fast as air rises through the source (Cetegen & Kasper 1996, Phys. Fluids 8, 2974).

A puff warms the cells of a heater around a random place with a Gaussian kernel, whose standard deviation is WIDTH R, R
being the radius of the heater. It lasts DURATION R/U, with U = (g beta P/(rho c_p R))^(1/3), the speed that air gains
over R. R is at least one cell here. The shares of all cells sum to 1 at any moment, so the power is exact.
"""

from math import floor

import numpy as np

from taichi_plume.grid.rng import generator
from taichi_plume.scenario.heat import Heat
from taichi_plume.solvers.release import Release

WIDTH, DURATION = 0.5, 3.0  # found by trials of one source; durations of 2 and 5 differ by no more than seeds


class HeatPuffs:
    """Puffs of heaters on the grid. Each puff follows from the seed and its number alone, so there is no state."""

    STATE = ()

    def __init__(self, release: Release):
        """The owner calls `begin`."""
        self.release = release
        self._periods = np.where(release.grid.periodic, release.grid.shape, np.inf)

    def begin(self, heat: Heat, seed: int) -> None:
        """Take over the heaters, which `release` has placed."""
        self._share, self._seed = heat.unsteadiness, seed
        self._radii = [max(heater.radius, self.release.grid.dx) for heater in heat.heaters]
        self._rates = [
            heat.rising_speed(heater.power, radius) / (DURATION * radius)
            for heater, radius in zip(heat.heaters, self._radii, strict=True)
        ]  # puffs per second
        self._numbers: list[int] = []  # of the puffs that the cells receive now

    def advance(self, t: float) -> None:
        """Release the puffs of time t [s]."""
        numbers = [floor(t * rate) for rate in self._rates]
        if self._share > 0.0 and numbers != self._numbers:
            self._numbers = numbers
            self.release.set_shares([self.shares(n, number) for n, number in enumerate(numbers)])

    def shares(self, n: int, number: int) -> np.ndarray:
        """Shares of the power of heater n that its cells receive during puff `number`."""
        cells, even = self.release.balls[n]
        rng = generator(self._seed, f"heaters[{n}] puff {number}")
        apart = np.abs(cells - cells[rng.choice(len(even), p=even / even.sum())])
        square = (np.minimum(apart, self._periods - apart) ** 2).sum(axis=-1)
        puff = even * np.exp(-0.5 * square * (self.release.grid.dx / (WIDTH * self._radii[n])) ** 2)
        return (1.0 - self._share) * even + self._share * even.sum() * puff / puff.sum()
