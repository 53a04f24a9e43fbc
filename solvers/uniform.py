"""The simplest wind: one constant velocity everywhere."""

import taichi as ti

from taichi_plume.grid import Grid
from taichi_plume.kernels import Template
from taichi_plume.winds import UniformWind


@ti.data_oriented
class UniformSolver:
    """A wind that does not change; satisfies `fields.Wind` and carries gas on the grid like a flow solver."""

    nu = None  # no eddies
    area = None  # through obstacles
    viscosity = max_viscosity = 0.0
    schmidt = 1.0

    def __init__(self, wind: UniformWind, grid: Grid):
        self.grid = grid
        self.mean = wind.velocity
        self.outflow_rate = sum(abs(speed) for speed in wind.velocity) / grid.dx
        self.u = grid.faces_field()
        self.open = grid.faces_field()
        for d, speed in enumerate(wind.velocity):
            self.u[d].fill(speed)
            self.open[d].fill(1.0)

    def stable_dt(self, t: float = 0.0) -> float:
        """No limit of its own."""
        return float("inf")

    def advance(self, t: float, dt: float) -> None:
        """Nothing changes."""

    @ti.func
    def velocity(self, x: Template, t: float):
        """The velocity [m/s]."""
        return ti.Vector([ti.cast(speed, ti.f32) for speed in ti.static(self.mean)])
