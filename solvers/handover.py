"""Handover of puffs wider than a cell to gas on the grid, which the wind carries and mixes.

A puff is handed over once its standard deviation is WIDTH cells. From then on eddies larger than a cell, which the wind
resolves, mix the gas; before, smaller eddies do, which `puff_growth` models. Means over cells add 1/12 dx² to the
variance of the puff, interpolation between cells another 1/6 dx². A puff is deposited narrower by this variance, so
that the concentration reads the same before and after.
"""

from typing import Any

import numpy as np

from taichi_plume.engine import ti
from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.fields import Carrier, sample_cells
from taichi_plume.grid.kernels import Template
from taichi_plume.solvers.convection import LIMITED
from taichi_plume.solvers.puff_deposit import Deposit
from taichi_plume.solvers.transport import Scalar, Transport

WIDTH = 1.0  # cells
WIDENED = 1.0 / 12.0 + 1.0 / 6.0  # variance [cells²] added by means over cells and interpolation


class Handover:
    """Handover of wide puffs: their gas is deposited on the grid, and the wind transports it there.

    solver: `PuffSolver` whose puffs are handed over; convection: key of the convection scheme; diffusivity [m²/s]: by
    molecules and all motion that the wind does not resolve.
    """

    STATE = ("transport",)

    def __init__(self, solver: Any, wind: Carrier, air: Air, convection: str, diffusivity: float):
        self.solver, self.grid, self.wind = solver, solver.grid, wind
        self.limit = (WIDTH * self.grid.dx) ** 2
        self.air = self.grid.filled(self.grid.pad(~air.solid))
        scheme = LIMITED[convection]
        self.transport = Transport(self.grid, wind, air, scheme, Scalar(self.grid), diffusivity, wind.schmidt)
        self._deposit = Deposit(solver, air, self.transport.q, self.transport.rest)

    def advance(self, t: float, dt: float) -> None:
        """Move the mass of wide puffs to the grid, then advance the gas on the grid from t to t + dt [s]."""
        self._take(t)
        steps = self.transport.steps(dt)
        for _ in range(steps):
            self.transport.step(dt / steps)

    @ti.kernel
    def _take(self, t: float):
        for _ in range(1):  # one after another: puffs share cells
            puffs = self.solver.puffs
            for q in range(puffs.cells.alive()):
                variance = puffs.now[puffs.variance][q]
                if variance >= self.limit:
                    narrow = ti.sqrt(variance - ti.static(WIDENED * self.grid.dx**2))
                    mass = puffs.now[puffs.mass][q]
                    held = self._deposit.add(0, q, narrow, t)
                    if held > 0.0:  # otherwise no cell of air holds a part of the puff
                        puffs.now[puffs.mass][q] = 0.0
                        puffs.lose((1.0 - held) * mass)

    @ti.func
    def concentration(self, x: Template):
        """Return the concentration on the grid [kg/m³] at point x [m], linear between the centres of cells with air."""
        return sample_cells(self.transport.q, self.air, x, self.grid.dx, self.grid.ghost, self.grid.padded)

    def cells(self) -> np.ndarray:
        """Return the concentration of every cell [kg/m³], an array of the grid's shape."""
        return self.grid.read(self.transport.q)
