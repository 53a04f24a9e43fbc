"""Loader of user-written code in a Python file, found by parsing, executed only on request: the class of a search
algorithm, the function of a law of gas or wind.
"""

import ast
import hashlib
import inspect
import sys
import traceback
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from itertools import count
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar, Protocol, runtime_checkable

from taichi_plume.guard.safe_open import content_of
from taichi_plume.guard.terminal import visible

LARGEST_FILE = 1 << 16  # bytes: Python takes minutes to parse some texts of half a megabyte
UNPARSED = (SyntaxError, ValueError, RecursionError, MemoryError)  # bad syntax, deep nesting, no text


@runtime_checkable
class Acts(Protocol):
    """Interface of a user-written robot algorithm: a class with the method `act`."""

    def act(self, robots: Any) -> None:
        """Compute the commands of the robots from their readings."""
        ...


Permission = bool | Collection[str]
"""Permission to execute Python files: all or none, or only those with one of these SHA-256."""
Code = type | Callable[..., Any]
"""Class of a user's algorithm, or function of a user's law."""
CLASSES: dict[str, Code] = {}
"""Classes of users' algorithms and functions of users' laws that Python code has passed, by name."""
NO_CLASS = (
    "no class or function was given; name a Python file with file: FILE.py (from Python: taichi_plume.Own)"
)
"""Error of a section that names no file, and nothing of `CLASSES` that fits."""


def register(algorithm: Code) -> str:
    """Put code into `CLASSES` and return its name there: of two classes of one name, the second is NAME_2."""
    names = (f"{algorithm.__name__}_{n}" if n > 1 else algorithm.__name__ for n in count(1))
    return next(name for name in names if CLASSES.setdefault(name, algorithm) is algorithm)


def file_of(algorithm: Code) -> Path:
    """Return the file of a class or function or, if typed into an interpreter or notebook, the name of that input."""
    code = getattr(inspect.unwrap(getattr(algorithm, "__dict__", {}).get("act", algorithm)), "__code__", None)
    if code is not None:
        return Path(code.co_filename)
    try:
        return Path(inspect.getsourcefile(algorithm) or "?")
    except (OSError, TypeError):
        return Path("?")


class OwnAlgorithmError(RuntimeError):
    """Error: the user's code failed or cannot be loaded; the message names the file and, if known, the line."""


@dataclass(frozen=True)
class OwnFile:
    """Python file with a user-written robot algorithm. name: of the class, None for the only one.

    Raises OwnAlgorithmError if the file cannot be read, is not Python, or certainly lacks the class.
    """

    STATEMENT: ClassVar[type[ast.ClassDef | ast.FunctionDef]] = ast.ClassDef
    MISSING: ClassVar[str] = "no class '{}' with a method act"

    path: Path
    name: str | None
    source: bytes

    @classmethod
    def read(cls, path: Path, name: str | None) -> "OwnFile":
        """Read and parse the user's Python file without executing it."""
        if path.suffix != ".py":
            raise OwnAlgorithmError(f"{path}: is no Python file; its name must end in .py")
        file = cls(path, name, content_of(path, LARGEST_FILE, OwnAlgorithmError))
        file._look()
        return file

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the user's file."""
        return hashlib.sha256(self.source).hexdigest()

    def is_allowed(self, allow: Permission) -> bool:
        """Return whether a permission includes the user's file."""
        return allow if isinstance(allow, bool) else self.digest in allow

    def _look(self) -> None:
        """Raise OwnAlgorithmError if the file is no Python, or its top level certainly lacks the code."""
        try:
            tree = ast.parse(self.source, str(self.path))
        except UNPARSED as error:
            line, what = (error.lineno, error.msg) if isinstance(error, SyntaxError) else (None, str(error))
            where = f"{self.path}, line {line}" if line else f"{self.path}"
            raise OwnAlgorithmError(f"{where}: {visible(what or 'is nested too deeply')}") from None
        statements = list(_at_top(tree))
        if not self._may_hold(statements):
            raise self._without([each.name for each in statements if isinstance(each, self.STATEMENT)])

    def _may_hold(self, statements: list[ast.AST]) -> bool:
        """Return whether one of the statements at the top of the file may define the code."""
        classes = [each for each in statements if isinstance(each, ast.ClassDef)]
        sure = [each.name for each in classes if _acts(each)]
        maybe = [each.name for each in classes if each.bases or each.decorator_list or each.name in sure]
        return self.name in maybe if self.name else bool(maybe) and len(sure) < 2

    def execute(self) -> Code:
        """Execute the user's file, with all rights of the user, and return the code that it defines."""
        module = ModuleType(f"own_algorithm_{self.path.stem}_{self.digest[:8]}")
        module.__file__ = str(self.path)
        sys.modules[module.__name__] = module  # for `inspect` and `dataclass`
        with failures_named(self.path):
            exec(compile(self.source, str(self.path), "exec", dont_inherit=True), module.__dict__)
        found = {name: value for name, value in vars(module).items() if self._is_code(value, module.__name__)}
        name = self.name or (next(iter(found)) if len(found) == 1 else "")
        if name not in found:
            raise self._without(list(found))
        return found[name]

    def _is_code(self, value: object, module: str) -> bool:
        return isinstance(value, type) and value.__module__ == module and issubclass(value, Acts)

    def _without(self, there: list[str]) -> OwnAlgorithmError:
        missing = (
            self.MISSING.format(visible(self.name, 100))
            if self.name
            else "not exactly one class with a method act"
        )
        names = visible(", ".join(there) or "none", 400)
        return OwnAlgorithmError(f"{self.path}: holds {missing}; there are: {names}")


class LawFile(OwnFile):
    """Python file with a user-written law of gas or wind: the function called `name`."""

    STATEMENT, MISSING = ast.FunctionDef, "no function '{}'"

    def _may_hold(self, statements: list[ast.AST]) -> bool:
        names = [each.name for each in statements if isinstance(each, ast.FunctionDef | ast.ClassDef)]
        for each in statements:
            if isinstance(each, ast.Assign | ast.AnnAssign):
                names += [name.id for name in ast.walk(each) if isinstance(name, ast.Name)]
            elif isinstance(each, ast.Import | ast.ImportFrom):
                names += [alias.asname or alias.name for alias in each.names]
        return self.name in names or "*" in names

    def _is_code(self, value: object, module: str) -> bool:
        return callable(value) and not isinstance(value, type)


def _at_top(node: ast.AST) -> Iterator[ast.AST]:
    """Yield the top-level statements of a parsed module, also those within `if`, `try` and `with`."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.stmt):
            yield child
        if not isinstance(child, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef | ast.expr):
            yield from _at_top(child)


def _acts(node: ast.ClassDef) -> bool:
    """Return whether a parsed class itself defines `act`, as a function or by assignment."""
    names = [each.name for each in node.body if isinstance(each, ast.FunctionDef)]
    targets = [target for each in node.body if isinstance(each, ast.Assign) for target in each.targets]
    return "act" in (*names, *(target.id for target in targets if isinstance(target, ast.Name)))


@contextmanager
def failures_named(path: Path) -> Iterator[None]:
    """Context that raises errors of the user's file, also SystemExit, as OwnAlgorithmError; Ctrl-C passes."""
    try:
        yield
    except (OwnAlgorithmError, KeyboardInterrupt):
        raise
    except BaseException as error:
        raise OwnAlgorithmError(_one_line(error, path)) from error


def _one_line(error: BaseException, path: Path) -> str:
    """Return the error in one line of text, with file and line number in the user's file."""
    frames = traceback.extract_tb(error.__traceback__)
    lines = [frame.lineno for frame in frames if Path(frame.filename).name == path.name]
    where = f"{path}, line {lines[-1]}" if lines else f"{path}"
    try:
        message = " ".join(str(error).split())
    except BaseException:  # __str__ may be the user's
        message = "its message cannot be made"
    return visible(f"{where}: {type(error).__name__}: {message}")
