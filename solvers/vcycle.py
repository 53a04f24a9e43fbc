"""Multigrid V-cycle for the Poisson equation of the pressure projection."""

from math import prod

import numpy as np

from taichi_plume.engine import ti
from taichi_plume.engine.device_loops import block_size
from taichi_plume.engine.fields import on_cpu
from taichi_plume.grid.kernels import FEW_CELLS, STRIP, Template
from taichi_plume.solvers.poisson import OpenFractions

OMEGA = 0.8  # damping of the Jacobi sweeps
COARSEST = (
    600  # largest number of cells solved by their dense inverse; with 64, u is 50 times as far from exact
)
BLOCK_CELLS = (
    16_000  # a level of fewer cells keeps a block of a GPU's threads no longer than its launches take
)


class VCycle:
    """Multigrid V-cycle x = M b on the finest level, M symmetric: two damped Jacobi sweeps each way, merged cells, and
    the dense inverse on the coarsest level.

    All levels are stored in flat arrays one after the other, so every kernel is compiled only once. A thread computes
    one piece of a level: a row of cells on a CPU, a cell on a GPU.
    """

    def __init__(self, fractions: OpenFractions):
        levels = [fractions]
        while np.prod(levels[-1].shape) > COARSEST and max(levels[-1].shape) > 2:
            levels.append(levels[-1].coarser())
        self.shapes = [level.shape for level in levels]
        self.periodic = fractions.periodic
        self.strips = on_cpu()
        self.axes = tuple(d for d in range(3) if fractions.shape[d] > 1 or fractions.a[d].any())
        sizes = [int(np.prod([n + 2 for n in shape])) for shape in self.shapes]
        begins = np.concatenate([[0], np.cumsum(sizes)])
        merged = [np.where(np.array(shape) > 1, 2, 1) for shape in self.shapes]
        layout = [
            [begin, *shape, *factor]
            for begin, shape, factor in zip(begins[:-1], self.shapes, merged, strict=True)
        ]
        # begin, cells per axis, cells merged per axis
        self.layout = ti.filled(layout)
        total = int(begins[-1])
        self.a = [
            ti.filled(np.concatenate([level.a[d].ravel(order="F") for level in levels])) for d in range(3)
        ]
        damped = np.concatenate([self._damped(level).ravel(order="F") for level in levels])
        self.damped = ti.filled(damped)
        self.x, self.t, self.b = (ti.field(ti.f32, total) for _ in range(3))
        self.pieces = [n[1] * n[2] if self.strips else prod(n) for n in self.shapes]
        single, self.last = FEW_CELLS if on_cpu() else BLOCK_CELLS, len(levels) - 1
        self.threaded = next(k for k, n in enumerate(self.shapes) if prod(n) <= single or k == self.last)
        """First of the levels that a single thread solves, or on a GPU a block of threads."""
        self.progress = ti.filled([1, 0])
        """Whether the cycle is executed, 1 or 0, and the number of iterations, see `multigrid`."""
        self._invert_coarsest(levels[-1], int(begins[-2]))

    @staticmethod
    def _damped(level: OpenFractions) -> np.ndarray:
        """Return OMEGA over the diagonal of a level's equations, 0 in closed-off cells, with one ghost layer."""
        inner = (slice(1, -1),) * 3
        diagonal = sum(a[inner] + np.roll(a, -1, axis=d)[inner] for d, a in enumerate(level.a))
        return np.pad(np.where(diagonal > 1e-6, OMEGA / np.maximum(diagonal, 1e-6), 0.0), 1)

    def _invert_coarsest(self, level: OpenFractions, begin: int) -> None:
        """Store the dense inverse of the coarsest level, and the indices of its cells in the flat arrays."""
        matrix = level.matrix().toarray()
        inverse = np.linalg.pinv(matrix, rcond=1e-6, hermitian=True)
        self.inverse = ti.filled(inverse)
        padded = [n + 2 for n in level.shape]
        place = begin + np.arange(prod(padded)).reshape(padded, order="F")[1:-1, 1:-1, 1:-1]
        self.place = ti.filled(place.ravel(order="F"))
        self.dense_b = ti.field(ti.f32, matrix.shape[0])

    # ---- a row of cells: where it starts and where its neighbours' rows start

    @ti.func
    def _row(self, level, row):
        """Return a row's first cell, its length, steps to lower and to upper neighbours per axis, and strides."""
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
        """Return (A x) at cell i of a row: the sum over faces of a (x_I - x_neighbour)."""
        c = first + i
        result = 0.0
        for d in ti.static(self.axes):
            below, above = self._beside(d, c, i, n0, low, high)
            result += self.a[d][c] * (x[c] - x[below]) + self.a[d][c + step[d]] * (x[c] - x[above])
        return result

    @ti.func
    def _beside(self, d: Template, c, i, n0, low: Template, high: Template):
        """Return the indices of the lower and upper neighbours of cell c along axis d."""
        below, above = c + low[d], c + high[d]
        if ti.static(d == 0 and self.periodic[0]):
            below = ti.select(i == 0, c + n0 - 1, below)
            above = ti.select(i == n0 - 1, c - n0 + 1, above)
        return below, above

    @ti.func
    def _place(self, level, piece):
        """Return the row of a piece, and its first cell and end in the row: all of it on a CPU, a cell on a GPU."""
        n0 = self.layout[level, 1]
        row, start, end = piece, 0, n0
        if ti.static(not self.strips):
            row = piece // n0
            start = piece - row * n0
            end = start + 1
        return row, start, end

    @ti.func
    def _fill(self, target: Template, formula: Template, level, row, start, extra: Template):
        """Set target = formula(first, i, n0, low, high, step, extra) in a row by strips; on a GPU in cell `start`."""
        first, n0, low, high, step = self._row(level, row)
        if ti.static(self.strips):
            for strip in range((n0 + STRIP - 1) // STRIP):
                values = ti.Vector([0.0] * STRIP)
                count = ti.min(STRIP, n0 - strip * STRIP)
                for n in range(count):
                    values[n] = formula(first, strip * STRIP + n, n0, low, high, step, extra)
                for n in range(count):
                    target[first + strip * STRIP + n] = values[n]
        else:
            target[first + start] = formula(first, start, n0, low, high, step, extra)

    @ti.func
    def _jacobi(self, first, i, n0, low: Template, high: Template, step: Template, source: Template):
        """Return cell i of a row after a damped Jacobi sweep: source + omega (b - A source)/diagonal."""
        ax = self._apply(source, first, i, n0, low, high, step)
        return source[first + i] + self.damped[first + i] * (self.b[first + i] - ax)

    @ti.func
    def _jacobi_twice(self, first, i, n0, low: Template, high: Template, step: Template, _: Template):
        """Return x in cell i of a row after two damped Jacobi sweeps from zero; the first is omega b/diagonal."""
        c = first + i
        once = self.damped[c] * self.b[c]
        ax = 0.0
        for d in ti.static(self.axes):
            below, above = self._beside(d, c, i, n0, low, high)
            ax += self.a[d][c] * (once - self.damped[below] * self.b[below])
            ax += self.a[d][c + step[d]] * (once - self.damped[above] * self.b[above])
        return once + self.damped[c] * (self.b[c] - ax)

    # ---- the V-cycle: what each pass does to a piece of a level

    @ti.func
    def _presmooth(self, level, piece):
        row, start, _ = self._place(level, piece)
        self._fill(self.x, self._jacobi_twice, level, row, start, 0)

    @ti.func
    def _restrict(self, level, piece):
        """Set b of a piece of the next coarser level to the residual summed over merged cells, scaled to the coarser
        spacing.
        """
        row, coarse, _ = self._place(level + 1, piece)
        target, _, _, _, _ = self._row(level + 1, row)
        n1, n2 = self.layout[level, 2], self.layout[level, 3]
        f0, f1, f2 = self.layout[level, 4], self.layout[level, 5], self.layout[level, 6]
        k = row // self.layout[level + 1, 2]
        j = row - k * self.layout[level + 1, 2]
        length = self.layout[level, 1]
        scale = 4.0 / ti.cast(f0 * f1 * f2, ti.f32)
        total = 0.0
        if ti.static(self.strips):
            for i in range((length + f0 - 1) >> (f0 - 1)):
                self.b[target + i] = 0.0
        for kk in range(k * f2, ti.min(k * f2 + f2, n2)):
            for jj in range(j * f1, ti.min(j * f1 + f1, n1)):
                first, n0, low, high, step = self._row(level, kk * n1 + jj)
                if ti.static(self.strips):
                    for strip in range((length + STRIP - 1) // STRIP):
                        count = ti.min(STRIP, length - strip * STRIP)
                        values = ti.Vector([0.0] * STRIP)
                        for n in range(count):
                            i = strip * STRIP + n
                            ax = self._apply(self.x, first, i, n0, low, high, step)
                            values[n] = scale * (self.b[first + i] - ax)
                        for n in range(count):
                            place = target + ((strip * STRIP + n) >> (f0 - 1))
                            self.b[place] = self.b[place] + values[n]
                else:
                    for i in range(coarse * f0, ti.min(coarse * f0 + f0, length)):
                        ax = self._apply(self.x, first, i, n0, low, high, step)
                        total += scale * (self.b[first + i] - ax)
        if ti.static(not self.strips):
            self.b[target + coarse] = total

    @ti.func
    def _prolong(self, level, piece):
        """Add the correction of the next coarser level to x."""
        row, start, _ = self._place(level, piece)
        m0, m1 = self.layout[level + 1, 1], self.layout[level + 1, 2]
        k = row // self.layout[level, 2]
        j = row - k * self.layout[level, 2]
        f0, f1, f2 = self.layout[level, 4], self.layout[level, 5], self.layout[level, 6]
        begin = self.layout[level + 1, 0] + ((k // f2 + 1) * (m1 + 2) + j // f1 + 1) * (m0 + 2) + 1
        self._fill(self.x, self._with_coarse, level, row, start, ti.Vector([begin, f0 - 1]))

    @ti.func
    def _with_coarse(self, first, i, n0, low: Template, high: Template, step: Template, coarse: Template):
        return self.x[first + i] + self.x[coarse[0] + (i >> coarse[1])]

    @ti.func
    def _smooth_into_t(self, level, piece):
        row, start, _ = self._place(level, piece)
        self._fill(self.t, self._jacobi, level, row, start, self.x)

    @ti.func
    def _smooth_into_x(self, level, piece):
        row, start, _ = self._place(level, piece)
        self._fill(self.x, self._jacobi, level, row, start, self.t)

    # ---- the V-cycle: large levels pass by pass, small ones in a single thread or, on a GPU, in a block of threads

    @ti.func
    def _down_passes(self, level: Template, pieces: Template, coarse_pieces: Template):
        for piece in range(pieces * self.progress[0]):
            self._presmooth(level, piece)
        for piece in range(coarse_pieces * self.progress[0]):
            self._restrict(level, piece)

    @ti.func
    def _up_passes(self, level: Template, pieces: Template):
        for piece in range(pieces * self.progress[0]):
            self._prolong(level, piece)
        for piece in range(pieces * self.progress[0]):
            self._smooth_into_t(level, piece)
        for piece in range(pieces * self.progress[0]):
            self._smooth_into_x(level, piece)

    @ti.kernel
    def _down(self, level: ti.i32, pieces: ti.i32, coarse_pieces: ti.i32):
        self._down_passes(level, pieces, coarse_pieces)

    @ti.kernel
    def _up(self, level: ti.i32, pieces: ti.i32):
        self._up_passes(level, pieces)

    @ti.func
    def _by_lane(self, run: Template, level, of_level, lane):
        """Execute a pass for the pieces of a level that a thread of the block takes, then wait for the others."""
        pieces = self.layout[of_level, 2] * self.layout[of_level, 3] * self.progress[0]
        if ti.static(not self.strips):
            pieces *= self.layout[of_level, 1]
        width = ti.static(block_size())
        for n in range((pieces - lane + width - 1) // width):
            run(level, lane + n * width)
        ti.barrier()

    @ti.func
    def _solve_coarsest(self, lane):
        width = ti.static(block_size())
        for n in range((self.place.shape[0] - lane + width - 1) // width):
            self.dense_b[lane + n * width] = self.b[self.place[lane + n * width]]
        ti.barrier()
        for n in range((self.place.shape[0] - lane + width - 1) // width):
            i = lane + n * width
            total = 0.0
            for j in range(self.place.shape[0]):
                if ti.static(self.strips):
                    total += self.inverse[i, j] * self.dense_b[j]
                else:  # the matrix is symmetric: neighbouring threads read neighbours
                    total += self.inverse[j, i] * self.dense_b[j]
            self.x[self.place[i]] = total
        ti.barrier()

    @ti.func
    def _coarse_passes(self, begin: Template, end: Template):
        """Run the V-cycle from level `begin` to the dense inverse of level `end` and back."""
        ti.loop_config(serialize=ti.static(self.strips), block_dim=ti.static(block_size()))
        for lane in range(ti.static(block_size())):
            for level in range(begin, end):
                self._by_lane(self._presmooth, level, level, lane)
                self._by_lane(self._restrict, level, level + 1, lane)
            self._solve_coarsest(lane)
            for back in range(end - begin):
                level = end - 1 - back
                self._by_lane(self._prolong, level, level, lane)
                self._by_lane(self._smooth_into_t, level, level, lane)
                self._by_lane(self._smooth_into_x, level, level, lane)

    @ti.kernel
    def _coarse_levels(self, begin: ti.i32, end: ti.i32):
        self._coarse_passes(begin, end)

    @ti.func
    def _cycle(self):
        """Run the V-cycle, all levels in one kernel."""
        for k in ti.static(range(self.threaded)):
            self._down_passes(k, self.pieces[k], self.pieces[k + 1])
        self._coarse_passes(self.threaded, self.last)
        for k in ti.static(range(self.threaded - 1, -1, -1)):
            self._up_passes(k, self.pieces[k])

    def _v_cycle(self) -> None:
        for k in range(self.threaded):
            self._down(k, self.pieces[k], self.pieces[k + 1])
        self._coarse_levels(self.threaded, self.last)
        for k in reversed(range(self.threaded)):
            self._up(k, self.pieces[k])
