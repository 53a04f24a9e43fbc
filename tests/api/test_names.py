"""The public names: listed, documented, with examples that run."""

import doctest
import inspect
import os
import re
from importlib import import_module
from pathlib import Path

import pytest

import taichi_plume as tp

EXAMPLES = [
    tp.simulate, tp.Simulation, tp.Own, tp.Scenario.from_file, tp.Scenario.check, tp.Scenario.with_, tp.load_scenario,
    tp.InputError, tp.ScenarioError, tp.RunFolderError, tp.RunError, tp.Robots, tp.open_run, tp.cite,
    tp.maps, tp.statistics, tp.study, tp.open_study,
    pytest.param(tp.contest, marks=pytest.mark.slow, id="contest"),
]  # fmt: skip


def test_every_public_name_is_listed_and_documented():
    assert set(tp.__all__) <= set(dir(tp))
    for name in tp.__all__:
        assert inspect.getdoc(getattr(tp, name)), name
    with pytest.raises(AttributeError, match="nonsense"):
        _ = tp.nonsense  # type: ignore[attr-defined]


def test_every_public_name_is_in_the_program_that_is_checked_for_types():
    text = (Path(__file__).parent / "typed_use.py").read_text()
    assert [name for name in tp.__all__ if not re.search(rf"\btp\.{name}\b", text)] == []


@pytest.mark.parametrize("name", ["study", "contest", "statistics", "maps"])
def test_modules_behind_commands_do_not_replace_functions(name):
    with pytest.raises(ImportError, match=f"tp.{name}"):
        import_module(f"taichi_plume.{name}")
    assert callable(getattr(tp, name))


@pytest.mark.parametrize("named", EXAMPLES, ids=lambda named: named.__qualname__)
@pytest.mark.slow
def test_examples_of_docstrings_run(taichi, tmp_path, monkeypatch, named):
    monkeypatch.chdir(tmp_path)
    (test,) = doctest.DocTestFinder(recurse=False).find(named, globs={"folder": tmp_path / "run"})
    assert test.examples
    output: list[str] = []
    failed, _ = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS).run(test, out=output.append)
    assert not failed, "".join(output)
    assert os.listdir(tmp_path) in ([], ["run"])
