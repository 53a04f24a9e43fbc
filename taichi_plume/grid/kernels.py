"""Passes over cells, and launches of several passes in a kernel."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import groupby
from math import prod
from typing import TYPE_CHECKING, Any, TypeAlias

from taichi_plume.engine import ti
from taichi_plume.engine.conditions import code
from taichi_plume.engine.fields import Field, on_cpu
from taichi_plume.engine.kernels import Kernel, data_flow_by_llvm

if TYPE_CHECKING:
    Template = Any
else:
    Template = ti.template()
"""Annotation of arguments of kernels that are parts: objects with fields, numbers and `ti.func` methods."""
Expression: TypeAlias = Any
"""Value inside a kernel (number, vector or point) whose type Taichi infers."""

STRIP = 32  # cells per strip; 100 and more are six times slower (LLVM stops using registers)
MANY_CELLS = 50_000  # cells set by a pass: from here on a separate launch costs comparatively little
FEW_CELLS = 300_000  # cells set by a pass: up to here the caller's thread is done before another wakes up
FEW_ROWS = 2000  # Taichi gives a CPU thread 512 iterations at least: with fewer rows, strips are tasks too


@dataclass(frozen=True)
class Pass:
    """Part of a kernel for `launch`: ti.func ``run(a, b)``, and the approximate number of cells that it sets."""

    run: Callable[[Expression, Expression], None]
    cells: int


class _Visit:
    def __init__(
        self, bodies: Sequence[Callable], shapes: Sequence[tuple[int, ...]], like: Sequence[Sequence[Field]]
    ):
        self.dim, self.pairs = len(shapes[0]), tuple(range(len(bodies)))
        self.bodies = tuple(bodies)
        self.like = tuple(tuple(fields) for fields in like) or ((),) * len(bodies)
        # Axis 0 is contiguous: the innermost loop on a CPU, but for the two sides of axis 0, and neighbouring threads
        # on a GPU.
        self.axes = tuple(int(on_cpu() and self.dim > 1 and shape[0] == 2) for shape in shapes)
        self.lengths = tuple(shape[axis] for shape, axis in zip(shapes, self.axes, strict=True))
        self.rows = tuple(
            tuple(n for d, n in reversed(list(enumerate(shape))) if d != axis or not on_cpu())
            for shape, axis in zip(shapes, self.axes, strict=True)
        )
        self.serial = on_cpu()

    @ti.func
    def run(self, a, b):
        for q in ti.static(self.pairs):
            for J in ti.grouped(ti.ndrange(*self.rows[q])):
                here = ti.row(J, self.like[q], self.dim, self.axes[q])
                if ti.static(self.serial):
                    for i in range(self.lengths[q]):
                        self.bodies[q](ti.along(here, i, self.axes[q]), a, b)
                else:
                    self.bodies[q](ti.along(here, J[self.dim - 1]), a, b)


def visit(bodies: Sequence[Callable], shapes: Sequence[tuple[int, ...]], *like: Sequence[Field]) -> Pass:
    """Return a pass that calls each ``body(I, a, b)``, which may store, at all indices I of the body's shape.

    like: fields of each body with the layouts that it uses most.
    """
    return Pass(_Visit(bodies, shapes, like).run, sum(prod(shape) for shape in shapes))


def launch(*passes: Pass) -> Callable[..., None]:
    """Return a function ``run(a=0, b=0)`` that executes several passes in order, in as few kernels as is fast.

    On a CPU, consecutive passes of few cells are one task of the caller's thread: waking another thread takes 0.1 ms. A
    pass of many cells is a kernel of its own, which costs 2 us: the time in which Taichi compiles a kernel grows with
    the square of the kernel's length.
    """
    groups = groupby(enumerate(passes), lambda nth: nth[0] if on_cpu() and nth[1].cells > MANY_CELLS else -1)
    parts = tuple(_launcher([part for _, part in group]) for _, group in groups)
    if len(parts) == 1:
        return parts[0]

    def run(a: float = 0.0, b: float = 0.0) -> None:
        for part in parts:
            part(a, b)

    return run


def _launcher(passes: Sequence[Pass]) -> Callable[..., None]:
    """Return ``run(a=0, b=0)``, which launches a kernel of several passes, in the caller's thread if that is faster."""
    parts = tuple(passes)
    serial = on_cpu() and parts[0].cells <= FEW_CELLS
    bound: Any = None

    def run(a: float = 0.0, b: float = 0.0) -> None:
        nonlocal bound
        if bound is None or not bound.usable:
            bound = _PASSES.bind(parts, serial, key=tuple(code(part.run) for part in parts))
        bound(a, b)

    return run


def _run(passes: Template, serial: Template, a: ti.f32, b: ti.f32):
    if ti.static(serial):
        ti.loop_config(serialize=True)
        for _ in range(1):
            ti.load_numbers()
            for part in ti.static(passes):
                part.run(a, b)
    else:
        for part in ti.static(passes):
            part.run(a, b)


_PASSES = Kernel(_run, data_flow_by_llvm)
