"""Arguments of a kernel that is traced: arrays, and numbers one by one or in a structure."""

from collections.abc import Callable
from typing import Any

import numpy as np

from taichi_plume.engine.conditions import Values
from taichi_plume.engine.fields import KINDS, ArrayField, filled, own_memory
from taichi_plume.engine.library import AnyArray, DataType, Expr, core, declared_array, impl, load, taichi


def declare_array(dtype: Any, n: int, ndim: int, name: str) -> AnyArray:
    """Add an array argument of numbers, or of vectors of n numbers, to the kernel that is traced."""
    element = core.get_type_factory_instance().get_tensor_type((n,), dtype) if n else dtype
    argument = impl.get_runtime().compiling_callable.insert_ndarray_param(element, ndim, name, False)
    return declared_array(element, ndim, argument)


def declare_field(dtype: Any, n: int, name: str) -> AnyArray:
    """Add the memory of a field on a CPU to the kernel that is traced, as a structure of its length and its address.

    Taichi looks up array arguments at each launch, 0.25 us each; a structure stays as it was set.
    """
    factory = core.get_type_factory_instance()
    element = factory.get_tensor_type((n,), dtype) if n else dtype
    kind = DataType(factory.get_ndarray_struct_type(dtype, 1, False))
    argument = impl.get_runtime().compiling_callable.insert_scalar_param(kind, name)
    return declared_array(element, 1, argument)


def setter_of(dtype: Any) -> str:
    """Return the end of the name of the function that sets a number of a type."""
    if dtype in (taichi.f32, taichi.f64):
        return "float"
    return "uint" if dtype in (taichi.u32, taichi.u8) else "int"


_NOWHERE = core.DebugInfo()


class Loaded:
    """Numbers that are loaded together, in a structure: a launch costs 0.1 us per argument, and LLVM would load again
    after each store.
    """

    def __init__(self, dtype: Any, count: int, name: str):
        members = [(dtype, f"n{k}") for k in range(count)]
        kind = core.get_type_factory_instance().get_struct_type(members)
        argument = impl.get_runtime().compiling_callable.insert_scalar_param(kind, name)
        self.structure = load(argument, kind, whole=False)
        elements = [
            Expr(core.make_get_element_expr(self.structure.ptr, (k,), _NOWHERE)) for k in range(count)
        ]
        self.variables: list[Any] = [impl.expr_init(element) for element in elements]
        self.members: list[Callable[[Values], Any]] = []

    def take(self, compute: Callable[[Values], Any]) -> Expr:
        """Return the variable of another number."""
        self.members.append(compute)
        return self.variables[len(self.members) - 1]

    def compute(self, values: Values) -> list[Any]:
        """Return the numbers for the values of a trace."""
        return [compute(values) for compute in self.members]


class Table:
    """Numbers of a type in an array on a device. The context of a launch is new each time there, and takes 0.3 us per
    number; the array stays.
    """

    def __init__(self, dtype: Any, name: str):
        self.dtype, self.array = dtype, declare_array(dtype, 0, 1, name)
        self.members: list[Callable[[Values], Any]] = []

    def take(self, compute: Callable[[Values], Any]) -> Expr:
        """Return the expression of another number."""
        self.members.append(compute)
        builder = impl.get_runtime().compiling_callable.ast_builder()
        return impl.subscript(builder, self.array, len(self.members) - 1)

    def compute(self, values: Values) -> ArrayField:
        """Return the array of the numbers for the values of a trace."""
        numbers = [compute(values) for compute in self.members]
        with own_memory():
            return filled(np.array(numbers, KINDS[self.dtype]), self.dtype)
