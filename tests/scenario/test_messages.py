"""What is said of scenarios: `messages.txt` lists changes of a scenario, and below each the faults and notes it gets.

A file of rows: ``== NAME & CHANGE ...`` begins those of a scenario of `SCENARIOS`. A row is a line of changes as of
`--set`, between ``&``; below it, indented, stands each line that is said: how it begins and, after ``...``, what else
is in it. A note is of a scenario that can be run; a row without a line gets neither.
"""

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

from taichi_plume.assembly.preparation import load
from taichi_plume.scenario import size
from taichi_plume.scenario.loading import ScenarioError

ROOM = """\
duration: 10
warm_up: 5
domain: {size: [4, 3, 0.5], spacing: 0.05}
wind:
  kind: cfd
  openings:
    - {kind: fan, face: x-, center: [1.5, 0.25], diameter: 0.4, speed: 0.5}
    - {kind: outlet, face: x+}
obstacles:
  - {kind: box, center: [2, 1, 0.15], size: [0.4, 0.3, 0.3]}
  - {kind: sphere, center: [3, 2, 0.2], radius: 0.2}
gas: {kind: eulerian, sources: [{position: [1, 1.5, 0.1], rate: 1e-5}]}
robots:
  - {count: 2, start: {kind: positions, positions: [[1, 1], [1, 2]]}, algorithm: {kind: casting}}
maps: [{kind: time_series}]
"""
FLOOR = """\
duration: 10
domain: {size: [4, 3], spacing: 0.05, depth: 0.5}
wind:
  kind: cfd
  openings:
    - {kind: fan, face: x-, center: [1.5], diameter: 0.4, speed: 0.5}
    - {kind: outlet, face: x+}
obstacles: [{kind: box, center: [2, 1], size: [0.4, 0.3]}]
gas: {kind: eulerian, sources: [{position: [1, 1.5], rate: 1e-5}]}
robots: [{count: 2, start: {kind: positions, positions: [[1, 1], [1, 2]]}, algorithm: {kind: casting}}]
"""
DUCT = """\
duration: 60
warm_up: 10
domain: {size: [4, 3], spacing: 0.05, depth: 0.5}
wind:
  kind: cfd
  openings:
    - {kind: inlet, face: x-, speed: 0.5}
    - {kind: outlet, face: x+}
gas: {kind: eulerian, species: acetone, sources: [{position: [1, 1.5], rate: 10 mg/s}]}
robots:
  - {count: 2, start: {kind: positions, positions: [[3.5, 1], [3.5, 2]]}, algorithm: {kind: casting}}
"""
HALL = """\
duration: 10
domain: {size: [4, 3, 2], spacing: 0.1}
wind: {kind: cfd, openings: [{kind: inlet, face: x-, speed: 0.5}, {kind: outlet, face: x+}]}
gas: {kind: eulerian, sources: [{position: [1, 1.5, 0.5], rate: 1e-5}]}
"""
FIELD = """\
duration: 10
warm_up: 5
domain: {size: [4, 3, 1], spacing: 0.1}
wind: {kind: uniform, velocity: [0.5, 0, 0]}
gas: {kind: continuous, diffusivity: 0.01, sources: [{position: [1, 1.5, 0.1], rate: 1e-5}]}
"""
SCENARIOS = {"room": ROOM, "floor": FLOOR, "duct": DUCT, "hall": HALL, "field": FIELD}


def said(folder: Path, text: str, *changes: str) -> list[str]:
    """Return the lines about a scenario: its faults or, as `note: ...`, its remarks."""
    path = folder / "s.yaml"
    path.write_text(text)
    try:
        return [f"note: {line}" for line in load(path, changes).resources.warnings]
    except ScenarioError as error:
        return [line.removeprefix(f"{path}: ") for line in error.lines]


def rows() -> Iterator[tuple[str, list[str], list[str]]]:
    """Yield the name of the scenario, the changes and the expected lines of each row."""
    name, common, row = "", [], None
    for line in Path(__file__).with_name("messages.txt").read_text(encoding="utf-8").splitlines():
        if line.startswith("    ") and row is not None:
            row[2].append(line.strip())
        elif line and not line.startswith("# "):
            if row is not None:
                yield row
            row = None
            if line.startswith("== "):
                name, *common = line.removeprefix("== ").split(" & ")
            else:
                row = (name, [*common, *line.split(" & ")], [])
    if row is not None:
        yield row


@pytest.mark.parametrize(
    ("name", "changes", "expected"), [pytest.param(*row, id=row[1][-1]) for row in rows()]
)
def test_each_change_is_said_to_be(tmp_path, monkeypatch, name, changes, expected):
    monkeypatch.setattr(size.psutil, "virtual_memory", lambda: SimpleNamespace(available=3e9))
    lines = said(tmp_path, SCENARIOS[name], *changes)
    assert len(lines) == len(expected), lines
    for begin, *parts in (line.split(" ... ") for line in expected):
        assert any(line.startswith(begin) and all(part in line for part in parts) for line in lines), lines


@pytest.mark.parametrize("text", SCENARIOS.values(), ids=SCENARIOS)
def test_of_sound_scenarios_nothing_is_said(tmp_path, text):
    assert said(tmp_path, text) == []
