"""How large the flow is: what bounds the step."""

from math import sqrt
from typing import Any

import taichi as ti

from taichi_plume.grid.transfer import reader
from taichi_plume.solvers.momentum import Momentum

HUGE = 1e6  # m/s: no flow of ours is as fast


@ti.data_oriented
class Limits:
    """Maxima over the cells: sum of |u| over the axes, flow out of the cell (both over a face's area), |u|, viscosity.

    What is not finite counts as huge.
    """

    def __init__(self, momentum: Momentum):
        self.m = momentum
        self.grid, self.dim = momentum.grid, momentum.dim
        self._rows = tuple(reversed(self.grid.cells[1:]))
        self._found = ti.field(ti.f32, 4)
        self._read = reader(self._found)

    @ti.func
    def _cell(self, J, i):
        """Index of the i-th cell of row J."""
        return ti.Vector([i + self.grid.ghost] + [J[self.dim - 1 - d] for d in ti.static(range(1, self.dim))])

    @ti.func
    def clear(self):
        """Forget what was measured."""
        for n in range(4):
            self._found[n] = 0.0

    @ti.func
    def measure(self):
        """Take the maxima."""
        for J in ti.grouped(ti.ndrange(*self._rows)):
            most, most_out, fastest, stickiest = 0.0, 0.0, 0.0, 0.0
            for i in range(self.grid.shape[0]):
                I = self._cell(J, i)
                total, out = 0.0, 0.0
                for d in ti.static(range(self.dim)):
                    low, high = self.m.u[d][I], self.m.u[d][I + ti.Vector.unit(self.dim, d, ti.i32)]
                    speed = ti.max(ti.abs(low), ti.abs(high))
                    total += speed
                    fastest = ti.max(fastest, speed)
                    out += ti.max(high, 0.0) - ti.min(low, 0.0)
                most = ti.max(most, ti.select(total < HUGE, total, HUGE))
                most_out = ti.max(most_out, out)
                if ti.static(self.m.eddies):
                    stickiest = ti.max(stickiest, self.m.nu[I])
            ti.atomic_max(self._found[0], most)
            ti.atomic_max(self._found[1], most_out)
            ti.atomic_max(self._found[2], fastest)
            ti.atomic_max(self._found[3], stickiest)

    def read(self) -> tuple[float, ...]:
        """The maxima, the first two over dx [1/s]."""
        speed_sum, out, speed, viscosity = (float(value) for value in self._read()[0])
        return speed_sum / self.grid.dx, out / self.grid.dx, speed, viscosity

    @ti.kernel
    def _strongest_buoyancy(self) -> ti.f32:
        """Largest acceleration by buoyancy, its components' magnitudes summed [m/s²]."""
        result = 0.0
        for J in ti.grouped(ti.ndrange(*self._rows)):
            most = 0.0
            for i in range(self.grid.shape[0]):
                I = self._cell(J, i)
                total = 0.0
                for d in ti.static(range(self.dim)):
                    component = 0.0
                    for n in ti.static(range(len(self.m.weighing))):
                        component += self.m.weighing[n][I] * self.m.pull[n][d]
                    total += ti.abs(component)
                most = ti.max(most, total)
            ti.atomic_max(result, most)
        return result

    def longest_step(self, rate: float, courant: float, viscosity: float) -> float:
        """The step [s] that keeps the Courant number at its limit and diffusion stable.

        rate: largest sum of |u|/dx over the axes [1/s]; viscosity: the largest [m²/s].
        """
        # Twice as careful as diffusion alone demands: the pressure lags behind in the first stage, and its error grows
        # when viscosity spreads it too fast.
        diffusion = (6.0 if self.m.eddies else 4.0) * self.dim * viscosity / self.grid.dx**2
        limit = max(rate / courant + diffusion, 1e-30)
        # What buoyancy adds to |u| within the step counts as well; near a corner the pressure turns and more than
        # doubles it. Waves in layered air are slower than that.
        strongest: Any = self._strongest_buoyancy() if self.m.weighing else 0.0
        return 2.0 / (limit + sqrt(limit**2 + 12.0 * strongest / (courant * self.grid.dx)))
