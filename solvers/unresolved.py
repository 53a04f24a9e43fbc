"""Fluctuations of gas by eddies smaller than a cell, as a gas sensor feels them.

A cell stores a mean. Eddies that it does not resolve make the gas fluctuate about it, with the variance at which they
make as much by stirring the mean gradient as mixing removes,

    var c = dx² |grad c|²/C  K/(K + D),   K = (0.17 dx)² |grad u|/0.7,

the equilibrium of the variance equation with the mixing rate C (K + D)/dx² of filtered density functions (Colucci et
al. 1998, doi:10.1063/1.869537). D is the diffusivity of the gas, K the eddy diffusivity of Smagorinsky's model with the
constant of isotropic turbulence and a turbulent Schmidt number of 0.7. It vanishes in air without eddies; where the
cells resolve the plume, the variance falls with dx^4. C = 4 is our choice: in large-eddy simulations of flames the
variance is 0.1 to 0.2 (code_saturne: 0.14) times the square of the gradient and of the filter's width, which is one to
two cells, so that C is 1.3 to 10.

The gas at a sensor is log-normal about the mean of the cells, so that its expected value is this mean and it is never
negative. A fluctuation is forgotten while eddies of a cell pass by the sensor, in dx over the speed of the air relative
to the sensor and of the unresolved eddies, dx |grad u|/2. Sensors fluctuate independently, however close they are.
"""

from taichi_plume.engine import ti
from taichi_plume.grid.fields import GridGas, Wind
from taichi_plume.grid.kernels import Template

MIXING = 4.0  # C
EDDIES = 0.17**2 / 0.7  # K over dx² |grad u|


class Unresolved:
    """Unresolved fluctuations of a gas on the grid in a wind. diffusivity: of the gas [m²/s]."""

    def __init__(self, gas: GridGas, wind: Wind, diffusivity: float):
        self.gas, self.wind, self.diffusivity = gas, wind, diffusivity
        self.dx, self.dim = gas.grid.dx, gas.grid.dim

    @ti.func
    def difference(self, x: Template, t: float):
        """Return the change of the wind over a cell, dx |grad u| [m/s], at point x [m] and time t [s]."""
        square = 0.0
        for d in range(self.dim):  # no static loop: each of its samples would be compiled
            half = self._half(d)
            square += (self.wind.velocity(x + half, t) - self.wind.velocity(x - half, t)).norm_sqr()
        return ti.sqrt(square)

    @ti.func
    def deviation(self, x: Template, difference, t: float):
        """Return the standard deviation of the concentration [kg/m³] at point x [m] and time t [s]."""
        square = 0.0
        for d in range(self.dim):
            half = self._half(d)
            square += (self.gas.concentration(x + half, t) - self.gas.concentration(x - half, t)) ** 2
        K = EDDIES * self.dx * difference
        return ti.sqrt(square / MIXING * K / (K + self.diffusivity))

    @ti.func
    def turnover(self, x: Template, v: Template, difference, t: float):
        """Return the rate [1/s] at which eddies of a cell pass a sensor at x [m] that moves with velocity v [m/s]."""
        return ((self.wind.velocity(x, t) - v).norm() + difference / 2.0) / self.dx

    @ti.func
    def _half(self, d):
        """Return the vector of half a cell [m] along axis d."""
        half = ti.Vector.zero(ti.f32, self.dim)
        for k in ti.static(range(self.dim)):
            half[k] = ti.select(k == d, 0.5 * self.dx, 0.0)
        return half
