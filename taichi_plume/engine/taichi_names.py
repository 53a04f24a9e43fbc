"""Names of Taichi 1.7 that the engine uses; `quadrants_names` defines the same names for Quadrants."""

# ruff: noqa: F401  `library` exports the names that are imported here

import ast
import textwrap
from collections.abc import Callable
from typing import Any

import taichi
from taichi import func
from taichi._lib import core
from taichi.lang import impl, kernel_arguments, kernel_impl, matrix
from taichi.lang.any_array import AnyArray
from taichi.lang.ast.ast_transformer import ASTTransformer, build_stmt, build_stmts
from taichi.lang.ast.ast_transformer_utils import ASTTransformerContext, Builder
from taichi.lang.enums import AutodiffMode
from taichi.lang.exception import TaichiCompilationError as CompilationError
from taichi.lang.exception import TaichiSyntaxError as KernelSyntaxError
from taichi.lang.expr import Expr
from taichi.lang.field import Field as SNodeField
from taichi.lang.impl import PyTaichi as Runtime
from taichi.lang.kernel_impl import Func, Kernel
from taichi.lang.matrix import Matrix, MatrixType, make_matrix
from taichi.lang.struct import StructType
from taichi.lang.util import cook_dtype
from taichi.types import ndarray_type

PREFIX = "TI_"
"""Start of the names of the library's environment variables."""

CACHE_LOCK = "ticache.lock"
"""File in the kernel cache that locks the cache."""

DataType = core.DataType

# ---------------------------------------------------------------- tracing

CALL_BUILDER, CALL_OF_TYPE, CALL_OF_BUILTIN = (
    ASTTransformer,
    "build_call_if_is_type",
    "build_call_if_is_builtin",
)
"""Class that builds calls in kernels, and its methods for calls of types and of Python's functions."""

SOURCE_READERS = ((kernel_impl, "getsourcelines", ("obj",)), (kernel_impl, "getsourcefile", ("obj",)))
"""Functions that read the source of a function at each call, with their parameters."""

TEXT_WRAPPER = kernel_impl
"""Module that wraps the source lines of each function."""

POSITION = (ASTTransformerContext, "get_pos_info")
"""Class and name of the method that returns the source position of a node."""

node_built = None
"""Function that is called with each AST node that was built; None if there is none."""

variable = ASTTransformerContext.get_var_by_name
"""Return a variable of a kernel from an AST context and the variable's name."""


decorator_of = ASTTransformer.get_decorator
"""Return the name of the special function, such as "static", that a node calls; "" if none."""


def debug_info(ctx: Any, node: ast.AST) -> Any:
    """Return the source position of a node for Taichi's messages."""
    return core.DebugInfo(ctx.get_pos_info(node))


def mark_function(target: Any, inner: Any) -> None:
    """Mark an object as a function that kernels may call. inner: its `Func`."""
    target._is_taichi_function = True
    target.func = inner


def replace_globals(other: Callable[[Any, Callable], dict[str, Any]]) -> None:
    """Let `other`, called with a function and Taichi's own function, return the global variables of functions."""
    plain = kernel_impl._get_global_vars
    kernel_impl._get_global_vars = lambda function: other(function, plain)


def kernel_context(function: Callable, shell: Kernel) -> tuple[ASTTransformerContext, list[ast.stmt]]:
    """Return the AST context of a kernel, and the statements of its function. shell: kernel of the library."""
    source, line = kernel_impl.getsourcelines(function)
    source = [kernel_impl.textwrap.fill(text, tabsize=4, width=9999) for text in source]
    tree: Any = ast.parse(textwrap.dedent("\n".join(source)))
    context = ASTTransformerContext(
        is_kernel=True, func=shell, global_vars={}, src=source, start_lineno=line,
        file=kernel_impl.getsourcefile(function),
    )  # fmt: skip
    return context, tree.body[0].body


def begin_kernel(shell: Kernel, context: ASTTransformerContext, target: Any) -> None:
    """Start to build a kernel. target: the kernel of the library's core."""
    runtime = impl.get_runtime()
    shell.kernel_cpp, runtime.inside_kernel, runtime.current_kernel = target, True, shell
    runtime.compiling_callable = target
    context.ast_builder = target.ast_builder()


def end_kernel() -> None:
    """End the building of a kernel."""
    runtime = impl.get_runtime()
    runtime.inside_kernel, runtime.current_kernel, runtime.compiling_callable = False, None, None


# ---------------------------------------------------------------- arguments and launches

_NOWHERE = core.DebugInfo()


def declared_array(element: Any, ndim: int, argument: Any) -> AnyArray:
    """Return the expression of an array argument."""
    return AnyArray(
        core.make_external_tensor_expr(element, ndim, argument, False, 0, core.BoundaryMode.UNSAFE)
    )


def load(argument: Any, dtype: Any, whole: bool = True) -> Expr:
    """Return the expression of a scalar argument, or of the place of a structure."""
    return Expr(
        core.make_arg_load_expr(argument, dtype, False, create_load=whole, arg_depth=0, dbg_info=_NOWHERE)
    )


def declared_matrix(kind: MatrixType, name: str) -> Any:
    """Add a vector argument to the kernel that is traced."""
    return kernel_arguments.decl_matrix_arg(kind, name, 0)


def declared_scalar(dtype: Any, name: str) -> Any:
    """Add a scalar argument to the kernel that is traced."""
    return kernel_arguments.decl_scalar_arg(dtype, name, 0)


def argument_index(n: int) -> Any:
    """Return the index of the n-th argument in a launch context."""
    return (n,)


def compile_kernel(program: Any, kernel: Any) -> Any:
    """Return the compiled form of a kernel."""
    return program.compile_kernel(program.config(), program.get_device_caps(), kernel)


def launch_context(kernel: Any) -> Any:
    """Return a new context of launches of a kernel of the library's core."""
    return kernel.make_launch_context()
