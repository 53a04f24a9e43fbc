"""Sweeps (stencil loops): passes over a grid's cells or faces that set a field from others, vectorised in strips."""

from collections.abc import Callable, Sequence
from math import prod

from taichi_plume.engine import ti
from taichi_plume.engine.fields import Field, on_cpu
from taichi_plume.grid.kernels import FEW_CELLS, FEW_ROWS, STRIP, Pass, Template

Ranges = Sequence[tuple[int, int]]
"""First index and end per axis of a sweep."""


def _strips(cells: int) -> tuple[int, int]:
    """Return the number of strips into which a row of cells is cut, and the cells of each strip except the last.

    The last strip has several cells: LLVM generates faulty code for loops over a cell of a field and none of another.
    """
    strips = -(-cells // STRIP)
    even = -(-cells // strips)
    whole = 8 * -(-even // 8)
    return strips, whole if cells - (strips - 1) * whole >= min(4, cells) else even


class _Rows:
    """Ranges of several bodies, with rows along the axis that is contiguous in memory.

    own: ranges of each body. whole: the range per axis that covers all of them.
    """

    def __init__(self, count: int, ranges: Sequence[Ranges]):
        self.pairs = tuple(range(count))
        self.own = tuple(ranges) if len(ranges) == count else tuple(ranges) * count
        self.whole = tuple(max(axis) for axis in zip(*self.own, strict=True))
        self.dim = len(self.whole)
        self.cells = count * prod(end - begin for begin, end in self.whole)

    @ti.func
    def has(self, q: Template, I):
        """Return whether the q-th body's range has the index I, which lies in the whole range."""
        inside = True
        for d in ti.static(range(self.dim)):
            if ti.static(self.own[q][d] != self.whole[d]):
                inside = inside and I[d] < self.own[q][d][1]
        return inside


class _Sweep(_Rows):
    def __init__(
        self, bodies: Sequence[Callable], outs: Sequence[Field | tuple[Field, ...]], ranges: Sequence[Ranges]
    ):
        super().__init__(len(bodies), ranges)
        self.bodies = tuple(bodies)
        self.outs = tuple(out if isinstance(out, tuple) else (out,) for out in outs)
        (low, high), both_sides = self.whole[0], on_cpu() and self.dim > 1
        self.axis = int(both_sides and high - low == 2)  # else 0, which is contiguous in memory
        self.begin, self.end = self.whole[self.axis]
        self.strips, self.width = _strips(self.end - self.begin)
        self.others = tuple(d for d in reversed(range(self.dim)) if d != self.axis)  # last axis slowest
        self.rows = tuple(self.whole[d] for d in self.others)
        self.few_rows = prod(b - a for a, b in self.rows) < FEW_ROWS

    @ti.func
    def strip(self, row: Template, k, a, b):
        """Set the k-th strip of a row: values are computed into registers, then stored."""
        first = self.begin + k * self.width
        here = ti.row(row, (self.outs[0][0],), self.dim, self.axis, first)
        for q in ti.static(self.pairs):
            count = ti.min(STRIP, self.width, self.own[q][self.axis][1] - first)
            for n, d in ti.static(enumerate(self.others)):
                if ti.static(self.own[q][d] != self.whole[d]):
                    count = ti.select(row[n] < self.own[q][d][1], count, 0)
            values = ti.Vector([0.0] * STRIP * ti.static(len(self.outs[q])))
            for n in range(count):
                if ti.static(len(self.outs[q]) == 1):
                    values[n] = self.bodies[q](ti.along(here, n, self.axis), a, b)
                else:
                    several = self.bodies[q](ti.along(here, n, self.axis), a, b)
                    for m in ti.static(range(len(self.outs[q]))):
                        values[n + STRIP * m] = several[m]
            for m in ti.static(range(len(self.outs[q]))):
                for n in range(count):
                    self.outs[q][m][ti.along(here, n, self.axis)] = values[n + STRIP * m]

    @ti.func
    def by_strip(self, a, b):
        for J in ti.grouped(ti.ndrange(*self.rows, self.strips)):
            self.strip(J, J[self.dim - 1], a, b)

    @ti.func
    def by_row(self, a, b):
        for J in ti.grouped(ti.ndrange(*self.rows)):
            for k in range(self.strips):
                self.strip(J, k, a, b)

    @ti.func
    def by_cell(self, a, b):
        for J in ti.grouped(ti.ndrange(*self.rows, (self.begin, self.end))):
            I = ti.along(ti.row(J, (self.outs[0][0],)), J[self.dim - 1])
            for q in ti.static(self.pairs):
                if self.has(q, I):
                    if ti.static(len(self.outs[q]) == 1):
                        self.outs[q][0][I] = self.bodies[q](I, a, b)
                    else:
                        several = self.bodies[q](I, a, b)
                        for m in ti.static(range(len(self.outs[q]))):
                            self.outs[q][m][I] = several[m]


def sweep(bodies: Sequence[Callable], outs: Sequence[Field | tuple[Field, ...]], *ranges: Ranges) -> Pass:
    """Return a pass that sets ``out[I] = body(I, a, b)`` for each pair of body and out, for I in the common range of
    all bodies or in the range of each body; ranges differ only in their ends.

    body: ti.func of an index and two scalars, without stores and with `ti.select` for `if`; it may read `out` at I
    only. If `out` is a tuple of fields, body returns a vector with a value for each field.

    On a CPU a row is cut into strips: 32 values are computed into registers, then stored. LLVM vectorises loops only
    while they store nothing global, so this is up to five times faster than storing cell by cell.
    """
    sweep = _Sweep(bodies, outs, ranges)
    if not on_cpu():
        return Pass(sweep.by_cell, sweep.cells)
    parallel = sweep.few_rows and sweep.cells > FEW_CELLS
    return Pass(sweep.by_strip if parallel else sweep.by_row, sweep.cells)


BLOCK = 16  # rows swept in order, so that a flux between two rows is computed once
CHUNK = 512  # iterations that Taichi gives a CPU thread at least


class _FluxSweep(_Rows):
    def __init__(
        self,
        fluxes: Sequence[Sequence[Callable]],
        lasts: Sequence[Callable],
        bodies: Sequence[Callable],
        outs: Sequence[Field],
        ranges: Sequence[Ranges],
    ):
        super().__init__(len(bodies), ranges)
        self.fluxes, self.lasts = tuple(tuple(per_axis) for per_axis in fluxes), tuple(lasts)
        self.bodies, self.outs = tuple(bodies), tuple(outs)
        (self.begin, end), (self.low, high) = self.whole[:2]
        self.bottom = self.whole[2][0] if self.dim == 3 else 0
        self.tops = tuple(axes[2][1] if self.dim == 3 else 1 for axes in self.own)
        (self.strips, self.width), self.blocks = _strips(end - self.begin), -(-(high - self.low) // BLOCK)
        # scratch: fluxes through the upper sides of a layer, which the next layer takes in
        self.upward: tuple[Field, ...] = (
            tuple(ti.field(ti.f32, (high, end)) for _ in bodies) if self.dim == 3 and on_cpu() else ()
        )

    @ti.func
    def column(self, q: Template, block, k, a, b):
        """Set the k-th strips of a block of rows, in all layers."""
        first, start = self.begin + k * self.width, self.low + block * BLOCK
        count = ti.min(STRIP, self.width, self.own[q][0][1] - first)
        for layer in range(self.bottom - ti.static(int(self.dim == 3)), self.tops[q]):
            below = ti.Vector([0.0] * STRIP)
            for row in range(start - 1, ti.min(start + BLOCK, self.own[q][1][1])):
                net = ti.Vector([0.0] * STRIP)
                here = ti.row((layer, row), (self.outs[q],), 0, 0, first)
                if layer >= self.bottom:
                    for n in range(count):
                        above = self.fluxes[q][1](ti.along(here, n) + ti.Vector.unit(self.dim, 1, ti.i32))
                        net[n] = below[n] - above
                        below[n] = above
                if row >= start:
                    if ti.static(self.dim == 3):
                        upper = ti.Vector([0.0] * STRIP)
                        for n in range(count):
                            upper[n] = self.fluxes[q][2](
                                ti.along(here, n) + ti.Vector.unit(self.dim, 2, ti.i32)
                            )
                        for n in range(count):
                            net[n] += self.upward[q][row, first + n] - upper[n]
                        for n in range(count):
                            self.upward[q][row, first + n] = upper[n]
                    if layer >= self.bottom:
                        along = ti.Vector([0.0] * (STRIP + 1))
                        for n in range(count):
                            along[n] = self.fluxes[q][0](ti.along(here, n))
                        along[count] = self.lasts[q](ti.along(here, count))
                        for n in range(count):
                            total = net[n] + (along[n] - along[n + 1])
                            net[n] = self.bodies[q](ti.along(here, n), total, a, b)
                        for n in range(count):
                            self.outs[q][ti.along(here, n)] = net[n]

    @ti.func
    def in_order(self, a, b):
        for block in range(self.blocks):
            for q in ti.static(self.pairs):
                for k in range(self.strips):
                    self.column(q, block, k, a, b)

    @ti.func
    def by_column(self, a, b):
        for n in range(self.blocks * self.strips * CHUNK):  # a column per chunk: threads divide the columns
            if n % CHUNK == 0:
                for q in ti.static(self.pairs):
                    self.column(q, n // (CHUNK * self.strips), n // CHUNK % self.strips, a, b)

    @ti.func
    def by_cell(self, a, b):
        for J in ti.grouped(ti.ndrange(*reversed(self.whole))):
            I = ti.along(ti.row(J, (self.outs[0],)), J[self.dim - 1])
            for q in ti.static(self.pairs):
                if self.has(q, I):
                    net = self.fluxes[q][0](I) - self.lasts[q](I + ti.Vector.unit(self.dim, 0, ti.i32))
                    for e in ti.static(range(1, self.dim)):
                        for side in range(2):
                            E = ti.Vector.unit(self.dim, e, ti.i32)
                            net += (1 - 2 * side) * self.fluxes[q][e](I + side * E)
                    self.outs[q][I] = self.bodies[q](I, net, a, b)


def flux_sweep(
    fluxes: Sequence[Sequence[Callable]],
    lasts: Sequence[Callable],
    bodies: Sequence[Callable],
    outs: Sequence[Field],
    *ranges: Ranges,
) -> Pass:
    """Return a finite-volume `sweep` that sets ``out[I] = body(I, net, a, b)``; net: net flux into volume I.

    The net flux is the sum over axes e of the flux through the lower side, ``fluxes[n][e](I)``, less the flux through
    the upper side, which is the lower side of I + e. lasts: the fluxes along a row at the end of the range, too.

    On a CPU each flux is computed once, for both volumes beside it: strips of a row are swept row by row and layer by
    layer, and the fluxes through their upper sides are stored for the next row and layer.
    """
    sweep = _FluxSweep(fluxes, lasts, bodies, outs, ranges)
    if not on_cpu():
        return Pass(sweep.by_cell, sweep.cells)
    return Pass(sweep.by_column if sweep.cells > FEW_CELLS else sweep.in_order, sweep.cells)
