"""Faster tracing of Taichi's kernels, the longest part of a start with compiled kernels on disk.

Taichi 1.7, the last release, collects data for error messages: at each call of a function its source, and for each node
of a kernel the position in the source. Here sources are read once and positions are file and line.

A function of Taichi is replaced only if its parameters are as expected. The traced code is the same, so that the cache
of compiled kernels stays valid.
"""

import ast
import linecache
import sys
import textwrap
from collections.abc import Callable
from functools import cache
from types import CodeType, FunctionType, SimpleNamespace
from typing import Any, TypeVar

from taichi_plume.engine.library import (
    POSITION,
    SOURCE_READERS,
    TEXT_WRAPPER,
    Builder,
    impl,
    kernel_impl,
    node_built,
)

Read = TypeVar("Read")


def replace(owner: object, name: str, parameters: tuple[str, ...], other: Callable) -> bool:
    """Replace the attribute `name` of `owner` by `other` if it is a function with these parameters; return whether."""
    old = vars(owner).get(name)
    if not isinstance(old, FunctionType):
        return False
    if old.__code__.co_varnames[: old.__code__.co_argcount] != parameters:
        return False
    setattr(owner, name, other)
    return True


# ---------------------------------------------------------------- sources


def once(read: Callable[[object], Read]) -> Callable[[object], Read]:
    """Return a caching version of `read`, which finds a function's source; functions of the same `def` share it."""
    known: dict[int, tuple[CodeType, Read]] = {}  # with the code object, so that its id is not reused

    def reading(function: object) -> Read:
        if type(function) is not FunctionType or "__wrapped__" in vars(function):
            return read(function)
        code = function.__code__
        if id(code) not in known:
            known[id(code)] = code, read(function)
        return known[id(code)][1]

    return reading


def inside_class(level_of_class_stackframe: int) -> bool:
    """Return whether the function being decorated is a method, by the source line of an outer stack frame."""
    try:
        frame = sys._getframe(level_of_class_stackframe)
    except ValueError:
        return False
    line = linecache.getline(frame.f_code.co_filename, frame.f_lineno, frame.f_globals).strip()
    return any(pattern.match(line) for pattern in kernel_impl._KERNEL_CLASS_STACKFRAME_STMT_RES)


# ---------------------------------------------------------------- positions


def position(self: Any, node: Any) -> str:
    """Return the text of the source position of an AST node for Taichi's messages: file, line number and line."""
    lines = vars(self).setdefault("line_texts", {})
    if node.lineno not in lines:
        text, line = self.src[node.lineno - 1].strip(), node.lineno + self.lineno_offset
        lines[node.lineno] = f'File "{self.file}", line {line}, in {self.func.func.__name__}:\n{text}\n'
    return lines[node.lineno]


# ---------------------------------------------------------------- nodes


class _Failing:
    """Stand-in for an AST builder whose methods raise the error of another builder."""

    def __init__(self, error: Exception):
        self.error = error

    def __getattr__(self, name: str) -> Callable:
        def fail(ctx: Any, node: ast.AST) -> None:
            raise self.error

        return fail


@cache
def _builder(builder: type, kind: type) -> tuple[Callable | None, bool]:
    """Return the method of an AST builder for nodes of a kind, and whether such nodes have a position in the source."""
    return getattr(builder, f"build_{kind.__name__}", None), issubclass(kind, ast.stmt | ast.expr)


def building(plain: Callable) -> Callable:
    """Return a faster function that builds an AST node; on an error it calls `plain`, which reports the error."""

    def build(self: object, ctx: Any, node: ast.AST) -> object:
        method, placed = _builder(type(self), type(node))
        if method is None:
            return plain(self, ctx, node)
        stack = impl.get_runtime().src_info_stack
        stack.append(position(ctx, node) if placed else "")
        try:
            result = method(ctx, node)
            if node_built is not None:
                node_built(node)
            return result
        except Exception as error:
            return plain(_Failing(error), ctx, node)
        finally:
            stack.pop()

    return build


def quicken() -> tuple[bool, ...]:
    """Replace the slow functions of Taichi; return for each whether it was replaced."""
    changes = [
        replace(owner, name, parameters, once(vars(owner)[name]))
        for owner, name, parameters in SOURCE_READERS
    ]
    if vars(TEXT_WRAPPER).get("textwrap") is textwrap:
        fill, dedent = cache(textwrap.fill), cache(textwrap.dedent)
        TEXT_WRAPPER.textwrap = SimpleNamespace(fill=fill, dedent=dedent)  # type: ignore[attr-defined]
        changes.append(True)
    changes.append(replace(kernel_impl, "_inside_class", ("level_of_class_stackframe",), inside_class))
    changes.append(replace(*POSITION, ("self", "node"), position))
    if hasattr(impl.get_runtime(), "src_info_stack"):
        plain = Builder.__call__
        changes.append(replace(Builder, "__call__", ("self", "ctx", "node"), building(plain)))
    return tuple(changes)


QUICKENED = quicken()
