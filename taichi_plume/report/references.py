"""The papers behind what a run used: what the docstrings of the modules that computed it cite.

Nothing is imported for it: the tables of kinds are read as text, and so are the modules that they name.
"""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from taichi_plume import __path__ as package_folders
from taichi_plume.scenario.scenario import Scenario

TABLES = (("assembly/kinds.py", "solvers"), ("agents/search.py", "agents"), ("agents/mapping.py", "agents"))
"""Files with tables of kinds, and the folders in which the modules are that these name."""
YEAR = re.compile(r"\b(1[89]|20)\d\d\b")
ENDS = re.compile(r"(?<!Trans)(?<!al)(?<!eq)\.\s+(?=[A-Z]|[a-z]:)")  # of sentences, not of abbreviations


def papers(scenario: Scenario) -> list[tuple[str, list[str]]]:
    """What of a run rests on papers, with what its module says of them; each sentence once."""
    said: set[str] = set()
    told = []
    for name, table, kind in _used(scenario):
        lines = [line for line in _cited(table, kind) if line not in said]
        said.update(lines)
        if lines:
            told.append((name, lines))
    return told


def _used(scenario: Scenario) -> Iterator[tuple[str, int, str]]:
    """Name for people, number of the table and kind of each part of a scenario; a kind once."""
    wanted = [
        (f"search algorithm {group.algorithm.kind}", 1, group.algorithm.kind) for group in scenario.robots
    ]
    wanted += [(f"gas map {one.kind}", 2, one.kind) for one in scenario.maps]
    wanted += [(f"gas {gas.kind}", 0, gas.kind) for _, gas in scenario.gases]
    wanted.append((f"wind {scenario.wind.kind}", 0, scenario.wind.kind))
    yield from dict.fromkeys((name.replace("_", " "), table, kind) for name, table, kind in wanted)


@cache
def _cited(table: int, kind: str) -> list[str]:
    """Sentences with a year in the docstrings of the modules behind a kind, and in those that these refer to."""
    file, folder = TABLES[table]
    lines: list[str] = []
    for module in _modules(_source(file), kind):
        text = _docstring(_source(f"{folder}/{module}.py"))
        found = _sentences(text)
        for other in re.findall(r"`(\w+)`", text) if not found else ():
            found += _sentences(_docstring(_source(f"{folder}/{other}.py")))
        lines += [line for line in found if line not in lines]
    return lines


def _sentences(text: str) -> list[str]:
    """Those that name a year, with the formulas between them left out."""
    found = []
    for block in re.split(r"\n\s*\n", text):
        if YEAR.search(block) and not block.startswith("    "):
            for sentence in ENDS.split(" ".join(block.split())):
                if YEAR.search(sentence or ""):
                    found.append(sentence.rstrip(". ") + ".")
    return found


def _source(name: str) -> Path:
    """Return the path of a source file of the package, which lies in several folders in a checkout."""
    paths = [Path(folder) / name for folder in package_folders]
    return next((path for path in paths if path.exists()), paths[0])


def _docstring(file: Path) -> str:
    try:
        return ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or ""
    except (OSError, ValueError, SyntaxError):
        return ""


def _modules(file: Path, kind: str) -> list[str]:
    """The modules that a table of kinds names for a kind."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    imported = {
        alias.asname or alias.name: (node.module or "").rpartition(".")[2]
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    functions = {node.name: node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}
    found: list[str] = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Dict):
            for key, value in zip(node.keys, node.values, strict=True):
                if isinstance(key, ast.Constant) and key.value == kind:
                    found += _named(value, imported, functions)
    return list(dict.fromkeys(found))


def _named(value: ast.AST, imported: dict[str, str], functions: dict[str, ast.FunctionDef]) -> list[str]:
    """Modules of an entry: of the class itself, or of those that its function asks `_of` for."""
    found = []
    for node in ast.walk(value):
        if isinstance(node, ast.Name) and node.id in functions and node is value:
            found += _named(functions[node.id], imported, {})
        elif isinstance(node, ast.Name) and node is value and node.id in imported:
            found.append(imported[node.id])
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "_of":
            found += [one.value for one in node.args[:1] if isinstance(one, ast.Constant)]
    return found
