"""Gaussian puffs in a uniform wind and their integral over time: gas for which the exact solution is known.

    puff:        c = M prod_k exp(-(x_k - X_k)²/(2 s_k²))/(sqrt(2 pi) s_k),  X = x0 + U a + Y,  s_k² = radius² + 2 D_k a
    continuous:  c = int Q puff(x, a) da

a is the age and Y the displacement of the air by gusts since the release. In 2-D c is divided by the depth of the slab.
Walls are faces of the domain along which the air moves.
"""

from math import inf

import numpy as np

from taichi_plume.engine import ti
from taichi_plume.engine.fields import Field
from taichi_plume.grid.fields import Gas
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.kernels import Template
from taichi_plume.scenario.closed_forms import ContinuousGas, GaussianPuffGas
from taichi_plume.solvers.gaussian_kernels import FAR, gaussian, walls_along
from taichi_plume.solvers.uniform_wind import UniformSolver

FAINT = 16.0  # parts of an integral below exp(-FAINT) of the largest part are left out
NODES = 32  # nodes of an integral over the logarithm of the age


def diffusivities(gas: GaussianPuffGas | ContinuousGas, dim: int) -> np.ndarray:
    """Return the diffusivity of a gas along each axis, (dim,) [m²/s]: as given, or by default that of the vapour."""
    given = (gas.vapour.diffusivity,) if gas.diffusivity is None else gas.diffusivity
    return np.broadcast_to(np.array(given), dim).astype(float)


def reflecting(gas: GaussianPuffGas | ContinuousGas, grid: Grid) -> tuple[tuple[float, float, int], ...]:
    """Return (lower wall [m], upper wall [m], number of walls) per axis of the grid; ±FAR where there is no wall."""
    limits = walls_along(gas.reflecting(grid.dim), np.eye(grid.dim), grid.extent)
    return tuple((float(low), float(high), int(low > -FAR) + int(high < FAR)) for low, high in limits)


class GaussianPuffs(Gas):
    """Gas of instantaneous releases as Gaussian puffs. Fields per release: mass, 0 before it; centre; variance."""

    STATE = ("mass", "centre", "variance", "_start")

    def __init__(self, gas: GaussianPuffGas, grid: Grid, wind: UniformSolver, t: float = 0.0):
        """t: start of the run [s]."""
        self.dim, self.wind, self.species = grid.dim, wind, gas.vapour
        self.count = len(gas.releases)
        self.walls = reflecting(gas, grid)
        self.mass: Field = ti.field(ti.f32, self.count)
        self.centre: Field = ti.vector_field(grid.dim, ti.f32, self.count)
        self.variance: Field = ti.vector_field(grid.dim, ti.f32, self.count)
        self._time = np.array([release.time for release in gas.releases])
        self._radius = np.array([release.radius for release in gas.releases])
        self._place = np.array([release.position for release in gas.releases])
        depth = grid.depth if self.dim == 2 else 1.0
        self._mass = np.array([release.mass for release in gas.releases]) / depth
        self._diffusivity = diffusivities(gas, self.dim)
        self._start = np.full((self.count, self.dim), np.nan)  # the air's displacement at the release
        self.advance(t, 0.0)

    def advance(self, t: float, dt: float) -> None:
        end = t + dt
        out = self._time <= end
        for n in np.flatnonzero(out & np.isnan(self._start[:, 0])):
            self._start[n] = self.wind.displacement(self._time[n])
        age = np.where(out, end - self._time, 0.0)[:, None]
        carried = np.where(out[:, None], self.wind.displacement(end) - self._start, 0.0)
        centre = self._place + np.array(self.wind.mean) * age + carried
        variance = self._radius[:, None] ** 2 + 2.0 * self._diffusivity * age
        self.mass.from_numpy(np.where(out, self._mass, 0.0))
        self.centre.from_numpy(centre)
        self.variance.from_numpy(variance)

    @ti.func
    def concentration(self, x: Template, t: float):
        total = 0.0
        for n in range(self.count):
            part = self.mass[n]
            for d in ti.static(range(self.dim)):
                low, high, most = ti.static(*self.walls[d])
                part *= gaussian(x[d], self.centre[n][d], self.variance[n][d], low, high, most)
            total += part
        return total


class ContinuousPuffs(Gas):
    """Gas of steady sources in a wind without gusts: the time integral of Gaussian puffs.

    A finite source counts as a point source that spread earlier: s = a + radius²/(2 D), D the geometric mean of the
    diffusivities, so that its Gaussian is round if they are equal. With A/s + B s the exponent of a puff at x, up to a
    constant, the integral covers the ages at which the exponent is within FAINT of its least value: Gauss-Legendre
    nodes in log s. Images are fainter than the puff itself at any age.

    Fields: U [m/s], D [m²/s] and root_B; per source its place, rate, spread (s of age 0) and the youngest and oldest
    age of its gas.
    """

    STATE = ("youngest", "oldest")

    def __init__(self, gas: ContinuousGas, grid: Grid, wind: UniformSolver, t: float = 0.0):
        """t: start of the run [s]."""
        self.dim, self.species = grid.dim, gas.vapour
        self.count = len(gas.sources)
        self.walls = reflecting(gas, grid)
        D, U = diffusivities(gas, self.dim), np.array(wind.mean)
        depth = grid.depth if self.dim == 2 else 1.0
        mean = float(np.exp(np.log(D).mean()))
        self._span = [
            (-inf if s.start is None else s.start, inf if s.stop is None else s.stop) for s in gas.sources
        ]
        self.U, self.D = ti.filled_vectors(U), ti.filled_vectors(D)
        self.root_B = ti.filled(max(np.sqrt((U**2 / (4.0 * D)).sum()), 1e-15))
        self.place = ti.filled_vectors([source.position for source in gas.sources])
        self.rate = ti.filled([source.rate / depth for source in gas.sources])
        self.spread = ti.filled([source.radius**2 / (2.0 * mean) for source in gas.sources])
        self.youngest, self.oldest = (ti.field(ti.f32, self.count) for _ in range(2))
        self.node, self.weight = map(ti.filled, np.polynomial.legendre.leggauss(NODES))
        self.advance(t, 0.0)

    def advance(self, t: float, dt: float) -> None:
        ages = np.clip([(t + dt - stop, t + dt - start) for start, stop in self._span], 0.0, 1e30)
        self.youngest.from_numpy(ages[:, 0])
        self.oldest.from_numpy(ages[:, 1])

    @ti.func
    def concentration(self, x: Template, t: float):
        total = 0.0
        U, D = self.U[None], self.D[None]
        for n in range(self.count):
            first, last = self._ages(x - self.place[n], n)
            half = 0.5 * ti.log(ti.max(last / first, 1.0))
            for k in range(NODES):
                s = first * ti.exp(half * (1.0 + self.node[k]))
                part = self.weight[k] * s
                for d in ti.static(range(self.dim)):
                    low, high, most = ti.static(*self.walls[d])
                    centre = self.place[n][d] + U[d] * (s - self.spread[n])
                    part *= gaussian(x[d], centre, 2.0 * D[d] * s, low, high, most)
                total += self.rate[n] * half * part
        return total

    @ti.func
    def _ages(self, dx: Template, n: ti.i32):
        """Return first and last s at which puffs of source n count at the offset dx [m]; last <= first if none does."""
        A = 0.0
        for d in ti.static(range(self.dim)):
            A += (dx[d] + self.U[None][d] * self.spread[n]) ** 2 / (4.0 * self.D[None][d])
        a, b = ti.sqrt(A), self.root_B[None]
        low, high = self.youngest[n] + self.spread[n], self.oldest[n] + self.spread[n]
        best = ti.math.clamp(a / b, low, high)
        faint = FAINT + (a / ti.sqrt(best) - b * ti.sqrt(best)) ** 2
        root = ti.sqrt(faint + 4.0 * a * b) + ti.sqrt(faint)
        first = ti.max((2.0 * a / root) ** 2, low)
        last = ti.min((root / (2.0 * b)) ** 2, high)
        return first, last
