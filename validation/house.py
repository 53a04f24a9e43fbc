"""Structure of two checkouts of this repository side by side, as a Markdown table: files, lines, types, tests.

    python -m taichi_plume.validation.house OLD NEW [--no-cases]

The source is read, not imported: files per folder, lines of code, docstrings and comments, the longest file and
function, `isinstance` on models outside their own module, `getattr` and `hasattr`, and the word `Any`. Test cases are
those that pytest collects in each checkout; --no-cases leaves them out.
"""

import ast
import io
import os
import re
import subprocess
import sys
import tokenize
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from taichi_plume.guard.terminal import Parser, say

PACKAGE = ("taichi_plume", "solvers", "agents")
FOLDERS = (*PACKAGE, "validation")
MODEL = "Model"  # base class of every section of the vocabulary
LAYOUT = (tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER)
Function = ast.FunctionDef | ast.AsyncFunctionDef


@dataclass
class Module:
    """Python file of a checkout: path, text and syntax tree."""

    path: str
    text: str
    tree: ast.Module

    @property
    def lines(self) -> int:
        """Number of lines of the file."""
        return len(self.text.splitlines())

    @property
    def folder(self) -> str:
        """Folder of the file within the checkout."""
        return self.path.rpartition("/")[0]

    @property
    def functions(self) -> Iterator[tuple[int, str]]:
        """Yield number of lines and name of every function in the file, nested functions included."""
        for node in ast.walk(self.tree):
            if isinstance(node, Function):
                yield (node.end_lineno or node.lineno) - node.lineno + 1, f"{node.name} ({self.path})"


def modules(root: Path, folders: Sequence[str]) -> list[Module]:
    """Return the Python files in these folders of a checkout."""
    paths = sorted(path for folder in folders for path in (root / folder).rglob("*.py"))
    texts = [(path.relative_to(root).as_posix(), path.read_text(encoding="utf-8")) for path in paths]
    return [Module(path, text, ast.parse(text)) for path, text in texts]


def kinds_of_lines(module: Module) -> tuple[int, int, int]:
    """Return the numbers of lines of code, of docstrings, and of comments; a line with code counts as code."""
    docstrings: set[int] = set()
    for node in ast.walk(module.tree):
        if (
            isinstance(node, ast.Expr)
            and isinstance(node.value, ast.Constant)
            and isinstance(node.value.value, str)
        ):
            docstrings |= set(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    code, comments = set(), set()
    for token in tokenize.generate_tokens(io.StringIO(module.text).readline):
        lines = range(token.start[0], token.end[0] + 1)
        if token.type == tokenize.COMMENT:
            comments |= set(lines)
        elif token.type not in LAYOUT:
            code |= set(lines)
    code -= docstrings
    return len(code), len(docstrings), len(comments - code - docstrings)


def names(node: ast.AST) -> set[str]:
    """Return the last parts of all names in an expression, such as `b` for `a.b`."""
    parts = (part for part in ast.walk(node) if isinstance(part, ast.Attribute | ast.Name))
    return {part.attr if isinstance(part, ast.Attribute) else part.id for part in parts}


def models(source: Sequence[Module]) -> dict[str, str]:
    """Return the classes that derive from `Model`, directly or indirectly, with the file of each."""
    classes: dict[str, str] = {}
    while True:
        before = len(classes)
        for module in source:
            for node in ast.walk(module.tree):
                if isinstance(node, ast.ClassDef) and node.name not in classes:
                    bases = set().union(*(names(base) for base in node.bases))
                    if bases & ({MODEL} | classes.keys()):
                        classes[node.name] = module.path
        if len(classes) == before:
            return classes


def calls(module: Module, function: str) -> list[ast.Call]:
    """Return all calls in a module of a function by its bare name."""
    nodes = (node for node in ast.walk(module.tree) if isinstance(node, ast.Call))
    return [call for call in nodes if isinstance(call.func, ast.Name) and call.func.id == function]


def foreign_kinds(module: Module, known: dict[str, str]) -> int:
    """Return how many isinstance calls and match patterns of a module name a model of another module."""
    asked = [names(call.args[1]) for call in calls(module, "isinstance") if len(call.args) > 1]
    asked += [names(node.cls) for node in ast.walk(module.tree) if isinstance(node, ast.MatchClass)]
    return sum(any(known.get(name, module.path) != module.path for name in kinds) for kinds in asked)


def counted(root: Path, cases: bool = True) -> dict[str, object]:
    """Return the rows of the table for a checkout, by title; cases: whether to collect test cases."""
    source, tests = modules(root, FOLDERS), modules(root, ("tests",))
    known = models(source)
    package = [module for module in source if module.path.startswith(PACKAGE)]
    files = Counter(module.folder for module in source)
    code, docstrings, comments = (
        (sum(column) for column in zip(*map(kinds_of_lines, package), strict=True)) if package else (0, 0, 0)
    )

    def size(part: Sequence[Module]) -> str:
        return f"{len(part)}, {sum(module.lines for module in part):,}"

    def longest(part: Sequence[Module]) -> str:
        return "{} {}".format(*max(((module.lines, module.path) for module in part), default=(0, "-")))

    functions = [function for module in source for function in module.functions]
    any_names = [node for module in source for node in ast.walk(module.tree) if isinstance(node, ast.Name)]
    probes = [sum(len(calls(module, name)) for module in source) for name in ("getattr", "hasattr")]
    test_functions = [name for module in tests for _, name in module.functions if name.startswith("test_")]
    return {
        **{f"{name}/: files, lines": size([m for m in source if m.folder == name]) for name in sorted(files)},
        "all: files, lines": size(source),
        "without validation: files, lines": size(package),
        "without validation: lines of code": code,
        "of docstrings": docstrings,
        "of comments alone": comments,
        "longest file": longest(source),
        "longest function": "{} {}".format(*max(functions, default=(0, "-"))),
        "models of the vocabulary": len(known),
        "isinstance on models outside their module": sum(foreign_kinds(module, known) for module in source),
        "getattr, hasattr": f"{probes[0]}, {probes[1]}",
        "Any": sum(node.id == "Any" for node in any_names),
        "test files, lines": size(tests),
        "test functions": len(test_functions),
        "test cases": collected(root) if cases else "-",
        "longest test file": longest(tests),
    }


def collected(root: Path) -> int:
    """Return the number of cases that pytest collects in a checkout. Raises RuntimeError if it fails."""
    options = ["-m", "pytest", "--collect-only", "-q", "-o", "addopts=", "-p", "no:cacheprovider"]
    environment = os.environ | {"PYTHONPATH": str(root.resolve())}
    run = partial(subprocess.run, capture_output=True, text=True, check=False)
    done = run([sys.executable, *options], cwd=root, env=environment)
    match = re.search(r"^(\d+) tests? collected", done.stdout, re.MULTILINE)
    if match is None:
        raise RuntimeError(f"{root}: {done.stdout[-2000:]}{done.stderr[-2000:]}")
    return int(match[1])


def table(old: dict[str, object], new: dict[str, object]) -> list[str]:
    """Return the lines of a Markdown table of both checkouts' rows; rows of removed folders come first."""
    gone = [title for title in old if title not in new]
    rows = [(title, old.get(title, "0, 0"), new.get(title, "0, 0")) for title in (*gone, *new)]
    cells = [[f"{cell:,}" if isinstance(cell, int) else str(cell) for cell in row] for row in rows]
    return [f"| {' | '.join(row)} |" for row in [["", "old", "new"], ["---", "---:", "---:"], *cells]]


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table for these command-line arguments and return the exit code."""
    parser = Parser(prog="python -m taichi_plume.validation.house", description=__doc__)
    parser.add_argument("checkouts", nargs=2, type=Path, metavar="FOLDER")
    parser.add_argument("--no-cases", action="store_true", help="do not collect the tests")
    args = parser.parse_args(argv)
    say(*table(*(counted(root, not args.no_cases) for root in args.checkouts)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
