"""Choice of the engine: names of both libraries, and messages for a wrong choice."""

import ast
from pathlib import Path

import pytest

import taichi_plume
from taichi_plume.engine import choice, library

ENGINE = Path(taichi_plume.__file__).parent / "engine"
OTHER = next(name for name in choice.ENGINES if name != library.NAME)


def defined(module: str) -> set[str]:
    """Public names that a module imports or defines at its top level."""
    names: set[str] = set()
    for node in ast.parse((ENGINE / f"{module}.py").read_text()).body:
        if isinstance(node, ast.Import | ast.ImportFrom):
            names |= {alias.asname or alias.name for alias in node.names}
        elif isinstance(node, ast.FunctionDef):
            names.add(node.name)
        elif isinstance(node, ast.Assign):
            names |= {
                part.id for target in node.targets for part in ast.walk(target) if isinstance(part, ast.Name)
            }
    return names


@pytest.mark.parametrize("module", ["taichi_names", "quadrants_names"])
def test_both_libraries_have_all_names_of_the_engine(module):
    used = {
        alias.name
        for path in ENGINE.glob("*.py")
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.ImportFrom) and node.module == library.__name__
        for alias in node.names
    }
    assert len(used) > 30
    assert used - {"NAME"} <= defined(module)


def test_an_unknown_engine_is_refused_by_a_line(monkeypatch):
    monkeypatch.setenv(choice.VARIABLE, "abacus")
    with pytest.raises(choice.EngineChoiceError) as refused:
        choice.chosen()
    assert refused.value.lines == [f"{choice.VARIABLE}: got 'abacus', allowed are taichi, quadrants"]


def test_an_engine_that_is_not_installed_is_refused_with_the_command_that_installs_it(monkeypatch):
    monkeypatch.setenv(choice.VARIABLE, OTHER)
    monkeypatch.setattr(choice, "is_installed", lambda name: False)
    with pytest.raises(choice.EngineChoiceError) as refused:
        choice.chosen()
    assert refused.value.lines == [f"the engine {OTHER} is not installed: {choice.ENGINES[OTHER]}"]
