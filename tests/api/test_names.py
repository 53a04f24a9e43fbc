"""The public names: listed, documented, with examples that run."""

import ast
import doctest
import inspect
import os
import re
import textwrap
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


def test_the_methods_of_a_scenario_are_declared_as_they_are():
    """`scenario/scenario.py` declares for type checkers what `api/scenario.py` attaches."""
    (declared,) = (
        node
        for node in ast.walk(ast.parse(Path(inspect.getfile(tp.Scenario)).read_text()))
        if isinstance(node, ast.If) and node.body and isinstance(node.body[0], ast.FunctionDef)
    )
    for method in declared.body:
        assert isinstance(method, ast.FunctionDef)
        attached = ast.parse(textwrap.dedent(inspect.getsource(getattr(tp.Scenario, method.name)))).body[0]
        assert isinstance(attached, ast.FunctionDef)
        expected, found = (
            [
                (arg.arg, ast.unparse(arg.annotation or ast.Constant(0)).strip("'"))
                for arg in each.args.args[1:]
            ]
            + [
                (arg.arg, ast.unparse(arg.annotation or ast.Constant(0)).strip("'"))
                for arg in each.args.kwonlyargs
            ]
            + [ast.unparse(default) for default in each.args.defaults]
            + [ast.unparse(each.returns or ast.Constant(0)).strip("'")]
            for each in (method, attached)
        )
        assert found == expected


@pytest.mark.parametrize("name", ["study"])
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
