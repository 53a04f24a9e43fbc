"""Steps from a part to what it holds, and conditions on what they find, by which a compiled kernel is chosen."""

import enum
import re
import types
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from taichi_plume.engine.fields import ArrayField
from taichi_plume.engine.library import DataType, Func, Matrix, MatrixType, SNodeField, StructType

Values = list[Any]
"""Parts of a kernel, and all values that it reads from them."""


# ---------------------------------------------------------------- steps


def same(value: Any, _: Any) -> Any:
    """Return the value itself."""
    return value


class Fixed:
    """Step to a certain field."""

    def __init__(self, field: ArrayField):
        self.field = field

    def __call__(self, value: Any, _: Any) -> ArrayField:
        return self.field

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Fixed) and other.field is self.field

    def __hash__(self) -> int:
        return id(self.field)


def owner_of(value: Any, _: Any) -> Any:
    """Return the object of a method."""
    return value.__self__


def count_of_entries(value: Matrix) -> int:
    """Return the number of entries of a vector of Taichi."""
    return len(value.entries if value.ndim == 1 else value.to_list())


def entry_of(value: Matrix, n: int) -> Any:
    """Return an entry of a vector of Taichi."""
    return (value.entries if value.ndim == 1 else value.to_list())[n]


def closed_over(function: Any, n: int) -> Any:
    """Return a free variable of a function."""
    return (raw(function).__closure__ or ())[n].cell_contents


def raw(function: Any) -> types.FunctionType:
    """Return the Python function of a ti.func, or of a partial one, or a Python function itself."""
    if isinstance(function, partial):
        return raw(function.func)
    inner = getattr(function, "func", None)
    return inner.func if isinstance(inner, Func) else function


def code(function: Any) -> types.CodeType:
    """Return the code of a function or method."""
    return raw(getattr(function, "__func__", function)).__code__


def name_in_source(functions: Iterable[Any]) -> str:
    """Return an identifier of functions by their files and names, such as ``flow__net_inflow__ghosts__fill``.

    Of more than three functions it has the first two and the number of the others.
    """
    codes = dict.fromkeys((Path(c.co_filename).stem, c.co_name) for c in map(code, functions))
    files, words = [""], []
    for file, function in list(codes)[: 3 if len(codes) == 3 else 2]:
        words += [function] if file == files[-1] else [file, function]
        files.append(file)
    words += [f"{len(codes) - 2}_more"] if len(codes) > 3 else []
    return re.sub(r"\W|^(?=\d)", "_", "__".join(word.strip("_") for word in words), flags=re.ASCII)


def as_tuple(value: Any, _: Any) -> tuple:
    """Return the entries of a collection."""
    return tuple(value)


def truth_of(value: Any, _: Any) -> bool:
    """Return whether a value counts as true."""
    return bool(value)


def length_of(value: Any, _: Any) -> int:
    """Return the length of a collection."""
    return len(value)


def computed(values: Values, compute: Callable[[Values], Any]) -> Any:
    """Return a number that follows from the values."""
    return compute(values)


# ---------------------------------------------------------------- conditions


class Same:
    """Condition that a value is the same object as another one of the values."""

    def __init__(self, other: int):
        self.other = other


class OfLength:
    """Condition on the type and length of a tuple or list."""

    def __init__(self, kind: type, length: int, len_of: Callable = len):
        self.kind, self.length, self.len_of = kind, length, len_of

    def __call__(self, value: Any) -> bool:
        return type(value) is self.kind and self.len_of(value) == self.length


class WithKeys:
    """Condition on the keys of a dict."""

    def __init__(self, keys: tuple):
        self.keys = keys

    def __call__(self, value: Any) -> bool:
        return type(value) is dict and tuple(value) == self.keys


class LikeField:
    """Condition on type, components, number and order of axes of a field, and whether the field shares memory."""

    def __init__(self, field: ArrayField):
        self.like = self._kind(field)

    @staticmethod
    def _kind(field: ArrayField) -> tuple:
        return field.dtype, field.n, len(field.shape), field.layout.first_axis_contiguous, field.block is None

    def __call__(self, value: Any) -> bool:
        return isinstance(value, ArrayField) and self._kind(value) == self.like


class Calls:
    """Condition on the code of a function."""

    def __init__(self, function: Any):
        self.code = raw(function).__code__

    def __call__(self, value: Any) -> bool:
        return getattr(raw(getattr(value, "__func__", value)), "__code__", None) is self.code


class EqualArray:
    """Condition on the content of an array of NumPy."""

    def __init__(self, value: np.ndarray):
        self.value = value.copy()

    def __call__(self, value: Any) -> bool:
        return isinstance(value, np.ndarray) and np.array_equal(value, self.value)


class Equal:
    """Condition on a value."""

    def __init__(self, value: Any):
        self.value = value

    def __call__(self, value: Any) -> bool:
        return value is self.value or (type(value) is type(self.value) and value == self.value)


class OfType:
    """Condition on the type of an object."""

    def __init__(self, kind: type):
        self.kind = kind

    def __call__(self, value: Any) -> bool:
        return type(value) is self.kind


def is_constant(value: Any) -> bool:
    """Return whether a value selects code, as a whole."""
    return (
        value is None
        or isinstance(
            value,
            bool | str | bytes | type | types.ModuleType | enum.Enum | range | slice | np.bool_ | complex
            | types.BuiltinFunctionType | np.ufunc | SNodeField | DataType | frozenset | set
            | MatrixType | StructType,
        )
    )  # fmt: skip
