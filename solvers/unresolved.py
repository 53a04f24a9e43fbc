"""Fluctuations of gas by eddies smaller than a cell, as a gas sensor feels them.

A cell stores a mean. Eddies that it does not resolve make the gas fluctuate about it, with the variance at which they
make as much by stirring the mean gradient as mixing removes,

    var c = dx² |grad c|²/C,   var u = dx² |grad u|²/C,   C = 4,

the equilibrium of the variance equation with the mixing rate C K/dx² of an eddy diffusivity K (filtered density
function; Colucci et al. 1998, doi:10.1063/1.869537; C by Jaberi et al. 1999, doi:10.1017/S0022112099006643). It falls
with the square of dx: where the cells resolve the plume, it vanishes. The gas at a sensor is log-normal about the mean
of the cells, so that its expected value is this mean and it is never negative. A fluctuation is forgotten while eddies
of a cell pass by the sensor, in dx over the speed of the air relative to the sensor and of the unresolved eddies.
"""

from taichi_plume.engine import ti
from taichi_plume.grid.fields import GridGas, Wind
from taichi_plume.grid.kernels import Template

MIXING = 4.0  # C


class Unresolved:
    """Unresolved fluctuations of a gas on the grid in a wind."""

    def __init__(self, gas: GridGas, wind: Wind):
        self.gas, self.wind = gas, wind
        self.dx, self.dim = gas.grid.dx, gas.grid.dim

    @ti.func
    def deviation(self, x: Template, t: float):
        """Return the standard deviation of the concentration [kg/m³] at point x [m] and time t [s]."""
        square = 0.0
        for d in ti.static(range(self.dim)):
            half = 0.5 * self.dx * ti.Vector.unit(self.dim, d, ti.f32)
            square += (self.gas.concentration(x + half, t) - self.gas.concentration(x - half, t)) ** 2
        return ti.sqrt(square / MIXING)

    @ti.func
    def turnover(self, x: Template, v: Template, t: float):
        """Return the rate [1/s] at which eddies of a cell pass a sensor at x [m] that moves with velocity v [m/s]."""
        square = 0.0
        for d in ti.static(range(self.dim)):
            half = 0.5 * self.dx * ti.Vector.unit(self.dim, d, ti.f32)
            square += (self.wind.velocity(x + half, t) - self.wind.velocity(x - half, t)).norm_sqr()
        return ((self.wind.velocity(x, t) - v).norm() + ti.sqrt(square / MIXING)) / self.dx
