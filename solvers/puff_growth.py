"""Growth of puffs: molecular diffusion, eddy viscosity of the wind, and relative dispersion (Richardson's law).

A puff among eddies of the inertial range grows as R^(2/3) = R0^(2/3) + (g epsilon/6)^(1/3) t. Unless given, the
dissipation epsilon is estimated from the wind around the puff. The differences of the velocity over r = 4 cells are
used, as the grid resolves these well. The law is Kolmogorov's, with the constant of Sreenivasan (1995,
doi:10.1063/1.868656) and Taylor's and Obukhov's 4/3 for the components across r:

    epsilon^(1/3) = |u(x + r/2) - u(x - r/2)| / (C W (1 + 4/3 (dim - 1)) r^(2/3))^(1/2),  C = 2.1

W is the share of waves longer than r in the square of the difference, as shorter waves are not in the wind: with E ~
k^(-5/3), 1 - I(2 pi)/I(0), I(a) the integral of x^(-5/3) (1 - sin(x)/x) from a on. epsilon^(1/3) is averaged over the
axes, so that a mean shear, along a single axis, counts little. The wind resolves eddies larger than a cell: a puff
wider than a cell keeps its growth rate, which is never below that of gas on the grid.
"""

from math import gamma, sqrt

import numpy as np

from taichi_plume.engine import ti
from taichi_plume.engine.fields import Field
from taichi_plume.grid.fields import Wind, corner, corner_weight
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.kernels import Template
from taichi_plume.scenario.gases import PuffGas

GROWTH = 1e-4  # m²/s, default in a wind without eddies
DISSIPATION = 1e-3  # m²/s³, default dissipation of inertial growth there
RICHARDSON = 0.5  # Richardson's constant of the distance of two particles
KOLMOGOROV = 2.1  # constant of the second-order structure function along the separation
RESOLVED = 0.64  # W, fraction of the difference by waves that the grid resolves
HALF = 2  # cells to either side: half of r


def rate_per_difference(dim: int) -> float:
    """Return the growth rate of R^(2/3) [m^(2/3)/s] over the mean of |u(x + r) - u(x)| / r^(1/3), for Gaussian u."""
    mean_per_rms = sqrt(2.0 / dim) * gamma(0.5 * (dim + 1)) / gamma(0.5 * dim)
    square = KOLMOGOROV * RESOLVED * (1.0 + 4.0 / 3.0 * (dim - 1))
    return (RICHARDSON / 6.0) ** (1 / 3) / (mean_per_rms * sqrt(square))


class Growth:
    """Law by which puffs grow in a wind: molecular and eddy diffusion, and relative dispersion."""

    def __init__(self, gas: PuffGas, grid: Grid, wind: Wind, alone: bool):
        """alone: whether the wind has no eddies, so that puffs grow by a default rate."""
        self.grid, self.dim, self.wind = grid, grid.dim, wind
        carrier = wind.carrier
        self.eddies: Field = carrier.nu if carrier is not None else None
        self.eddying = self.eddies is not None
        self.u: Field = carrier.u if carrier is not None else ()
        law = gas.growth
        self.local = self.eddying and (law is None or (law.kind == "inertial" and law.dissipation is None))
        self.inertial = self.local or (law is not None and law.kind == "inertial")
        rate = (GROWTH if alone else 0.0) if law is None or law.kind != "diffusive" else law.rate
        if self.local:
            rate = rate_per_difference(self.dim)
        elif law is not None and law.kind == "inertial":
            rate = (RICHARDSON * (law.dissipation or DISSIPATION) / 6.0) ** (1 / 3)
        self.diffusive = 0.0 if self.inertial else 0.5 * rate
        """Diffusivity [m²/s] of a given diffusive growth law, without molecules and eddies; 0 for other laws."""
        self._rate, self._widest = ti.filled(rate), ti.filled(grid.dx ** (2 / 3))
        self._diffusivity = ti.filled(gas.vapour.diffusivity)
        if carrier is not None:
            self._viscosity = ti.filled(carrier.viscosity)
            self._per_schmidt = ti.filled(1.0 / float(np.float32(carrier.schmidt)))
            self._uphill = ti.filled(1.0 / float(np.float32(carrier.schmidt * grid.dx)))

    @ti.func
    def grown(self, variance: float, x: Template, K: float, dt: float):
        """Return the variance [m²] after dt [s] of a puff at x [m]; K: eddy diffusivity there [m²/s]."""
        rate, after = self._rate[None], variance
        if ti.static(self.local):
            rate *= self._difference(x)
            width = ti.pow(variance, 1.0 / 3.0)
            gain = ti.math.clamp(self._widest[None] - width, 0.0, dt * rate)
            after = (width + gain) ** 3 + 3.0 * self._widest[None] ** 2 * (dt * rate - gain)
            after = ti.max(after, variance + 2.0 * dt * K)
        elif ti.static(self.inertial):
            after = (ti.pow(variance, 1.0 / 3.0) + rate * dt) ** 3 + 2.0 * dt * K
        else:
            after += dt * (rate + 2.0 * K)
        return after + 2.0 * dt * self._diffusivity[None]

    @ti.func
    def _difference(self, x: Template):
        """Return the velocity difference across r = 4 cells around x (fewer at faces) over r^(1/3), axis mean."""
        total = 0.0
        I = ti.Vector.zero(ti.i32, self.dim)
        for d in ti.static(range(self.dim)):
            n = ti.static(self.grid.shape[d])
            I[d] = ti.math.clamp(ti.cast(x[d] / self.grid.dx, ti.i32), 0, n - 1)
        for e in ti.static(range(self.dim)):
            low, high = I, I
            low[e] -= HALF
            high[e] += HALF
            if ti.static(not self.grid.periodic[e]):
                low[e] = ti.max(low[e], 0)
                high[e] = ti.min(high[e], ti.static(self.grid.shape[e] - 1))
            square = 0.0
            for d in ti.static(range(self.dim)):
                ghost = ti.static(self.grid.ghost)
                square += (self.u[d][high + ghost] - self.u[d][low + ghost]) ** 2
            cells = ti.cast(ti.max(high[e] - low[e], 1), ti.f32)
            total += ti.sqrt(square) * ti.pow(cells * self.grid.dx, -1.0 / 3.0)
        return total * ti.static(1.0 / self.dim)

    @ti.func
    def eddy_diffusivity(self, x: Template):
        """Return the eddy diffusivity nu_t/Sc_t [m²/s] at x and its gradient [m/s]."""
        K, uphill = 0.0, ti.Vector.zero(ti.f32, self.dim)
        if ti.static(self.eddying):
            shift = ti.Vector([0.5] * self.dim)
            base, weight = corner(x, shift, self.grid.dx, self.grid.ghost, self.grid.padded)
            I = ti.cell(base, (self.eddies,))
            for offset in ti.static(ti.grouped(ti.ndrange(*((2,) * self.dim)))):
                nu = ti.max(self.eddies[I + offset] - self._viscosity[None], 0.0)
                K += corner_weight(weight, offset) * nu
                for d in ti.static(range(self.dim)):
                    part = weight
                    part[d] = 1.0 * offset[d]
                    uphill[d] += (2.0 * offset[d] - 1.0) * corner_weight(part, offset) * nu
            K *= self._per_schmidt[None]
            uphill *= self._uphill[None]
        return K, uphill
