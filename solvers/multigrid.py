"""Conjugate gradients for the Poisson equation of the pressure projection, preconditioned by a multigrid V-cycle."""

import numpy as np
import scipy.sparse as sp

from taichi_plume.engine import ti
from taichi_plume.engine.fields import Field
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.kernels import Template
from taichi_plume.solvers.poisson import OpenFractions
from taichi_plume.solvers.vcycle import VCycle

THREADS, GROUPS = 1 << 14, 1 << 7  # threads of the two steps of a sum on a GPU


class Multigrid(VCycle):
    """Poisson solver by conjugate gradients with one V-cycle as preconditioner; a `pressure.PressureSolver`."""

    def __init__(self, fractions: OpenFractions, grid: Grid):
        super().__init__(fractions)
        self.grid = grid
        fine = fractions.a[0].size
        self.p, self.phi = (ti.field(ti.f32, fine) for _ in range(2))
        self.rows = fractions.shape[1] * fractions.shape[2]
        # partial sums, of single precision: Vulkan misplaces 64-bit fields
        self.partial = ti.field(ti.f32, self.rows if self.strips else THREADS)
        self.results = self.partial if self.strips else ti.field(ti.f32, GROUPS)
        self.rho, self.alpha, self.beta, self.mean = (ti.field(ti.f32, ()) for _ in range(4))
        matrix = fractions.matrix()
        self.air_cells = int((matrix.diagonal() > 0).sum())
        self._store_grounded(matrix, fractions.shape)
        self.floating = self.conductance == 0.0
        self.iterations = 0

    def _store_grounded(self, matrix: sp.csr_array, shape: tuple[int, ...]) -> None:
        """Store the coefficients of the free faces of the domain, where phi = 0, in the cells beside them."""
        excess = np.where(matrix.diagonal() > 0, np.asarray(matrix.sum(axis=1)).ravel(), 0.0)
        excess = np.where(excess > 1e-6, excess, 0.0)
        self.conductance = float(excess.sum())
        padded = np.pad(excess.reshape(shape, order="F"), 1).ravel(order="F")
        self.ground = ti.filled(padded)

    # ---- conjugate gradients; sums are added in one order, so results do not depend on the threads

    @ti.func
    def _add_up(self, term: Template, merge: Template):
        """Merge term(c) of all padded indices c of the fine level into partial results, which `_sum` or `_most` merges.

        merge(total, value) is the sum or the maximum. Each thread takes a row on a CPU, every THREADS-th cell on a GPU.
        """
        if ti.static(self.strips):
            for row in range(self.rows):
                first, n0, _, _, _ = self._row(0, row)
                total = 0.0
                for i in range(n0):
                    total = merge(total, term(first + i))
                self.partial[row] = total
        else:
            for lane in range(THREADS):
                total = 0.0
                for n in range(-(-self.phi.shape[0] // THREADS)):
                    if lane + n * THREADS < self.phi.shape[0]:
                        total = merge(total, term(lane + n * THREADS))
                self.partial[lane] = total
            for group in range(GROUPS):
                total = 0.0
                for n in range(THREADS // GROUPS):
                    total = merge(total, self.partial[group + n * GROUPS])
                self.results[group] = total

    @ti.func
    def _sum(self):
        total = ti.cast(0.0, ti.f64)
        for n in range(self.results.shape[0]):
            total += ti.cast(self.results[n], ti.f64)
        return total

    @ti.func
    def _most(self):
        largest = 0.0
        for n in range(self.results.shape[0]):
            largest = ti.max(largest, self.results[n])
        return largest

    @ti.func
    def _plus(self, total, value):
        return total + value

    @ti.func
    def _larger(self, total, value):
        return ti.max(total, ti.abs(value))

    @ti.func
    def _cell(self, row, i):
        """Return the padded index of the i-th fine cell of a row."""
        g = ti.static(self.grid.ghost)
        n1 = self.layout[0, 2]
        I = ti.Vector([i, row % n1, row // n1])
        return ti.Vector([I[d] + g for d in ti.static(range(self.grid.dim))])

    @ti.kernel
    def _load(self, b: Template, pieces: ti.i32):
        """Start from phi = 0: set the residual to b, without closed-off cells and, if floating, without the mean."""
        for piece in range(pieces):
            row, start, end = self._place(0, piece)
            first, _, _, _, _ = self._row(0, row)
            for i in range(start, end):
                self.b[first + i] = ti.select(self.damped[first + i] > 0.0, b[self._cell(row, i)], 0.0)
        self._add_up(self._residual, self._plus)
        for _ in range(1):
            self.rho[None] = 0.0
            self.mean[None] = ti.cast(self._sum() / self.air_cells, ti.f32)
        for piece in range(pieces):
            row, start, end = self._place(0, piece)
            first, _, _, _, _ = self._row(0, row)
            for i in range(start, end):
                if ti.static(self.floating):
                    mean = ti.select(self.damped[first + i] > 0.0, self.mean[None], 0.0)
                    self.b[first + i] = self.b[first + i] - mean
                self.p[first + i] = 0.0
                self.phi[first + i] = 0.0

    @ti.kernel
    def _iterate(self, pieces: ti.i32) -> ti.f32:
        """Step along p = x + beta p, x the preconditioned residual of b; return the largest residual.

        Afterwards t, which the V-cycle no longer needs, holds A p.
        """
        self._add_up(self._residual_preconditioned, self._plus)
        for _ in range(1):
            rho = ti.cast(self._sum(), ti.f32)
            self.beta[None] = rho / self.rho[None] if self.rho[None] > 0.0 else 0.0
            self.rho[None] = rho
        for piece in range(pieces):
            row, start, _ = self._place(0, piece)
            self._fill(self.p, self._direction, 0, row, start, self.beta[None])
        for piece in range(pieces):
            row, start, _ = self._place(0, piece)
            self._fill(self.t, self._along, 0, row, start, 0)
        self._add_up(self._curvature, self._plus)
        for _ in range(1):
            curvature = self._sum()
            self.alpha[None] = ti.cast(self.rho[None] / curvature, ti.f32) if curvature > 0.0 else 0.0
        for piece in range(pieces):
            row, start, _ = self._place(0, piece)
            self._fill(self.phi, self._stepped, 0, row, start, self.alpha[None])
            self._fill(self.b, self._remaining, 0, row, start, self.alpha[None])
        self._add_up(self._residual, self._larger)
        result = 0.0
        for _ in range(1):
            result = self._most()
        return result

    @ti.func
    def _residual(self, c):
        return self.b[c]

    @ti.func
    def _residual_preconditioned(self, c):
        return self.b[c] * self.x[c]

    @ti.func
    def _curvature(self, c):
        return self.t[c] * self.p[c]

    @ti.func
    def _along(self, first, i, n0, low: Template, high: Template, step: Template, _: Template):
        return self._apply(self.p, first, i, n0, low, high, step)

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
    def _store(self, phi: Template, pieces: ti.i32):
        """Write the solution to phi, shifted so that the flux through the free faces balances the sources exactly."""
        if ti.static(not self.floating):
            self._add_up(self._outflow, self._plus)
        for _ in range(1):
            self.alpha[None] = 0.0
            if ti.static(not self.floating):
                given = ti.cast(self.mean[None], ti.f64) * self.air_cells
                self.alpha[None] = ti.cast((given - self._sum()) / self.conductance, ti.f32)
        for piece in range(pieces):
            row, start, end = self._place(0, piece)
            first, _, _, _, _ = self._row(0, row)
            for i in range(start, end):
                value = self.phi[first + i]  # 0 without air
                phi[self._cell(row, i)] = ti.select(value != 0.0, value + self.alpha[None], 0.0)

    @ti.func
    def _outflow(self, c):
        return self.ground[c] * self.phi[c]

    def solve(self, b: Field, phi: Field, tolerance: float, limit: int = 60) -> None:
        """Solve for the right side b into phi, until the largest residual is below `tolerance` or `limit` steps."""
        pieces = self.pieces[0]
        self._load(b, pieces)
        for self.iterations in range(1, limit + 1):
            self._v_cycle()
            if self._iterate(pieces) < tolerance:
                break
        self._store(phi, pieces)
