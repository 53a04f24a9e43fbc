"""A study's file, its base, and what that names: what may be opened, how often, and texts that mean harm."""

from typing import Any

import pytest
import yaml
from small_study import ROOM, SPEED, faults, write

from taichi_plume.studies import scenario_checks
from taichi_plume.studies.plan import load_plan


def test_files_have_to_lie_in_the_folder_unless_it_is_said(tmp_path):
    (tmp_path / "a").mkdir()
    file = write(tmp_path / "a")
    (tmp_path / "a" / "room.yaml").rename(tmp_path / "room.yaml")
    file.write_text(file.read_text().replace("room.yaml", "../room.yaml"))
    assert "lies outside the study's folder" in faults(file)[0]
    found = load_plan(file, allow_outside=True)
    assert found.folder == tmp_path
    (tmp_path / "b.py").write_text("class Mine:\n    def act(self, readings):\n        return 0, 0\n")
    own = {"robots.0.algorithm": {"kind": "own", "file": "../b.py"}}
    (line,) = faults(write(tmp_path / "a", axes={"a": {"variants": {"mine": own, "none": {"robots": []}}}}))
    assert line.startswith("axes.a: mine: robots[0].algorithm.file: ../b.py lies outside")


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("", "is empty; a study needs at least name, base and axes"),
        ("name: a", "missing key 'base'"),
        (
            "name: a\nduration: 3\ndomain: {size: [1, 1]}",
            "is a scenario, not a study; python -m taichi_plume.run runs scenarios; a study names its base scenario",
        ),
    ],
)
def test_texts_that_are_no_study(tmp_path, text, line):
    (tmp_path / "study.yaml").write_text(text)
    assert faults(tmp_path / "study.yaml")[0] == line


def test_what_cannot_be_opened(tmp_path):
    assert faults(tmp_path / "none.yaml") == ["cannot be read: No such file or directory"]
    assert faults(tmp_path) == ["cannot be read: Is a directory"]


def test_hostile_texts_are_shown_harmless(tmp_path):
    study: dict[str, Any] = yaml.safe_load(write(tmp_path).read_text())
    study["axes"] = {"a": {"key": "tick", "values": ["\u202e<b>"]}}
    (tmp_path / "study.yaml").write_text(yaml.safe_dump(study))
    (line,) = faults(tmp_path / "study.yaml")
    assert "\u202e" not in line


def test_files_are_opened_once_for_all_points(tmp_path, monkeypatch):
    (tmp_path / "b.py").write_text("class Mine:\n    def act(self, readings):\n        return 0, 0\n")
    opened = []
    real = scenario_checks.prepare
    monkeypatch.setattr(scenario_checks, "prepare", lambda one, *more: opened.append(1) or real(one, *more))
    gain = {"key": "robots.0.algorithm.parameters.gain", "values": [1.0, 2.0, 3.0]}
    robot = ROOM["robots"][0] | {"algorithm": {"kind": "own", "file": "b.py"}}
    room = ROOM | {"robots": [robot]}
    assert len(load_plan(write(tmp_path, room, axes={"gain": gain, "speed": SPEED})).requests) == 30
    assert len(opened) == 1
