"""Cell lists of puffs, and the order of the puffs by cells.

There is a list of cells per octave of the puffs' size. Its cells are half as wide as the reach of its largest puffs, so
that a point visits few cells of any list.

The order is by cell, then by previous order (CPU) or by number of the puff (GPU).
Neither depends on threads, so sums are the same to the bit.
"""

from math import prod

import numpy as np

from taichi_plume.engine import ti
from taichi_plume.engine.fields import Field, on_cpu
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.kernels import Template

STEP = 2.0  # factor from the sizes of a list to those of the next list
WIDTH = 0.5  # width of the cells over the reach of a list's puffs
CELLS = 1 << 16  # largest number of cells of the finest list
BLOCK = 256  # cells per task of the parallel running sum


class PuffCells:
    """Lists of cells for up to `most` puffs, one list per octave of size. `start` holds for each cell, list by list,
    the number of puffs in all cells before, and at its end the total. `order` holds the puffs by cells.
    """

    STATE = ("start", "farthest")

    def __init__(self, most: int, cutoff: float, grid: Grid, smallest: float):
        """cutoff: reach in standard deviations; smallest: standard deviation of new puffs [m]."""
        self.grid, self.dim, self.cutoff = grid, grid.dim, cutoff
        sizes, shapes = self._lists_of(smallest)
        ends = np.cumsum([0, *map(prod, shapes)])
        self._size = ti.filled(sizes)  # size of the largest puff in each list [m]
        self._shape = ti.filled_vectors(shapes)
        self._first = ti.filled(ends)
        self.lists, self._cells = len(sizes), int(ends[-1])  # number of lists, and of the cells of all lists
        self._largest, self._per_smallest = 0.999 * sizes[-1], 1.0 / float(np.float32(sizes[0]))
        self.start: Field = ti.field(ti.i32, self._cells + 1)
        self.farthest: Field = ti.field(ti.f32, ())  # largest reach of any puff [m]
        self.order: Field = ti.field(ti.i32, most)
        self._cell: Field = ti.field(ti.i32, most)  # cell of each new puff; -1: left the domain
        self._cursor: Field = ti.field(ti.i32, self._cells)
        self._blocks: Field = ti.field(ti.i32, self._cells // BLOCK + 1)
        self._rough_order: Field = None if on_cpu() else ti.field(ti.i32, most)

    def _lists_of(self, smallest: float) -> tuple[list[float], list[tuple[int, ...]]]:
        """Return the largest puff size [m] and the shape of each list of cells; smallest: size of new puffs [m]."""
        extent = np.array(self.grid.extent)
        width = max(2.0 * WIDTH * self.cutoff * smallest, (np.prod(extent) / CELLS) ** (1 / self.dim))
        while np.prod(np.ceil(extent / width)) > CELLS:
            width *= 1.02
        sizes = [width / (WIDTH * self.cutoff)]
        while sizes[-1] < extent.max():  # a puff as large as the room is spread evenly over the room
            sizes.append(STEP * sizes[-1])
        return sizes, [tuple(np.ceil(extent / (WIDTH * self.cutoff * size)).astype(int)) for size in sizes]

    # ---------------------------------------------------------------- where puffs are

    @ti.func
    def size(self, variance: float):
        """Return the standard deviation [m] with which a puff of this variance is shown, at most about the room."""
        return ti.min(ti.sqrt(variance), self._largest)

    @ti.func
    def put(self, k: ti.i32, x: Template, variance: float, stays):
        """Store the cell of new puff k at x; stays: False drops the puff, which left the domain."""
        octaves = ti.log(self.size(variance) * self._per_smallest) * ti.static(1 / np.log(STEP))
        which = ti.math.clamp(ti.cast(ti.ceil(octaves), ti.i32), 0, self.lists - 1)
        width = WIDTH * self.cutoff * self._size[which]
        cell = 0
        for d in ti.static(range(self.dim - 1, -1, -1)):  # axis 0 runs fastest
            n = self._shape[which][d]
            cell = cell * n + ti.math.clamp(ti.cast(x[d] / width, ti.i32), 0, n - 1)
        self._cell[k] = ti.select(stays, self._first[which] + cell, -1)

    @ti.func
    def stays(self, k: ti.i32):
        """Return whether new puff k stays in the domain."""
        return self._cell[k] >= 0

    @ti.func
    def alive(self):
        """Return the number of sorted puffs."""
        return self.start[self._cells]

    @ti.func
    def empty(self, which: ti.i32):
        """Return whether list `which` holds no puff."""
        return self.start[self._first[which]] == self.start[self._first[which + 1]]

    @ti.func
    def reach(self, which: ti.i32):
        """Return the largest distance [m] that the puffs of list `which` reach."""
        return self.cutoff * self._size[which]

    @ti.func
    def block(self, p: Template, which: ti.i32):
        """Return the rows of a list's cells around p [m]: first cell and count per axis from 1 on, and row count."""
        reach, shape = self.reach(which), self._shape[which]
        width = WIDTH * reach
        low, rows = ti.Vector.zero(ti.i32, self.dim), ti.Vector.zero(ti.i32, self.dim)
        count = 1
        for d in ti.static(range(1, self.dim)):
            low[d] = ti.max(ti.cast(ti.floor((p[d] - reach) / width), ti.i32), 0)
            high = ti.min(ti.cast(ti.floor((p[d] + reach) / width), ti.i32), shape[d] - 1)
            rows[d] = ti.max(high - low[d] + 1, 0)
            count *= rows[d]
        return low, rows, count

    @ti.func
    def row(self, p: Template, which: ti.i32, low: Template, rows: Template, r: ti.i32):
        """Return (begin, end) in `order` of the puffs in row r of a block that reach point p [m]."""
        reach, shape = self.reach(which), self._shape[which]
        width = WIDTH * reach
        begin, end = 0, 0
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
                begin, end = self.start[row + a], self.start[row + b + 1]
        return begin, end

    # ---------------------------------------------------------------- the order

    @ti.func
    def sort(self, count: ti.i32, number: Template):
        """Sort the first `count` new puffs without those that left the domain; number: field of the puffs' numbers."""
        if ti.static(on_cpu()):
            self._order_serially(count)
        else:
            self._order_in_parallel(count, number)
        for _ in range(1):
            self.farthest[None] = 0.0
            for which in range(self.lists):
                if not self.empty(which):
                    self.farthest[None] = self.reach(which)

    @ti.func
    def _order_serially(self, count: ti.i32):
        for _ in range(1):
            for c in range(self._cells):
                self._cursor[c] = 0
            for k in range(count):
                c = self._cell[k]
                if c >= 0:
                    self._cursor[c] = self._cursor[c] + 1
            total = 0
            for c in range(self._cells):
                n = self._cursor[c]
                self.start[c] = total
                self._cursor[c] = total
                total += n
            self.start[self._cells] = total
            for k in range(count):
                c = self._cell[k]
                if c >= 0:
                    self.order[self._cursor[c]] = k
                    self._cursor[c] = self._cursor[c] + 1

    @ti.func
    def _order_in_parallel(self, count: ti.i32, number: Template):
        for c in range(self._cells):
            self._cursor[c] = 0
        for k in range(count):
            if self._cell[k] >= 0:
                ti.atomic_add(self._cursor[self._cell[k]], 1)
        for b in range(self._blocks.shape[0]):
            total = 0
            for c in range(b * BLOCK, ti.min((b + 1) * BLOCK, self._cells)):
                total += self._cursor[c]
            self._blocks[b] = total
        for _ in range(1):
            total = 0
            for b in range(self._blocks.shape[0]):
                n = self._blocks[b]
                self._blocks[b] = total
                total += n
            self.start[self._cells] = total
        for b in range(self._blocks.shape[0]):
            total = self._blocks[b]
            for c in range(b * BLOCK, ti.min((b + 1) * BLOCK, self._cells)):
                n = self._cursor[c]
                self.start[c] = total
                self._cursor[c] = total
                total += n
        for k in range(count):
            c = self._cell[k]
            if c >= 0:
                self._rough_order[ti.atomic_add(self._cursor[c], 1)] = k
        for q in range(self.alive()):
            k = self._rough_order[q]
            c, before = self._cell[k], 0
            for other in range(self.start[c], self.start[c + 1]):
                before += ti.cast(number[self._rough_order[other]] < number[k], ti.i32)
            self.order[self.start[c] + before] = k
