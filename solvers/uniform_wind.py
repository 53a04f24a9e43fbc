"""Uniform wind: the same velocity everywhere, constant or with gusts across the wind."""

import numpy as np

from taichi_plume.engine import ti
from taichi_plume.grid.fields import Carrier
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.kernels import Template
from taichi_plume.grid.rng import generator
from taichi_plume.scenario.winds import UniformWind
from taichi_plume.solvers.gusts import OrnsteinUhlenbeck

LONGEST_TICK = 1.0  # s


def memory(wind: UniformWind, extent: tuple[float, ...]) -> float:
    """Return the time [s] for which gusts are stored: the time that air takes through the domain, plus a tick."""
    crossing = np.abs(wind.frame[0]) @ extent / wind.speed
    return float(crossing) + LONGEST_TICK


class UniformSolver(Carrier):
    """Wind with the same velocity everywhere, constant or with gusts.

    With gusts, the face velocities u are the means over the last step, so that gas on the grid moves exactly with the
    air. Field now: the present velocity [m/s].
    """

    STATE = ("u", "now", "outflow_rate", "gusts")

    def __init__(self, wind: UniformWind, grid: Grid, t: float = 0.0, seed: int = 0):
        self.grid = grid
        self.dim = grid.dim
        self.u = grid.faces_field()
        self.open = tuple(grid.filled(np.ones(grid.padded)) for _ in self.u)
        self.now = ti.vector_field(grid.dim, ti.f32, ())
        self.gusts: OrnsteinUhlenbeck | None = None
        if wind.gusts is None:
            self.STATE = ()  # the velocity follows from the scenario alone
        self.model = wind
        self.mean = wind.velocity
        self.across = wind.frame[1:]
        self._set_velocity(np.array(self.mean), np.zeros(self.dim))
        if wind.gusts is not None:
            deviations = [share * wind.speed for share in wind.gusts.deviations(self.dim)]
            reach, rng = memory(wind, grid.extent), generator(seed, "gusts")
            self.gusts = OrnsteinUhlenbeck(deviations, wind.gusts.time, t, reach, rng)
            self.advance(t, 0.0)

    def _set_velocity(self, carrying: np.ndarray, gust: np.ndarray) -> None:
        """Set the velocity of the faces, `carrying` [m/s], and the present velocity, the mean plus `gust` [m/s]."""
        felt = np.array(self.mean, np.float32) + gust.astype(np.float32)
        self._fill(*(np.append(u, [0.0] * (3 - self.dim)) for u in (carrying, felt)))
        self.outflow_rate = float(np.abs(carrying).sum()) / self.grid.dx

    @ti.kernel
    def _fill(self, carrying: ti.math.vec3, felt: ti.math.vec3):
        for d in ti.static(range(self.dim)):
            self.now[None][d] = felt[d]
        for d in ti.static(range(self.dim)):
            for I in ti.grouped(ti.ndrange(*self.u[d].shape)):
                self.u[d][I] = carrying[d]

    def advance(self, t: float, dt: float) -> None:
        if self.gusts is None:
            return
        before, gust = self.gusts.at(t)
        self.gusts.advance(t + dt)
        after, now = self.gusts.at(t + dt)
        carrying = self.mean + ((after - before) / dt if dt > 0.0 else gust) @ self.across
        self._set_velocity(carrying, now @ self.across)

    def displacement(self, t: float) -> np.ndarray:
        """Return the displacement (dim,) [m] of the air by gusts up to time t [s], which must be within the memory."""
        return np.zeros(self.dim) if self.gusts is None else self.gusts.at(t)[0] @ self.across

    @ti.func
    def velocity(self, x: Template, t: float):
        return self.now[None]

    @ti.func
    def solenoidal_velocity(self, x: Template, t: float):
        return self.now[None]
