"""A class from a Python file of the user's: found without running anything, and executed only where that is wanted."""

import ast
import dis
import hashlib
import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import ModuleType
from typing import Any, Protocol, runtime_checkable

from taichi_plume.guard.opening import read_regular
from taichi_plume.guard.terminal import visible

LARGEST_FILE = 1 << 16  # bytes: Python takes minutes to parse some texts of half a megabyte
UNPARSED = (SyntaxError, ValueError, RecursionError, MemoryError)  # too deep, or not text


@runtime_checkable
class Acts(Protocol):
    """What a class of the user's has to have."""

    def act(self, robots: Any) -> None:
        """Turn readings into commands."""
        ...


class OwnAlgorithmError(RuntimeError):
    """The user's algorithm failed; says in which file and line."""


def content_of(path: Path, most: int, largest: str) -> bytes:
    """The content of a file of the user's, of at most so many bytes; largest: the same in words, and a question.

    Raises OwnAlgorithmError where it cannot be read.
    """
    try:
        content = read_regular(path, most)
    except FileNotFoundError:
        raise OwnAlgorithmError(f"{path}: does not exist") from None
    except OSError as error:
        raise OwnAlgorithmError(f"{path}: cannot be read: {error.strerror or error}") from None
    if content is None:
        raise OwnAlgorithmError(f"{path}: is larger than {largest}")
    return content


@dataclass(frozen=True)
class OwnFile:
    """A Python file that holds an algorithm, as it was when it was looked at. name: of its class, unless the only one.

    Raises OwnAlgorithmError where it cannot be read, is no Python, or where the class is certainly missing.
    """

    path: Path
    name: str | None
    source: bytes

    @classmethod
    def read(cls, path: Path, name: str | None) -> "OwnFile":
        """Read and parse the file; nothing in it is executed."""
        if path.suffix != ".py":
            raise OwnAlgorithmError(f"{path}: is no Python file; its name must end in .py")
        largest = f"{LARGEST_FILE >> 10} KiB; is it an algorithm?"
        found = cls(path, name, content_of(path, LARGEST_FILE, largest))
        found._look()
        return found

    @cached_property
    def digest(self) -> str:
        """The SHA-256 of the file."""
        return hashlib.sha256(self.source).hexdigest()

    def _look(self) -> None:
        """Whether the text holds the class. What a base class brings only its execution tells."""
        try:
            tree = ast.parse(self.source, str(self.path))
        except UNPARSED as error:
            line = getattr(error, "lineno", None)
            where = f"{self.path}, line {line}" if line else f"{self.path}"
            what = getattr(error, "msg", None) or str(error) or "is nested too deeply"
            raise OwnAlgorithmError(f"{where}: {visible(what)}") from None
        classes = {node.name: node for node in _at_top(tree) if isinstance(node, ast.ClassDef)}
        sure = [name for name, node in classes.items() if _acts(node)]
        maybe = [name for name, node in classes.items() if node.bases or node.decorator_list or name in sure]
        if self.name is None:
            wrong = not maybe or len(sure) > 1
        else:
            wrong = self.name not in maybe
        if wrong:
            raise self._without(sure)

    def execute(self) -> type:
        """The class: what was looked at is executed, with all rights of the user."""
        module = ModuleType(f"own_algorithm_{self.path.stem}_{self.digest[:8]}")
        module.__file__ = str(self.path)
        sys.modules[module.__name__] = module  # where `inspect` and `dataclass` look for it
        with failures_told(self.path):
            exec(compile(self.source, str(self.path), "exec", dont_inherit=True), module.__dict__)
        own = {
            key: value
            for key, value in vars(module).items()
            if isinstance(value, type) and value.__module__ == module.__name__ and issubclass(value, Acts)
        }
        if self.name is not None and self.name in own:
            return own[self.name]
        if self.name is None and len(own) == 1:
            return next(iter(own.values()))
        raise self._without(list(own))

    def _without(self, there: list[str]) -> OwnAlgorithmError:
        wanted = f"no class '{visible(self.name, 100)}'" if self.name else "not exactly one class"
        names = visible(", ".join(there) or "none", 400)
        return OwnAlgorithmError(f"{self.path}: holds {wanted} with a method act; there are: {names}")


def _at_top(node: ast.AST) -> Iterator[ast.AST]:
    """The statements of a module, also within its `if`, `try` and `with`."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.stmt):
            yield child
        if not isinstance(child, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef | ast.expr):
            yield from _at_top(child)


def _acts(node: ast.ClassDef) -> bool:
    """Whether the text of a class gives it an `act`."""
    named = {one.name for one in node.body if isinstance(one, ast.FunctionDef)}
    assigned = {
        target.id
        for one in node.body
        if isinstance(one, ast.Assign)
        for target in one.targets
        if isinstance(target, ast.Name)
    }
    return "act" in named | assigned


# ---------------------------------------------------------------- failures


@contextmanager
def failures_told(path: Path) -> Iterator[None]:
    """Whatever code of that file raises, SystemExit too, leaves as an OwnAlgorithmError; a user's Ctrl-C stays one."""
    try:
        yield
    except OwnAlgorithmError:
        raise
    except BaseException as error:
        if isinstance(error, Exception | SystemExit | GeneratorExit) or _raised_in(error, path):
            raise OwnAlgorithmError(told(error, path)) from error
        raise


def _raised_in(error: BaseException, path: Path) -> bool:
    """Whether a `raise` of that file brought the error up: a signal never comes up there."""
    last = error.__traceback__
    while last is not None and last.tb_next is not None:
        last = last.tb_next
    if last is None:
        return False
    code = last.tb_frame.f_code
    return (
        Path(code.co_filename).name == path.name
        and dis.opname[code.co_code[last.tb_lasti]] == "RAISE_VARARGS"
    )


def told(error: BaseException, path: Path) -> str:
    """The error in one line, with the place in the user's file where it came up."""
    lines = [
        one.lineno
        for one in traceback.extract_tb(error.__traceback__)
        if Path(one.filename).name == path.name
    ]
    where = f"{path}, line {lines[-1]}" if lines else f"{path}"
    try:
        message = " ".join(str(error).split())
    except BaseException:  # it is the user's too
        message = "its message cannot be made"
    return visible(f"{where}: {type(error).__name__}: {message}")
