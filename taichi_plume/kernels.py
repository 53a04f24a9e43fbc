"""How our kernels run: start-up, the Template alias, and the sweep that turns a cell formula into a fast kernel."""

import contextlib
import io
from collections.abc import Callable, Sequence
from math import prod
from typing import TYPE_CHECKING, Any

import taichi as ti

if TYPE_CHECKING:
    Template = Any
else:
    Template = ti.template()
"""Annotation of compile-time arguments: fields, axes, objects with `ti.func` methods."""

STRIP = 32  # cells per strip; 100 and more are six times slower (LLVM stops using registers)
FEW_ROWS = 2000  # Taichi gives a CPU thread 512 iterations at least: with fewer rows, strips are tasks too


def start(arch: str = "cpu", debug: bool = False) -> str:
    """Initialise Taichi on `arch` (auto, cpu, cuda, vulkan, metal) and return the backend it chose."""
    backend = {"auto": ti.gpu, "cpu": ti.cpu, "cuda": ti.cuda, "vulkan": ti.vulkan, "metal": ti.metal}[arch]
    with contextlib.redirect_stdout(io.StringIO()):  # "[Taichi] Starting on arch=..."
        ti.init(arch=backend, default_fp=ti.f32, default_ip=ti.i32, log_level=ti.ERROR, debug=debug)
    return "cpu" if on_cpu() else ti.cfg.arch.name


def on_cpu() -> bool:
    """Whether kernels run on the CPU."""
    return ti.cfg.arch in (ti.x64, ti.arm64)


def sweep(body: Callable, out: Any, ranges: Sequence[tuple[int, int]]) -> Callable[[float], None]:
    """A kernel ``run(s)`` that sets ``out[I] = body(I, s)`` for all I in `ranges`, (begin, end) per axis.

    body: ti.func of an index vector and a scalar, without stores and with `ti.select` for `if`.

    On a CPU a row is cut into strips: 32 values are computed into registers, then stored. LLVM vectorises loops
    only while they store nothing global, so this is up to five times faster than storing cell by cell.
    """
    dim = len(ranges)
    begin, end = ranges[0]  # axis 0 is contiguous in memory
    strips = -(-(end - begin) // STRIP)
    rows = tuple(reversed(ranges[1:]))  # last axis slowest
    flat = prod(b - a for a, b in rows) < FEW_ROWS

    @ti.func
    def index(row: Template, i):
        I = ti.Vector.zero(ti.i32, dim)
        I[0] = i
        for d in ti.static(range(1, dim)):
            I[d] = row[dim - 1 - d]
        return I

    @ti.func
    def strip(row: Template, k, s):
        first = begin + k * STRIP
        count = ti.min(STRIP, end - first)
        values = ti.Vector([0.0] * STRIP)
        for n in range(count):
            values[n] = body(index(row, first + n), s)
        for n in range(count):
            out[index(row, first + n)] = values[n]

    @ti.kernel
    def by_strip(s: ti.f32):
        for J in ti.grouped(ti.ndrange(*rows, strips)):
            strip(J, J[dim - 1], s)

    @ti.kernel
    def by_row(s: ti.f32):
        for J in ti.grouped(ti.ndrange(*rows)):
            for k in range(strips):
                strip(J, k, s)

    @ti.kernel
    def by_cell(s: ti.f32):
        for J in ti.grouped(ti.ndrange(*rows, (begin, end))):
            I = index(J, J[dim - 1])
            out[I] = body(I, s)

    if not on_cpu():
        return by_cell
    return by_strip if flat else by_row
