"""Whatever a command prints goes through the one place that keeps control characters from terminals."""

import ast
from pathlib import Path

import pytest
from test_imports import PACKAGE, ROOMS, ROOT, tree

from taichi_plume.cli import maps, run
from taichi_plume.execution.summary import print_summary

PRINTER = ROOT / PACKAGE / "guard" / "terminal.py"
OTHERS = {
    "start.py",
    "clock_rows.py",
    "gpu_rows.py",
    "jax_box.py",
}  # of the benchmark, run beside other checkouts
FILES = [
    path
    for folder in [ROOT / PACKAGE, *ROOMS.values()]
    for path in sorted(folder.glob("*.py") if folder.name == PACKAGE else folder.rglob("*.py"))
    if path != PRINTER and path.name not in OTHERS
]
NAMES = {"Console", "ArgumentParser", "print_exc", "print_exception", "pprint", "rprint", "showwarning"}
WRITES = {"sys.stdout.write", "sys.stderr.write", "os.write"}


def prints(path: Path) -> list[str]:
    """What in a file prints by itself."""
    found = []
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.ClassDef):
            bases = [ast.unparse(base) for base in node.bases]
            found += [f"class {node.name}" for base in bases if base.endswith("ArgumentParser")]
        elif isinstance(node, ast.Call):
            called = ast.unparse(node.func)
            if called in WRITES | {"print"} or called.rpartition(".")[2] in NAMES:
                found.append(called)
    return found


def test_nothing_prints_by_itself_and_what_prints_is_seen():
    assert {str(path): found for path in FILES if (found := prints(path))} == {}
    assert len(FILES) > 150
    assert len(prints(PRINTER)) > 1


SCENARIO = """
duration: 1
domain: {size: [4, 3], spacing: 0.1}
wind: {kind: uniform, velocity: [0.5, 0]}
gas: {kind: eulerian, sources: [{position: [0.5, 1.5], rate: 1 mg/s}]}
"""
WICKED = "a\x1b]0;x\x07\x9b2J\u202e"


@pytest.fixture
def said(capsys):
    """What was printed, all of which prints."""

    def read() -> str:
        reported = "".join(capsys.readouterr())
        assert all(one.isprintable() or one == "\n" for one in reported)
        assert max(map(len, reported.splitlines()), default=0) <= 1000
        return reported

    return read


@pytest.mark.slow
def test_names_of_files_and_folders(tmp_path, said):
    assert run.main([str(tmp_path / f"{WICKED}.yaml")]) == 2
    assert r"a\x1b]0;x\x07\x9b2J\u202e.yaml: cannot be read" in said()
    (tmp_path / "s.yaml").write_text(SCENARIO)
    (tmp_path / WICKED).write_text("")
    for out in (WICKED, f"{WICKED}/b", "b" * 5000, "\udcff", "new\nline/\udcff" + "c" * 300):
        assert run.main([str(tmp_path / "s.yaml"), "--out", str(tmp_path / out), "--quiet"]) == 2
        assert said().count("\n") == 1
    assert maps.main([str(tmp_path / WICKED), "--size", "4", "3", "--out", str(tmp_path / "map")]) == 2
    assert r"\x1b]0;x" in said()


def test_values_on_the_command_line(tmp_path, said):
    (tmp_path / "s.yaml").write_text(SCENARIO)
    for text in (f"name={WICKED}", f"{WICKED}=1", f"gas.sources.0.rate={WICKED}", "duration=" + "9" * 5000):
        assert run.main([str(tmp_path / "s.yaml"), "--set", text]) == 2
        assert said()
    with pytest.raises(SystemExit):
        run.main([str(tmp_path / "s.yaml"), "--arch", WICKED])
    assert said()
    assert maps.main(["a.csv", "--size", WICKED, "3", "--out", "b"]) == 2
    assert said()


def test_cells_of_tables(tmp_path, said):
    (tmp_path / "r.csv").write_text(f"t,x,y,reading\n1,1,1,{WICKED}\n")
    assert maps.main([str(tmp_path / "r.csv"), "--size", "4", "3", "--out", str(tmp_path / "map")]) == 2
    assert "r.csv: line 2" in said()


def test_names_of_groups_in_the_summary(tmp_path, said):
    """Also such as rich takes for markup."""
    group = {
        "name": f"[/x] {WICKED}", "algorithm": "own", "robots": 1, "trials": 1,
        "per_trial": {"found": [0], "success": [0]}, "summary": {"success_rate": {}},
        "no_search": None, "unlike_them": False, "trials_differ_by": None,
    }  # fmt: skip
    content = {
        "name": "[bold]", "status": "completed", "message": "", "wall_s": 1.0, "simulated_s": 1.0, "cells": 1,
        "steps": 1, "backend": "cpu", "Mcell_steps_per_s": None, "flow": None, "gas": None, "groups": [group],
        "maps": [],
    }  # fmt: skip
    (tmp_path / WICKED).mkdir()
    (tmp_path / WICKED / "recording.rrd").touch()
    print_summary(content, tmp_path / WICKED)
    reported = said()
    assert "[/x]" in reported
    assert "[bold]" in reported


def test_a_group_that_looks_like_markup_is_run(tmp_path, monkeypatch, said):
    monkeypatch.chdir(tmp_path)
    start = "{kind: positions, positions: [[3, 1]]}"
    robots = f"robots: [{{name: '[/x]', count: 1, start: {start}, algorithm: {{kind: casting}}}}]"
    (tmp_path / "s.yaml").write_text(SCENARIO + robots)
    assert run.main([str(tmp_path / "s.yaml"), "--check"]) == 0
    assert "name: '[/x]'" in said()
