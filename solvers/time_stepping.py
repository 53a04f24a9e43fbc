"""Time stepping of the flow: three-stage Runge-Kutta method and limits of the step (Courant number, CFL condition)."""

from math import prod, sqrt
from typing import cast

import numpy as np

from taichi_plume.engine import ti
from taichi_plume.engine.fields import LANES, on_cpu
from taichi_plume.grid.kernels import Pass
from taichi_plume.solvers.convection import greater, lesser
from taichi_plume.solvers.momentum import Momentum

# Shortest first stage over the step with which no wave grows by fifth-order upwind convection, at Courant numbers 2 %
# above these; linear between them.
COURANT, FIRST = (1.1, 1.2, 1.3, 1.4), (0.5, 0.54, 0.64, 1.0)


def stages_for(courant: float) -> tuple[tuple[float, float, float], ...]:
    """Return the Runge–Kutta coefficients (see `stages`) with the least damping for this Courant number."""
    return stages(float(np.interp(courant, COURANT, FIRST)))


def stages(first: float) -> tuple[tuple[float, float, float], ...]:
    """Return the coefficients (k, c, g) of each stage of the Runge-Kutta method.

    After a stage u = u0 + k (u - u0 + dt du/dt) approximates the velocity at t + c dt. The stage ends with a pressure
    projection if g > 0; the pressure is then g dt old.

    The method is of second order for any `first`, the length of the first stage over the step's. With 1 it is SSP-RK3
    (Shu & Osher 1988, doi:10.1016/0021-9991(88)90177-5), which damps waves that the wind carries: the energy of a wave
    that advances by the phase a per step is multiplied by 1 - a⁴/12. In general the factor is 1 - (2 C - 1/4) a⁴ + C²
    a⁶, with C = first/(2 + 4 first). From 1/2 on only the last term lets the energy grow. The upwind scheme of
    convection outweighs this term up to a Courant number that rises with `first`.

    With only the last projection, short waves that move by about a cell per step would lose or gain energy. A
    projection after the first stage has no effect.
    """
    second = 1.0 / (1.0 + 3.0 * first)
    third = (1.0 + 3.0 * first) / (2.0 + 4.0 * first)
    reached = second * (1.0 + first)
    return (first, first, 0.0), (second, reached, reached), (third, 1.0, third)


HUGE = 1e6  # m/s: far above the speed of any flow here


class Limits:
    """Maxima over the cells that limit the time step: sum of |u| over the axes, outflow, |u|, viscosity and the rate at
    which convection and diffusion together change a cell (see `weights`).

    The outflow of a cell is over a face's area. Values that are not finite count as HUGE.
    """

    def __init__(self, momentum: Momentum):
        self.m = momentum
        self.grid, self.dim = momentum.grid, momentum.dim
        self._rows = tuple(reversed(self.grid.cells[1:]))
        self._found = ti.field(ti.f32, 5)
        # Maxima of every 8th cell of a row, on a CPU: LLVM does not vectorise a maximum along a row.
        self._width = LANES if on_cpu() else 1

    @ti.func
    def _cell(self, J, i):
        """Return the index, ghost cells included, of the i-th cell of the grid row J."""
        return ti.Vector([i + self.grid.ghost] + [J[self.dim - 1 - d] for d in ti.static(range(1, self.dim))])

    def passes(self) -> tuple[Pass, Pass]:
        """Return the two passes that clear and compute the maxima; their arguments are the two `weights`."""
        return Pass(self._clear, 1), Pass(self._measure, prod(self.grid.shape))

    @ti.func
    def _clear(self, convection, diffusion):
        for n in range(5):
            self._found[n] = 0.0

    @ti.func
    def _measure(self, convection, diffusion):
        for J in ti.grouped(ti.ndrange(*self._rows)):
            width, cells = ti.static(self._width, self.grid.shape[0])
            most, out = ti.Vector([0.0] * width), ti.Vector([0.0] * width)
            fastest, stickiest = ti.Vector([0.0] * width), ti.Vector([0.0] * width)
            quickest = ti.Vector([0.0] * width)
            for k in range((cells + width - 1) // width):
                strip = ti.row(J, (self.m.u[0],), self.dim, 0, self.grid.ghost + k * width)
                for n in range(width):
                    of_cell = self._of_cell(ti.along(strip, n), convection, diffusion)
                    inside = k * width + n < cells
                    most[n] = greater(most[n], ti.select(inside, of_cell[0], 0.0))
                    out[n] = greater(out[n], ti.select(inside, of_cell[1], 0.0))
                    fastest[n] = greater(fastest[n], ti.select(inside, of_cell[2], 0.0))
                    stickiest[n] = greater(stickiest[n], ti.select(inside, of_cell[3], 0.0))
                    quickest[n] = greater(quickest[n], ti.select(inside, of_cell[4], 0.0))
            ti.atomic_max(self._found[0], most.max())
            ti.atomic_max(self._found[1], out.max())
            ti.atomic_max(self._found[2], fastest.max())
            ti.atomic_max(self._found[3], stickiest.max())
            ti.atomic_max(self._found[4], quickest.max())

    @ti.func
    def _of_cell(self, I, convection, diffusion):
        total, out, fastest, viscosity = 0.0, 0.0, 0.0, 0.0
        for d in ti.static(range(self.dim)):
            low, high = self.m.u[d][I], self.m.u[d][I + ti.Vector.unit(self.dim, d, ti.i32)]
            speed = greater(ti.abs(low), ti.abs(high))
            total += speed
            fastest = greater(fastest, speed)
            out += greater(high, 0.0) - lesser(low, 0.0)
        if ti.static(self.m.eddies):
            viscosity = self.m.nu[I]
        rate = convection * total + diffusion * greater(viscosity, self.m.viscosity[None])
        return ti.Vector([ti.select(total < HUGE, total, HUGE), out, fastest, viscosity, rate])

    def read(self) -> tuple[float, ...]:
        """Return the maxima: sum of |u|/dx [1/s], outflow/dx [1/s], |u| [m/s], viscosity [m²/s] and rate [1/s]."""
        speed_sum, out, speed, viscosity, rate = (float(value) for value in self._found.values)
        return speed_sum / self.grid.dx, out / self.grid.dx, speed, viscosity, rate

    @ti.kernel
    def _strongest_buoyancy(self) -> ti.f32:
        """Return the largest acceleration by buoyancy over the cells [m/s²], summed over its components."""
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

    def weights(self, courant: float) -> tuple[float, float]:
        """Return the weights of the sum of |u| [1/m] and of the viscosity [1/m²] in the rate of a cell [1/s].

        The step may be one over the largest rate: by the Courant number (CFL) and by diffusion, each in the same cell.
        """
        # More careful than diffusion alone demands (1.6 times the dimension): the pressure lags behind in the first
        # stage, and its error grows when viscosity spreads it too fast. Eddies' stress has a second part.
        diffusion = (3.75 if self.m.eddies else 2.5) * self.dim / self.grid.dx**2
        return 1.0 / (courant * self.grid.dx), diffusion

    def longest_step(self, rate: float, courant: float) -> float:
        """Return the largest time step [s] for the largest rate of a cell [1/s] (see `weights`) and for buoyancy."""
        limit = max(rate, 1e-30)
        # The growth of |u| by buoyancy within the step counts as well; near a corner the pressure turns and more than
        # doubles it. Waves in stratified air are slower.
        strongest = cast(float, self._strongest_buoyancy()) if self.m.weighing else 0.0
        return 2.0 / (limit + sqrt(limit**2 + 12.0 * strongest / (courant * self.grid.dx)))
