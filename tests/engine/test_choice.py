"""Choice of the engine: names of both libraries, and messages for a wrong choice."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

from taichi_plume.__main__ import main
from taichi_plume.engine import choice, library

ROOT = Path(__file__).parents[2]
ENGINE = ROOT / "taichi_plume" / "engine"
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


@pytest.fixture
def fresh(monkeypatch):
    """Process that has not imported an engine yet."""
    monkeypatch.delitem(sys.modules, library.__name__)
    return monkeypatch


def test_the_variable_chooses_the_engine_until_one_is_imported(monkeypatch):
    monkeypatch.setenv(choice.VARIABLE, OTHER)
    monkeypatch.setattr(choice, "is_installed", lambda name: True)
    assert choice.chosen() == library.NAME
    monkeypatch.delitem(sys.modules, library.__name__)
    assert choice.chosen() == OTHER
    monkeypatch.delenv(choice.VARIABLE)
    assert choice.chosen() == "taichi"


def test_an_unknown_engine_is_refused_by_a_line(fresh):
    fresh.setenv(choice.VARIABLE, "abacus")
    with pytest.raises(choice.EngineChoiceError) as refused:
        choice.chosen()
    assert refused.value.lines == [f"{choice.VARIABLE}: got 'abacus', allowed are taichi, quadrants"]


def test_an_engine_that_is_not_installed_is_refused_with_the_command_that_installs_it(fresh):
    fresh.setenv(choice.VARIABLE, OTHER)
    fresh.setattr(choice, "is_installed", lambda name: False)
    with pytest.raises(choice.EngineChoiceError) as refused:
        choice.chosen()
    assert refused.value.lines == [f"the engine {OTHER} is not installed: {choice.ENGINES[OTHER]}"]


def test_a_process_keeps_its_engine(monkeypatch, capsys):
    monkeypatch.setenv(choice.VARIABLE, library.NAME)
    choice.choose(library.NAME)
    with pytest.raises(SystemExit) as ended:
        main(["run", "none.yaml", "--engine", OTHER])
    assert ended.value.code == 2
    assert f"this process uses {library.NAME}" in capsys.readouterr().err
    assert os.environ[choice.VARIABLE] == library.NAME


@pytest.mark.parametrize("way", ["option", "variable"])
def test_a_command_with_a_missing_engine_prints_a_line_and_exits_with_2(tmp_path, way):
    """A folder without installed packages is put before those of this Python."""
    (tmp_path / "sitecustomize.py").write_text(
        "import importlib.util as u; plain = u.find_spec\n"
        f"u.find_spec = lambda name, *more: None if name == {OTHER!r} else plain(name, *more)\n"
    )
    environment = {name: value for name, value in os.environ.items() if name != choice.VARIABLE}
    environment["PYTHONPATH"] = os.pathsep.join([str(tmp_path), str(ROOT)])
    command = [sys.executable, "-m", "taichi_plume.run", str(ROOT / "configs" / "casting_room.yaml")]
    if way == "option":
        command += ["--engine", OTHER]
    else:
        environment[choice.VARIABLE] = OTHER
    ended = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert ended.returncode == 2
    assert ended.stderr == f"the engine {OTHER} is not installed: {choice.ENGINES[OTHER]}\n"
