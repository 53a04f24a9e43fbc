"""What CONTRIBUTING.md says of how few files know a kind: counted for every kind there is."""

import ast
from functools import cache
from pathlib import Path
from typing import Any, get_args

import pytest
from test_imports import tree

from taichi_plume.agents.columns import COLUMNS
from taichi_plume.scenario.algorithms import Algorithm
from taichi_plume.scenario.gases import PureGas
from taichi_plume.scenario.maps import Map
from taichi_plume.scenario.metal_oxides import MOX_MODELS
from taichi_plume.scenario.openings import Opening

ROOT = Path(__file__).parent.parent
LISTS = {
    "taichi_plume/scenario/algorithms.py",
    "taichi_plume/scenario/gases.py",
    "taichi_plume/contests/entrants.py",  # who takes part
}
NAMESAKES = {
    "taichi_plume/studies/study_keys.py",  # a kind of study is called sweep, as an algorithm
    "taichi_plume/files/network.py",  # a network's weights may be external
}
ROOMS = [ROOT / "taichi_plume", ROOT / "solvers", ROOT / "agents"]


def words(path: Path) -> set[str]:
    """Names, attributes and whole texts, these in quotes, of a source file."""
    found = set()
    for node in ast.walk(tree(path)):
        match node:
            case ast.Constant(value=str(text)):
                found.add(f"'{text}'")
            case ast.Name(id=name) | ast.Attribute(attr=name):
                found.add(name)
    return found


@cache
def words_of_files() -> dict[str, set[str]]:
    return {str(path.relative_to(ROOT)): words(path) for room in ROOMS for path in room.rglob("*.py")}


def files_with(*several: str) -> set[str]:
    return {path for path, found in words_of_files().items() if not found.isdisjoint(several)}


def members(union: Any) -> list[type]:
    """The models of a discriminated union."""
    (first, *_) = get_args(union)
    return list(get_args(first)) or [first]


def knowing(model: type) -> set[str]:
    """The source files that name a section of the vocabulary, or its kind as the whole of a text."""
    (kind,) = get_args(model.model_fields["kind"].annotation)  # type: ignore[attr-defined]
    return files_with(f"'{kind}'", model.__name__)


def cases(union: Any, but: tuple[str, ...] = ()) -> list[Any]:
    return [pytest.param(one, id=one.__name__) for one in members(union) if one.__name__ not in but]


# Parts of a union that others are built on, that are read from files or learnt: these are known where that is done.
@pytest.mark.parametrize(
    "model",
    [
        *cases(PureGas, but=("PlaybackGas", "PlumeSimGas", "FluentGas", "MovieGas", "GadenGas")),
        *cases(Algorithm, but=("Own", "Policy", "Replay", "Casting")),
        *cases(Map, but=("TimeSeriesMap",)),
    ],
)
def test_a_kind_of_gas_algorithm_or_map_is_known_in_three_files(model):
    """Its section, its file, a table; and the list of sections, where that stands in another file."""
    assert len(knowing(model) - LISTS - NAMESAKES) <= 3


def test_a_boundary_is_known_in_three_files():
    for model in members(Opening):
        files = {path for path in knowing(model) if path.startswith("solvers")}
        if model.__name__ not in (
            "MovingWall",
            "Periodic",
        ):  # "wall" and "periodic" are words of other things, too
            assert files <= {"solvers/boundaries.py", "solvers/openings.py"}


def test_a_metal_oxide_sensor_is_an_entry_in_one_file():
    for name in MOX_MODELS:
        assert files_with(f"'{name}'") == {"taichi_plume/scenario/metal_oxides.py"}


NAMES_OF_MORE = ("x", "y", "heading", "found", "state", "declarations", "false_declarations")
"""Columns of which trials have namesakes, or that are words of other things."""


LOOKS = [
    "record/",
    "latest_instant",
    "report/",
    "results/",
    "map",
    "readings",
    "bag",
    "trajectories",
    "serve/",
    "client",
    "envs/truth",
    "draw/past",
]


def test_a_column_is_declared_in_one_file_and_written_in_another():
    """What a robot table shows is named in no other file, but where one is looked at, as in a picture or a bag."""
    for column in COLUMNS:
        for name in column.table:
            if name not in NAMES_OF_MORE:
                files = files_with(f"'{name}'")
                shown = {path for path in files if any(part in path for part in LOOKS)}
                assert files - shown <= {"agents/columns.py"}, name
