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


def _merged(
    bodies: Sequence[Callable], ranges: Sequence[Ranges]
) -> tuple[Sequence[Ranges], list[tuple[int, int]]]:
    """Return the index ranges of each body, and the range per axis that covers all of them."""
    own = ranges if len(ranges) == len(bodies) else tuple(ranges) * len(bodies)
    return own, [max(axis) for axis in zip(*own, strict=True)]


def sweep(bodies: Sequence[Callable], outs: Sequence[Field | tuple[Field, ...]], *ranges: Ranges) -> Pass:
    """Return a pass that sets ``out[I] = body(I, a, b)`` for each pair of body and out, for I in the common range of
    all bodies or in the range of each body; ranges differ only in their ends.

    body: ti.func of an index vector and two scalars, without stores and with `ti.select` for `if`; it may read `out` at
    I only. If `out` is a tuple of fields, body returns a vector with a value for each field.

    On a CPU a row is cut into strips: 32 values are computed into registers, then stored. LLVM vectorises loops only
    while they store nothing global, so this is up to five times faster than storing cell by cell.
    """
    own, whole = _merged(bodies, ranges)
    dim = len(whole)
    axis = int(
        on_cpu() and dim > 1 and whole[0][1] - whole[0][0] == 2
    )  # else 0, which is contiguous in memory
    begin, end = whole[axis]
    strips, width = _strips(end - begin)
    others = tuple(d for d in reversed(range(dim)) if d != axis)  # last axis slowest
    rows = tuple(whole[d] for d in others)
    flat = prod(b - a for a, b in rows) < FEW_ROWS
    pairs = tuple(range(len(bodies)))
    bodies = tuple(bodies)
    outs = tuple(out if isinstance(out, tuple) else (out,) for out in outs)

    @ti.func
    def strip(row: Template, k, a, b):
        first = begin + k * width
        here = ti.row(row, (outs[0][0],), dim, axis, first)
        for q in ti.static(pairs):
            count = ti.min(STRIP, width, own[q][axis][1] - first)
            for n, d in ti.static(enumerate(others)):
                if ti.static(own[q][d] != whole[d]):
                    count = ti.select(row[n] < own[q][d][1], count, 0)
            values = ti.Vector([0.0] * STRIP * ti.static(len(outs[q])))
            for n in range(count):
                if ti.static(len(outs[q]) == 1):
                    values[n] = bodies[q](ti.along(here, n, axis), a, b)
                else:
                    several = bodies[q](ti.along(here, n, axis), a, b)
                    for m in ti.static(range(len(outs[q]))):
                        values[n + STRIP * m] = several[m]
            for m in ti.static(range(len(outs[q]))):
                for n in range(count):
                    outs[q][m][ti.along(here, n, axis)] = values[n + STRIP * m]

    @ti.func
    def by_strip(a, b):
        for J in ti.grouped(ti.ndrange(*rows, strips)):
            strip(J, J[dim - 1], a, b)

    @ti.func
    def by_row(a, b):
        for J in ti.grouped(ti.ndrange(*rows)):
            for k in range(strips):
                strip(J, k, a, b)

    @ti.func
    def by_cell(a, b):
        for J in ti.grouped(ti.ndrange(*rows, (begin, end))):
            I = ti.along(ti.row(J, (outs[0][0],)), J[dim - 1])
            for q in ti.static(pairs):
                inside = True
                for d in ti.static(range(dim)):
                    if ti.static(own[q][d] != whole[d]):
                        inside = inside and I[d] < ti.static(own[q][d][1])
                if inside:
                    if ti.static(len(outs[q]) == 1):
                        outs[q][0][I] = bodies[q](I, a, b)
                    else:
                        several = bodies[q](I, a, b)
                        for m in ti.static(range(len(outs[q]))):
                            outs[q][m][I] = several[m]

    cells = prod(b - a for a, b in whole) * len(bodies)
    if not on_cpu():
        return Pass(by_cell, cells)
    return Pass(by_strip if flat and cells > FEW_CELLS else by_row, cells)


BLOCK = 16  # rows swept in order, so that a flux between two rows is computed once
CHUNK = 512  # iterations that Taichi gives a CPU thread at least


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
    own, whole = _merged(bodies, ranges)
    dim = len(whole)
    (begin, end), (low, high) = whole[:2]
    bottom = whole[2][0] if dim == 3 else 0
    tops = tuple(axes[2][1] if dim == 3 else 1 for axes in own)
    (strips, width), blocks = _strips(end - begin), -(-(high - low) // BLOCK)
    pairs = tuple(range(len(bodies)))
    bodies, outs = tuple(bodies), tuple(outs)
    fluxes, lasts = tuple(tuple(per_axis) for per_axis in fluxes), tuple(lasts)
    # scratch: fluxes through the upper sides of a layer, which the next layer takes in
    upward: tuple[Field, ...] = (
        tuple(ti.field(ti.f32, (high, end)) for _ in pairs) if dim == 3 and on_cpu() else ()
    )

    @ti.func
    def column(q: Template, block, k, a, b):
        first, start = begin + k * width, low + block * BLOCK
        count = ti.min(STRIP, width, own[q][0][1] - first)
        for layer in range(ti.static(bottom - (dim == 3)), ti.static(tops[q])):
            below = ti.Vector([0.0] * STRIP)
            for row in range(start - 1, ti.min(start + BLOCK, ti.static(own[q][1][1]))):
                net = ti.Vector([0.0] * STRIP)
                here = ti.row((layer, row), (outs[q],), 0, 0, first)
                if layer >= bottom:
                    for n in range(count):
                        above = fluxes[q][1](ti.along(here, n) + ti.Vector.unit(dim, 1, ti.i32))
                        net[n] = below[n] - above
                        below[n] = above
                if row >= start:
                    if ti.static(dim == 3):
                        upper = ti.Vector([0.0] * STRIP)
                        for n in range(count):
                            upper[n] = fluxes[q][2](ti.along(here, n) + ti.Vector.unit(dim, 2, ti.i32))
                        for n in range(count):
                            net[n] += upward[q][row, first + n] - upper[n]
                        for n in range(count):
                            upward[q][row, first + n] = upper[n]
                    if layer >= bottom:
                        along = ti.Vector([0.0] * (STRIP + 1))
                        for n in range(count):
                            along[n] = fluxes[q][0](ti.along(here, n))
                        along[count] = lasts[q](ti.along(here, count))
                        for n in range(count):
                            total = net[n] + (along[n] - along[n + 1])
                            net[n] = bodies[q](ti.along(here, n), total, a, b)
                        for n in range(count):
                            outs[q][ti.along(here, n)] = net[n]

    @ti.func
    def in_order(a, b):
        for block in range(blocks):
            for q in ti.static(pairs):
                for k in range(strips):
                    column(q, block, k, a, b)

    @ti.func
    def by_column(a, b):
        for n in range(blocks * strips * CHUNK):  # a column per chunk: threads divide the columns
            if n % CHUNK == 0:
                for q in ti.static(pairs):
                    column(q, n // (CHUNK * strips), n // CHUNK % strips, a, b)

    @ti.func
    def by_cell(a, b):
        for J in ti.grouped(ti.ndrange(*reversed(whole))):
            I = ti.along(ti.row(J, (outs[0],)), J[dim - 1])
            for q in ti.static(pairs):
                inside = True
                for d in ti.static(range(dim)):
                    if ti.static(own[q][d] != whole[d]):
                        inside = inside and I[d] < ti.static(own[q][d][1])
                if inside:
                    net = fluxes[q][0](I) - lasts[q](I + ti.Vector.unit(dim, 0, ti.i32))
                    for e in ti.static(range(1, dim)):
                        for side in range(2):
                            net += (1 - 2 * side) * fluxes[q][e](I + side * ti.Vector.unit(dim, e, ti.i32))
                    outs[q][I] = bodies[q](I, net, a, b)

    cells = prod(b - a for a, b in whole) * len(bodies)
    if not on_cpu():
        return Pass(by_cell, cells)
    return Pass(by_column if cells > FEW_CELLS else in_order, cells)
