"""Gaussian plumes of steady sources in a uniform wind: the mean plume, and one that gusts sweep to and fro.

    c = Q/U prod_k exp(-(q_k - q0_k - Y_k)²/(2 s_k²))/(sqrt(2 pi) s_k)

over the axes k across the wind, in 2-D divided by the depth of the slab. s_k grows with the distance x downwind. In the
mean plume Y is zero. In the meandering one it is how far gusts have carried the air since it passed the source, x/U
ago: the plume is where the air is in which the robots' anemometers have seen those gusts. The straight rays that are
often taken instead, Y = x v(t - x/U)/U, are the same for x << U T, T the gusts' integral time: in the mean both are as
wide as the intensity of the gusts times x. Beyond, the air forgets where its gusts had been going, and the mean plume
widens as by diffusion, with the root of x.
"""

import numpy as np
import taichi as ti

from taichi_plume.grid.grid import Grid
from taichi_plume.grid.kernels import Template, listed
from taichi_plume.grid.rng import generator
from taichi_plume.scenario.closed_forms import GaussianPlumeGas, MeanderingGas
from taichi_plume.solvers.gaussian_puffs import bells
from taichi_plume.solvers.gusts import OrnsteinUhlenbeck
from taichi_plume.solvers.uniform import UniformSolver, memory


@ti.data_oriented
class Plumes:
    """Gaussian plumes, mean or meandering; satisfies `fields.Gas`.

    Variance of the Gaussians: radius² + (b radius + c) x + d x², with b, c, d per axis across the wind.
    """

    def __init__(
        self,
        gas: GaussianPlumeGas | MeanderingGas,
        grid: Grid,
        wind: UniformSolver,
        begin: float = 0.0,
        seed: int = 0,
        name: str = "gas",
    ):
        """name: of the gas among others; begin: start of the run [s]."""
        model = wind.model
        self.dim = grid.dim
        self.species = gas.vapour
        self.wind = wind
        self.count = len(gas.sources)
        self.speed = model.speed
        self.axes = tuple(tuple(axis) for axis in model.frame)
        self.bells = bells(gas.reflecting(grid.dim), model.frame[1:], grid.extent)
        self.growth = tuple(tuple(map(float, row)) for row in self._growth(gas).T)
        self.meanders = isinstance(gas, MeanderingGas)
        self.width = None
        self.fluctuation = gas.width_fluctuation if isinstance(gas, MeanderingGas) else 0.0
        if self.fluctuation and model.gusts is not None:
            reach, rng = memory(model, grid.extent), generator(seed, f"{name}.width_fluctuation")
            self.width = OrnsteinUhlenbeck([self.fluctuation], model.gusts.time, begin, reach, rng)
        depth = grid.depth if grid.dim == 2 else 1.0
        self.place = listed(np.array([source.position for source in gas.sources]))
        self.flow = listed(
            np.array([source.rate / self.speed / depth for source in gas.sources])
        )  # kg/m or kg/m²
        self.radius = listed(np.array([source.radius for source in gas.sources]))

    def _growth(self, gas: GaussianPlumeGas | MeanderingGas) -> np.ndarray:
        """b, c and d, rows of one per axis across the wind."""
        size, zero = self.dim - 1, np.zeros(self.dim - 1)
        if isinstance(gas, MeanderingGas):
            return np.array([zero, zero, np.array([gas.width_slope, gas.height_slope])[:size] ** 2])
        if gas.intensity is not None:  # (radius + intensity x)²
            intensity = np.broadcast_to(gas.intensity, size)
            return np.array([2.0 * intensity, zero, intensity**2])
        assert gas.diffusivity is not None
        return np.array([zero, 2.0 * np.broadcast_to(gas.diffusivity, size) / self.speed, zero])

    def advance(self, t: float, dt: float) -> None:
        """Go on to time t + dt, as the wind has done."""
        if self.width is not None:
            self.width.advance(t + dt)

    def is_finite(self) -> bool:
        """A closed form always is."""
        return True

    @ti.func
    def concentration(self, x: Template, t: float):
        """Concentration [kg/m³] at point x [m]; the time is the wind's own."""
        total = 0.0
        for n in range(self.count):
            along = self._component(x - self.place[n], 0)
            if along > 0.0:
                total += self._cross_section(x, along, n)
        return total

    @ti.func
    def _cross_section(self, x: Template, along: float, n: ti.i32):
        """Concentration of the plume of source n at x, a distance `along` [m] downwind."""
        age = along / self.speed
        carried = ti.Vector.zero(ti.f32, self.dim - 1)
        if ti.static(self.meanders):
            carried, _ = self.wind.gusts.before(age)
        c = self.flow[n]
        for k in ti.static(range(self.dim - 1)):
            radius = self.radius[n]
            g = ti.static(self.growth[k])
            variance = radius**2 + (g[0] * radius + g[1] + g[2] * along) * along
            if ti.static(k == 0 and self.fluctuation > 0.0):
                _, wider = self.width.before(age)
                variance *= ti.exp(2.0 * wider[0] - self.fluctuation**2)
            centre = self._component(self.place[n], k + 1) + carried[k]
            c *= self.bells[k](self._component(x, k + 1), centre, variance)
        return c

    @ti.func
    def _component(self, x: Template, k: Template):
        """Of x along an axis of the wind's frame [m]."""
        result = 0.0
        for d in ti.static(range(self.dim)):
            result += ti.static(float(self.axes[k][d])) * x[d]
        return result
