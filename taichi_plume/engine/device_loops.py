"""Parallel loops of kernels on a GPU: the same number of threads for a range of any length.

Taichi computes the bounds of a parallel loop, unless they are constants, in a launch of their own, and copies arguments
of functions in another one. Here the loop runs over a constant number of threads instead; each computes the bounds
itself, and strides over the range. Neighbouring threads take neighbouring indices. Arguments are copied within loops
only.
"""

import ast
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from math import prod
from typing import Any

from taichi_plume.engine.cells import macro
from taichi_plume.engine.fields import on_cpu
from taichi_plume.engine.library import (
    ASTTransformer,
    Expr,
    build_stmt,
    build_stmts,
    debug_info,
    decorator_of,
    impl,
    make_matrix,
    taichi,
)
from taichi_plume.engine.trace import Number

LOG_THREADS = 17
THREADS = 1 << LOG_THREADS
"""Threads of a parallel loop whose bounds are not constants, enough for all processors of a large GPU."""

BLOCK = 1024
"""Threads of a block, which can wait for each other, see `barrier`."""


def block_size() -> int:
    """Return the number of threads of a block: a constant loop over them is a block with `block_dim` of that size."""
    return 1 if on_cpu() else BLOCK


@macro
def barrier() -> None:
    """Let the threads of a block wait for each other, and see what each has stored."""
    if not on_cpu():
        if taichi.cfg.arch not in (taichi.cuda, taichi.amdgpu):
            taichi.simt.block.mem_sync()
        taichi.simt.block.sync()


_open = 0
"""Number of loops and branches around the statement that is built."""


@contextmanager
def _inside() -> Iterator[None]:
    global _open
    _open += 1
    try:
        yield
    finally:
        _open -= 1


def _bounds(ctx: Any, node: ast.For) -> list[tuple[Any, Any]] | None:
    """Return the first index and the end of each range of a loop; None for a loop over other things."""
    kind, call = decorator_of(ctx, node.iter), node.iter
    if not isinstance(call, ast.Call):
        return None
    if kind == "grouped":
        call = call.args[0]
        kind = decorator_of(ctx, call)
    if kind == "ndrange":
        return build_stmt(ctx, call).bounds
    if isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id == "range":
        ends = [build_stmt(ctx, end) for end in call.args]
        return [(ends[0] if len(ends) == 2 else 0, ends[-1])]
    return None


def _build_for(ctx: Any, node: ast.For, plain: Callable = ASTTransformer.build_For) -> None:
    """Build a loop as Taichi does; a parallel one on a GPU, with bounds that are no constants, over threads."""
    if decorator_of(ctx, node.iter) == "static":
        plain(ctx, node)
        return
    bounds = None if _open or on_cpu() else _bounds(ctx, node)
    with _inside():
        if bounds is None or all(isinstance(end, int) for pair in bounds for end in pair):
            plain(ctx, node)
        else:
            _build_threads(ctx, node, bounds)


def _build_threads(ctx: Any, node: ast.For, bounds: Sequence[tuple[Any, Any]]) -> None:
    grouped = decorator_of(ctx, node.iter) == "grouped"
    sizes = [end - begin for begin, end in bounds]
    with ctx.loop_scope_guard(), ctx.variable_scope_guard():
        thread = _begin(ctx, node, THREADS)
        turn = _begin(ctx, node, (prod(sizes) - thread + (THREADS - 1)) >> LOG_THREADS)
        rest: Any = impl.expr_init(thread + (turn << LOG_THREADS))
        index: list[Any] = []
        for d, (begin, _) in enumerate(bounds):  # last axis fastest
            inner = prod(sizes[d + 1 :])
            here: Any = impl.expr_init(taichi.raw_div(rest, inner)) if d + 1 < len(bounds) else rest
            rest = impl.expr_init(rest - here * inner)
            index.append(impl.expr_init(here + begin))
        names = ASTTransformer.get_for_loop_targets(node)
        values = [impl.expr_init(make_matrix(index, dt=taichi.i32))] if grouped else index
        for name, value in zip(names, values, strict=True):
            ctx.create_variable(name, value)
        build_stmts(ctx, node.body)
        ctx.ast_builder.end_frontend_range_for()
        ctx.ast_builder.end_frontend_range_for()


def _begin(ctx: Any, node: ast.For, count: Any) -> Expr:
    """Begin a loop over a range; return its index."""
    index = Expr(ctx.ast_builder.make_id_expr(""))
    ends = [taichi.cast(Expr(0), taichi.i32), taichi.cast(Expr(count), taichi.i32)]
    ctx.ast_builder.begin_frontend_range_for(index.ptr, *(end.ptr for end in ends), debug_info(ctx, node))
    return index


def _build_while(ctx: Any, node: ast.While, plain: Callable = ASTTransformer.build_While) -> None:
    with _inside():
        plain(ctx, node)


def _build_if(ctx: Any, node: ast.If, plain: Callable = ASTTransformer.build_If) -> Any:
    if decorator_of(ctx, node.test) == "static":
        return plain(ctx, node)
    with _inside():
        return plain(ctx, node)


_numbers: set[int] = set()
"""Identities of the expressions that are arguments of the kernel that is built."""


def begin(arguments: Sequence[Any]) -> None:
    """Begin to build a kernel with these expressions as its arguments."""
    _numbers.clear()
    _numbers.update(map(id, arguments))


def _given(value: Any, plain: Callable = impl.expr_init_func) -> Any:
    """Return the parameter of a function for an argument: on a GPU between loops, the kernel's argument itself."""
    if not _open and not on_cpu() and (id(value) in _numbers or isinstance(value, Number)):
        return value
    return plain(value)


impl.expr_init_func = _given
ASTTransformer.build_For = staticmethod(_build_for)
ASTTransformer.build_While = staticmethod(_build_while)
ASTTransformer.build_If = staticmethod(_build_if)
