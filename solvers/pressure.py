"""The Poisson equation of the projection: sum over faces of a (phi_I - phi_neighbour) = b.

`a` is the openness of a face (0 closed, 1 open, 2 on the domain's boundary with phi = 0 on the face itself). The
direct solver serves flows of one cell layer on a CPU, the multigrid-preconditioned conjugate gradient all others.
Both work on arrays with one ghost layer, axis 0 contiguous, three axes whatever the dimension.
"""

from dataclasses import dataclass
from math import prod
from typing import Any

import numpy as np
import scipy.sparse as sp
import taichi as ti
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from taichi_plume.grid import Grid
from taichi_plume.kernels import FEW_CELLS, STRIP, Template, on_cpu


def three_axes(shape: tuple[int, ...]) -> tuple[int, int, int]:
    """`shape` with ones appended."""
    n = tuple(shape) + (1,) * (3 - len(shape))
    return n[0], n[1], n[2]


@dataclass(frozen=True)
class Openness:
    """Face coefficients a per axis, arrays of shape n + 2 with one ghost layer, and which axes wrap round."""

    a: tuple[np.ndarray, np.ndarray, np.ndarray]
    periodic: tuple[bool, bool, bool]

    @property
    def shape(self) -> tuple[int, int, int]:
        """Inner cells per axis."""
        n = tuple(m - 2 for m in self.a[0].shape)
        return n[0], n[1], n[2]

    @staticmethod
    def of(openness: tuple[np.ndarray, ...], grid: Grid) -> "Openness":
        """From face arrays on the padded grid, 1 where open; free domain faces become 2."""
        n = three_axes(grid.shape)
        result = [np.zeros(tuple(m + 2 for m in n), np.float32) for _ in range(3)]
        for d, source in enumerate(openness):
            inner = [slice(b, e + (axis == d)) for axis, (b, e) in enumerate(grid.cells)]
            faces = source[tuple(inner)].astype(np.float32)
            if not grid.periodic[d]:
                faces = np.moveaxis(faces.copy(), d, 0)
                faces[0] *= 2.0
                faces[-1] *= 2.0
                faces = np.moveaxis(faces, 0, d)
            index = tuple(slice(1, 1 + m) for m in faces.shape) + (1,) * (3 - grid.dim)
            result[d][index] = faces
        periodic = tuple(grid.periodic) + (False,) * (3 - grid.dim)
        return Openness((result[0], result[1], result[2]), (periodic[0], periodic[1], periodic[2]))

    def coarser(self) -> "Openness":
        """Cells merged in twos; a coarse face is the mean of the fine faces it consists of.

        An axis of one cell stays: its faces then weigh four times as much against those that doubled their spacing.
        """
        factor = [2 if n > 1 else 1 for n in self.shape]
        shape = [-(-n // f) for n, f in zip(self.shape, factor, strict=True)]
        result = []
        for d in range(3):
            fine = self.a[d]
            planes = np.minimum(np.arange(shape[d] + 1) * factor[d], self.shape[d]) + 1
            coarse = np.take(fine, planes, axis=d)
            for e in range(3):
                if e != d:
                    inner = np.moveaxis(coarse, e, 0)[1:-1]
                    missing = np.zeros((shape[e] * factor[e] - len(inner), *inner.shape[1:]), inner.dtype)
                    inner = np.concatenate([inner, missing]).reshape(shape[e], factor[e], *inner.shape[1:])
                    coarse = np.moveaxis(inner.mean(axis=1), 0, e)
            if factor[d] == 1:
                coarse = coarse * 4.0
            padded = np.zeros([n + 2 for n in shape], np.float32)
            padded[tuple(slice(1, 1 + n) for n in coarse.shape)] = coarse
            result.append(padded)
        return Openness((result[0], result[1], result[2]), self.periodic)

    def matrix(self) -> sp.csr_array:
        """The equations of all inner cells (axis 0 fastest); closed-off cells have an empty row."""
        shape = self.shape
        number = np.arange(np.prod(shape)).reshape(shape, order="F")
        total = len(number.ravel())
        inner = tuple(slice(1, 1 + n) for n in shape)
        result = sp.csr_array((total, total))
        for d in range(3):
            low = self.a[d][inner]
            high = np.roll(self.a[d], -1, axis=d)[inner]
            result += sp.diags_array((low + high).ravel(order="F"))
            below = np.roll(number, 1, axis=d)
            linked = low > 0
            if not self.periodic[d]:
                np.moveaxis(linked, d, 0)[0] = False
            i, j, a = number[linked], below[linked], low[linked]
            link = sp.csr_array((a, (i, j)), shape=(total, total))
            result -= link + link.T
        return sp.csr_array(result)


class DirectSolver:
    """Sparse LU factors of the equations, made once (SuperLU, Li 2005, doi:10.1145/1089014.1089017)."""

    def __init__(self, openness: Openness, grid: Grid):
        self.grid = grid
        matrix = openness.matrix()
        self.air = np.flatnonzero(matrix.diagonal() > 0)
        matrix = matrix[self.air][:, self.air]
        count, self.region = connected_components(matrix, directed=False)
        grounded = np.zeros(count, bool)
        np.logical_or.at(grounded, self.region, matrix.sum(axis=1) > 1e-6)
        self.floating = ~grounded[self.region]  # cells of regions that phi = 0 nowhere touches
        self.size = np.bincount(self.region)
        first = np.unique(self.region, return_index=True)[1]
        pins = np.zeros(len(self.air))
        pins[first[~grounded]] = 1.0
        matrix = (matrix + sp.diags_array(pins)).tocsc()
        options = {"SymmetricMode": True}
        self.lu = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
        self.iterations = 1

    def solve(self, b: Any, phi: Any, tolerance: float) -> None:
        """Set the inner cells of field phi to the solution for field b; exact, whatever the tolerance."""
        del tolerance
        right = self.grid.inner(b.to_numpy()).ravel(order="F")[self.air].astype(np.float64)
        if self.floating.any():  # solvable only without a net source
            mean = np.bincount(self.region, right) / self.size
            right -= np.where(self.floating, mean[self.region], 0.0)
        flat = np.zeros(int(np.prod(self.grid.shape)), np.float32)
        flat[self.air] = self.lu.solve(right)
        phi.from_numpy(self.grid.pad(flat.reshape(self.grid.shape, order="F")))


OMEGA = 0.8  # damping of the Jacobi sweeps
COARSEST = 600  # cells that are solved by their dense inverse


@ti.data_oriented
class Multigrid:
    """Conjugate gradients preconditioned by one V-cycle (two damped Jacobi sweeps each way, merged cells).

    All levels live in flat arrays one after the other, so every kernel is compiled once for all of them.
    """

    def __init__(self, openness: Openness, grid: Grid):
        self.grid = grid
        levels = [openness]
        while np.prod(levels[-1].shape) > COARSEST and max(levels[-1].shape) > 2:
            levels.append(levels[-1].coarser())
        self.shapes = [level.shape for level in levels]
        self.periodic = openness.periodic
        self.axes = tuple(d for d in range(3) if openness.shape[d] > 1 or openness.a[d].any())
        sizes = [int(np.prod([n + 2 for n in shape])) for shape in self.shapes]
        begins = np.concatenate([[0], np.cumsum(sizes)])
        merged = [np.where(np.array(shape) > 1, 2, 1) for shape in self.shapes]
        layout = [
            [begin, *shape, *factor]
            for begin, shape, factor in zip(begins[:-1], self.shapes, merged, strict=True)
        ]
        self.layout: Any = ti.field(ti.i32, (len(levels), 7))  # begin, cells per axis, cells merged per axis
        self.layout.from_numpy(np.array(layout, np.int32))
        total = int(begins[-1])
        self.a = [ti.field(ti.f32, total) for _ in range(3)]
        for d in range(3):
            flat = np.concatenate([level.a[d].ravel(order="F") for level in levels])
            self.a[d].from_numpy(flat.astype(np.float32))
        self.x, self.t, self.b = (ti.field(ti.f32, total) for _ in range(3))
        self.p, self.q, self.phi = (ti.field(ti.f32, sizes[0]) for _ in range(3))
        self.rows = [n[1] * n[2] for n in self.shapes]
        self.threaded = next(
            k for k, n in enumerate(self.shapes) if prod(n) <= FEW_CELLS or k == len(levels) - 1
        )
        self.partial = ti.field(ti.f64, self.rows[0])
        self.rho = ti.field(ti.f64, ())
        self.alpha, self.beta, self.mean = (ti.field(ti.f32, ()) for _ in range(3))

        matrix = levels[-1].matrix().toarray()
        self.inverse = ti.field(ti.f32, matrix.shape)
        self.inverse.from_numpy(np.linalg.pinv(matrix, rcond=1e-6, hermitian=True).astype(np.float32))
        n = self.shapes[-1]
        place = begins[-2] + np.arange(sizes[-1]).reshape([m + 2 for m in n], order="F")[1:-1, 1:-1, 1:-1]
        self.place = ti.field(ti.i32, matrix.shape[0])
        self.place.from_numpy(place.ravel(order="F").astype(np.int32))
        self.dense_b = ti.field(ti.f32, matrix.shape[0])

        fine = openness.matrix()
        air = fine.diagonal() > 0
        self.air_cells = int(air.sum())
        self.floating = not bool((fine.sum(axis=1)[air] > 1e-6).any())
        self.iterations = 0

    # ---- a row of cells: where it starts and where its neighbours' rows start

    @ti.func
    def _row(self, level, row):
        """(index of the row's first cell, its length, index steps to the neighbours below and above per axis)."""
        n0, n1, n2 = self.layout[level, 1], self.layout[level, 2], self.layout[level, 3]
        s1, s2 = n0 + 2, (n0 + 2) * (n1 + 2)
        k = row // n1
        j = row - k * n1
        first = self.layout[level, 0] + (k + 1) * s2 + (j + 1) * s1 + 1
        low = ti.Vector([-1, -s1, -s2])
        high = ti.Vector([1, s1, s2])
        if ti.static(self.periodic[1]):
            low[1] = ti.select(j == 0, (n1 - 1) * s1, -s1)
            high[1] = ti.select(j == n1 - 1, -(n1 - 1) * s1, s1)
        if ti.static(self.periodic[2]):
            low[2] = ti.select(k == 0, (n2 - 1) * s2, -s2)
            high[2] = ti.select(k == n2 - 1, -(n2 - 1) * s2, s2)
        return first, n0, low, high, ti.Vector([1, s1, s2])

    @ti.func
    def _apply(self, x: Template, first, i, n0, low: Template, high: Template, step: Template):
        """(sum of a (x_I - x_neighbour), sum of a) at cell i of a row."""
        c = first + i
        result, diagonal = 0.0, 0.0
        for d in ti.static(self.axes):
            below, above = c + low[d], c + high[d]
            if ti.static(d == 0 and self.periodic[0]):
                below = ti.select(i == 0, c + n0 - 1, below)
                above = ti.select(i == n0 - 1, c - n0 + 1, above)
            a_low, a_high = self.a[d][c], self.a[d][c + step[d]]
            result += a_low * (x[c] - x[below]) + a_high * (x[c] - x[above])
            diagonal += a_low + a_high
        return result, diagonal

    @ti.func
    def _jacobi(self, source: Template, target: Template, level, row):
        """target = source + omega (b - A source)/diagonal over one row."""
        first, n0, low, high, step = self._row(level, row)
        for strip in range((n0 + STRIP - 1) // STRIP):
            values = ti.Vector([0.0] * STRIP)
            count = ti.min(STRIP, n0 - strip * STRIP)
            for n in range(count):
                i = strip * STRIP + n
                ax, diagonal = self._apply(source, first, i, n0, low, high, step)
                change = OMEGA * (self.b[first + i] - ax) / ti.max(diagonal, 1e-6)
                values[n] = source[first + i] + ti.select(diagonal > 1e-6, change, 0.0)
            for n in range(count):
                target[first + strip * STRIP + n] = values[n]

    # ---- the V-cycle: x = M b on the finest level, M symmetric

    @ti.func
    def _smooth_zero(self, level, rows):
        """t = one Jacobi sweep from zero."""
        for row in range(rows):
            first, n0, _, _, step = self._row(level, row)
            for i in range(n0):
                c = first + i
                diagonal = 0.0
                for d in ti.static(self.axes):
                    diagonal += self.a[d][c] + self.a[d][c + step[d]]
                self.t[c] = ti.select(diagonal > 1e-6, OMEGA * self.b[c] / ti.max(diagonal, 1e-6), 0.0)

    @ti.func
    def _smooth(self, source: Template, target: Template, level, rows):
        for row in range(rows):
            self._jacobi(source, target, level, row)

    @ti.func
    def _restrict(self, level, coarse_rows):
        """b of the coarser level = residual summed over merged cells, scaled to its spacing."""
        for row in range(coarse_rows):
            target, _, _, _, _ = self._row(level + 1, row)
            n1, n2 = self.layout[level, 2], self.layout[level, 3]
            f0, f1, f2 = self.layout[level, 4], self.layout[level, 5], self.layout[level, 6]
            k = row // self.layout[level + 1, 2]
            j = row - k * self.layout[level + 1, 2]
            length = self.layout[level, 1]
            scale = 4.0 / ti.cast(f0 * f1 * f2, ti.f32)
            for strip in range((length + STRIP - 1) // STRIP):
                count = ti.min(STRIP, length - strip * STRIP)
                sums = ti.Vector([0.0] * STRIP)
                for kk in range(k * f2, ti.min(k * f2 + f2, n2)):
                    for jj in range(j * f1, ti.min(j * f1 + f1, n1)):
                        first, n0, low, high, step = self._row(level, kk * n1 + jj)
                        values = ti.Vector([0.0] * STRIP)
                        for n in range(count):
                            i = strip * STRIP + n
                            ax, _ = self._apply(self.x, first, i, n0, low, high, step)
                            values[n] = self.b[first + i] - ax
                        for n in range(count):
                            sums[n >> (f0 - 1)] += values[n]
                begin = target + ((strip * STRIP) >> (f0 - 1))
                for n in range((count + f0 - 1) >> (f0 - 1)):
                    self.b[begin + n] = scale * sums[n]

    @ti.func
    def _prolong(self, level, rows):
        """Add the coarser level's correction to x."""
        for row in range(rows):
            first, n0, _, _, _ = self._row(level, row)
            m0, m1 = self.layout[level + 1, 1], self.layout[level + 1, 2]
            k = row // self.layout[level, 2]
            j = row - k * self.layout[level, 2]
            f0, f1, f2 = self.layout[level, 4], self.layout[level, 5], self.layout[level, 6]
            begin = self.layout[level + 1, 0] + ((k // f2 + 1) * (m1 + 2) + j // f1 + 1) * (m0 + 2) + 1
            for i in range(n0):
                self.x[first + i] = self.x[first + i] + self.x[begin + (i >> (f0 - 1))]

    @ti.func
    def _down_passes(self, level, rows, coarse_rows):
        self._smooth_zero(level, rows)
        self._smooth(self.t, self.x, level, rows)
        self._restrict(level, coarse_rows)

    @ti.func
    def _up_passes(self, level, rows):
        self._prolong(level, rows)
        self._smooth(self.x, self.t, level, rows)
        self._smooth(self.t, self.x, level, rows)

    @ti.func
    def _rows(self, level):
        return self.layout[level, 2] * self.layout[level, 3]

    @ti.kernel
    def _down(self, level: ti.i32, rows: ti.i32, coarse_rows: ti.i32):
        self._down_passes(level, rows, coarse_rows)

    @ti.kernel
    def _up(self, level: ti.i32, rows: ti.i32):
        self._up_passes(level, rows)

    @ti.kernel
    def _coarse_levels(self, begin: ti.i32, end: ti.i32):
        """The V-cycle from level `begin` to the dense inverse of level `end` and back, in one thread."""
        for _ in range(1):
            for level in range(begin, end):
                self._down_passes(level, self._rows(level), self._rows(level + 1))
            for i in range(self.place.shape[0]):
                self.dense_b[i] = self.b[self.place[i]]
            for i in range(self.place.shape[0]):
                total = 0.0
                for j in range(self.place.shape[0]):
                    total += self.inverse[i, j] * self.dense_b[j]
                self.x[self.place[i]] = total
            for back in range(end - begin):
                level = end - 1 - back
                self._up_passes(level, self._rows(level))

    def _v_cycle(self) -> None:
        for k in range(self.threaded):
            self._down(k, self.rows[k], self.rows[k + 1])
        self._coarse_levels(self.threaded, len(self.shapes) - 1)
        for k in reversed(range(self.threaded)):
            self._up(k, self.rows[k])

    # ---- conjugate gradients; sums over rows are added in one order, so results do not depend on the threads

    @ti.func
    def _sum(self, rows):
        total = ti.cast(0.0, ti.f64)
        for row in range(rows):
            total += self.partial[row]
        return total

    @ti.func
    def _cell(self, row, i):
        """Index of a fine cell on the padded grid."""
        g = ti.static(self.grid.ghost)
        n1 = self.layout[0, 2]
        I = ti.Vector([i, row % n1, row // n1])
        return ti.Vector([I[d] + g for d in ti.static(range(self.grid.dim))])

    @ti.kernel
    def _load(self, b: Template, rows: ti.i32):
        """The residual of phi = 0; closed-off cells and, where only differences of phi count, the mean are left out."""
        for row in range(rows):
            first, n0, low, high, step = self._row(0, row)
            total = 0.0
            for i in range(n0):
                _, diagonal = self._apply(self.p, first, i, n0, low, high, step)
                value = ti.select(diagonal > 1e-6, b[self._cell(row, i)], 0.0)
                self.b[first + i] = value
                total += value
            self.partial[row] = ti.cast(total, ti.f64)
        for _ in range(1):
            self.rho[None] = 0.0
            self.mean[None] = ti.cast(self._sum(rows) / self.air_cells, ti.f32)
        for row in range(rows):
            first, n0, low, high, step = self._row(0, row)
            for i in range(n0):
                if ti.static(self.floating):
                    _, diagonal = self._apply(self.p, first, i, n0, low, high, step)
                    mean = ti.select(diagonal > 1e-6, self.mean[None], 0.0)
                    self.b[first + i] = self.b[first + i] - mean
                self.p[first + i] = 0.0
                self.phi[first + i] = 0.0

    @ti.kernel
    def _iterate(self, rows: ti.i32) -> ti.f32:
        """One step along p = x + beta p, where x is the preconditioned residual b; returns the largest residual."""
        for row in range(rows):
            first, n0, _, _, _ = self._row(0, row)
            total = 0.0
            for i in range(n0):
                total += self.b[first + i] * self.x[first + i]
            self.partial[row] = ti.cast(total, ti.f64)
        for _ in range(1):
            rho = self._sum(rows)
            self.beta[None] = ti.cast(rho / self.rho[None], ti.f32) if self.rho[None] > 0.0 else 0.0
            self.rho[None] = rho
        for row in range(rows):
            first, n0, _, _, _ = self._row(0, row)
            for i in range(n0):
                self.p[first + i] = self.x[first + i] + self.beta[None] * self.p[first + i]
        for row in range(rows):
            first, n0, low, high, step = self._row(0, row)
            total = 0.0
            for strip in range((n0 + STRIP - 1) // STRIP):
                values = ti.Vector([0.0] * STRIP)
                count = ti.min(STRIP, n0 - strip * STRIP)
                for n in range(count):
                    i = strip * STRIP + n
                    ax, _ = self._apply(self.p, first, i, n0, low, high, step)
                    values[n] = ax
                    total += ax * self.p[first + i]
                for n in range(count):
                    self.q[first + strip * STRIP + n] = values[n]
            self.partial[row] = ti.cast(total, ti.f64)
        for _ in range(1):
            curvature = self._sum(rows)
            self.alpha[None] = ti.cast(self.rho[None] / curvature, ti.f32) if curvature > 0.0 else 0.0
        for row in range(rows):
            first, n0, _, _, _ = self._row(0, row)
            alpha, largest = self.alpha[None], 0.0
            for i in range(n0):
                self.phi[first + i] = self.phi[first + i] + alpha * self.p[first + i]
            for i in range(n0):
                self.b[first + i] = self.b[first + i] - alpha * self.q[first + i]
            for i in range(n0):
                largest = ti.max(largest, ti.abs(self.b[first + i]))
            self.partial[row] = ti.cast(largest, ti.f64)
        result = 0.0
        for _ in range(1):
            for row in range(rows):
                result = ti.max(result, ti.cast(self.partial[row], ti.f32))
        return result

    @ti.kernel
    def _store(self, phi: Template, rows: ti.i32):
        for row in range(rows):
            first, n0, _, _, _ = self._row(0, row)
            for i in range(n0):
                phi[self._cell(row, i)] = self.phi[first + i]

    def solve(self, b: Any, phi: Any, tolerance: float, limit: int = 60) -> None:
        """Set the inner cells of field phi to the solution for field b, to a largest residual below `tolerance`."""
        rows = self.rows[0]
        self._load(b, rows)
        for self.iterations in range(1, limit + 1):
            self._v_cycle()
            if self._iterate(rows) < tolerance:
                break
        self._store(phi, rows)


def pressure_solver(openness: tuple[np.ndarray, ...], grid: Grid) -> "DirectSolver | Multigrid":
    """The faster solver for these faces: a direct one for a single layer of cells, otherwise multigrid."""
    equations = Openness.of(openness, grid)
    if sum(n > 1 for n in grid.shape) <= 2 and on_cpu():
        return DirectSolver(equations, grid)
    return Multigrid(equations, grid)
