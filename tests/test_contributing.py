"""What CONTRIBUTING.md says of how few files know a kind: counted for every kind there is."""

import ast
from pathlib import Path
from typing import Any, get_args

import pytest

from taichi_plume.scenario.algorithms import Algorithm
from taichi_plume.scenario.gases import PureGas
from taichi_plume.scenario.maps import Map
from taichi_plume.scenario.openings import Opening

ROOT = Path(__file__).parent.parent
ROOMS = [ROOT / "taichi_plume", ROOT / "solvers", ROOT / "agents"]
SOURCES = {
    path.relative_to(ROOT): ast.parse(path.read_text())
    for room in ROOMS
    for path in room.rglob("*.py")
    if not any(parent.is_symlink() for parent in path.parents)
}


def members(union: Any) -> list[type]:
    """The models of a discriminated union."""
    (first, *_) = get_args(union)
    return list(get_args(first)) or [first]


def knowing(*words: str) -> set[str]:
    """The source files in which one of these is a name or the whole of a text."""
    return {
        str(path)
        for path, tree in SOURCES.items()
        for node in ast.walk(tree)
        if (isinstance(node, ast.Constant) and node.value in words)
        or (isinstance(node, ast.Name) and node.id in words)
        or (isinstance(node, ast.Attribute) and node.attr in words)
    }


def cases(union: Any) -> list[Any]:
    return [pytest.param(model, id=model.__name__) for model in members(union)]


if __name__ == "__main__":
    for union in (PureGas, Algorithm, Map, Opening):
        for m in members(union):
            kind = get_args(m.model_fields["kind"].annotation)[0]
            print(m.__name__, kind, sorted(knowing(m.__name__)), sorted(knowing(kind)))
