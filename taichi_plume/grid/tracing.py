"""Taichi's tracing of kernels, made cheaper: of a start with compiled kernels on disk it is the longest part.

Taichi 1.7, the last of its line, reads a function's source anew for each place that calls it, works out for each node
of each kernel where in the source it stands, and for each field the whole stack that declares it, all for messages of
errors. Here sources are read once and places are told by file and line. Each change is made only where Taichi is as
expected; elsewhere it works as usual. What is traced is the same: the cache of compiled kernels is found by it.
"""

import ast
import linecache
import sys
import textwrap
from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import CodeType, FunctionType, SimpleNamespace
from typing import Any

import taichi as ti
from taichi.lang import impl, kernel_impl, matrix, snode
from taichi.lang.ast import ast_transformer_utils
from taichi.lang.ast.ast_transformer_utils import ASTTransformerContext, Builder

TAICHI = str(Path(ti.__file__).parent)


def replace(owner: Any, name: str, parameters: tuple[str, ...], other: Callable) -> bool:
    """Put another function in the place of one of Taichi's that has these parameters; whether it was as expected."""
    old = getattr(owner, name, None)
    code = getattr(old, "__code__", None)
    if code is None or code.co_varnames[: code.co_argcount] != parameters:
        return False
    setattr(owner, name, other)
    return True


# ---------------------------------------------------------------- sources


def once(read: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """`read` of a function's source, once for all functions that one `def` makes."""
    known: dict[int, tuple[CodeType, Any]] = {}  # with the code, so that its number is not given again

    def reading(function: Any) -> Any:
        if type(function) is not FunctionType or hasattr(function, "__wrapped__"):
            return read(function)
        code = function.__code__
        if id(code) not in known:
            known[id(code)] = code, read(function)
        return known[id(code)][1]

    return reading


def inside_class(level_of_class_stackframe: int) -> bool:
    """Whether the function that is being decorated is one of a class, by the line that the frame outside stands at."""
    try:
        frame = sys._getframe(level_of_class_stackframe)
    except ValueError:
        return False
    line = linecache.getline(frame.f_code.co_filename, frame.f_lineno, frame.f_globals).strip()
    return any(pattern.match(line) for pattern in kernel_impl._KERNEL_CLASS_STACKFRAME_STMT_RES)


# ---------------------------------------------------------------- places


def position(self: Any, node: Any) -> str:
    """File and line for Taichi's messages, and the line's text.

    Taichi itself also underlines the place.
    """
    lines = self.__dict__.setdefault("told", {})
    told = lines.get(node.lineno)
    if told is None:
        text, line = self.src[node.lineno - 1].strip(), node.lineno + self.lineno_offset
        told = lines[node.lineno] = (
            f'File "{self.file}", line {line}, in {self.func.func.__name__}:\n{text}\n'
        )
    return told


def declaration(stacklevel: int = 1) -> str:
    """The line that declares a field: the innermost that is not Taichi's."""
    frame = sys._getframe(1)
    while frame.f_back is not None and frame.f_code.co_filename.startswith(TAICHI):
        frame = frame.f_back
    return f'  File "{frame.f_code.co_filename}", line {frame.f_lineno}, in {frame.f_code.co_name}\n'


# ---------------------------------------------------------------- nodes


class _Failing:
    """A builder of nodes that fails as another one did."""

    def __init__(self, error: Exception):
        self.error = error

    def __getattr__(self, name: str) -> Callable:
        def fail(ctx: Any, node: Any) -> Any:
            raise self.error

        return fail


@cache
def _builder(builder: type, kind: type) -> tuple[Callable | None, bool]:
    """The function that builds nodes of a kind, and whether they have a place in the source."""
    return getattr(builder, f"build_{kind.__name__}", None), issubclass(kind, ast.stmt | ast.expr)


def building(plain: Callable) -> Callable:
    """What builds a node: as `plain` does, which still tells what is wrong with one."""

    def build(self: Any, ctx: Any, node: Any) -> Any:
        method, placed = _builder(type(self), type(node))
        if method is None:
            return plain(self, ctx, node)
        stack = impl.get_runtime().src_info_stack
        stack.append(ctx.get_pos_info(node) if placed else "")
        try:
            return method(ctx, node)
        except Exception as error:
            return plain(_Failing(error), ctx, node)
        finally:
            stack.pop()

    return build


def quicken() -> tuple[bool, ...]:
    """Make the changes; which of them were made."""
    places = ("getsourcelines", "getsourcefile")
    changes = [replace(kernel_impl, name, ("obj",), once(getattr(kernel_impl, name))) for name in places]
    if getattr(kernel_impl, "textwrap", None) is textwrap:
        fill, dedent = cache(textwrap.fill), cache(textwrap.dedent)
        kernel_impl.textwrap = SimpleNamespace(fill=fill, dedent=dedent)  # type: ignore[attr-defined]
        changes.append(True)
    changes.append(replace(kernel_impl, "_inside_class", ("level_of_class_stackframe",), inside_class))
    changes.append(replace(ASTTransformerContext, "get_pos_info", ("self", "node"), position))
    changes.extend(
        replace(one, "get_traceback", ("stacklevel",), declaration) for one in (impl, matrix, snode)
    )
    if ast_transformer_utils.impl is impl and hasattr(impl.PyTaichi(), "src_info_stack"):
        plain = Builder.__call__
        changes.append(replace(Builder, "__call__", ("self", "ctx", "node"), building(plain)))
    return tuple(changes)


QUICKENED = quicken()
