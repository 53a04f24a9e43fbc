"""An algorithm of the user's own, from a file or handed over, and what is said when it fails."""

import json
import sys
from collections import Counter
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from taichi_plume.agents.own_algorithm import UserState
from taichi_plume.api.own import Own
from taichi_plume.assembly.assemble import assemble
from taichi_plume.assembly.preparation import load_scenario
from taichi_plume.cli import run
from taichi_plume.execution import outputs
from taichi_plume.files.own_class import OwnAlgorithmError
from taichi_plume.grid.state import saves_itself
from taichi_plume.scenario.loading import ScenarioError

pytestmark = pytest.mark.usefixtures("taichi")

UPWIND = """
import numpy as np

class Upwind:
    STATE_NAMES = ("AWAY", "UPWIND")

    def __init__(self, speed=0.1):
        self.speed_wanted = speed

    def act(self, robots):
        robots.turn_to(np.arctan2(-robots.wind[:, 1], -robots.wind[:, 0]))
        robots.speed[:] = self.speed_wanted
        robots.state[:] = robots.wind_known
"""

SCENARIO = """
duration: 4
domain: {size: [4, 3], spacing: 0.1}
wind: {kind: uniform, velocity: [0.5, 0]}
gas: {kind: eulerian, sources: [{position: [0.5, 1.5], rate: 1 mg/s}]}
robots:
  - name: mine
    count: 2
    trials: 2
    start: {kind: positions, positions: [[3, 1], [3, 2]], heading_deg: 90}
    algorithm: {kind: own, file: upwind.py, parameters: {speed: 0.15}}
    sensors: {wind: {kind: ideal}, gas: {kind: ideal}}
"""


@pytest.fixture
def path(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "upwind.py").write_text(UPWIND)
    (tmp_path / "own.yaml").write_text(SCENARIO)
    return tmp_path / "own.yaml"


CIRCLES = """
  - name: circles
    count: 2
    trials: 2
    start: {kind: positions, positions: [[3, 1], [3, 2]], heading_deg: 90}
    algorithm: {kind: own}
    localization: {kind: odometry, veer_deg: 20}
    sensors: {wind: {kind: ideal}, gas: {kind: ideal}}
rivals: true
"""


@pytest.mark.slow
def test_classes_of_a_file_and_handed_over_drive_robots(path):
    class Circle:
        def act(self, robots):
            assert robots.trial.tolist() == [0, 0, 1, 1]
            assert robots.robot.tolist() == [0, 1, 0, 1]
            self.seen = robots.position.copy(), robots.heading.copy(), robots.path_length.copy()
            robots.speed, robots.turn_rate = 0.1, 0.5

    path.write_text(SCENARIO + CIRCLES)
    scenario = load_scenario(path, {"robots.1.algorithm": Own(Circle)})
    sim = assemble(scenario, path.parent, allow_code=True)
    sim.run()
    now = sim.swarm.snapshot()
    moved = now["position"][:4] - np.tile([[3, 1], [3, 2]], (2, 1))
    assert moved[:, 0] == pytest.approx(-0.15 * 3.45, abs=0.06)  # half a second for the turn
    assert sim.teams[0].state_names == ("AWAY", "UPWIND")
    assert (now["state"][:4] == 1).all()
    turned = 0.5 * (4 - sim.dt)  # commands come at the end of each tick
    assert now["heading"][4:] == pytest.approx(np.pi / 2 + turned - 2 * np.pi, abs=1e-3)
    seen = dict(zip(("position", "heading", "odometer"), sim.teams[1].algorithm.algorithm.seen, strict=True))
    for name, values in seen.items():
        believed = now[name if name == "odometer" else f"believed_{name}"][4:]
        np.testing.assert_array_equal(values, believed, err_msg=name)
    assert (np.abs(seen["position"] - now["position"][4:]) > 1e-4).any(axis=1).all()


@pytest.mark.parametrize(
    ("wrong", "file", "reported"),
    [
        ("class A:\n  def act(self, robots)\n    pass", "upwind.py", "upwind.py, line 2: expected ':'"),
        ("x = 1", "upwind.py", "holds not exactly one class with a method act; there are: none"),
        (UPWIND, "gone.py", "gone.py: cannot be read: No such file"),
    ],
)
def test_a_file_without_an_algorithm(path, wrong, file, reported):
    (path.parent / "upwind.py").write_text(wrong)
    with pytest.raises(ScenarioError, match=r"robots\[0\].algorithm.file: .*" + reported):
        load_scenario(path, [f"robots.0.algorithm.file={file}"])


def test_without_a_file_a_class_has_to_be_handed_over(path):
    scenario = load_scenario(path, ["robots.0.algorithm={kind: own}"])
    with pytest.raises(ScenarioError, match=r"robots\[0\]\.algorithm: no class or function was given"):
        assemble(scenario, path.parent)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("act", "reported"),
    [
        ("if robots.t > 1: raise ValueError('\\x1b[2J')", r"upwind.py, line 4: ValueError: \x1b[2J"),
        ("raise SystemExit(0)", "upwind.py, line 4: SystemExit: 0"),
    ],
)
def test_a_failure_is_reported_and_what_was_computed_is_kept(path, capsys, act, reported):
    (path.parent / "upwind.py").write_text(f"\nclass A:\n  def act(self, robots):\n    {act}\n")
    options = ["--set", "robots.0.algorithm.parameters={}", "--no-recording", "--allow-code"]
    assert run.main([str(path), "--out", "out", *options]) == 1
    assert reported in capsys.readouterr().err
    kept = json.loads(Path("out/result.json").read_text())
    assert kept["status"] == "failed"
    assert reported in kept["message"]
    assert Path("out/robots.parquet").exists()


# ---------------------------------------------------------------- decision quantities


def decided(path, listed: str, held: str) -> dict[str, np.ndarray]:
    """Decision quantities after the first tick of a class with `listed` as DECISIONS, whose attribute is `held`."""
    text = UPWIND.replace("STATE_NAMES", f"DECISIONS = {listed}\n    STATE_NAMES", 1)
    (path.parent / "upwind.py").write_text(text + f"        self.lost = {held}\n")
    sim = assemble(load_scenario(path), path.parent, allow_code=True)
    sim.advance()
    return sim.decisions()


LOST = '(("lost", "s", "time since the last detection"),)'


@pytest.mark.parametrize(
    ("held", "expected"),
    [
        ("robots.trial + 0.5", [0.5, 0.5, 1.5, 1.5]),
        ("np.where(robots.robot > 0, np.nan, 3)", [3, np.nan, 3, np.nan]),
        ("robots.dt > 0", [1, 1, 1, 1]),
        ("None", [np.nan] * 4),
    ],
)
def test_decision_quantities_are_attributes_of_the_class(path, held, expected):
    (values,) = decided(path, LOST, held).values()
    np.testing.assert_array_equal(values, np.float32(expected))


@pytest.mark.parametrize(
    ("listed", "held", "reported"),
    [
        ('("lost", "s", "time")', "0", r"upwind.py, DECISIONS of Upwind is \('lost', .* must be a tuple of"),
        ('(("lost time", "s", "time"),)', "0", "must be a tuple of"),
        ('(("found_at", "s", "time"),)', "0", "upwind.py: Upwind has no attribute 'found_at'"),
        (LOST, "np.zeros(3)", r"upwind.py, Upwind.lost has the shape \(3,\), not \(4,\)"),
    ],
)
def test_wrong_decision_quantities_are_refused(path, listed, held, reported):
    with pytest.raises(OwnAlgorithmError, match=reported):
        decided(path, listed, held)


@pytest.mark.parametrize("name", ["t", "robot", "x", "reading_ppm"])
def test_columns_of_the_table_are_no_names_of_decision_quantities(path, name):
    with pytest.raises(ScenarioError, match=rf"robots\[0\].algorithm: DECISIONS has the name '{name}'"):
        decided(path, f'(("{name}", "s", "time"),)', "0")


# ---------------------------------------------------------------- what it keeps


@pytest.fixture
def started(path, monkeypatch):
    """Runs the command with an algorithm of some lines, for a second; at once after hours, as its clock says."""

    def start(lines: str, *options: str) -> int:
        text = "class A:\n    def act(self, robots):\n        robots.speed[:] = 0.1\n" + lines
        (path.parent / "upwind.py").write_text(text)
        (path.parent / "own.yaml").write_text(SCENARIO.replace(", parameters: {speed: 0.15}", ""))
        monkeypatch.setattr(outputs, "USUAL", 0.0)
        command = [str(path), "--out", "out", "--quiet", "--no-recording", "--allow-code", "--duration", "1"]
        return run.main([*command, *options])

    return start


def result() -> dict:
    return json.loads(Path("out/result.json").read_text())


LACKS = "robots[0].algorithm: has no state() and restore(), without which a run cannot be resumed"


@pytest.mark.slow
def test_a_run_that_cannot_be_resumed_says_so_when_it_takes_long(started, capsys):
    assert started("") == 0
    said = capsys.readouterr().err
    assert said.count(LACKS) == 1
    assert "this run makes no checkpoint" in said
    assert LACKS in "".join(result()["remarks"])
    assert started("", "--force", "--set=checkpoint=null") == 0
    assert LACKS not in capsys.readouterr().err
    assert LACKS not in "".join(result()["remarks"])


@pytest.mark.parametrize(
    "keys", [{"state": lambda self: 1}, {"STATE": "SEARCH"}, {"state": None, "restore": None}]
)
def test_classes_that_cannot_be_saved(keys):
    assert not saves_itself(type("A", (), keys)())


def test_checkpoints_that_cannot_be_made_are_refused_where_they_are_asked_for(started, capsys):
    assert started("", "--set=checkpoint={every: 0.5}") == 2
    assert capsys.readouterr().err.startswith(LACKS)
    assert not Path("out").exists()


def endless() -> list:
    a: list = []
    a.append(a)
    return a


WRONG = [
    (lambda: {"seen": {1, 2}}, "state().seen: is a set, which is no number, text, array, list or dict"),
    (lambda: [object()], "state()[0]: is a object, which is no number, text, array, list or dict"),
    (lambda: Counter("a"), "state(): is a Counter, which is no"),
    (lambda: np.array([object()]), "state(): is an array of Python objects"),
    (endless, "upwind.py: RecursionError"),
    (sys.exit, "SystemExit"),
]


@pytest.mark.parametrize(("state", "reported"), WRONG)
def test_a_state_that_is_no_plain_data(state, reported):
    with pytest.raises(OwnAlgorithmError) as error:
        UserState(Path("upwind.py"), SimpleNamespace(state=state)).state()
    assert reported in str(error.value)


@pytest.mark.slow
def test_a_failing_state_ends_a_run_whose_checkpoints_were_asked_for(started, capsys):
    """Otherwise the run matters more."""
    lines = "    def state(self):\n        1 / 0\n    def restore(self, state):\n        pass\n"
    reported = "upwind.py, line 5: ZeroDivisionError: division by zero"
    assert started(lines) == 0
    said = capsys.readouterr().err
    assert reported in said
    assert "this run makes no checkpoint" in said
    assert started(lines, "--force", "--set=checkpoint={every: 0.5}") == 1
    assert reported in capsys.readouterr().err.splitlines()[1]
    assert reported in result()["message"]


@pytest.mark.slow
def test_a_failing_restore_is_reported_and_destroys_nothing(started, capsys, path):
    lines = "    def state(self):\n        return 1\n    def restore(self, state):\n        1 / 0\n"
    broken = "        if robots.t > 0.6 and not __import__('os').path.exists('mended'): 1 / 0\n"
    assert started(broken + lines, "--set=checkpoint={every: 0.2}") == 1
    kept = {file.name: file.read_bytes() for file in Path("out").iterdir()}
    capsys.readouterr()
    assert run.main(["--resume", "out", "--allow-code", "--allow-outside", "--quiet"]) == 1
    assert "upwind.py, line 8: ZeroDivisionError" in capsys.readouterr().err
    assert {file.name: file.read_bytes() for file in Path("out").iterdir()} == kept
