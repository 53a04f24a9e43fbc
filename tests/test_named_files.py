"""Python files that docstrings, comments and documents name exist, and hold the names that they are said to hold."""

import ast
import io
import re
import subprocess
import tokenize
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
FILE = re.compile(r"(?<![\w/{*<.-])((?:[\w.-]+/)*\w+\.py)\b(?!\w)")
DOTTED = re.compile(r"`(\w+)\.([A-Z]\w+)`")
HELD = re.compile(r"`(\w+)` (?:of|in) `?((?:[\w.-]+/)*\w+\.py)\b")


def tracked() -> list[str]:
    """Return the paths of the project's files; without git, of those beside this test."""
    try:
        command = ["git", "-C", str(ROOT), "ls-files"]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.split("\n")[:-1]
    except (OSError, subprocess.CalledProcessError):
        return [str(path.relative_to(ROOT)) for path in ROOT.rglob("*") if path.is_file()]


OTHERS = {"tp", "taichi_plume", "np", "pandas", "polars", "xarray", "rr", "ti", "zarr", "threading"}
"""Modules and short names of modules that hold names of other files or libraries."""
PATHS = tracked()
MODULES = [path for path in PATHS if path.endswith(".py")]
OF_USERS = re.compile(r"(?:caption|file): `?(\w+\.py)\b")
"""Python files of users, which documents show with a caption or a scenario names."""


def prose(path: str) -> Iterator[tuple[int, str]]:
    """Yield line and text of the docstrings and comments of a module, or of all text of a document."""
    text = (ROOT / path).read_text(encoding="utf-8")
    if not path.endswith(".py"):
        yield from enumerate(text.splitlines(), 1)
        return
    if not (FILE.search(text) or DOTTED.search(text)):
        return
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            yield token.start[0], token.string
    for node in ast.walk(ast.parse(text)):
        if (
            isinstance(node, ast.Expr)
            and isinstance(node.value, ast.Constant)
            and isinstance(node.value.value, str)
        ):
            yield node.lineno, node.value.value


def named(name: str) -> list[str]:
    """Return the project's modules that a name such as "grid/state.py" can mean."""
    end = f"/{name.removeprefix('taichi_plume/')}"
    return [path for path in MODULES if f"/{path}".endswith(end)]


def documents() -> list[str]:
    """Return the paths of documents that are checked: all but the changelog, which names files of the past."""
    kinds = (".md", ".yaml", ".toml", ".cff")
    return [
        path for path in PATHS if path.endswith(kinds) and path != "CHANGELOG.md" and (ROOT / path).is_file()
    ]


@cache
def of_users() -> set[str]:
    return {
        name for path in documents() for name in OF_USERS.findall((ROOT / path).read_text(encoding="utf-8"))
    }


def holds(paths: list[str], name: str) -> bool:
    """Return whether one of some modules has a name."""
    return any(re.search(rf"\b{name}\b", (ROOT / path).read_text(encoding="utf-8")) for path in paths)


def faults(path: str, text: str) -> Iterator[str]:
    """Yield the names in a text of a file that no module has, and the things that the named modules lack."""
    for name in FILE.findall(text):
        beside = Path(path).parent / name
        if not named(name) and not (ROOT / beside).exists() and name not in of_users():
            yield f"{name} does not exist"
    said = [(name, thing) for thing, name in HELD.findall(text)]
    said += [(f"{module}.py", thing) for module, thing in DOTTED.findall(text) if module not in OTHERS]
    for name, thing in said:
        if not holds(named(name), thing):
            yield f"{name} has no {thing}"


def test_named_files_exist():
    found = []
    for path in (*MODULES, *documents()):
        for line, text in prose(path):
            found += [f"{path}:{line}: {fault}" for fault in faults(path, text)]
    assert not found, "\n".join(found)


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("pictures as of `store.PictureStore`", None),
        ("methods of `reading.RecordedPictures`", "reading.py has no RecordedPictures"),
        ("see grid/state.py and `reward` in envs/step_kernel.py", None),
        ("see solvers/nowhere.py", "solvers/nowhere.py does not exist"),
        ("the protocol `Mapper` of api/simulation.py", "api/simulation.py has no Mapper"),
    ],
)
def test_a_name_that_moved_is_found(text, fault):
    assert list(faults("agents/gas_map.py", text)) == ([fault] if fault else [])
