"""Conjugate gradients for the Poisson equation of the pressure projection, preconditioned by a multigrid V-cycle."""

from collections import deque

import numpy as np
import scipy.sparse as sp

from taichi_plume.engine import ti
from taichi_plume.engine.device_loops import BLOCK, block_size
from taichi_plume.engine.fields import Field
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.kernels import Template
from taichi_plume.solvers.poisson import OpenFractions
from taichi_plume.solvers.vcycle import VCycle

THREADS, GROUPS = 1 << 14, 1 << 5  # threads of the first and of the last step of a sum on a GPU


class Multigrid(VCycle):
    """Poisson solver by conjugate gradients with one V-cycle as preconditioner; a `pressure.PressureSolver`.

    One sum per iteration: A p follows from A x by the recurrence of p, and p A p from the sums b x and x A x
    (Chronopoulos & Gear 1989, doi:10.1016/0377-0427(89)90045-9). x is the preconditioned residual of b. On a GPU
    iterations are launched ahead, as many as the solution before the last one took, as a time step has two. Iterations
    after the last one that is needed do nothing.
    """

    def __init__(self, fractions: OpenFractions, grid: Grid):
        super().__init__(fractions)
        self.grid = grid
        fine = fractions.a[0].size
        self.p, self.ap, self.phi = (ti.field(ti.f32, fine) for _ in range(3))
        self.rows = fractions.shape[1] * fractions.shape[2]
        # partial sums, of single precision: Vulkan misplaces 64-bit fields
        self.partial = ti.vector_field(2, ti.f32, self.rows if self.strips else THREADS)
        self.sums = ti.vector_field(2, ti.f32, 1 if self.strips else BLOCK + GROUPS)
        self.rho, self.curvature, self.alpha, self.beta, self.mean = (ti.field(ti.f32, ()) for _ in range(5))
        matrix = fractions.matrix()
        self.air_cells = int((matrix.diagonal() > 0).sum())
        self._store_grounded(matrix, fractions.shape)
        self.floating = self.conductance == 0.0
        self.iterations = 0
        self._earlier = deque([1, 1], 2)  # iterations of the last two solutions

    def _store_grounded(self, matrix: sp.csr_array, shape: tuple[int, ...]) -> None:
        """Store the coefficients of the free faces of the domain, where phi = 0, in the cells beside them."""
        excess = np.where(matrix.diagonal() > 0, np.asarray(matrix.sum(axis=1)).ravel(), 0.0)
        excess = np.where(excess > 1e-6, excess, 0.0)
        self.conductance = float(excess.sum())
        padded = np.pad(excess.reshape(shape, order="F"), 1).ravel(order="F")
        self.ground = ti.filled(padded)

    # ---- sums over the fine level: added in one order, so results do not depend on the threads

    @ti.func
    def _reduce(self, visit: Template, merge: Template, pieces: Template, source: Template):
        """Merge visit(piece, source), two numbers of each fine piece, into partial results, which `_merged` merges.

        merge(total, value) is the sum or the maximum. Each thread takes a row on a CPU, every THREADS-th cell on a GPU.
        """
        if ti.static(self.strips):
            for row in range(pieces):
                self.partial[row] = visit(row, source)
        else:
            for lane in range(THREADS):
                total = ti.Vector([0.0, 0.0])
                for n in range((pieces - lane + (THREADS - 1)) // THREADS):
                    total = merge(total, visit(lane + n * THREADS, source))
                self.partial[lane] = total

    @ti.func
    def _merged(self, merge: Template, lane):
        """Return the merged partial results, two numbers, in the first thread of a block; f64 as sums are long."""
        total = ti.Vector([ti.cast(0.0, ti.f64), ti.cast(0.0, ti.f64)])
        if ti.static(self.strips):
            for row in range(self.rows):
                total = merge(total, ti.cast(self.partial[row], ti.f64))
        else:
            block = ti.static(block_size())
            for n in range(THREADS // block):
                total = merge(total, ti.cast(self.partial[lane + n * block], ti.f64))
            if ti.static(block_size() > 1):
                self.sums[lane] = ti.cast(total, ti.f32)
                ti.barrier()
                if lane < GROUPS:
                    total = ti.Vector([ti.cast(0.0, ti.f64), ti.cast(0.0, ti.f64)])
                    for n in range(block // GROUPS):
                        total = merge(total, ti.cast(self.sums[lane + n * GROUPS], ti.f64))
                    self.sums[block + lane] = ti.cast(total, ti.f32)
                ti.barrier()
                if lane == 0:
                    total = ti.Vector([ti.cast(0.0, ti.f64), ti.cast(0.0, ti.f64)])
                    for n in range(GROUPS):
                        total = merge(total, ti.cast(self.sums[block + n], ti.f64))
        return total

    @ti.func
    def _plus(self, total, value):
        return total + value

    @ti.func
    def _larger(self, total, value):
        return ti.max(total, value)

    @ti.func
    def _cell(self, row, i):
        """Return the padded index of the i-th fine cell of a row."""
        g = ti.static(self.grid.ghost)
        n1 = self.layout[0, 2]
        I = ti.Vector([i, row % n1, row // n1])
        return ti.Vector([I[d] + g for d in ti.static(range(self.grid.dim))])

    # ---- conjugate gradients

    @ti.kernel
    def _load(self, b: Template, pieces: ti.i32):
        """Start from phi = 0: set the residual to b, without closed-off cells and, if floating, without the mean."""
        self._reduce(self._given, self._plus, pieces, b)
        ti.loop_config(serialize=ti.static(self.strips), block_dim=ti.static(block_size()))
        for lane in range(ti.static(block_size())):
            total = self._merged(self._plus, lane)
            if lane == 0:
                self.progress[0], self.progress[1], self.rho[None] = 1, 0, 0.0
                self.mean[None] = ti.cast(total[0] / self.air_cells, ti.f32)
        for piece in range(pieces):
            row, start, end = self._place(0, piece)
            first, _, _, _, _ = self._row(0, row)
            for i in range(start, end):
                if ti.static(self.floating):
                    mean = ti.select(self.damped[first + i] > 0.0, self.mean[None], 0.0)
                    self.b[first + i] = self.b[first + i] - mean
                self.p[first + i] = 0.0
                self.ap[first + i] = 0.0
                self.phi[first + i] = 0.0

    @ti.func
    def _given(self, piece, b: Template):
        """Set the residual of a piece to b; return its sum."""
        row, start, end = self._place(0, piece)
        first, _, _, _, _ = self._row(0, row)
        total = 0.0
        for i in range(start, end):
            value = ti.select(self.damped[first + i] > 0.0, b[self._cell(row, i)], 0.0)
            self.b[first + i] = value
            total += value
        return ti.Vector([total, 0.0])

    @ti.kernel
    def _iterate(self, pieces: ti.i32, tolerance: ti.f32, limit: ti.i32):
        self._step_along(pieces, tolerance, limit)

    @ti.kernel
    def _cycle_and_iterate(self, pieces: ti.i32, tolerance: ti.f32, limit: ti.i32):
        self._cycle()
        self._step_along(pieces, tolerance, limit)

    @ti.func
    def _step_along(self, pieces: Template, tolerance: Template, limit: Template):
        """Step along p = x + beta p; set `progress` by the largest residual and the tolerance. t, which the V-cycle no
        longer needs, holds A x.
        """
        self._reduce(self._products, self._plus, pieces * self.progress[0], 0)
        ti.loop_config(serialize=ti.static(self.strips), block_dim=ti.static(block_size()))
        for lane in range(ti.static(block_size())):
            total = self._merged(self._plus, lane)
            if lane == 0 and self.progress[0] == 1:
                rho, before = ti.cast(total[0], ti.f32), self.rho[None]
                beta = ti.select(before > 0.0, rho / before, 0.0)
                curvature = ti.cast(total[1], ti.f32) - beta * beta * self.curvature[None]
                if before <= 0.0:
                    curvature = ti.cast(total[1], ti.f32)
                self.rho[None], self.beta[None], self.curvature[None] = rho, beta, curvature
                self.alpha[None] = ti.select(curvature > 0.0, rho / curvature, 0.0)
        self._reduce(self._step, self._larger, pieces * self.progress[0], 0)
        ti.loop_config(serialize=ti.static(self.strips), block_dim=ti.static(block_size()))
        for lane in range(ti.static(block_size())):
            largest = self._merged(self._larger, lane)
            if lane == 0 and self.progress[0] == 1:
                self.progress[1] += 1
                self.progress[0] = ti.cast(largest[0] >= tolerance and self.progress[1] < limit, ti.i32)

    @ti.func
    def _products(self, piece, source: Template):
        """Set t = A x in a piece; return its sums b x and x A x."""
        row, start, end = self._place(0, piece)
        first, _, _, _, _ = self._row(0, row)
        self._fill(self.t, self._along, 0, row, start, 0)
        rho, curvature = 0.0, 0.0
        for c in range(first + start, first + end):
            rho += self.b[c] * self.x[c]
            curvature += self.t[c] * self.x[c]
        return ti.Vector([rho, curvature])

    @ti.func
    def _step(self, piece, source: Template):
        """Update p, A p, phi and the residual b in a piece; return the largest residual."""
        row, start, end = self._place(0, piece)
        first, _, _, _, _ = self._row(0, row)
        self._fill(self.p, self._next_p, 0, row, start, self.beta[None])
        self._fill(self.ap, self._next_ap, 0, row, start, self.beta[None])
        self._fill(self.phi, self._stepped, 0, row, start, self.alpha[None])
        self._fill(self.b, self._remaining, 0, row, start, self.alpha[None])
        largest = 0.0
        for c in range(first + start, first + end):
            largest = ti.max(largest, ti.abs(self.b[c]))
        return ti.Vector([largest, 0.0])

    @ti.func
    def _along(self, first, i, n0, low: Template, high: Template, step: Template, _: Template):
        return self._apply(self.x, first, i, n0, low, high, step)

    @ti.func
    def _next_p(self, first, i, n0, low: Template, high: Template, step: Template, beta: Template):
        return self.x[first + i] + beta * self.p[first + i]

    @ti.func
    def _next_ap(self, first, i, n0, low: Template, high: Template, step: Template, beta: Template):
        return self.t[first + i] + beta * self.ap[first + i]

    @ti.func
    def _stepped(self, first, i, n0, low: Template, high: Template, step: Template, alpha: Template):
        return self.phi[first + i] + alpha * self.p[first + i]

    @ti.func
    def _remaining(self, first, i, n0, low: Template, high: Template, step: Template, alpha: Template):
        return self.b[first + i] - alpha * self.ap[first + i]

    @ti.kernel
    def _store(self, phi: Template, pieces: ti.i32):
        """Write the solution to phi, shifted so that the flux through the free faces balances the sources exactly."""
        if ti.static(not self.floating):
            self._reduce(self._outflow, self._plus, pieces, 0)
            ti.loop_config(serialize=ti.static(self.strips), block_dim=ti.static(block_size()))
            for lane in range(ti.static(block_size())):
                total = self._merged(self._plus, lane)
                if lane == 0:
                    given = ti.cast(self.mean[None], ti.f64) * self.air_cells
                    self.alpha[None] = ti.cast((given - total[0]) / self.conductance, ti.f32)
        for piece in range(pieces):
            row, start, end = self._place(0, piece)
            first, _, _, _, _ = self._row(0, row)
            shift = 0.0
            if ti.static(not self.floating):
                shift = self.alpha[None]
            for i in range(start, end):
                value = self.phi[first + i]  # 0 without air
                phi[self._cell(row, i)] = ti.select(value != 0.0, value + shift, 0.0)

    @ti.func
    def _outflow(self, piece, source: Template):
        row, start, end = self._place(0, piece)
        first, _, _, _, _ = self._row(0, row)
        total = 0.0
        for c in range(first + start, first + end):
            total += self.ground[c] * self.phi[c]
        return ti.Vector([total, 0.0])

    def solve(self, b: Field, phi: Field, tolerance: float, limit: int = 60) -> None:
        """Solve for the right side b into phi, until the largest residual is below `tolerance` or `limit` steps."""
        pieces, ahead = self.pieces[0], 1 if self.strips else self._earlier[0]
        self._load(b, pieces)
        active = 1
        while active:
            for _ in range(ahead):
                if self.strips:
                    self._v_cycle()
                    self._iterate(pieces, tolerance, limit)
                else:  # a launch takes long on a GPU
                    self._cycle_and_iterate(pieces, tolerance, limit)
            active, self.iterations = map(int, self.progress.values)
            ahead = 1
        self._earlier.append(self.iterations)
        self._store(phi, pieces)
