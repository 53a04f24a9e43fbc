"""No code of a scenario is executed, and nothing outside its folder read, unless the user wants it."""

import io
import os
import sys
from pathlib import Path

import pytest
from scripts import refusal

from taichi_plume.assembly import own_code
from taichi_plume.assembly.assemble import assemble
from taichi_plume.assembly.preparation import load, load_scenario
from taichi_plume.cli import run
from taichi_plume.files.own_class import OwnAlgorithmError, OwnFile, failures_named
from taichi_plume.scenario.loading import ScenarioError

SCENARIO = """
duration: 1
domain: {size: [4, 3], spacing: 0.1}
wind: {kind: uniform, velocity: [0.5, 0]}
gas: {kind: eulerian, sources: [{position: [0.5, 1.5], rate: 1 mg/s}]}
robots:
  - count: 1
    start: {kind: positions, positions: [[3, 1]]}
    algorithm: {kind: own, file: own.py}
"""
OWN = """
from pathlib import Path
Path(__file__).with_name("executed").touch()
class Still:
    def act(self, robots):
        robots.speed[:] = 0
"""
LOG = "1000,2,0.5\n" + "".join(f"+{n} 2\n1,1,0,0.5,0,{n}\n1.5,1,0,0.5,0,{n}\n" for n in (1, 2))
GAS = "gas={{kind: plumesim_log, file: {}, sources: [{{position: [1, 1]}}]}}"


@pytest.fixture
def path(tmp_path) -> Path:
    case = tmp_path / "case"
    case.mkdir()
    (case / "own.py").write_text(OWN)
    (case / "s.yaml").write_text(SCENARIO)
    (tmp_path / "plume.pslog").write_text(LOG)
    (case / "plume.pslog").write_text(LOG)
    return case / "s.yaml"


def test_checking_executes_nothing(path, monkeypatch, capsys):
    monkeypatch.chdir(path.parent)
    assert run.main([str(path), "--check", "--allow-code"]) == 0
    assert load(path).resources.own == {}
    assert not path.with_name("executed").exists()


def test_running_executes_nothing_unasked(path, capsys):
    expected = refusal(capsys, "run", str(path), "--out", str(path.parent / "out"), "--quiet")
    assert "robots[0].algorithm.file: " in expected
    assert "own.py holds Python code" in expected
    assert not path.with_name("executed").exists()
    assert not path.with_name("out").exists()


def test_from_python_it_has_to_be_allowed(path):
    scenario = load_scenario(path)
    with pytest.raises(ScenarioError, match="allow_code=True"):
        assemble(scenario, path.parent)
    assert not path.with_name("executed").exists()
    prepared = load(path)
    own_code.execute(prepared, allow=True)
    assert path.with_name("executed").exists()
    assert prepared.resources.own["robots[0].algorithm"].__name__ == "Still"


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize(
    ("answer", "executed"), [("y\n", True), ("Yes\n", True), ("\n", False), ("no\n", False), ("", False)]
)
def test_at_a_terminal_it_is_asked_for(path, monkeypatch, answer, executed):
    monkeypatch.setattr(sys, "stdin", Terminal(answer))
    monkeypatch.setattr(sys, "stderr", err := Terminal())
    prepared = load(path)
    if executed:
        own_code.execute(prepared, allow=False, ask=True)
    else:
        with pytest.raises(ScenarioError, match="--allow-code"):
            own_code.execute(prepared, allow=False, ask=True)
    assert path.with_name("executed").exists() == executed
    assert prepared.resources.code["robots[0].algorithm"].digest[:16] in err.getvalue()
    assert "own.py" in err.getvalue()


def test_what_was_looked_at_is_executed(path):
    """Neither what the file has become since, nor a compiled file beside it."""
    prepared = load(path)
    path.with_name("own.py").write_text("raise RuntimeError")
    own_code.execute(prepared, allow=True)
    assert prepared.resources.own["robots[0].algorithm"].__name__ == "Still"
    assert not path.with_name("__pycache__").exists()


def test_code_is_allowed_by_its_digest(path, capsys):
    digest = load(path).resources.code["robots[0].algorithm"].digest
    path.with_name("own.py").write_text(path.with_name("own.py").read_text() + "# more\n")
    line = [str(path), "--out", str(path.parent / "out"), "--quiet", "--allow-sha256", digest]
    error = refusal(capsys, "run", *line)
    assert "robots[0].algorithm.file: " in error
    assert load(path).resources.code["robots[0].algorithm"].digest[:16] in error
    assert not path.with_name("executed").exists()
    assert not path.with_name("out").exists()
    prepared = load(path)
    own_code.execute(prepared, allow=[digest, prepared.resources.code["robots[0].algorithm"].digest])
    assert path.with_name("executed").exists()


@pytest.mark.parametrize(
    ("source", "name", "expected"),
    [
        (b"class A:\n  def act(self, robots): pass\nclass B:\n  act = print", None, "there are: A, B"),
        (b"class A:\n  def go(self, robots): pass", "A", "no class 'A' with a method act"),
        (b"class A:\n  def act(self, robots): pass", "B", "no class 'B' with a method act; there are: A"),
        (b"def f():\n  class A:\n    def act(self, robots): pass", None, "there are: none"),
        (b"x = '\0'", None, "null bytes"),
        (b"x = '\xff'", None, "own.py"),
        (b"(" * 5000, None, "too many nested"),
        (b"x = " + b"-" * 60_000 + b"1", None, "nested too deeply|too complex|recursion"),
        (b"#" * (2 << 17), None, "larger than 64 KiB"),
    ],
)
def test_what_is_surely_no_algorithm_is_reported_unexecuted(tmp_path, source, name, expected):
    (tmp_path / "own.py").write_bytes(source)
    with pytest.raises(OwnAlgorithmError, match=expected) as caught:
        OwnFile.read(tmp_path / "own.py", name)
    assert str(caught.value).isprintable()


def test_files_that_are_none(tmp_path):
    os.mkfifo(tmp_path / "pipe.py")
    faults = {
        "pipe.py": "is a pipe",
        "own.txt": r"must end in \.py",
        "a" * 5000 + ".py": "File name too long",
    }
    for name, fault in faults.items():
        with pytest.raises(OwnAlgorithmError, match=fault):
            OwnFile.read(tmp_path / name, None)


@pytest.mark.parametrize(
    "source",
    [
        "class A:\n  def act(self, robots): pass\nclass B:\n  pass",
        "if True:\n  class A:\n    def act(self, robots): pass",
        "from dataclasses import dataclass\n@dataclass\nclass A:\n  x: int = 1\n  def act(self, r): pass",
        "class Base:\n  pass\nBase.act = print\nclass A(Base):\n  pass\ndel Base",
    ],
)
def test_algorithms_in_all_shapes(tmp_path, source):
    (tmp_path / "own.py").write_text(source)
    assert OwnFile.read(tmp_path / "own.py", None).execute().__name__ == "A"


BAD = "class E({}):\n  def __str__(self): raise self\n"


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("raise SystemExit(0)", "line 1: SystemExit: 0"),
        ("import sys\nsys.exit()", "line 2: SystemExit"),
        (BAD.format("BaseException") + "raise E", "line 3: E: "),
        (BAD.format("Exception") + "raise E", "line 3: E: its message cannot be made"),
        ("import nowhere", "line 1: ModuleNotFoundError: No module named 'nowhere'"),
        (
            "raise ValueError('a\\n\\x1b[31m\\ud800' + 5000 * 'b')",
            r"line 1: ValueError: a \\x1b\[31m\\ud800bbb",
        ),
        ("def f(): f()\nf()", "RecursionError"),
    ],
)
def test_whatever_it_raises_is_reported_with_the_line(tmp_path, source, expected):
    (tmp_path / "own.py").write_text(source + "\nclass A:\n  def act(self, robots): pass")
    with pytest.raises(OwnAlgorithmError, match=expected) as caught:
        OwnFile.read(tmp_path / "own.py", None).execute()
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) <= 1000


def test_the_users_own_ctrl_c_stays_one(tmp_path):
    import signal

    (tmp_path / "own.py").write_text("class A:\n  def act(self, robots):\n    while True: pass")
    algorithm = OwnFile.read(tmp_path / "own.py", None).execute()()
    before = signal.signal(signal.SIGALRM, signal.default_int_handler)
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.05)
        with pytest.raises(KeyboardInterrupt), failures_named(tmp_path / "own.py"):
            algorithm.act(None)
    finally:
        signal.signal(signal.SIGALRM, before)


# ---------------------------------------------------------------- files outside


def playing(name: str) -> str:
    """The scenario with the gas of a log."""
    lines = [line for line in SCENARIO.splitlines() if not line.startswith("gas: ")]
    return "\n".join([*lines, GAS.format(name).replace("=", ": ", 1)])


@pytest.mark.parametrize("name", ["../plume.pslog", "{tmp}/plume.pslog", "link.pslog", "away/plume.pslog"])
def test_files_outside_are_not_read_unasked(path, tmp_path, name):
    name = name.format(tmp=tmp_path)
    (path.parent / "link.pslog").symlink_to(tmp_path / "plume.pslog")
    (path.parent / "away").symlink_to(tmp_path)
    path.write_text(playing(name))
    with pytest.raises(ScenarioError, match=r"gas\.file: .*\.pslog lies outside .*--allow-outside"):
        load_scenario(path)
    scenario = load_scenario(path, allow_outside=True)
    with pytest.raises(ScenarioError, match="allow_outside=True"):
        assemble(scenario, path.parent)


@pytest.mark.parametrize("name", ["plume.pslog", "./sub/../plume.pslog", "{case}/plume.pslog"])
def test_files_inside_are_read(path, name):
    (path.parent / "sub").mkdir()
    path.write_text(playing(name.format(case=path.parent)))
    assert load_scenario(path).gas


def test_files_named_on_the_command_line_are_the_users_will(path):
    assert load_scenario(path, [GAS.format("../plume.pslog")]).gas
    assert load_scenario(path, [GAS.format("none"), "gas.file=../plume.pslog"]).gas
    path.write_text(path.read_text().replace("own.py", "../own.py"))
    (path.parent / "own.py").rename(path.parent.parent / "own.py")
    assert load_scenario(path, ["robots[0].algorithm.file=../own.py"]).robots
    with pytest.raises(ScenarioError, match=r"robots\[0\]\.algorithm\.file: \.\./own\.py lies outside"):
        load_scenario(path, ["robots.0.algorithm.name=Still", GAS.format("../plume.pslog")])


def test_one_of_several_files_may_not_lead_outside(path, tmp_path):
    (path.parent / "a1.csv").write_text("")
    (path.parent / "a2.csv").symlink_to(tmp_path / "plume.pslog")
    path.write_text(
        SCENARIO.replace("{kind: uniform, velocity: [0.5, 0]}", "{kind: imported, files: a%d.csv}")
    )
    with pytest.raises(ScenarioError, match=r"wind\.files: a%d\.csv lies outside"):
        load_scenario(path)


def test_what_is_written_out_tells_how_it_is_run_again(path, tmp_path):
    from taichi_plume.engine.choice import DEFAULT, chosen
    from taichi_plume.files.run_folder import resuming, write_scenario

    text = playing("plume.pslog").replace("own.py}", "own.py, parameters: {file: 3, files: here.csv}}")
    path.write_text(text)
    scenario = load_scenario(path)
    (tmp_path / "a run").mkdir()
    write_scenario(tmp_path / "a run", scenario, path.parent, "cpu")
    first = (tmp_path / "a run" / "scenario.yaml").read_text().splitlines()[0]
    engine = "" if chosen() == DEFAULT else f" --engine={chosen()}"
    file = tmp_path / "a run" / "scenario.yaml"
    assert first.endswith(f"'{file}' --allow-code --allow-outside{engine}")
    assert resuming(tmp_path / "a run").endswith(f"a run' --allow-code --allow-outside{engine}")
    again = load_scenario(tmp_path / "a run" / "scenario.yaml", allow_outside=True)
    assert again.robots[0].algorithm.file == "../case/own.py"
    assert again.robots[0].algorithm.parameters == {"file": 3, "files": "here.csv"}  # the user's own affair
