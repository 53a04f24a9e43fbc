"""Indices of cells in kernels: one place in memory, and steps from there.

Neighbours ``I + D`` of a cell are found by adding a step to the cell's place, which is computed once for a row of
cells. Vectors of three numbers would be multiplied by the steps at each access.
"""

from collections.abc import Callable, Iterable, Sequence
from functools import reduce
from typing import Any

import numpy as np

from taichi_plume.engine.library import Expr, impl, mark_function, matrix, taichi
from taichi_plume.engine.trace import PLAIN, Components, Number, Trace, View

MOST = (1 << 30) - 1
"""Largest place in the memory of a field, in entries."""


class Index(Components):
    """Index of a cell, or difference of two."""

    _data_oriented = True  # assigned and given to functions as it is
    dtype = taichi.i32

    def __init__(self, components: Sequence[Any]):
        self.components, self.n = list(components), len(components)
        self.dbg_info, self.ptr_type_checked = None, True

    def component(self, d: int) -> Any:
        return self.components[d]


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
    """Index of a cell: `origin`, the components of the first cell of a row or strip, and the steps from there.

    along: steps along the axis of the row, a loop variable, and that axis. places: the first cell's places in the
    memory of fields, by their layouts.
    """

    def __init__(
        self,
        origin: Sequence[Any],
        shift: Sequence[Any],
        places: dict[int, Any],
        along: tuple[Any, int] = (0, 0),
    ):
        super().__init__(origin)
        self.origin, self.shift, self.places, self.along = origin, shift, places, along

    def component(self, d: int) -> Any:
        n, axis = self.along
        return taichi.cast(
            _total([self.origin[d], self.shift[d], n if d == axis else 0]), taichi.i32
        )  # a value

    def moved(self, shift: Sequence[Any]) -> "Cell":
        steps = [_sum(a, b) for a, b in zip(self.shift, shift, strict=True)]
        return Cell(self.origin, steps, self.places, self.along)

    def __add__(self, other: Any) -> Any:
        if type(other) is Shift:
            return self.moved(other.components)
        if isinstance(other, taichi.Matrix) and all(isinstance(k, int | np.integer) for k in other.entries):
            return self.moved([int(k) for k in other.entries])
        return self.moved([other] * self.n) if _scalar(other) else super().__add__(other)

    __radd__ = __add__

    def __sub__(self, other: Any) -> Any:
        if type(other) is Shift:
            return self.moved((-other).components)
        return self.moved([_scaled(other, -1)] * self.n) if _scalar(other) else super().__sub__(other)

    def place_in(self, view: View, before: Any = 0) -> Any:
        """Return the cell's place in the memory of a field, behind `before` entries."""
        contiguous = view._field.layout.first_axis_contiguous
        steps = (1, *view.steps()[1:]) if contiguous else view.steps()
        n, axis = self.along
        place = self.places.get(id(view._field.layout))
        if place is None:
            place = _total(map(_scaled, self.origin, steps))
        place = _total(
            [place, before, *(_scaled(k, step) for k, step in zip(self.shift[1:], steps[1:], strict=True))]
        )
        if contiguous and axis == 0 and isinstance(self.shift[0], int) and not isinstance(place, int):
            return (place & MOST) + _sum(n, self.shift[0])  # LLVM sees that a strip does not wrap around
        return _total([place, _scaled(self.shift[0], steps[0]), _scaled(n, steps[axis])])


def _total(terms: Iterable[Any]) -> Any:
    return reduce(_sum, terms, 0)


def _scalar(value: Any) -> bool:
    return isinstance(value, int | Number) or (
        isinstance(value, Expr) and not isinstance(value, Index) and not value.is_tensor()
    )


def _scaled(a: Any, b: Any) -> Any:
    if isinstance(a, int) and isinstance(b, int):
        return a * b
    for factor, other in ((a, b), (b, a)):
        if isinstance(factor, int) and factor in (0, 1):
            return other if factor else 0
    return a * b


def _sum(a: Any, b: Any) -> Any:
    if isinstance(a, int) and a == 0:
        return b
    return a if isinstance(b, int) and b == 0 else a + b


def macro(function: Callable) -> Callable:
    """Decorator of Python functions that kernels call while they are traced."""
    mark_function(function, PLAIN)
    return function


@macro
def row(others: Any, like: Sequence[Any], dim: int = 0, axis: int = 0, first: Any = 0) -> Cell:
    """Return the first cell of a row along an axis, with its place in the memory of fields like these.

    others: index of the row, last axis first, more entries than needed are allowed: a vector of which the first ones
    count, or a tuple of which the last ones count. dim: number of axes, by default those of the fields. first: index
    along the axis.
    """
    dim = int(dim) or len(like[0]._field.shape)
    if isinstance(others, tuple):
        entries = list(others[len(others) - dim + 1 :])
    else:
        entries = [impl.subscript(None, others, n) for n in range(dim - 1)]
    origin = [impl.expr_init(entry) for entry in reversed(entries)]
    origin.insert(int(axis), first)
    cell = Cell(origin, [0] * dim, {})
    for view in like:
        cell.places[id(view._field.layout)] = impl.expr_init(cell.place_in(view))
    return cell


@macro
def cell(index: Any, like: Sequence[Any]) -> Cell:
    """Return the cell of an index (dim,), a vector, with its place in the memory of fields like these."""
    components = [impl.subscript(None, index, d) for d in range(len(like[0]._field.shape))]
    return row(tuple(components[:0:-1]), like, first=components[0])


@macro
def along(cell: Cell, n: Any, axis: int = 0) -> Cell:
    """Return the cell that is n cells further along an axis."""
    return Cell(cell.origin, cell.shift, cell.places, (n, int(axis)))


def _unit(n: int, i: int, dt: Any = None, plain: Callable = taichi.Vector.unit) -> Any:
    """Return a unit vector, as Taichi does; one of whole numbers is a difference of indices."""
    n, i = int(n), int(i)
    return Shift([int(k == i) for k in range(n)]) if dt is taichi.i32 else plain(n, i, dt)


_unit.__module__ = matrix.__name__  # Taichi warns of calls of other functions
taichi.Vector.unit = staticmethod(_unit)


@macro
def load_numbers() -> None:
    """Load the numbers of parts, which are used later, here: for a kernel that is a loop of one iteration."""
    Trace.current.load(taichi.i32, 64)
    Trace.current.load(taichi.f32, 16)
