"""Sweeps (stencil loops): passes over a grid's cells or faces that set a field from others, vectorised in strips.

On a CPU a row of cells is cut into strips of LANES cells. LLVM makes vector instructions of a loop over a strip, as it
has a constant length and stores nothing global; the stores follow one by one. The last strip of a row computes up to
LANES - 1 cells beyond the row, which are not stored: bodies must stand that (fields have some SLACK behind them). An
array of several strips is filled by copying strips, as LLVM makes no vectors of a loop that computes into its middle.
"""

from collections.abc import Callable, Sequence
from functools import partial
from math import prod

from taichi_plume.engine import ti
from taichi_plume.engine.fields import LANES, Field, on_cpu
from taichi_plume.grid.kernels import CHUNK, FEW_CELLS, FEW_ROWS, Pass, Template, each, launch, together

Ranges = Sequence[tuple[int, int]]
"""First index and end per axis of a sweep."""

BLOCK = 16  # rows that a thread sweeps in order, so that a flux between two rows is computed once
PANEL = 32  # strips of a row that are swept in order


@ti.func
def store(out: Template, here: Template, rest, values: Template, offset: Template, axis: Template):
    """Store a strip's values, from `offset` on, at the cells of a row of which `rest` are left, beginning `here`."""
    if rest < LANES:
        for n in range(rest):
            out[ti.along(here, n, axis)] = values[offset + n]
    else:
        for n in ti.static(range(LANES)):
            out[ti.along(here, n, axis)] = values[offset + n]


@ti.func
def copy_strip(values, into: Template, k):
    """Copy a strip's values to the k-th strip of an array."""
    for n in range(LANES):
        into[k * LANES + n] = values[n]


@ti.func
def same_cell(I, m: Template):
    """Return cell I, where a sweep stores the value of cell I."""
    return I


@ti.func
def nth_cell(n, ranges: Template, like: Template):
    """Return the n-th cell of a range per axis, the first axis fastest, for fields like this one."""
    dim = ti.static(len(ranges))
    J, rest = ti.Vector.zero(ti.i32, dim), n
    for d in ti.static(range(dim - 1)):
        size = ranges[d][1] - ranges[d][0]
        above = ti.raw_div(rest, size)
        J[dim - 1 - d] = ranges[d][0] + rest - above * size
        rest = above
    J[0] = ranges[dim - 1][0] + rest
    return ti.along(ti.row(J, (like,)), J[dim - 1])


class _Sweep:
    def __init__(self, body: Callable, outs: Sequence[Field], ranges: Ranges, place: Callable, axis: int):
        self.body, self.outs, self.place, self.bodies = body, tuple(outs), place, (body,)
        self.dim, self.count, self.cells = len(ranges), len(outs), prod(end - begin for begin, end in ranges)
        self.axis = axis if on_cpu() else 0
        self.begin, self.end = ranges[self.axis]
        self.strips = -(-(self.end - self.begin) // LANES)
        self.rows = tuple(ranges[d] for d in reversed(range(self.dim)) if d != self.axis)  # last axis slowest
        self.ranges = tuple(ranges)
        self.few_rows = prod(b - a for a, b in self.rows) < FEW_ROWS

    @ti.func
    def strip(self, row: Template, k, a, b):
        """Set the k-th strip of a row."""
        first = self.begin + k * LANES
        here = ti.row(row, (self.outs[0],), self.dim, self.axis, first)
        values = ti.Vector([0.0] * LANES * self.count)
        for n in range(LANES):
            lane = n
            if ti.static(self.axis == 1):  # a step is a row of memory, and SLACK some entries
                lane = ti.min(n, self.end - 1 - first)
            if ti.static(self.count == 1):
                values[n] = self.body(ti.along(here, lane, self.axis), a, b)
            else:
                several = self.body(ti.along(here, lane, self.axis), a, b)
                for m in ti.static(range(self.count)):
                    values[n + LANES * m] = several[m]
        for m in ti.static(range(self.count)):
            store(self.outs[m], self.place(here, m), self.end - first, values, LANES * m, self.axis)

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
    def at(self, n, a, b):
        """Set the n-th cell."""
        I = nth_cell(n, self.ranges, self.outs[0])
        if ti.static(self.count == 1):
            self.outs[0][self.place(I, 0)] = self.body(I, a, b)
        else:
            several = self.body(I, a, b)
            for m in ti.static(range(self.count)):
                self.outs[m][self.place(I, m)] = several[m]


def sweep(
    body: Callable, out: Field | tuple[Field, ...], ranges: Ranges, place: Callable = same_cell, axis: int = 0
) -> Pass:
    """Return a pass that sets ``out[I] = body(I, a, b)`` for I in a range per axis.

    body: ti.func of an index and two scalars, without stores and with `ti.select` for `if`; it may read `out` at I
    only. If `out` is a tuple of fields, body returns a vector with a value for each field. place: ti.func (I, m) of
    the entry of the m-th field to set instead of I, in another row. axis: of the rows on a CPU, which should be
    contiguous in memory; 1 for the two sides of axis 0, as a row of two would fill no strip.
    """
    loops = _Sweep(body, out if isinstance(out, tuple) else (out,), ranges, place, axis)
    if not on_cpu():
        return each(loops.at, loops.cells)
    parallel = loops.few_rows and loops.cells > FEW_CELLS
    return Pass(loops.by_strip if parallel else loops.by_row, loops.cells)


class _FluxSweep:
    def __init__(self, fluxes: Sequence[Callable], body: Callable, out: Field, ranges: Ranges, exact: bool):
        self.fluxes, self.body, self.out, self.exact = tuple(fluxes), body, out, exact
        self.ranges, self.bodies = tuple(ranges), (body,)
        self.dim, self.cells = len(ranges), prod(end - begin for begin, end in ranges)
        (self.begin, self.end), (self.low, self.high) = ranges[:2]
        self.bottom, self.top = ranges[2] if self.dim == 3 else (0, 1)
        self.strips = -(-(self.end - self.begin) // LANES)
        self.block = BLOCK if self.cells > FEW_CELLS else self.high - self.low
        self.panels, self.blocks = -(-self.strips // PANEL), -(-(self.high - self.low) // self.block)
        self.count = (self.top - self.bottom) * self.blocks * self.panels

    @ti.func
    def difference(self, x, y):
        """Return the difference of two fluxes, in f64 if the sum is to be exact."""
        if ti.static(self.exact):
            return ti.cast(x, ti.f64) - ti.cast(y, ti.f64)
        else:  # noqa: RET505  Taichi compiles one branch only
            return x - y

    @ti.func
    def strip_of(self, e: Template, here: Template):
        """Return the fluxes through the lower e-sides of a strip that begins `here`."""
        values = ti.Vector([0.0] * LANES)
        for n in range(LANES):
            values[n] = self.fluxes[e](ti.along(here, n))
        return values

    @ti.func
    def rows_of(self, part, a, b):
        """Set a panel of a block of rows in a layer."""
        panel, block = part % self.panels, part // self.panels
        layer, start = self.bottom + block // self.blocks, self.low + block % self.blocks * self.block
        origin, strips = self.begin + panel * (PANEL * LANES), ti.min(PANEL, self.strips - panel * PANEL)
        Y = ti.Vector.unit(self.dim, 1, ti.i32)
        below = ti.Vector([0.0] * (PANEL * LANES))  # fluxes through the lower sides of a row
        for k in range(strips):
            here = ti.row((layer, start), (self.out,), 0, 0, origin + k * LANES)
            copy_strip(self.strip_of(1, here), below, k)
        along = ti.Vector([0.0] * ((PANEL + 1) * LANES))  # fluxes through the lower sides along a row
        for row in range(start, ti.min(start + self.block, self.high)):
            for k in range(strips + 1):
                here = ti.row((layer, row), (self.out,), 0, 0, origin + k * LANES)
                copy_strip(self.strip_of(0, here), along, k)
            for k in range(strips):
                first = origin + k * LANES
                here = ti.row((layer, row), (self.out,), 0, 0, first)
                above, values = self.strip_of(1, here + Y), ti.Vector([0.0] * LANES)
                for n in range(LANES):
                    I = ti.along(here, n)
                    net = self.difference(below[k * LANES + n], above[n])
                    net += self.difference(along[k * LANES + n], along[k * LANES + n + 1])
                    if ti.static(self.dim == 3):
                        Z = ti.Vector.unit(self.dim, 2, ti.i32)
                        net += self.difference(self.fluxes[2](I), self.fluxes[2](I + Z))
                    values[n] = self.body(I, net, a, b)
                copy_strip(above, below, k)
                store(self.out, here, self.end - first, values, 0, 0)

    @ti.func
    def in_order(self, a, b):
        for part in range(self.count):
            self.rows_of(part, a, b)

    @ti.func
    def by_part(self, a, b):
        for n in range(self.count * CHUNK):  # a part per chunk: threads divide the parts
            if n & (CHUNK - 1) == 0:  # n % CHUNK takes several times as long
                self.rows_of(n // CHUNK, a, b)

    @ti.func
    def at(self, n, a, b):
        """Set the n-th cell."""
        I = nth_cell(n, self.ranges, self.out)
        net = self.difference(0.0, 0.0)
        for e in ti.static(range(self.dim)):
            net += self.difference(self.fluxes[e](I), self.fluxes[e](I + ti.Vector.unit(self.dim, e, ti.i32)))
        self.out[I] = self.body(I, net, a, b)


def flux_sweep(
    fluxes: Sequence[Callable], body: Callable, out: Field, ranges: Ranges, exact: bool = False
) -> Pass:
    """Return a finite-volume `sweep` that sets ``out[I] = body(I, net, a, b)``; net: net flux into volume I.

    The net flux is the sum over axes e of the flux through the lower side, ``fluxes[e](I)``, less the flux through the
    upper side, which is the lower side of I + e. exact: whether to sum in f64, so that what leaves a volume enters the
    next to the last bit.

    On a CPU the fluxes along a row and between rows are computed once, for both volumes beside the side; those between
    layers twice, so that layers are independent.
    """
    loops = _FluxSweep(fluxes, body, out, ranges, exact)
    if not on_cpu():
        return each(loops.at, loops.cells)
    return Pass(loops.by_part if loops.cells > FEW_CELLS else loops.in_order, loops.cells)


@ti.func
def _value(source: Template, I, a, b):
    return source[I]


def copying(targets: Sequence[Field], sources: Sequence[Field]) -> Callable[..., None]:
    """Return a function that copies fields of numbers to others of the same layout. On a CPU NumPy is the fastest; on a
    GPU `copy_from` would wait for it.
    """

    def copy() -> None:
        for target, source in zip(targets, sources, strict=True):
            target.copy_from(source)

    if on_cpu():
        return copy
    pairs = zip(targets, sources, strict=True)
    return launch(
        *together([sweep(partial(_value, source), to, [(0, n) for n in to.shape]) for to, source in pairs])
    )
