"""The simplest wind: one velocity everywhere, constant or with gusts across it."""

import numpy as np
import taichi as ti

from taichi_plume.grid.grid import Grid
from taichi_plume.grid.kernels import Template
from taichi_plume.grid.rng import generator
from taichi_plume.scenario.winds import UniformWind
from taichi_plume.solvers.gusts import OrnsteinUhlenbeck

LONGEST_TICK = 1.0  # s


def memory(wind: UniformWind, extent: tuple[float, ...]) -> float:
    """For how long [s] the gusts are remembered: for as long as air takes through the domain, and a tick."""
    crossing = np.abs(wind.frame[0]) @ extent / wind.speed
    return float(crossing) + LONGEST_TICK


@ti.kernel
def _fill(field: Template, value: ti.f32):
    """`field.fill` compiles anew for every value."""
    for I in ti.grouped(field):
        field[I] = value


@ti.data_oriented
class UniformSolver:
    """A wind that is the same everywhere; satisfies `fields.Wind` and carries gas on the grid like a flow solver.

    With gusts, the face velocities u are those of the last step in the mean, so that gas on the grid is carried as far
    as the air has gone.
    """

    nu = None  # no eddies
    area = None  # through obstacles
    viscosity = max_viscosity = 0.0
    schmidt = 1.0

    def __init__(self, wind: UniformWind, grid: Grid, begin: float = 0.0, seed: int = 0):
        """begin: start of the run [s]."""
        self.grid = grid
        self.model = wind
        self.dim = grid.dim
        self.mean = wind.velocity
        self.across = wind.frame[1:]
        self.gusts = None
        self.gusty = wind.gusts is not None
        self.u = grid.faces_field()
        self.open = grid.faces_field()
        for d in range(grid.dim):
            self.open[d].fill(1.0)
        self._carry(np.array(self.mean))
        if wind.gusts is not None:
            self.gusts = OrnsteinUhlenbeck(
                [share * wind.speed for share in wind.gusts.deviations(grid.dim)],
                wind.gusts.time,
                begin,
                memory(wind, grid.extent),
                generator(seed, "gusts"),
            )
            self.gust = ti.Vector.field(grid.dim, ti.f32, ())
            self.advance(begin, 0.0)

    def _carry(self, velocity: np.ndarray) -> None:
        for d, speed in enumerate(velocity):
            _fill(self.u[d], speed)
        self.outflow_rate = float(np.abs(velocity).sum()) / self.grid.dx

    def stable_dt(self, t: float = 0.0) -> float:
        """No limit of its own."""
        return float("inf")

    def advance(self, t: float, dt: float) -> None:
        """Go on to time t + dt."""
        if self.gusts is None:
            return
        before, gust = self.gusts.at(t)
        self.gusts.advance(t + dt)
        after, now = self.gusts.at(t + dt)
        self.gust[None] = now @ self.across
        self._carry(self.mean + ((after - before) / dt if dt > 0.0 else gust) @ self.across)

    def displacement(self, t: float) -> np.ndarray:
        """How far [m] gusts have carried the air up to time t, not further back than the memory goes, nor ahead."""
        return np.zeros(self.dim) if self.gusts is None else self.gusts.at(t)[0] @ self.across

    @ti.func
    def velocity(self, x: Template, t: float):
        """The velocity [m/s]; the time is the solver's own."""
        u = ti.Vector([ti.cast(speed, ti.f32) for speed in ti.static(self.mean)])
        if ti.static(self.gusty):
            u += self.gust[None]
        return u
