"""Puffs in the order of the cells that they are in, and the sum of their Gaussians at a point.

There are several lists of cells, one per octave of the puffs' size, each with cells half as wide as its largest puffs
reach: a point looks at few cells of any list. The puffs of a row of cells lie side by side in memory, and the sum over
them is one loop without stores or branches, which LLVM vectorises; ti.exp would stop it, a polynomial does not.

The order is that of the cells, then of the puffs before, on a CPU; of the cells, then of the puffs' numbers, on a GPU.
Neither depends on threads, so sums are the same to the bit.
"""

from math import ceil, erf, exp, log2, pi, prod, sqrt
from typing import Any

import numpy as np
import taichi as ti

from taichi_plume.grid.grid import Grid
from taichi_plume.grid.kernels import Template, double_field, on_cpu
from taichi_plume.grid.level_set import LevelSet

STEP = 2.0  # from the sizes of one list to those of the next
WIDTH = 0.5  # of the cells, over how far the puffs of a list reach
CELLS = 1 << 16  # of the finest list, at most
BLOCK = 256  # cells per task of the parallel running sum
FREE = 1e3  # m: distance of a puff from surfaces that it does not reach


def exponential(largest: float) -> tuple[list[float], int]:
    """(coefficients, k) such that exp(-y) is p(y) squared k times, 0 <= y <= `largest`; to 4e-5 of it."""
    k = max(0, ceil(log2(largest / 0.8)))
    end = largest / 2**k
    fit = np.polynomial.Chebyshev.interpolate(lambda y: np.exp(-y), 4, [0.0, end])
    return list(map(float, fit.convert(kind=np.polynomial.Polynomial, domain=[-1, 1]).coef)), k


def share_within(cutoff: float, dim: int) -> float:
    """Share of a Gaussian's mass within `cutoff` standard deviations."""
    tail = exp(-0.5 * cutoff**2)
    if dim == 2:
        return 1.0 - tail
    return erf(cutoff / sqrt(2.0)) - sqrt(2.0 / pi) * cutoff * tail


@ti.data_oriented
class PuffList:
    """Up to `most` puffs. `new` is where they are moved to, `sort` puts them in order into `now`.

    Columns of both: x [m] and v [m/s] per axis, variance [m²], mass [kg]; and their numbers.
    """

    def __init__(self, most: int, smallest: float, cutoff: float, grid: Grid, surfaces: LevelSet | None):
        """smallest: size of a new puff [m]."""
        self.most, self.grid, self.dim, self.cutoff, self.surfaces = most, grid, grid.dim, cutoff, surfaces
        self.walled = surfaces is not None
        columns = 2 * grid.dim + 2
        self.now: tuple[Any, ...] = tuple(ti.field(ti.f32, most) for _ in range(columns))
        self.new: tuple[Any, ...] = tuple(ti.field(ti.f32, most) for _ in range(columns))
        self.number: Any = ti.field(ti.i32, most)
        self.new_number: Any = ti.field(ti.i32, most)
        self.variance, self.mass = 2 * grid.dim, 2 * grid.dim + 1  # columns
        self._per_area: Any = ti.field(ti.f32, most)  # 1/(2 s²)
        self._weight: Any = ti.field(ti.f32, most)  # concentration at the centre [kg/m³]
        self._plane: Any = tuple(ti.field(ti.f32, most) for _ in range(grid.dim + 1)) if surfaces else ()
        self._make_cells(smallest)
        self._cell: Any = ti.field(ti.i32, most)  # of each new puff; -1: gone
        self._order: Any = ti.field(ti.i32, most)
        self._rough_order: Any = None if on_cpu() else ti.field(ti.i32, most)
        self._gone = double_field()  # kg
        self._powers, self._squarings = exponential(0.5 * cutoff**2)
        self._unit = sqrt(2.0 * pi) ** -grid.dim / share_within(cutoff, grid.dim)
        if grid.dim == 2:
            self._unit /= grid.depth

    def _make_cells(self, smallest: float) -> None:
        """Largest size, reach and cells of each list."""
        extent = np.array(self.grid.extent)
        width = max(2.0 * WIDTH * self.cutoff * smallest, (np.prod(extent) / CELLS) ** (1 / self.dim))
        while np.prod(np.ceil(extent / width)) > CELLS:
            width *= 1.02
        sizes = [width / (WIDTH * self.cutoff)]
        while sizes[-1] < extent.max():  # a puff as large as the room is spread evenly over it
            sizes.append(STEP * sizes[-1])
        self.lists = len(sizes)
        shapes = [np.ceil(extent / (WIDTH * self.cutoff * size)).astype(int) for size in sizes]
        self.smallest_list, self.largest = sizes[0], sizes[-1]
        self.cells = sum(prod(map(int, shape)) for shape in shapes)
        self._size: Any = ti.field(ti.f32, self.lists)
        self._size.from_numpy(np.array(sizes, np.float32))
        self._shape: Any = ti.Vector.field(self.dim, ti.i32, self.lists)
        self._shape.from_numpy(np.array(shapes, np.int32))
        self._first: Any = ti.field(ti.i32, self.lists + 1)
        self._first.from_numpy(np.cumsum([0, *(int(np.prod(shape)) for shape in shapes)]).astype(np.int32))
        self._start: Any = ti.field(ti.i32, self.cells + 1)  # of each cell in the order; the last: of none
        self.farthest: Any = ti.field(ti.f32, ())  # that any puff reaches [m]
        self._cursor: Any = ti.field(ti.i32, self.cells)
        self._blocks: Any = ti.field(ti.i32, self.cells // BLOCK + 1)

    # ---------------------------------------------------------------- the order

    @ti.func
    def size(self, variance: float):
        """Standard deviation that a puff is shown with [m]."""
        return ti.min(ti.sqrt(variance), ti.static(0.999 * self.largest))

    @ti.func
    def put(self, k: ti.i32, x: Template, v: Template, variance: float, mass: float, number: ti.i32, stays):
        """Set new puff k, and whether it stays in the domain."""
        for d in ti.static(range(self.dim)):
            self.new[d][k] = x[d]
            self.new[self.dim + d][k] = v[d]
        self.new[self.variance][k] = variance
        self.new[self.mass][k] = mass
        self.new_number[k] = number
        step = ti.ceil(
            ti.log(self.size(variance) / ti.static(self.smallest_list)) * ti.static(1 / np.log(STEP))
        )
        which = ti.math.clamp(ti.cast(step, ti.i32), 0, ti.static(self.lists - 1))
        width = WIDTH * self.cutoff * self._size[which]
        cell = 0
        for d in ti.static(range(self.dim - 1, -1, -1)):  # axis 0 runs fastest
            n = self._shape[which][d]
            cell = cell * n + ti.math.clamp(ti.cast(x[d] / width, ti.i32), 0, n - 1)
        self._cell[k] = ti.select(stays, self._first[which] + cell, -1)

    def sort(self, count: int) -> None:
        """Put the first `count` new puffs in order, without those that are gone."""
        self._sort(count)

    @ti.kernel
    def _sort(self, count: ti.i32):
        if ti.static(on_cpu()):
            self._order_serially(count)
        else:
            self._order_in_parallel(count)
        for _ in range(1):
            self.farthest[None] = 0.0
            for which in range(self.lists):
                if not self.empty(which):
                    self.farthest[None] = self.reach(which)
        for q in range(self._start[ti.static(self.cells)]):
            k = self._order[q]
            for column in ti.static(range(len(self.now))):
                self.now[column][q] = self.new[column][k]
            self.number[q] = self.new_number[k]
            self._prepare(q)

    @ti.func
    def _order_serially(self, count: ti.i32):
        for _ in range(1):
            for c in range(self.cells):
                self._cursor[c] = 0
            for k in range(count):
                c = self._cell[k]
                if c >= 0:
                    self._cursor[c] = self._cursor[c] + 1
                else:
                    self._gone[None] += ti.cast(self.new[self.mass][k], ti.f64)
            total = 0
            for c in range(self.cells):
                n = self._cursor[c]
                self._start[c] = total
                self._cursor[c] = total
                total += n
            self._start[ti.static(self.cells)] = total
            for k in range(count):
                c = self._cell[k]
                if c >= 0:
                    self._order[self._cursor[c]] = k
                    self._cursor[c] = self._cursor[c] + 1

    @ti.func
    def _order_in_parallel(self, count: ti.i32):
        for c in range(self.cells):
            self._cursor[c] = 0
        for k in range(count):
            if self._cell[k] >= 0:
                ti.atomic_add(self._cursor[self._cell[k]], 1)
            else:
                self._gone[None] += ti.cast(self.new[self.mass][k], ti.f64)
        for b in range(self._blocks.shape[0]):
            total = 0
            for c in range(b * BLOCK, ti.min((b + 1) * BLOCK, self.cells)):
                total += self._cursor[c]
            self._blocks[b] = total
        for _ in range(1):
            total = 0
            for b in range(self._blocks.shape[0]):
                n = self._blocks[b]
                self._blocks[b] = total
                total += n
            self._start[ti.static(self.cells)] = total
        for b in range(self._blocks.shape[0]):
            total = self._blocks[b]
            for c in range(b * BLOCK, ti.min((b + 1) * BLOCK, self.cells)):
                n = self._cursor[c]
                self._start[c] = total
                self._cursor[c] = total
                total += n
        for k in range(count):
            c = self._cell[k]
            if c >= 0:
                self._rough_order[ti.atomic_add(self._cursor[c], 1)] = k
        for q in range(self._start[ti.static(self.cells)]):
            k = self._rough_order[q]
            c, before = self._cell[k], 0
            for other in range(self._start[c], self._start[c + 1]):
                before += ti.cast(self.new_number[self._rough_order[other]] < self.new_number[k], ti.i32)
            self._order[self._start[c] + before] = k

    @ti.func
    def _prepare(self, q: ti.i32):
        """What the sum needs to know of puff q."""
        s = self.size(self.now[self.variance][q])
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
            self._plane[ti.static(self.dim)][q] = away

    @ti.func
    def in_front(self, q: ti.i32, p: Template):
        """Distance of p from the plane of the surface next to puff q [m]; negative behind it."""
        result = self._plane[ti.static(self.dim)][q]
        for d in ti.static(range(self.dim)):
            result += self._plane[d][q] * (p[d] - self.now[d][q])
        return result

    def merge(self) -> None:
        """Make one puff of neighbours in the order, two by two, that overlap and see each other.

        Mass, centre of mass, and variance about it, summed over the axes, stay as they are.
        """
        count = self.count
        self._merge(count)
        self._sort(count)

    @ti.kernel
    def _merge(self, count: ti.i32):
        for pair in range((count + 1) // 2):
            q, r = 2 * pair, ti.min(2 * pair + 1, count - 1)
            a, b = self.place(q), self.place(r)
            square, mean = (
                ti.math.dot(b - a, b - a),
                0.5 * (self.now[self.variance][q] + self.now[self.variance][r]),
            )
            joins = q < r and square < 2.0 * mean
            share = 0.0
            if joins:
                share = self.now[self.mass][r] / (self.now[self.mass][q] + self.now[self.mass][r])
            center = a + share * (b - a)
            if ti.static(self.walled):
                joins = joins and self.in_front(q, b) > 0.0 and self.in_front(r, a) > 0.0
                joins = joins and self.surfaces.distance(center) > 0.0
            for n in range(2):
                k = q + n
                if k < count:
                    x, v = self.place(k), ti.Vector.zero(ti.f32, self.dim)
                    variance, mass = self.now[self.variance][k], self.now[self.mass][k]
                    for d in ti.static(range(self.dim)):
                        v[d] = self.now[self.dim + d][k]
                    if joins:
                        x = center
                        for d in ti.static(range(self.dim)):
                            v[d] = (1.0 - share) * self.now[self.dim + d][q] + share * self.now[self.dim + d][
                                r
                            ]
                        variance = (1.0 - share) * self.now[self.variance][q] + share * self.now[
                            self.variance
                        ][r]
                        variance += share * (1.0 - share) * square / self.dim
                        mass = (1 - n) * (self.now[self.mass][q] + self.now[self.mass][r])
                    self.put(k, x, v, variance, mass, self.number[k], not joins or n == 0)

    @ti.func
    def place(self, q: ti.i32):
        """Centre of puff q [m]."""
        x = ti.Vector.zero(ti.f32, self.dim)
        for d in ti.static(range(self.dim)):
            x[d] = self.now[d][q]
        return x

    @ti.func
    def alive(self):
        """How many puffs there are."""
        return self._start[ti.static(self.cells)]

    @ti.func
    def plane_distance(self, q: ti.i32):
        """How far puff q is from the tangent plane of the next surface [m]; large where it reaches none."""
        away = FREE
        if ti.static(self.walled):
            away = self._plane[ti.static(self.dim)][q]
        return away

    @ti.func
    def plane_normal(self, q: ti.i32, d: Template):
        """Component d of the plane's unit normal, away from the surface."""
        n = 0.0
        if ti.static(self.walled):
            n = self._plane[d][q]
        return n

    @property
    def count(self) -> int:
        """How many puffs there are."""
        return int(self._start[self.cells])

    @property
    def gone(self) -> float:
        """Mass of the puffs that did not stay [kg]."""
        return self._gone[None]

    def column(self, number: int) -> np.ndarray:
        """One column of the puffs that there are."""
        return self.now[number].to_numpy()[: self.count]

    # ---------------------------------------------------------------- the sum

    @ti.func
    def gaussian(self, y):
        """exp(-y) up to the cut-off, 0 beyond."""
        inside = ti.min(y, ti.static(0.5 * self.cutoff**2))
        e = ti.cast(self._powers[-1], ti.f32)
        z = inside * ti.static(1.0 / 2**self._squarings)
        for n in ti.static(range(len(self._powers) - 2, -1, -1)):
            e = e * z + self._powers[n]
        for _ in ti.static(range(self._squarings)):
            e = e * e
        return ti.select(y < ti.static(0.5 * self.cutoff**2), e, 0.0)

    @ti.func
    def _one(self, q: ti.i32, p: Template):
        """Concentration of puff q at p; behind the plane of the next surface there is none, before it the mirrored
        puff adds to it.
        """
        square = 0.0
        for d in ti.static(range(self.dim)):
            square += (p[d] - self.now[d][q]) ** 2
        y = square * self._per_area[q]
        result = self.gaussian(y)
        if ti.static(self.walled):
            away, before = self._plane[ti.static(self.dim)][q], self.in_front(q, p)
            mirrored = y + 4.0 * away * before * self._per_area[q]
            result = ti.select(before > 0.0, result + self.gaussian(mirrored), 0.0)
        return self._weight[q] * result

    @ti.func
    def near(self, p: Template, which: ti.i32):
        """Concentration [kg/m³] at a point [m], perhaps outside of the domain, of the puffs of one list."""
        reach = self.cutoff * self._size[which]
        width = WIDTH * reach
        shape = self._shape[which]
        low, rows = ti.Vector.zero(ti.i32, self.dim), ti.Vector.zero(ti.i32, self.dim)
        count = 1
        for d in ti.static(range(1, self.dim)):
            low[d] = ti.max(ti.cast(ti.floor((p[d] - reach) / width), ti.i32), 0)
            high = ti.min(ti.cast(ti.floor((p[d] + reach) / width), ti.i32), shape[d] - 1)
            rows[d] = ti.max(high - low[d] + 1, 0)
            count *= rows[d]
        total = 0.0
        for r in range(count):
            row, left = self._first[which], r
            rest, stride = reach * reach, shape[0]
            for d in ti.static(range(1, self.dim)):
                i = low[d] + left % rows[d]
                left = left // rows[d]
                gap = ti.max(ti.abs((i + 0.5) * width - p[d]) - 0.5 * width, 0.0)
                rest -= gap * gap
                row += i * stride
                stride *= shape[d]
            if rest > 0.0:
                along = ti.sqrt(rest)
                a = ti.max(ti.cast(ti.floor((p[0] - along) / width), ti.i32), 0)
                b = ti.min(ti.cast(ti.floor((p[0] + along) / width), ti.i32), shape[0] - 1)
                if a <= b:
                    for q in range(self._start[row + a], self._start[row + b + 1]):
                        total += self._one(q, p)
        return total

    @ti.func
    def empty(self, which: ti.i32):
        """Whether a list holds no puff."""
        return self._start[self._first[which]] == self._start[self._first[which + 1]]

    @ti.func
    def reach(self, which: ti.i32):
        """How far the puffs of a list reach [m]."""
        return self.cutoff * self._size[which]
