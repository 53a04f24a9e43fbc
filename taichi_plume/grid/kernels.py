"""Passes over cells, and launches of several passes in a kernel."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import accumulate, groupby
from typing import TYPE_CHECKING, Any, TypeAlias

from taichi_plume.engine import ti
from taichi_plume.engine.conditions import code, name_in_source
from taichi_plume.engine.fields import on_cpu
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
CHUNK = 512  # iterations that Taichi gives a CPU thread at least
FEW_ROWS = 2000  # with fewer rows, strips are tasks too


@dataclass(frozen=True)
class Pass:
    """Part of a kernel for `launch`: ti.func ``run(a, b)``, and the approximate number of cells that it sets.

    at: ti.func ``at(n, a, b)`` that sets the n-th cell alone, for `together`.
    """

    run: Callable[[Expression, Expression], None]
    cells: int
    at: Callable[[Expression, Expression, Expression], None] | None = None


class _Each:
    def __init__(self, at: Callable, count: int):
        self.at, self.count, self.bodies = at, count, (at,)

    @ti.func
    def run(self, a, b):
        for n in range(self.count):
            self.at(n, a, b)


def each(at: Callable, count: int) -> Pass:
    """Return the pass that executes ti.func ``at(n, a, b)`` for n in range(count)."""
    return Pass(_Each(at, count).run, count, at)


class _Together:
    def __init__(self, passes: Sequence[Pass]):
        self.at = self.bodies = tuple(part.at for part in passes)
        self.ends = tuple(accumulate(part.cells for part in passes))
        self.begins = (0, *self.ends[:-1])
        self.cells = self.ends[-1]

    @ti.func
    def run(self, a, b):
        for n in range(self.cells):
            for k in ti.static(range(len(self.at))):
                if self.begins[k] <= n and n < self.ends[k]:
                    self.at[k](n - self.begins[k], a, b)


def together(passes: Sequence[Pass]) -> list[Pass]:
    """Return passes none of which reads what another sets; on a GPU they become one loop, as a launch takes as long as
    10,000 cells. Their numbers of cells must be exact.
    """
    if on_cpu() or len(passes) < 2:
        return list(passes)
    loop = _Together(passes)
    return [Pass(loop.run, loop.cells)]


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
            key = tuple(code(part.run) for part in parts)
            name = name_in_source(body for part in parts for body in _bodies(part.run))
            bound = _execute.bind(parts, serial, key=key, name=name)
        bound(a, b)

    return run


def _bodies(function: Callable) -> Iterator[Callable]:
    """Yield the functions that a loop executes per cell, the `bodies` of its object; any other function itself."""
    bodies = getattr(getattr(function, "__self__", None), "bodies", None)
    if bodies is None:
        yield function
    for body in bodies or ():
        yield from _bodies(body)


def long_kernel(function: Callable) -> Any:
    """Decorator of long kernels, which compile in half the time if LLVM analyses their data flow."""
    return Kernel(function, data_flow_by_llvm)


@long_kernel
def _execute(passes: Template, serial: Template, a: ti.f32, b: ti.f32):
    if ti.static(serial):
        ti.loop_config(serialize=True)
        for _ in range(1):
            ti.load_numbers()
            for part in ti.static(passes):
                part.run(a, b)
    else:
        for part in ti.static(passes):
            part.run(a, b)
