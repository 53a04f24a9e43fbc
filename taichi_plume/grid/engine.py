"""Lifetime of Taichi's program: fields raise EngineError after a restart, unused kernels and SNode trees are freed.

Taichi frees all fields when Taichi is restarted or reset. Access to such a field would crash the process.
"""

import gc
import weakref
from collections.abc import Callable
from functools import cache

from taichi._snode.fields_builder import FieldsBuilder
from taichi._snode.snode_tree import SNodeTree
from taichi.lang import impl
from taichi.lang.exception import TaichiCompilationError
from taichi.lang.field import Field
from taichi.lang.impl import PyTaichi
from taichi.lang.kernel_impl import Kernel


class EngineError(TaichiCompilationError, RuntimeError):
    """Error of access to a simulation whose fields no longer exist, because Taichi was restarted or reset."""

    def __init__(self, *_: object):  # Taichi raises errors within kernels again, with the place in the kernel
        super().__init__(
            "the fields of this simulation or environment no longer exist: Taichi was restarted or reset after they "
            "were made; assemble the simulation, or make the environment, again"
        )


class Kernels(weakref.WeakSet):
    """Weak set of kernels that Taichi resets at a restart; Taichi's own list would keep kernels and fields alive."""

    append = weakref.WeakSet.add
    compiled = 0
    """Number of kernels compiled since Taichi was reset."""

    def __bool__(self) -> bool:
        return True  # Taichi would replace an empty list by a list of its own


class _Gone:
    """Class of a freed field: every access raises EngineError."""

    def __getattribute__(self, name: str) -> type:
        if name == "__class__":  # `isinstance` asks for it
            return type(self)
        raise EngineError


@cache
def _gone(kind: type) -> type:
    return type("GoneField", (_Gone, kind), {})


def live_fields() -> list[Field]:
    """Return all Taichi fields of the running program that are still referenced."""
    kinds = ((thing, type(thing)) for thing in gc.get_objects())
    return [thing for thing, kind in kinds if issubclass(kind, Field) and not issubclass(kind, _Gone)]


def free_unused_trees(live: list[Field]) -> None:
    """Free the SNode trees without a field in `live`; Taichi has room for 512 trees."""
    runtime = impl.get_runtime()
    used = {field.snode.ptr.get_snode_tree_id() for field in live if field.snode.ptr is not None}
    for tree in reversed(_trees):
        if tree.id not in used:
            # addresses kept by `memory`: another tree gets this number
            vars(runtime).get("roots_in_place", {}).pop(tree.id, None)
            tree.ptr.destroy_snode_tree(runtime.prog)
            tree.destroyed = True
    _trees[:] = [tree for tree in _trees if not tree.destroyed]


def _finalize(
    builder: FieldsBuilder, *args: object, plain: Callable = FieldsBuilder._finalize, **named: object
) -> SNodeTree:
    """Place the fields of a builder in memory, as Taichi does, and register their SNode tree."""
    _trees.append(plain(builder, *args, **named))
    return _trees[-1]


def _materialize(runtime: PyTaichi, plain: Callable = PyTaichi.materialize) -> None:
    """Place new fields in memory, as each launch of a kernel does first. Raises EngineError if Taichi was reset."""
    if runtime.prog is None:
        raise EngineError
    plain(runtime)


def _compile(kernel: Kernel, *args: object, plain: Callable = Kernel.materialize, **named: object) -> None:
    """Compile a kernel for new arguments, as Taichi does, and count the compilation."""
    before = len(kernel.compiled_kernels)
    plain(kernel, *args, **named)
    KERNELS.compiled += len(kernel.compiled_kernels) - before


def _reset(plain: Callable = impl.reset) -> None:
    """Reset Taichi; all fields of the program raise EngineError afterwards."""
    if impl.get_runtime().prog is not None:
        for field in live_fields():
            field.__class__ = _gone(type(field))
    plain()
    _trees.clear()
    KERNELS.compiled = 0
    impl.get_runtime().print_full_traceback = False  # read by failing kernels, set only by `init`


_trees: list[SNodeTree] = []
FieldsBuilder._finalize = _finalize
impl.reset = _reset
PyTaichi.materialize = _materialize
Kernel.materialize = _compile
KERNELS = impl.get_runtime().kernels = Kernels(impl.get_runtime().kernels)
