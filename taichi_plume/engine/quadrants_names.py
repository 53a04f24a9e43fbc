"""Names of Quadrants 1.3 that the engine uses, as `taichi_names` defines them for Taichi."""

# ruff: noqa: F401  `library` exports the names that are imported here
# The package is an extra, which the type checker may not find:
# pyright: reportMissingImports=false

import ast
import textwrap
from collections.abc import Callable
from functools import partial, wraps
from typing import Any

import quadrants as taichi
from quadrants._lib import core
from quadrants.lang import (
    _func_base,
    _kernel_impl_dataclass,
    impl,
    kernel_arguments,
    kernel_impl,
    matrix,
)
from quadrants.lang._pruning import Pruning
from quadrants.lang.any_array import AnyArray
from quadrants.lang.ast.ast_transformer import ASTTransformer, build_stmt, build_stmts
from quadrants.lang.ast.ast_transformer_utils import (
    ASTTransformerFuncContext,
    ASTTransformerGlobalContext,
    Builder,
    get_decorator,
)
from quadrants.lang.ast.ast_transformers.call_transformer import CallTransformer
from quadrants.lang.exception import QuadrantsCompilationError as CompilationError
from quadrants.lang.exception import QuadrantsSyntaxError as KernelSyntaxError
from quadrants.lang.expr import Expr
from quadrants.lang.field import Field as SNodeField
from quadrants.lang.impl import PyQuadrants as Runtime
from quadrants.lang.kernel import _GRAPH_ENABLED
from quadrants.lang.kernel_impl import Func, Kernel
from quadrants.lang.matrix import Matrix, MatrixType, make_matrix
from quadrants.lang.struct import StructType
from quadrants.lang.util import cook_dtype
from quadrants.types import ndarray_type
from quadrants.types.enums import AutodiffMode

PREFIX = "QD_"
CACHE_LOCK = "kernel_compilation_manager/qdcache.lock"
DataType = core.DataTypeCxx

# The engine asks whether a program runs; Quadrants' own property raises an error if none does.
Runtime.prog = property(lambda runtime: runtime._prog)

# ---------------------------------------------------------------- tracing

CALL_BUILDER, CALL_OF_TYPE, CALL_OF_BUILTIN = (
    CallTransformer,
    "_build_call_if_is_type",
    "_build_call_if_is_builtin",
)
SOURCE_READERS = ((_func_base, "get_source_info_and_src", ("func",)),)
TEXT_WRAPPER = _func_base
POSITION = (ASTTransformerFuncContext, "memoized_get_pos_info")


def _flattened(
    tree: ast.Module,
    struct_locals: set[str],
    plain: Callable = _kernel_impl_dataclass.unpack_ast_struct_expressions,
) -> ast.Module:
    """Return a function's tree in which members of dataclass arguments are variables.

    Quadrants copies the tree of each called function, a fifth of the tracing, even if there are no such arguments.
    """
    return plain(tree, struct_locals) if struct_locals else tree


_kernel_impl_dataclass.unpack_ast_struct_expressions = _flattened


def node_built(node: Any) -> None:
    """Mark a node as free of global variables, on which Quadrants' cache by source would depend."""
    if not hasattr(node, "violates_pure"):
        node.violates_pure, node.violates_pure_reason = False, None


def variable(context: Any, name: str) -> Any:
    """Return a variable; Quadrants also returns whether the variable is global, and how."""
    return context.get_var_by_name(name)[1]


decorator_of = get_decorator


def debug_info(ctx: Any, node: ast.AST) -> Any:
    """Return the source position of a node for the messages of Quadrants."""
    return core.DebugInfo(ctx.memoized_get_pos_info(node))


def mark_function(target: Any, inner: Any) -> None:
    """Mark an object as a function that kernels may call."""
    target._is_quadrants_function = True
    target.func = target.wrapper = inner


def func(function: Callable) -> Callable:
    """Decorator of functions for kernels: a plain function, as in Taichi, so that access makes a plain method of it.

    Quadrants' own is an object that stores a bound copy of itself in each instance.
    """
    inner = Func(function, _classfunc=kernel_impl._inside_class(2))

    @wraps(function)
    def decorated(*arguments: Any, **named: Any) -> Any:
        return inner(*arguments, **named)

    mark_function(decorated, inner)
    return decorated


def replace_globals(other: Callable[[Any, Callable], dict[str, Any]]) -> None:
    """Let `other` return the global variables of functions, which is a method in Quadrants."""
    base = _func_base.FuncBase
    plain = base._get_global_vars
    base._get_global_vars = lambda self, function: other(function, partial(plain, self))


def kernel_context(function: Callable, shell: Kernel) -> tuple[ASTTransformerFuncContext, list[ast.stmt]]:
    """Return the AST context of a kernel, and the statements of its function.

    Quadrants traces a kernel twice, first to find the used members of dataclass arguments. As no kernel has such
    arguments, the pruning of members starts as finished (`enforce`).
    """
    source_info, source = _func_base.get_source_info_and_src(function)
    source = [_func_base.textwrap.fill(text, tabsize=4, width=9999) for text in source]
    tree: Any = ast.parse(textwrap.dedent("\n".join(source)))
    pruning = Pruning(kernel_used_parameters=set())
    pruning.enforce()
    context = ASTTransformerFuncContext(
        global_context=ASTTransformerGlobalContext(shell, pruning, None, 1),
        template_slot_locations=(), is_kernel=True, is_pure=False, func=shell, arg_features=None, global_vars={},
        template_vars={}, py_args=(), src=source, start_lineno=source_info.start_lineno,
        end_lineno=source_info.end_lineno, file=source_info.filepath, ast_builder=None, is_real_function=False,
        autodiff_mode=AutodiffMode.NONE, raise_on_templated_floats=False,
    )  # fmt: skip
    return context, tree.body[0].body


def begin_kernel(shell: Kernel, context: ASTTransformerFuncContext, target: Any) -> None:
    """Start to build a kernel; functions find it by a global context."""
    runtime = impl.get_runtime()
    shell.kernel_cpp, runtime.inside_kernel = target, True
    runtime._compiling_callable, runtime._current_global_context = target, context.global_context
    context.ast_builder = target.ast_builder()


def end_kernel() -> None:
    """End the building of a kernel."""
    runtime = impl.get_runtime()
    runtime.inside_kernel, runtime._compiling_callable, runtime._current_global_context = False, None, None


# ---------------------------------------------------------------- arguments and launches

_NOWHERE = core.DebugInfo()


def declared_array(element: Any, ndim: int, argument: Any) -> AnyArray:
    """Return the expression of an array argument; Quadrants has no nested argument packs, thus no depth."""
    return AnyArray(core.make_external_tensor_expr(element, ndim, argument, False, core.BoundaryMode.UNSAFE))


def load(argument: Any, dtype: Any, whole: bool = True) -> Expr:
    """Return the expression of a scalar argument, or of the place of a structure."""
    return Expr(core.make_arg_load_expr(argument, dtype, False, create_load=whole, dbg_info=_NOWHERE))


declared_matrix = kernel_arguments.decl_matrix_arg
declared_scalar = kernel_arguments.decl_scalar_arg


def argument_index(n: int) -> Any:
    """Return the index of the n-th argument in a launch context: a plain number in Quadrants."""
    return n


def compile_kernel(program: Any, kernel: Any) -> Any:
    """Return the compiled form of a kernel; Quadrants also returns whether the form was in the cache."""
    return program.compile_kernel(program.config(), program.get_device_caps(), kernel).compiled_kernel_data


def launch_context(kernel: Any) -> Any:
    """Return a new context of launches of a kernel; on a card of NVIDIA its loops are launched as one CUDA graph.

    QD_GRAPH=0 in the environment launches loops one by one. Without a card Quadrants ignores the request.
    """
    context = kernel.make_launch_context()
    context.use_graph = _GRAPH_ENABLED
    return context
