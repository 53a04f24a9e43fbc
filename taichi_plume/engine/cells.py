"""Indices of cells in kernels: one place in memory, and steps from there.

Neighbours ``I + D`` of a cell are found by adding a step to the cell's place, which is computed once for a row of
cells. Vectors of three numbers would be multiplied by the steps at each access.
"""

from collections.abc import Callable, Sequence
from typing import Any

import taichi
from taichi.lang import impl, matrix
from taichi.lang.expr import Expr

from taichi_plume.engine.trace import _PLAIN, Block, Number, Trace, View


class Index(Expr):
    """Index whose components are known while a kernel is traced; used otherwise, it is a vector."""

    _data_oriented = True  # assigned and given to functions as it is

    def __init__(self, components: Sequence[Any]):
        self.components = list(components)
        self.dbg_info, self.ptr_type_checked = None, True

    @property
    def ptr(self) -> Any:
        return matrix.make_matrix([self.component(d) for d in range(self.n)], dt=taichi.i32).ptr

    @property
    def n(self) -> int:
        return len(self.components)

    def component(self, d: int) -> Any:
        return self.components[d]

    def is_tensor(self) -> bool:
        return True


class Shift(Index):
    """Difference of two indices: a multiple of unit vectors."""

    def _each(self, operation: Callable) -> "Shift":
        return Shift([operation(k) for k in self.components])

    def __neg__(self) -> "Shift":
        return self._each(lambda k: _scaled(k, -1))

    def __mul__(self, other: Any) -> Any:
        return self._each(lambda k: _scaled(k, other)) if _scalar(other) else super().__mul__(other)

    __rmul__ = __mul__

    def __add__(self, other: Any) -> Any:
        if type(other) is Shift:
            return Shift([_sum(a, b) for a, b in zip(self.components, other.components, strict=True)])
        return super().__add__(other)

    def __sub__(self, other: Any) -> Any:
        return self + -other if type(other) is Shift else super().__sub__(other)


class Cell(Index):
    """Index of a cell: `origin`, the components of another cell with a place in memory, and the steps from there."""

    def __init__(self, origin: Sequence[Any], shift: Sequence[Any]):
        super().__init__(origin)
        self.origin, self.shift = origin, shift

    def component(self, d: int) -> Any:
        return taichi.cast(_sum(self.origin[d], self.shift[d]), taichi.i32)  # a value, not a variable

    def moved(self, shift: Sequence[Any]) -> "Cell":
        return Cell(self.origin, [_sum(a, b) for a, b in zip(self.shift, shift, strict=True)])

    def __add__(self, other: Any) -> Any:
        if type(other) is Shift:
            return self.moved(other.components)
        return self.moved([other] * self.n) if _scalar(other) else super().__add__(other)

    __radd__ = __add__

    def __sub__(self, other: Any) -> Any:
        if type(other) is Shift:
            return self.moved((-other).components)
        return self.moved([_scaled(other, -1)] * self.n) if _scalar(other) else super().__sub__(other)

    def place(self, view: View) -> Any:
        """Return the cell's place in a field's memory, in entries."""
        steps, layout = view._steps(), view._field.layout
        key = ("place", id(self.origin), id(layout))
        place = next((block.numbers[key] for block in reversed(Block.stack) if key in block.numbers), None)
        if place is None:
            place = 0
            for entry, step in zip(self.origin, (1, *steps[1:]), strict=True):
                place = _sum(place, _scaled(entry, step))
            if Block.inner() is not None:
                place = impl.expr_init(place)
                Block.stack[-1].numbers[key] = place
                Trace.current.keep.append(self.origin)
        for d in range(1, self.n):
            place = _sum(place, _scaled(self.shift[d], steps[d]))
        return _sum(place, self.shift[0])


def _scalar(value: Any) -> bool:
    return isinstance(value, int | Number) or (
        isinstance(value, Expr) and not isinstance(value, Index) and not value.is_tensor()
    )


def _scaled(a: Any, b: Any) -> Any:
    if isinstance(a, int) and isinstance(b, int):
        return a * b
    for one, other in ((a, b), (b, a)):
        if isinstance(one, int) and one in (0, 1):
            return other * one if one else 0
    return a * b


def _sum(a: Any, b: Any) -> Any:
    if isinstance(a, int) and a == 0:
        return b
    return a if isinstance(b, int) and b == 0 else a + b


def macro(function: Callable) -> Callable:
    """Decorator of Python functions that kernels call while they are traced."""
    function._is_taichi_function = True  # type: ignore[attr-defined]
    function.func = _PLAIN  # type: ignore[attr-defined]
    return function


@macro
def row(others: Any, like: Sequence[Any], dim: int = 0, axis: int = 0) -> Cell:
    """Return the first cell of a row along an axis, with its place in the memory of fields like these.

    others: index of the row, last axis first, more entries than needed are allowed: a vector of which the first ones
    count, or a tuple of which the last ones count. dim: number of axes, by default those of the fields.
    """
    dim = int(dim) or len(like[0]._field.shape)
    if isinstance(others, tuple):
        entries = list(others[len(others) - dim + 1 :])
    else:
        entries = [impl.subscript(None, others, n) for n in range(dim - 1)]
    origin = [impl.expr_init(entry) for entry in reversed(entries)]
    origin.insert(int(axis), 0)
    cell = Cell(origin, [0] * dim)
    for view in like:
        cell.place(view)
    return cell


@macro
def along(cell: Cell, i: Any, axis: int = 0) -> Cell:
    """Return the cell that is i cells further along an axis."""
    return cell.moved([i if d == int(axis) else 0 for d in range(cell.n)])


def _unit(n: int, i: int, dt: Any = None, plain: Callable = taichi.Vector.unit) -> Any:
    """Return a unit vector, as Taichi does; one of whole numbers is a difference of indices."""
    n, i = int(n), int(i)
    return Shift([int(k == i) for k in range(n)]) if dt is taichi.i32 else plain(n, i, dt)


_unit.__module__ = matrix.__name__  # Taichi warns of calls of other functions
taichi.Vector.unit = staticmethod(_unit)
