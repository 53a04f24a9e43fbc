"""Taichi's own functions while a kernel is traced, replaced where they meet stand-ins of parts."""

import ast
import operator
import sys
from collections.abc import Callable
from typing import Any

from taichi_plume.engine.fields import ArrayField
from taichi_plume.engine.library import (
    CALL_BUILDER,
    CALL_OF_BUILTIN,
    CALL_OF_TYPE,
    ASTTransformer,
    Expr,
    build_stmt,
    build_stmts,
    impl,
    replace_globals,
    taichi,
    variable,
)
from taichi_plume.engine.trace import FREE, Components, Function, Number, Part, Trace, View, is_on_host


def _global_variables(function: Any, plain: Callable) -> dict[str, Any]:
    """Return the global and free variables of a function, as Taichi does, with stand-ins for the free ones."""
    if FREE and FREE[-1][0] is function:
        return {**function.__globals__, **FREE[-1][1]}
    return plain(function)


def _subscript(
    builder: Any, value: Any, *indices: Any, plain: Callable = impl.subscript, **named: Any
) -> Any:
    """Subscript as Taichi does; a number that selects a vector's component, or a tuple's entry, is a constant."""
    if isinstance(value, Components) and len(indices) == 1 and isinstance(indices[0], int | Number):
        return value.component(operator.index(indices[0]))
    if type(value) is ArrayField:  # reached through a global variable: always this field
        value = Trace.current.fixed(value)
    if type(value) in (tuple, list, dict) or (isinstance(value, Expr) and not isinstance(value, Number)):
        indices = tuple(index.constant() if isinstance(index, Number) else index for index in indices)
    return plain(builder, value, *indices, **named)


_PLAIN_STATIC = impl.static


def static(x: Any, *xs: Any, plain: Callable = impl.static) -> Any:
    """Evaluate at compile time, as Taichi does; stand-ins stay what they are."""
    if xs:
        return [static(x), *(static(y) for y in xs)]
    if type(x) in (Number, Part, View, Function):
        return x
    return plain(x)


def _build_name(ctx: Any, node: ast.Name, plain: Callable = ASTTransformer.build_Name) -> Any:
    value = variable(ctx, node.id)
    if isinstance(value, Number):
        node.ptr = value  # type: ignore[attr-defined]
        return value
    return plain(ctx, node)


def _build_compare(ctx: Any, node: ast.Compare, plain: Callable = ASTTransformer.build_Compare) -> Any:
    """Build a comparison as Taichi does; numbers of parts are compared on the host."""
    if len(node.ops) == 1 and type(node.ops[0]) in _COMPARISONS:
        build_stmt(ctx, node.left)
        build_stmts(ctx, node.comparators)
        left, right = node.left.ptr, node.comparators[0].ptr  # type: ignore[attr-defined]
        if (isinstance(left, Number) or isinstance(right, Number)) and is_on_host(left) and is_on_host(right):
            node.ptr = _COMPARISONS[type(node.ops[0])](left, right)  # type: ignore[attr-defined]
            return node.ptr  # type: ignore[attr-defined]
    return plain(ctx, node)


_COMPARISONS = {
    ast.Eq: operator.eq, ast.NotEq: operator.ne, ast.Lt: operator.lt, ast.LtE: operator.le,
    ast.Gt: operator.gt, ast.GtE: operator.ge,
}  # fmt: skip


_PLAIN_CALL_OF_TYPE = getattr(CALL_BUILDER, CALL_OF_TYPE)
_PLAIN_CALL_OF_BUILTIN = getattr(CALL_BUILDER, CALL_OF_BUILTIN)


def _build_call_if_is_type(ctx: Any, node: Any, args: Any, keywords: Any) -> bool:
    if (
        len(args) == 1
        and isinstance(args[0], Number)
        and id(node.func.ptr) in taichi.types.primitive_types.type_ids
    ):
        node.ptr = args[0].typed(node.func.ptr)
        return True
    return _PLAIN_CALL_OF_TYPE(ctx, node, args, keywords)


def _build_call_if_is_builtin(ctx: Any, node: Any, args: Any, keywords: Any) -> bool:
    """Call Python's own functions of numbers of parts on the host."""
    numbers = [arg for arg in args if isinstance(arg, Number)]
    if numbers and node.func.ptr in (min, max, int, float, bool, pow) and all(map(is_on_host, args)):
        node.ptr = numbers[0]._derived(node.func.ptr, *args)
        return True
    return _PLAIN_CALL_OF_BUILTIN(ctx, node, args, keywords)


static.__module__ = impl.__name__  # Taichi warns of calls of other functions
impl.subscript = _subscript
for _module in [module for name, module in sys.modules.items() if name.split(".")[0] == taichi.__name__]:
    if vars(_module).get("static") is _PLAIN_STATIC:
        _module.static = static  # type: ignore[attr-defined]
replace_globals(_global_variables)
ASTTransformer.build_Name = staticmethod(_build_name)
ASTTransformer.build_Compare = staticmethod(_build_compare)
setattr(CALL_BUILDER, CALL_OF_TYPE, staticmethod(_build_call_if_is_type))
setattr(CALL_BUILDER, CALL_OF_BUILTIN, staticmethod(_build_call_if_is_builtin))
