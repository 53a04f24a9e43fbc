"""Kernels that know no room: what a kernel reads from its arguments decides what is compiled.

A kernel gets parts: plain objects with fields, numbers, further parts, and things that select code. While a kernel is
traced, parts are replaced by stand-ins. A field becomes an argument, and so does a number; what the code of the kernel
depends on (a dimension, a flag, a function, the length of a tuple) becomes a condition. For another part, the compiled
kernel is used if its conditions hold, with the fields and numbers of that part; else it is traced again.
"""

import operator
import types
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from taichi_plume.engine.arguments import Loaded, Table, declare_array, declare_field, setter_of
from taichi_plume.engine.conditions import (
    Calls,
    Equal,
    EqualArray,
    Fixed,
    LikeField,
    OfLength,
    OfType,
    Same,
    Values,
    WithKeys,
    as_tuple,
    closed_over,
    computed,
    count_of_entries,
    entry_of,
    is_constant,
    length_of,
    owner_of,
    raw,
    same,
    truth_of,
)
from taichi_plume.engine.fields import ArrayField, on_cpu
from taichi_plume.engine.library import AnyArray, Expr, Matrix, impl, load, make_matrix, mark_function, taichi


class Trace:
    """Record of what the trace of a kernel reads: nodes, conditions and arguments.

    A node is a value found from the kernel's parts: (parent, step, key). A condition is a test of such a value.
    """

    current: "Trace"

    def __init__(self, parts: Sequence[Any]):
        Trace.current = self
        self.values: Values = list(parts)
        self.steps: list[tuple[int, Callable[[Any, Any], Any], Any, Any]] = []
        self.seen: dict[Any, Any] = {}
        self.arguments: dict[Any, tuple[Expr | AnyArray, Callable[[Values], Any], str]] = {}
        self.numbers: dict[Any, Any] = {}
        self.loaded: dict[str, Loaded] = {}
        self.tables: dict[Any, Table] = {}
        self.first_layouts: dict[int, int] = {}
        self.keep: list[Any] = []  # so that identities stay unique during the trace

    # ------------------------------------------------------------ nodes

    def node(self, parent: int, step: Callable[[Any, Any], Any], key: Any, value: Any, check: Any) -> int:
        """Register a value as a node with a condition; return its number."""
        self.values.append(value)
        self.steps.append((parent, step, key, check))
        return len(self.values) - 1

    def wrap(self, parent: int, step: Callable[[Any, Any], Any], key: Any, value: Any) -> Any:
        """Return the stand-in for a value that `step(values[parent], key)` returns."""
        place = (parent, step, key)
        if place not in self.seen:
            self.seen[place] = self._stand_in(parent, step, key, value)
        return self.seen[place]

    def _stand_in(self, parent: int, step: Any, key: Any, value: Any) -> Any:
        kind = type(value)
        if kind is int or kind is float or isinstance(value, np.integer | np.floating):
            index = self.node(parent, step, key, value, None)
            return Number(self, value, ("node", index), lambda values: values[index])
        if kind is tuple or kind is list or (isinstance(value, tuple) and hasattr(value, "_fields")):
            index = self.node(parent, step, key, value, OfLength(kind, len(value)))
            parts = [self.wrap(index, operator.getitem, n, entry) for n, entry in enumerate(value)]
            if hasattr(value, "_fields"):
                return kind(*parts)
            return kind(parts)
        if kind is dict:
            index = self.node(parent, step, key, value, WithKeys(tuple(value)))
            return {name: self.wrap(index, operator.getitem, name, entry) for name, entry in value.items()}
        if isinstance(value, ArrayField):
            index = self.node(parent, step, key, value, LikeField(value))
            return View(self, index, value)
        if isinstance(value, Matrix):
            entries = value.entries if value.ndim == 1 else value.to_list()
            index = self.node(parent, step, key, value, OfLength(kind, len(entries), len_of=count_of_entries))
            return [self.wrap(index, entry_of, n, entry) for n, entry in enumerate(entries)]
        if isinstance(value, types.MethodType):
            index = self.node(parent, step, key, value, Calls(value.__func__))
            owner = value.__self__
            if parent < len(self.values) and self.values[parent] is owner:
                stand_in = self.seen["self", parent]
            else:
                stand_in = self.wrap(index, owner_of, None, owner)
            return Function(self, index, value.__func__, stand_in)
        if isinstance(value, types.FunctionType):
            index = self.node(parent, step, key, value, Calls(value))
            return Function(self, index, value, None)
        if isinstance(value, partial):
            index = self.node(parent, step, key, value, OfType(kind))
            function = self.wrap(index, getattr, "func", value.func)
            return function.given(self.wrap(index, getattr, "args", value.args))
        if isinstance(value, np.ndarray):
            self.node(parent, step, key, value, EqualArray(value))
            return value
        if is_constant(value):
            self.node(parent, step, key, value, Equal(value))
            return value
        index = self.node(parent, step, key, value, OfType(kind))
        return Part(self, index, value)

    # ------------------------------------------------------------ arguments

    def number(self, key: Any, compute: Callable[[Values], Any], dtype: Any) -> Any:
        """Return the expression of a number: one that was loaded before, or an argument."""
        place = (key, str(dtype))
        if place not in self.numbers:
            loaded = self.loaded.get(str(dtype))
            if loaded is not None and len(loaded.members) < len(loaded.variables):
                self.numbers[place] = loaded.take(compute)
            elif not on_cpu() and dtype in (taichi.i32, taichi.f32):  # Vulkan misplaces 64-bit fields
                self.numbers[place] = self._table(dtype).take(compute)
            else:
                argument = impl.get_runtime().compiling_callable.insert_scalar_param(
                    dtype, f"a{len(self.arguments)}"
                )
                self.numbers[place] = load(argument, dtype)
                self.arguments[place] = self.numbers[place], compute, setter_of(dtype)
        return self.numbers[place].ptr

    def _table(self, dtype: Any) -> Table:
        place = ("table", str(dtype))
        if place not in self.tables:
            self.tables[place] = table = Table(dtype, f"t{len(self.arguments)}")
            self.arguments[place] = table.array, table.compute, "field"
        return self.tables[place]

    def load(self, dtype: Any, count: int) -> None:
        """Load so many numbers here, before it is known which they are."""
        self.loaded[str(dtype)] = loaded = Loaded(dtype, count, f"a{len(self.arguments)}")
        self.arguments["loaded", str(dtype)] = loaded.structure, loaded.compute, f"struct_{setter_of(dtype)}"

    def array(self, index: int, field: ArrayField) -> Any:
        """Return the expression of an array argument for the field at a node, or for the memory it shares."""
        if field.block is not None:
            node, field = ("block", index), field.block
            if node not in self.seen:
                self.seen[node] = self.node(index, getattr, "block", field, LikeField(field))
            index = self.seen[node]
        place = ("field", id(field))
        if place not in self.arguments:
            self.keep.append(field)
            n, name = 0 if field.apart else field.n, f"f{len(self.arguments)}"
            on_device = field.flat is None
            array = (
                declare_array(field.dtype, n, 1, name) if on_device else declare_field(field.dtype, n, name)
            )
            self.arguments[place] = array, lambda values: values[index], "field"
            self.seen["first", id(field)] = index
        else:
            first = self.seen["first", id(field)]
            if first != index and ("same", first, index) not in self.seen:
                self.seen["same", first, index] = True
                self.alike(first, index)
        return self.arguments[place][0]

    def fixed(self, field: ArrayField) -> "View":
        """Return the stand-in for a field that is no part of an argument."""
        return self.wrap(0, Fixed(field), None, field)

    def alike(self, first: int, other: int) -> None:
        """Require that two nodes are the same object."""
        self.steps.append((other, same, None, Same(first)))
        self.values.append(self.values[other])


# ---------------------------------------------------------------- stand-ins


class Part:
    """Stand-in for an object: its attributes are stand-ins."""

    _data_oriented = True

    def __init__(self, trace: Trace, index: int, value: Any):
        object.__setattr__(self, "_stands_for", (trace, index, value))
        trace.seen["self", index] = self

    def __getattr__(self, name: str) -> Any:
        trace, index, value = object.__getattribute__(self, "_stands_for")
        return trace.wrap(index, getattr, name, getattr(value, name))

    @property
    def __class__(self) -> Any:  # pyright: ignore
        return type(object.__getattribute__(self, "_stands_for")[2])

    def __getitem__(self, key: Any) -> Any:
        trace, index, value = object.__getattribute__(self, "_stands_for")
        if isinstance(getattr(type(value), "__getitem__", None), types.FunctionType):
            return trace.wrap(index, getattr, "__getitem__", value.__getitem__)(key)
        key = key if not isinstance(key, Number) else key.constant()
        return trace.wrap(index, operator.getitem, key, value[key])

    def __len__(self) -> int:
        trace, index, value = object.__getattribute__(self, "_stands_for")
        return operator.index(trace.wrap(index, length_of, None, len(value)))

    def __iter__(self) -> Any:
        trace, index, value = object.__getattribute__(self, "_stands_for")
        return iter(trace.wrap(index, as_tuple, None, tuple(value)))

    def __bool__(self) -> bool:
        trace, index, value = object.__getattribute__(self, "_stands_for")
        return trace.wrap(index, truth_of, None, bool(value))

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        trace, index, value = object.__getattribute__(self, "_stands_for")
        return trace.wrap(index, getattr, "__call__", value.__call__)(*arguments, **named)


class Function:
    """Stand-in for a function or method, whose free variables are stand-ins too."""

    _data_oriented = True

    def __init__(self, trace: Trace, index: int, function: Any, owner: Any, first: tuple = ()):
        self.trace, self.index, self.function, self.owner, self.first = trace, index, function, owner, first
        self.__name__ = getattr(function, "__name__", "function")
        mark_function(self, getattr(function, "func", PLAIN))

    def given(self, first: tuple) -> "Function":
        """Return the function with its first arguments given (partial)."""
        return Function(self.trace, self.index, self.function, self.owner, (*self.first, *first))

    def free(self) -> dict[str, Any]:
        """Return the stand-ins of the function's free variables, by name."""
        code, cells = raw(self.function).__code__, raw(self.function).__closure__ or ()
        return {
            name: self.trace.wrap(self.index, closed_over, n, cell.cell_contents)
            for n, (name, cell) in enumerate(zip(code.co_freevars, cells, strict=True))
        }

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        arguments = (*(() if self.owner is None else (self.owner,)), *self.first, *arguments)
        plain = raw(self.function)
        if plain is self.function:
            if plain.__closure__:
                cells = tuple(types.CellType(value) for value in self.free().values())
                plain = types.FunctionType(
                    plain.__code__, plain.__globals__, plain.__name__, plain.__defaults__, cells
                )
            return plain(*arguments, **named)
        FREE.append((plain, self.free()))
        try:
            return self.function(*arguments, **named)
        finally:
            FREE.pop()


PLAIN = types.SimpleNamespace(has_print=False)
FREE: list[tuple[Any, dict[str, Any]]] = []


class View:
    """Stand-in for a field."""

    _data_oriented = True

    def __init__(self, trace: Trace, index: int, field: ArrayField):
        self._trace, self._index, self._field = trace, index, field
        self.n, self.m, self.dtype = field.n, 1, field.dtype

    @property
    def __class__(self) -> Any:  # pyright: ignore
        return ArrayField

    @property
    def shape(self) -> tuple:
        return self._trace.wrap(self._index, getattr, "shape", self._field.shape)

    def _layout(self) -> int:
        """Return the node of the layout; fields that share it have the same steps."""
        trace, layout = self._trace, self._field.layout
        if id(layout) not in trace.first_layouts:
            trace.keep.append(layout)
            trace.first_layouts[id(layout)] = trace.node(self._index, getattr, "layout", layout, None)
        elif ("layout", self._index) not in trace.seen:
            trace.seen["layout", self._index] = own = trace.node(self._index, getattr, "layout", layout, None)
            trace.alike(trace.first_layouts[id(layout)], own)
        return trace.first_layouts[id(layout)]

    def steps(self) -> tuple:
        """Return the distances in memory between neighbours along each axis."""
        return self._trace.wrap(self._layout(), getattr, "steps", self._field.layout.steps)

    def length(self) -> Any:
        """Return the number of entries."""
        return self._trace.wrap(self._layout(), getattr, "length", self._field.layout.length)

    def place(self, I: Any, before: Any = 0) -> Any:
        """Return the place of an entry in the memory, in entries, `before` entries of which lie before the first."""
        if hasattr(I, "place_in"):
            return I.place_in(self, before)
        indices, layout = _indices(I), self._field.layout
        dim = len(layout.shape)
        if len(indices) != dim:
            raise IndexError(f"{len(indices)} indices for a field of {dim} axes")
        if dim < 2:
            return indices[0] if dim else 0
        axes = range(dim) if layout.first_axis_contiguous else range(dim - 1, -1, -1)
        at = indices[axes[0]] if isinstance(before, int) else indices[axes[0]] + before
        for d in axes[1:]:
            at = at + indices[d] * self.steps()[d]
        return at

    def __getitem__(self, I: Any) -> Any:
        if self._field.apart:
            return Entries(self, I)
        place = self.place(I)
        if self._field.block is not None:
            place = place + self._trace.wrap(self._index, getattr, "first", self._field.first)
        return impl.subscript(None, self.array(), place)

    def array(self) -> AnyArray:
        """Return the argument for the field's memory."""
        return self._trace.array(self._index, self._field)


def _indices(I: Any) -> list[Any]:
    if I is None:
        return []
    if isinstance(I, Components):
        return [I.component(d) for d in range(I.n)]
    if isinstance(I, Matrix):
        return list(I.to_list())
    if isinstance(I, Expr) and not isinstance(I, Number) and I.is_tensor():
        builder = impl.get_runtime().compiling_callable.ast_builder()
        return [Expr(x) for x in builder.expand_exprs([I.ptr])]
    if isinstance(I, tuple | list):
        return [index for part in I for index in _indices(part)]
    return [I]


class Components(Expr):
    """Vector whose components are known while a kernel is traced; used otherwise, it is a vector of Taichi."""

    n: Any = 0  # pyright: ignore
    dtype: Any = None

    def component(self, d: int) -> Any:
        raise NotImplementedError

    @property
    def ptr(self) -> Any:
        return make_matrix([self.component(d) for d in range(self.n)], self.dtype).ptr

    def is_tensor(self) -> bool:
        return True


class Entries(Components):
    """Vector of a field whose components lie apart."""

    def __init__(self, view: View, I: Any):
        self.view, self.index, self.n = view, I, view.n
        self.dbg_info, self.ptr_type_checked = None, True

    def component(self, d: int) -> Any:
        before = d * self.view.length() if d else 0
        return impl.subscript(None, self.view.array(), self.view.place(self.index, before))

    def _assign(self, other: Any) -> None:
        for d in range(self.n):
            self.component(d)._assign(impl.subscript(None, other, d))


def is_on_host(value: Any) -> bool:
    """Return whether a value is a number of the host, known before a kernel runs."""
    return isinstance(value, Number | int | float | np.integer | np.floating | bool)


class Number(Expr):
    """Stand-in for a number: an argument of the kernel, or a constant and a condition where the code depends on it.

    Arithmetic with constants and other such numbers is done on the host, in double precision.
    """

    def __init__(self, trace: Trace, value: Any, key: Any, compute: Callable[[Values], Any]):
        self.trace, self.value, self.key, self.compute = trace, value, key, compute
        self.known = False
        self.dbg_info = None
        self.ptr_type_checked = True

    def constant(self) -> Any:
        """Return the number as a constant, and require that other parts have the same."""
        if ("constant", self.key) not in self.trace.seen:
            self.trace.seen["constant", self.key] = True
            compute = self.compute
            self.trace.steps.append((-1, computed, compute, Equal(self.value)))
            self.trace.values.append(self.value)
        return self.value

    @property
    def ptr(self) -> Any:
        return self._argument()

    def _argument(self) -> Any:
        compute = self.compute
        if isinstance(self.value, bool):
            expression = Expr(self.trace.number(self.key, compute, taichi.i32)) != 0
            return expression.ptr
        if isinstance(self.value, int | np.integer):
            return self.trace.number(self.key, lambda values: _i32(compute(values)), taichi.i32)
        return self.trace.number(self.key, compute, taichi.f32)

    @ptr.setter
    def ptr(self, _: Any) -> None:
        raise AttributeError

    def typed(self, dtype: Any) -> Expr:
        """Return the number as an argument of a type."""
        return Expr(self.trace.number(self.key, self.compute, dtype))

    def is_tensor(self) -> bool:
        return False

    def _derived(self, operation: Callable, *operands: Any) -> Any:
        key = (operation, *(o.key if isinstance(o, Number) else ("is", o, type(o)) for o in operands))
        if ("derived", key) not in self.trace.seen:
            parts = [o.compute if isinstance(o, Number) else _constant(o) for o in operands]
            value = operation(*(o.value if isinstance(o, Number) else o for o in operands))

            def compute(values: Values) -> Any:
                return operation(*(part(values) for part in parts))

            self.trace.seen["derived", key] = Number(self.trace, value, key, compute)
        return self.trace.seen["derived", key]

    def __bool__(self) -> bool:
        return bool(self._derived(bool, self).constant())

    def __index__(self) -> int:
        return operator.index(self.constant())

    def __int__(self) -> int:
        return int(self.constant())

    def __float__(self) -> float:
        return float(self.constant())

    def __hash__(self) -> int:
        return hash(self.constant())

    def __neg__(self) -> Any:
        return self._derived(operator.neg, self)

    def __abs__(self) -> Any:
        return self._derived(abs, self)

    def __truediv__(self, other: Any) -> Any:
        return (
            self._derived(operator.truediv, self, other) if is_on_host(other) else super().__truediv__(other)
        )

    def __rtruediv__(self, other: Any) -> Any:
        if is_on_host(other):
            return self._derived(operator.truediv, other, self)
        if isinstance(self.value, float | np.floating):
            return other * self._derived(_reciprocal, self)
        return super().__rtruediv__(other)


def _reciprocal(value: float) -> float:
    with np.errstate(divide="ignore"):
        return float(np.float32(1.0) / np.float32(value))


def _constant(value: Any) -> Callable[[Values], Any]:
    return lambda values: value


def _i32(value: int) -> int:
    value = int(value)
    return value - (1 << 32) if value >= 1 << 31 else value


def _operator(name: str, operation: Callable, reflected: bool) -> None:
    plain = getattr(Expr, name)

    def method(self: Number, other: Any) -> Any:
        if is_on_host(other):
            return (
                self._derived(operation, other, self) if reflected else self._derived(operation, self, other)
            )
        if isinstance(other, list | tuple):
            return operation(other, self.constant())
        return plain(self, other)

    setattr(Number, name, method)


for _name, _op in {
    "add": operator.add, "sub": operator.sub, "mul": operator.mul, "mod": operator.mod, "pow": operator.pow,
    "floordiv": operator.floordiv, "and": operator.and_, "or": operator.or_, "xor": operator.xor,
    "lshift": operator.lshift, "rshift": operator.rshift,
}.items():  # fmt: skip
    _operator(f"__{_name}__", _op, False)
    _operator(f"__r{_name}__", _op, True)
for _name, _op in {
    "eq": operator.eq, "ne": operator.ne, "lt": operator.lt, "le": operator.le, "gt": operator.gt, "ge": operator.ge,
}.items():  # fmt: skip
    _operator(f"__{_name}__", _op, False)
