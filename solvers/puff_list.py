"""Puffs side by side in memory, in the order of their cells, and the sum of their Gaussians at a point.

The sum over the puffs of a row of cells is a loop without stores or branches, which LLVM vectorises; a polynomial
replaces ti.exp, which LLVM cannot vectorise.
"""

from math import ceil, erf, exp, log2, pi, sqrt

import numpy as np

from taichi_plume.engine import ti
from taichi_plume.engine.fields import Field, on_cpu
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.kernels import Template
from taichi_plume.grid.level_set import LevelSet
from taichi_plume.solvers.puff_cells import PuffCells

FREE = 1e3  # m: distance that stands for surfaces out of a puff's reach


def exponential(largest: float) -> tuple[list[float], int]:
    """Return (coefficients, k): exp(-y) is p(y) squared k times for 0 <= y <= `largest`, with relative error 4e-5."""
    k = max(0, ceil(log2(largest / 0.8)))
    end = largest / 2**k
    fit = np.polynomial.Chebyshev.interpolate(lambda y: np.exp(-y), 4, [0.0, end])
    return list(map(float, fit.convert(kind=np.polynomial.Polynomial, domain=[-1, 1]).coef)), k


def share_within(cutoff: float, dim: int) -> float:
    """Return the fraction of a Gaussian's mass within `cutoff` standard deviations, in `dim` dimensions."""
    tail = exp(-0.5 * cutoff**2)
    if dim == 2:
        return 1.0 - tail
    return erf(cutoff / sqrt(2.0)) - sqrt(2.0 / pi) * cutoff * tail


class PuffList:
    """Storage of up to `most` puffs, sorted by cells. Moved puffs are written to `new`; `sort` writes them in order to
    `now`.

    Columns of both: position [m], turbulent velocity [m/s], variance [m²], mass [kg]; puffs' numbers. count: their
    number.
    """

    STATE = ("count", "now", "number", "cells", "_per_area", "_weight", "_plane", "_gone")

    def __init__(self, most: int, cutoff: float, grid: Grid, surfaces: LevelSet | None, smallest: float):
        """cutoff: radius of a puff in standard deviations; smallest: standard deviation of a new puff [m]."""
        self.grid, self.dim, self.cutoff, self.surfaces = grid, grid.dim, cutoff, surfaces
        self.walled = surfaces is not None
        self.cells = PuffCells(most, cutoff, grid, smallest)
        self.count = 0
        columns = 2 * grid.dim + 2
        self.now: tuple[Field, ...] = tuple(ti.field(ti.f32, most) for _ in range(columns))
        self.new: tuple[Field, ...] = tuple(ti.field(ti.f32, most) for _ in range(columns))
        self.number: Field = ti.field(ti.i32, most)
        self.new_number: Field = ti.field(ti.i32, most)
        self.variance, self.mass = 2 * grid.dim, 2 * grid.dim + 1  # columns
        self._per_area: Field = ti.field(ti.f32, most)  # 1/(2 s²)
        self._weight: Field = ti.field(ti.f32, most)  # concentration at the centre [kg/m³]
        self._plane: Field = tuple(ti.field(ti.f32, most) for _ in range(grid.dim + 1)) if surfaces else ()
        self._gone = ti.field(ti.f64)  # mass that left the domain [kg]
        self._powers, self._squarings = exponential(0.5 * cutoff**2)
        self._unit = sqrt(2.0 * pi) ** -grid.dim / share_within(cutoff, grid.dim)
        if grid.dim == 2:
            self._unit /= grid.depth

    # ---------------------------------------------------------------- columns

    @property
    def gone(self) -> float:
        """Total mass of the puffs that have left the domain [kg]."""
        return self._gone[None]

    def rows(self) -> np.ndarray:
        """Return all columns of the present puffs, (count, columns)."""
        return np.stack([column.values[: self.count] for column in self.now], axis=1)

    @ti.func
    def place(self, q: ti.i32):
        """Return the centre (dim,) of puff q [m]."""
        x = ti.Vector.zero(ti.f32, self.dim)
        for d in ti.static(range(self.dim)):
            x[d] = self.now[d][q]
        return x

    @ti.func
    def velocity(self, q: ti.i32):
        """Return the turbulent velocity (dim,) of puff q [m/s]."""
        v = ti.Vector.zero(ti.f32, self.dim)
        for d in ti.static(range(self.dim)):
            v[d] = self.now[self.dim + d][q]
        return v

    @ti.func
    def plane_distance(self, q: ti.i32):
        """Return puff q's distance from the tangent plane of the nearest surface [m]; FREE if out of reach."""
        away = FREE
        if ti.static(self.walled):
            away = self._plane[self.dim][q]
        return away

    @ti.func
    def plane_normal(self, q: ti.i32, d: Template):
        """Return component d of the unit normal of puff q's tangent plane, away from the surface; 0 without one."""
        n = 0.0
        if ti.static(self.walled):
            n = self._plane[d][q]
        return n

    @ti.func
    def in_front(self, q: ti.i32, p: Template):
        """Return the distance of point p from the tangent plane of the surface near puff q [m]; negative behind it."""
        result = self._plane[self.dim][q]
        for d in ti.static(range(self.dim)):
            result += self._plane[d][q] * (p[d] - self.now[d][q])
        return result

    # ---------------------------------------------------------------- from `new` to `now`

    @ti.func
    def put(self, k: ti.i32, x: Template, v: Template, variance: float, mass: float, number: ti.i32, stays):
        """Write puff k to the new puffs, with position x, velocity v, variance, mass, number and whether it stays."""
        for d in ti.static(range(self.dim)):
            self.new[d][k] = x[d]
            self.new[self.dim + d][k] = v[d]
        self.new[self.variance][k] = variance
        self.new[self.mass][k] = mass
        self.new_number[k] = number
        self.cells.put(k, x, variance, stays)

    def sort(self, count: int) -> None:
        """Sort the first `count` new puffs by cells into `now`, without the puffs that left the domain."""
        self.count = self._sort(count)

    @ti.kernel
    def _sort(self, count: ti.i32) -> ti.i32:
        self._count_gone(count)
        self.cells.sort(count, self.new_number)
        for q in range(self.cells.alive()):
            k = self.cells.order[q]
            for column in ti.static(range(len(self.now))):
                self.now[column][q] = self.new[column][k]
            self.number[q] = self.new_number[k]
            self._prepare(q)
        return self.cells.alive()

    @ti.func
    def _count_gone(self, count: ti.i32):
        if ti.static(on_cpu()):
            for _ in range(1):  # in a fixed order, for any number of threads
                for k in range(count):
                    self._lose(k)
        else:
            for k in range(count):
                self._lose(k)

    @ti.func
    def _lose(self, k: ti.i32):
        if not self.cells.stays(k):
            self.lose(self.new[self.mass][k])

    @ti.func
    def lose(self, mass: float):
        """Add a mass [kg] to the total that left the domain."""
        self._gone[None] += ti.cast(mass, ti.f64)

    @ti.func
    def _prepare(self, q: ti.i32):
        """Compute the weight, width and tangent plane of puff q that the sum of Gaussians needs."""
        s = self.cells.size(self.now[self.variance][q])
        self._per_area[q] = 0.5 / (s * s)
        self._weight[q] = self.now[self.mass][q] * self._unit / s**self.dim
        if ti.static(self.walled):
            x = self.place(q)
            away = self.surfaces.distance(x)
            n = ti.Vector.zero(ti.f32, self.dim)
            if away < self.cutoff * s:
                n = self.surfaces.normal(x)
            else:
                away = FREE
            for d in ti.static(range(self.dim)):
                self._plane[d][q] = n[d]
            self._plane[self.dim][q] = away

    # ---------------------------------------------------------------- merging

    def merge(self) -> None:
        """Merge pairs of puffs that are neighbours in memory, overlap, and are not separated by a surface.

        Mass, centre of mass, and the variance about this centre, summed over the axes, are conserved.
        """
        self._merge(self.count)
        self.sort(self.count)

    @ti.kernel
    def _merge(self, count: ti.i32):
        for pair in range((count + 1) // 2):
            q, r = 2 * pair, ti.min(2 * pair + 1, count - 1)
            a, b = self.place(q), self.place(r)
            u, v = self.velocity(q), self.velocity(r)
            s, t = self.now[self.variance][q], self.now[self.variance][r]
            m, n = self.now[self.mass][q], self.now[self.mass][r]
            square = ti.math.dot(b - a, b - a)
            joins = q < r and square < s + t
            share = 0.0
            if joins:
                share = n / (m + n)
            center = a + share * (b - a)
            if ti.static(self.walled):
                joins = joins and self.in_front(q, b) > 0.0 and self.in_front(r, a) > 0.0
                joins = joins and self.surfaces.distance(center) > 0.0
            x, w, variance, mass = a, u, s, m
            if joins:
                x, w, mass = center, (1.0 - share) * u + share * v, m + n
                variance = (1.0 - share) * s + share * t
                variance += share * (1.0 - share) * square / self.dim
            for k in range(q, r + 1):
                if k > q:
                    if joins:
                        mass = 0.0
                    else:
                        x, w, variance, mass = b, v, t, n
                self.put(k, x, w, variance, mass, self.number[k], not joins or k == q)

    # ---------------------------------------------------------------- the sum

    @ti.func
    def gaussian(self, y):
        """Return exp(-y) up to the cut-off of a puff, 0 beyond."""
        inside = ti.min(y, ti.static(0.5 * self.cutoff**2))
        e = ti.cast(self._powers[-1], ti.f32)
        z = inside * ti.static(1.0 / 2**self._squarings)
        for n in ti.static(range(len(self._powers) - 2, -1, -1)):
            e = e * z + self._powers[n]
        for _ in ti.static(range(self._squarings)):
            e = e * e
        return ti.select(y < ti.static(0.5 * self.cutoff**2), e, 0.0)

    @ti.func
    def _concentration(self, q: ti.i32, p: Template):
        """Return the concentration of puff q and its mirror image at p; 0 behind the tangent plane of a surface."""
        square = 0.0
        for d in ti.static(range(self.dim)):
            square += (p[d] - self.now[d][q]) ** 2
        y = square * self._per_area[q]
        result = self.gaussian(y)
        if ti.static(self.walled):
            away, before = self._plane[self.dim][q], self.in_front(q, p)
            mirrored = y + 4.0 * away * before * self._per_area[q]
            result = ti.select(before > 0.0, result + self.gaussian(mirrored), 0.0)
        return self._weight[q] * result

    @ti.func
    def near(self, p: Template, which: ti.i32):
        """Return the concentration [kg/m³] at p [m], also outside the domain, of the puffs in list `which`."""
        low, rows, count = self.cells.block(p, which)
        total = 0.0
        for r in range(count):
            begin, end = self.cells.row(p, which, low, rows, r)
            for q in range(begin, end):
                total += self._concentration(q, p)
        return total
