"""Gaussian puffs in a uniform wind and their integral over time: gas for which the exact solution is known.

    puff:        c = M prod_k exp(-(x_k - X_k)²/(2 s_k²))/(sqrt(2 pi) s_k),  X = x0 + U a + Y,  s_k² = radius² + 2 D_k a
    continuous:  c = int Q puff(x, a) da

a is the age and Y how far gusts have carried the air meanwhile. In 2-D c is divided by the depth of the slab. Walls are
faces of the domain along which the air moves.
"""

from collections.abc import Callable, Sequence
from math import inf, pi
from typing import Any

import numpy as np
import taichi as ti

from taichi_plume.grid.grid import Grid
from taichi_plume.grid.kernels import Template, listed
from taichi_plume.scenario.closed_forms import ContinuousGas, GaussianPuffGas
from taichi_plume.scenario.vocabulary import Face
from taichi_plume.solvers.uniform import UniformSolver

FAINT = 16.0  # exp(-FAINT) of the largest part of an integral is left out
NODES = 32  # of an integral over the logarithm of the age


def bell(low: float | None = None, high: float | None = None) -> Callable:
    """ti.func ``bell(q, centre, variance)``: a Gaussian of unit area, reflected by walls at `low` and at `high`.

    Between two walls: images while it is narrow, a cosine series when it is wide (Poisson's formula); both to 1e-7.
    """

    @ti.func
    def free(q, centre, variance):
        return ti.exp(-((q - centre) ** 2) / (2.0 * variance)) / ti.sqrt(2.0 * pi * variance)

    if low is None and high is None:
        return free
    wall = (high if low is None else low) or 0.0

    @ti.func
    def before_one(q, centre, variance):
        return free(q, centre, variance) + free(q, 2.0 * wall - centre, variance)

    if low is None or high is None:
        return before_one
    width = high - low

    @ti.func
    def between_two(q, centre, variance):
        total = 0.0
        if variance < 0.25 * width**2:
            near = centre - 2.0 * width * ti.round((centre - wall) / (2.0 * width))  # of all images
            for m in ti.static(range(-2, 3)):
                total += before_one(q, near + 2.0 * m * width, variance)
        else:
            total = 1.0
            for m in ti.static(range(1, 4)):
                k = ti.static(m * pi / width)
                waves = ti.cos(k * (q - wall)) * ti.cos(k * (centre - wall))
                total += 2.0 * waves * ti.exp(-0.5 * k**2 * variance)
            total /= width
        return total

    return between_two


def bells(walls: Sequence[Face], axes: np.ndarray, extent: tuple[float, ...]) -> tuple[Callable, ...]:
    """A `bell` per axis (a row of unit vectors) between the walls that it goes through."""
    limits: list[dict[int, float]] = [{} for _ in axes]
    for face in walls:
        d, side = "xyz".index(face[0]), int(face[1] == "+")
        for n, axis in enumerate(axes):
            if abs(axis[d]) > 0.5:
                upper = side if axis[d] > 0 else 1 - side
                limits[n][upper] = axis[d] * side * extent[d]
    return tuple(bell(limit.get(0), limit.get(1)) for limit in limits)


def diffusivities(gas: GaussianPuffGas | ContinuousGas, dim: int) -> np.ndarray:
    """Per axis [m²/s]."""
    given = (gas.vapour.diffusivity,) if gas.diffusivity is None else gas.diffusivity
    return np.broadcast_to(np.array(given), dim).astype(float)


@ti.data_oriented
class GaussianPuffs:
    """Gaussian puffs; satisfies `fields.Gas`. Fields, one entry per release: mass, 0 before it, centre, variance."""

    def __init__(self, gas: GaussianPuffGas, grid: Grid, wind: UniformSolver, begin: float = 0.0):
        """begin: start of the run [s]."""
        self.dim = grid.dim
        self.species = gas.vapour
        self.wind = wind
        self.count = len(gas.releases)
        self.bells = bells(gas.reflecting(grid.dim), np.eye(grid.dim), grid.extent)
        self._time = np.array([release.time for release in gas.releases])
        self._radius = np.array([release.radius for release in gas.releases])
        self._place = np.array([release.position for release in gas.releases])
        depth = grid.depth if grid.dim == 2 else 1.0
        self._mass = np.array([release.mass for release in gas.releases]) / depth
        self._diffusivity = diffusivities(gas, grid.dim)
        self._start: Any = np.full((self.count, grid.dim), np.nan)  # the air's displacement at the release
        self.mass = listed(np.zeros(self.count))
        self.centre = listed(self._place)
        self.variance = listed(np.ones((self.count, grid.dim)))
        self.advance(begin, 0.0)

    def advance(self, t: float, dt: float) -> None:
        """Go on to time t + dt, as the wind has done."""
        end = t + dt
        out = self._time <= end
        for n in np.flatnonzero(out & np.isnan(self._start[:, 0])):
            self._start[n] = self.wind.displacement(self._time[n])
        age = np.where(out, end - self._time, 0.0)[:, None]
        carried = np.where(out[:, None], self.wind.displacement(end) - self._start, 0.0)
        centre = self._place + np.array(self.wind.mean) * age + carried
        variance = self._radius[:, None] ** 2 + 2.0 * self._diffusivity * age
        self.mass.from_numpy(np.where(out, self._mass, 0.0).astype(np.float32))
        self.centre.from_numpy(centre.astype(np.float32))
        self.variance.from_numpy(variance.astype(np.float32))

    def is_finite(self) -> bool:
        """A closed form always is."""
        return True

    @ti.func
    def concentration(self, x: Template, t: float):
        """Concentration [kg/m³] at point x [m]; the time is the solver's own."""
        total = 0.0
        for n in range(self.count):
            part = self.mass[n]
            for d in ti.static(range(self.dim)):
                part *= self.bells[d](x[d], self.centre[n][d], self.variance[n][d])
            total += part
        return total


@ti.data_oriented
class ContinuousPuffs:
    """What steady sources emit, in a wind without gusts; satisfies `fields.Gas`.

    A source is what has spread from a point for a while already: for s = a + radius²/(2 D), D the geometric mean of the
    diffusivities. So its Gaussian is round where they are equal. With A/s + B s the exponent of a puff at x, up to a
    constant, the integral is taken over the ages at which it is within FAINT of its least value: Gauss and Legendre's
    nodes in log s. Images are fainter than the puff itself at any age.
    """

    def __init__(self, gas: ContinuousGas, grid: Grid, wind: UniformSolver, begin: float = 0.0):
        """begin: start of the run [s]."""
        self.dim = grid.dim
        self.species = gas.vapour
        self.count = len(gas.sources)
        self.bells = bells(gas.reflecting(grid.dim), np.eye(grid.dim), grid.extent)
        depth = grid.depth if grid.dim == 2 else 1.0
        given = diffusivities(gas, grid.dim)
        mean = float(np.exp(np.log(given).mean()))
        self.U: tuple[float, ...] = tuple(wind.mean)
        self.D = tuple(given)
        self.B = sum(U**2 / (4.0 * D) for U, D in zip(self.U, self.D, strict=True))
        self._span = [
            (-inf if s.start is None else s.start, inf if s.stop is None else s.stop) for s in gas.sources
        ]
        self.place = listed(np.array([source.position for source in gas.sources]))
        self.rate = listed(np.array([source.rate / depth for source in gas.sources]))
        self.spread = listed(
            np.array([source.radius**2 / (2.0 * mean) for source in gas.sources])
        )  # s of age 0
        self.youngest = listed(np.zeros(self.count))
        self.oldest = listed(np.zeros(self.count))
        nodes, weights = np.polynomial.legendre.leggauss(NODES)
        self.node, self.weight = listed(nodes), listed(weights)
        self.advance(begin, 0.0)

    def advance(self, t: float, dt: float) -> None:
        """Go on to time t + dt."""
        ages = np.clip([(t + dt - stop, t + dt - start) for start, stop in self._span], 0.0, 1e30)
        self.youngest.from_numpy(ages[:, 0].astype(np.float32))
        self.oldest.from_numpy(ages[:, 1].astype(np.float32))

    def is_finite(self) -> bool:
        """A closed form always is."""
        return True

    @ti.func
    def concentration(self, x: Template, t: float):
        """Concentration [kg/m³] at point x [m]; the time is the solver's own."""
        total = 0.0
        for n in range(self.count):
            first, last = self._ages(x - self.place[n], n)
            half = 0.5 * ti.log(ti.max(last / first, 1.0))
            for k in range(NODES):
                s = first * ti.exp(half * (1.0 + self.node[k]))
                part = self.weight[k] * s
                for d in ti.static(range(self.dim)):
                    centre = self.place[n][d] + ti.static(self.U[d]) * (s - self.spread[n])
                    part *= self.bells[d](x[d], centre, ti.static(2.0 * self.D[d]) * s)
                total += self.rate[n] * half * part
        return total

    @ti.func
    def _ages(self, dx: Template, n: ti.i32):
        """The first and last s at which a puff of source n is felt at dx from it; last <= first where none is."""
        A = 0.0
        for d in ti.static(range(self.dim)):
            A += (dx[d] + ti.static(self.U[d]) * self.spread[n]) ** 2 / ti.static(4.0 * self.D[d])
        a, b = ti.sqrt(A), ti.static(max(self.B**0.5, 1e-15))
        low, high = self.youngest[n] + self.spread[n], self.oldest[n] + self.spread[n]
        best = ti.math.clamp(a / b, low, high)
        faint = FAINT + (a / ti.sqrt(best) - b * ti.sqrt(best)) ** 2
        root = ti.sqrt(faint + 4.0 * a * b) + ti.sqrt(faint)
        first = ti.max((2.0 * a / root) ** 2, low)
        last = ti.min((root / (2.0 * b)) ** 2, high)
        return first, last
