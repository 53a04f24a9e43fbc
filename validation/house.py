"""Two checkouts of this repository side by side, as a Markdown table: how their source is built.

    python -m taichi_plume.validation.house OLD NEW [--no-cases]

It reads the source and does not import it: files per folder, lines of code, docstrings and comments, the longest file
and function, `isinstance` on models outside their own module, `getattr` and `hasattr`, and the word `Any`. Cases of
tests are those that pytest collects in each checkout, which --no-cases leaves out.
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
from dataclasses import dataclass, field
from pathlib import Path

from taichi_plume.guard.terminal import Parser, say

PACKAGE = ("taichi_plume", "solvers", "agents")
FOLDERS = (*PACKAGE, "validation")
MODEL = "Model"  # what every section of the vocabulary derives from
Function = ast.FunctionDef | ast.AsyncFunctionDef


@dataclass
class Module:
    """A file: its path in the checkout, text and syntax tree."""

    path: str
    text: str
    tree: ast.Module

    @property
    def lines(self) -> int:
        """How many lines it has."""
        return len(self.text.splitlines())

    @property
    def functions(self) -> Iterator[tuple[int, str]]:
        """Lines and name of every function, with those inside of others."""
        for node in ast.walk(self.tree):
            if isinstance(node, Function):
                yield (node.end_lineno or node.lineno) - node.lineno + 1, f"{node.name} ({self.path})"


@dataclass
class House:
    """What is counted of a checkout."""

    files: Counter[str] = field(default_factory=Counter)
    lines: Counter[str] = field(default_factory=Counter)
    code: int = 0  # of the package, without validation, as the two that follow
    docstrings: int = 0
    comments: int = 0
    longest_file: tuple[int, str] = (0, "-")
    longest_function: tuple[int, str] = (0, "-")
    models: int = 0
    isinstance_on_models: int = 0
    probes: Counter[str] = field(default_factory=Counter)
    any: int = 0
    test_files: int = 0
    test_lines: int = 0
    longest_test: tuple[int, str] = (0, "-")
    test_functions: int = 0
    test_cases: int | None = None


def modules(root: Path, folders: Sequence[str]) -> list[Module]:
    """Return the Python files of these folders."""
    found = []
    for folder in folders:
        for place, names, files in os.walk(root / folder):
            names.sort()
            for path in (Path(place) / name for name in sorted(files) if name.endswith(".py")):
                text = path.read_text(encoding="utf-8")
                found.append(Module(path.relative_to(root).as_posix(), text, ast.parse(text)))
    return found


def kinds_of_lines(module: Module) -> tuple[int, int, int]:
    """Lines of code, of docstrings, and of comments alone; a line with code counts as code."""
    docstrings: set[int] = set()
    for node in ast.walk(module.tree):
        if (
            isinstance(node, ast.Expr)
            and isinstance(node.value, ast.Constant)
            and isinstance(node.value.value, str)
        ):
            docstrings |= set(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    code, comments = set(), set()
    layout = (tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER)
    for token in tokenize.generate_tokens(io.StringIO(module.text).readline):
        lines = range(token.start[0], token.end[0] + 1)
        if token.type == tokenize.COMMENT:
            comments |= set(lines)
        elif token.type not in layout:
            code |= set(lines)
    code -= docstrings
    return len(code), len(docstrings), len(comments - code - docstrings)


def names(node: ast.AST) -> set[str]:
    """The last parts of all names in an expression: `b` of `a.b`."""
    return {part.attr if isinstance(part, ast.Attribute) else part.id
            for part in ast.walk(node) if isinstance(part, ast.Attribute | ast.Name)}  # fmt: skip


def models(source: Sequence[Module]) -> dict[str, str]:
    """The classes that derive from `Model`, itself or through others, and the file of each."""
    found: dict[str, str] = {}
    while True:
        before = len(found)
        for module in source:
            for node in ast.walk(module.tree):
                if isinstance(node, ast.ClassDef) and node.name not in found:
                    bases = set().union(*(names(base) for base in node.bases))
                    if bases & ({MODEL} | found.keys()):
                        found[node.name] = module.path
        if len(found) == before:
            return found


def calls(tree: ast.Module, function: str) -> Iterator[ast.Call]:
    """Calls of a function by its bare name."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == function:
            yield node


def asked_kinds(tree: ast.Module) -> Iterator[set[str]]:
    """The classes that each isinstance, and each pattern of a match, asks for."""
    for call in calls(tree, "isinstance"):
        yield names(call.args[1]) if len(call.args) > 1 else set()
    for node in ast.walk(tree):
        if isinstance(node, ast.MatchClass):
            yield names(node.cls)


def counted(root: Path, cases: bool = True) -> House:
    """Everything of a checkout."""
    house = House()
    source = modules(root, FOLDERS)
    known = models(source)
    house.models = len(known)
    for module in source:
        folder = module.path.rpartition("/")[0]
        house.files[folder] += 1
        house.lines[folder] += module.lines
        if folder.startswith(PACKAGE):
            code, docstrings, comments = kinds_of_lines(module)
            house.code += code
            house.docstrings += docstrings
            house.comments += comments
        house.longest_file = max(house.longest_file, (module.lines, module.path))
        house.longest_function = max(house.longest_function, *module.functions, (0, "-"))
        for kinds in asked_kinds(module.tree):
            house.isinstance_on_models += any(known.get(name, module.path) != module.path for name in kinds)
        for name in ("getattr", "hasattr"):
            house.probes[name] += sum(1 for _ in calls(module.tree, name))
        house.any += sum(isinstance(node, ast.Name) and node.id == "Any" for node in ast.walk(module.tree))
    tests = modules(root, ("tests",))
    house.test_files = len(tests)
    house.test_lines = sum(module.lines for module in tests)
    house.longest_test = max(((module.lines, module.path) for module in tests), default=(0, "-"))
    house.test_functions = sum(name.startswith("test_") for module in tests for _, name in module.functions)
    if cases:
        house.test_cases = collected(root)
    return house


def collected(root: Path) -> int:
    """How many cases pytest collects in a checkout. Raises RuntimeError where it cannot."""
    command = [
        sys.executable,
        "-m",
        "pytest",
        "--collect-only",
        "-q",
        "-o",
        "addopts=",
        "-p",
        "no:cacheprovider",
    ]
    environment = os.environ | {"PYTHONPATH": str(root.resolve())}
    done = subprocess.run(command, cwd=root, env=environment, capture_output=True, text=True, check=False)
    found = re.search(r"^(\d+) tests? collected", done.stdout, re.MULTILINE)
    if found is None:
        raise RuntimeError(f"{root}: {done.stdout[-2000:]}{done.stderr[-2000:]}")
    return int(found[1])


def of(counts: Counter[str], folders: Sequence[str]) -> int:
    """What is counted in these folders and those below."""
    return sum(count for folder, count in counts.items() if folder.split("/")[0] in folders)


def table(old: House, new: House) -> list[str]:
    """Return the lines of a Markdown table of both."""
    rows: list[tuple[str, str, str]] = []

    def row(name: str, *values: object) -> None:
        told = [
            "-" if value is None else f"{value:,}" if isinstance(value, int) else str(value)
            for value in values
        ]
        rows.append((name, told[0], told[1]))

    both = (old, new)
    for folder in sorted(old.files.keys() | new.files.keys()):
        row(f"{folder}/: files, lines", *(f"{h.files[folder]}, {h.lines[folder]:,}" for h in both))
    for part, folders in (("all", FOLDERS), ("without validation", PACKAGE)):
        row(f"{part}: files, lines", *(f"{of(h.files, folders)}, {of(h.lines, folders):,}" for h in both))
    row("without validation: lines of code", *(h.code for h in both))
    row("of docstrings", *(h.docstrings for h in both))
    row("of comments alone", *(h.comments for h in both))
    row("longest file", *("{} {}".format(*h.longest_file) for h in both))
    row("longest function", *("{} {}".format(*h.longest_function) for h in both))
    row("models of the vocabulary", *(h.models for h in both))
    row("isinstance on models outside their module", *(h.isinstance_on_models for h in both))
    row("getattr, hasattr", *("{getattr}, {hasattr}".format(**h.probes) for h in both))
    row("Any", *(h.any for h in both))
    row("test files, lines", *(f"{h.test_files}, {h.test_lines:,}" for h in both))
    row("test functions", *(h.test_functions for h in both))
    row("test cases", *(h.test_cases for h in both))
    row("longest test file", *("{} {}".format(*h.longest_test) for h in both))
    head = [("", "old", "new"), ("---", "---:", "---:")]
    return [f"| {' | '.join(cells)} |" for cells in head + rows]


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv` and return its exit code."""
    parser = Parser(prog="python -m taichi_plume.validation.house", description=__doc__)
    parser.add_argument("checkouts", nargs=2, type=Path, metavar="FOLDER")
    parser.add_argument("--no-cases", action="store_true", help="do not collect the tests")
    args = parser.parse_args(argv)
    say(*table(*(counted(root, not args.no_cases) for root in args.checkouts)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
