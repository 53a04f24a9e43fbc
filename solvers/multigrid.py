"""Conjugate gradients for the Poisson equation of the pressure projection, preconditioned by a multigrid V-cycle."""

import numpy as np
import scipy.sparse as sp
import taichi as ti

from taichi_plume.grid.grid import Grid
from taichi_plume.grid.kernels import STRIP, Field, Template
from taichi_plume.grid.tables import Tables
from taichi_plume.solvers.poisson import OpenFractions
from taichi_plume.solvers.vcycle import VCycle


@ti.data_oriented
class Multigrid(VCycle):
    """Poisson solver by conjugate gradients with one V-cycle as preconditioner; a `pressure.PressureSolver`."""

    def __init__(self, fractions: OpenFractions, grid: Grid):
        tables = Tables()
        super().__init__(fractions, tables)
        self.grid = grid
        fine = fractions.a[0].size
        self.p, self.phi = (ti.field(ti.f32, fine) for _ in range(2))
        self.partial = ti.field(ti.f32, self.rows[0])  # of single precision: Vulkan misplaces 64-bit fields
        self.rho, self.alpha, self.beta, self.mean = (ti.field(ti.f32, ()) for _ in range(4))
        matrix = fractions.matrix()
        self.air_cells = int((matrix.diagonal() > 0).sum())
        self._list_grounded(matrix, fractions.shape, tables)
        self.floating = self.conductance == 0.0
        self.iterations = 0
        tables.upload()

    def _list_grounded(self, matrix: sp.csr_array, shape: tuple[int, ...], tables: Tables) -> None:
        """Store the cells beside free faces of the domain, where phi = 0: indices and coefficients of the faces."""
        excess = np.where(matrix.diagonal() > 0, np.asarray(matrix.sum(axis=1)).ravel(), 0.0)
        cells = np.flatnonzero(excess > 1e-6)
        i, j, k = np.unravel_index(cells, shape, order="F")
        s1, s2 = shape[0] + 2, (shape[0] + 2) * (shape[1] + 2)
        self.conductance = float(excess[cells].sum())
        self.grounded = tables.listed((k + 1) * s2 + (j + 1) * s1 + i + 1)
        self.ground = tables.listed(excess[cells])

    # ---- conjugate gradients; sums over rows are added in one order, so results do not depend on the threads

    @ti.func
    def _sum(self, rows):
        total = ti.cast(0.0, ti.f64)
        for row in range(rows):
            total += ti.cast(self.partial[row], ti.f64)
        return total

    @ti.func
    def _cell(self, row, i):
        """Return the padded index of the i-th fine cell of a row."""
        g = ti.static(self.grid.ghost)
        n1 = self.layout[0, 2]
        I = ti.Vector([i, row % n1, row // n1])
        return ti.Vector([I[d] + g for d in ti.static(range(self.grid.dim))])

    @ti.kernel
    def _load(self, b: Template, rows: ti.i32):
        """Start from phi = 0: set the residual to b, without closed-off cells and, if floating, without the mean."""
        for row in range(rows):
            first, n0, _, _, _ = self._row(0, row)
            total = 0.0
            for i in range(n0):
                value = ti.select(self.damped[first + i] > 0.0, b[self._cell(row, i)], 0.0)
                self.b[first + i] = value
                total += value
            self.partial[row] = total
        for _ in range(1):
            self.rho[None] = 0.0
            self.mean[None] = ti.cast(self._sum(rows) / self.air_cells, ti.f32)
        for row in range(rows):
            first, n0, _, _, _ = self._row(0, row)
            for i in range(n0):
                if ti.static(self.floating):
                    mean = ti.select(self.damped[first + i] > 0.0, self.mean[None], 0.0)
                    self.b[first + i] = self.b[first + i] - mean
                self.p[first + i] = 0.0
                self.phi[first + i] = 0.0

    @ti.kernel
    def _iterate(self, rows: ti.i32) -> ti.f32:
        """Step along p = x + beta p, x the preconditioned residual of b; return the largest residual.

        Afterwards t, which the V-cycle no longer needs, holds A p.
        """
        for row in range(rows):
            first, n0, _, _, _ = self._row(0, row)
            total = 0.0
            for i in range(n0):
                total += self.b[first + i] * self.x[first + i]
            self.partial[row] = total
        for _ in range(1):
            rho = ti.cast(self._sum(rows), ti.f32)
            self.beta[None] = rho / self.rho[None] if self.rho[None] > 0.0 else 0.0
            self.rho[None] = rho
        for row in range(rows):
            self._fill(self.p, self._direction, 0, row, self.beta[None])
        for row in range(rows):
            first, n0, low, high, step = self._row(0, row)
            total = 0.0
            if ti.static(self.strips):
                for strip in range((n0 + STRIP - 1) // STRIP):
                    values = ti.Vector([0.0] * STRIP)
                    count = ti.min(STRIP, n0 - strip * STRIP)
                    for n in range(count):
                        i = strip * STRIP + n
                        ax = self._apply(self.p, first, i, n0, low, high, step)
                        values[n] = ax
                        total += ax * self.p[first + i]
                    for n in range(count):
                        self.t[first + strip * STRIP + n] = values[n]
            else:
                for i in range(n0):
                    ax = self._apply(self.p, first, i, n0, low, high, step)
                    self.t[first + i] = ax
                    total += ax * self.p[first + i]
            self.partial[row] = total
        for _ in range(1):
            curvature = self._sum(rows)
            self.alpha[None] = ti.cast(self.rho[None] / curvature, ti.f32) if curvature > 0.0 else 0.0
        for row in range(rows):
            first, n0, _, _, _ = self._row(0, row)
            largest = 0.0
            self._fill(self.phi, self._stepped, 0, row, self.alpha[None])
            self._fill(self.b, self._remaining, 0, row, self.alpha[None])
            for i in range(n0):
                largest = ti.max(largest, ti.abs(self.b[first + i]))
            self.partial[row] = largest
        result = 0.0
        for _ in range(1):
            for row in range(rows):
                result = ti.max(result, self.partial[row])
        return result

    @ti.func
    def _direction(self, first, i, n0, low: Template, high: Template, step: Template, beta: Template):
        return self.x[first + i] + beta * self.p[first + i]

    @ti.func
    def _stepped(self, first, i, n0, low: Template, high: Template, step: Template, alpha: Template):
        return self.phi[first + i] + alpha * self.p[first + i]

    @ti.func
    def _remaining(self, first, i, n0, low: Template, high: Template, step: Template, alpha: Template):
        return self.b[first + i] - alpha * self.t[first + i]

    @ti.kernel
    def _store(self, phi: Template, rows: ti.i32):
        """Write the solution to phi, shifted so that the flux through the free faces balances the sources exactly."""
        for _ in range(1):
            out = ti.cast(0.0, ti.f64)
            for n in range(self.grounded.shape[0]):
                out += ti.cast(self.ground[n] * self.phi[self.grounded[n]], ti.f64)
            if ti.static(not self.floating):
                given = ti.cast(self.mean[None], ti.f64) * self.air_cells
                self.alpha[None] = ti.cast((given - out) / self.conductance, ti.f32)
            else:
                self.alpha[None] = 0.0
        for row in range(rows):
            first, n0, _, _, _ = self._row(0, row)
            for i in range(n0):
                value = self.phi[first + i]  # 0 without air
                phi[self._cell(row, i)] = ti.select(value != 0.0, value + self.alpha[None], 0.0)

    def solve(self, b: Field, phi: Field, tolerance: float, limit: int = 60) -> None:
        """Solve for the right side b into phi, until the largest residual is below `tolerance` or `limit` steps."""
        rows = self.rows[0]
        self._load(b, rows)
        for self.iterations in range(1, limit + 1):
            self._v_cycle()
            if self._iterate(rows) < tolerance:
                break
        self._store(phi, rows)
