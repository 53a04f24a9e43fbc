"""Remarks point at what they are about, where that has a place."""

import pytest
from test_messages import ROOM

from taichi_plume.assembly.preparation import load
from taichi_plume.scenario.checks import numbered

GROUPS = (
    "robots=[{name: a, count: 2, start: {kind: positions, positions: [[1, 1], [1, 2]]}, algorithm: {kind: casting}}, "
    "{name: b, count: 2, start: {kind: area, low: [3, 1], high: [3.5, 2]}, algorithm: {kind: casting}}]"
)
BOX = "obstacles=[{kind: box, center: [2, 1, 0.15], size: [0.4, 0.3, 0.3]}]"
SCREEN = "wind.screens=[{kind: honeycomb, axis: x, at: 0.4}]"


@pytest.mark.parametrize(
    ("path", "place"),
    [
        ("wind.openings[0]", (0.0, 1.5, 0.25)),
        ("wind.openings[1].temperature", (4.0, 1.5, 0.25)),
        ("wind.screens[0].at", (0.4, 1.5, 0.25)),
        ("obstacles[0]", (2.0, 1.0, 0.15)),
        ("gas.sources[0].radius", (1.0, 1.5, 0.1)),
        ("robots[0].algorithm.threshold_ppm", (1.0, 1.0)),
        ("robots[1].reach", (3.25, 1.5)),
        ("duration", None),
        ("wind", None),
        ("robots[10]", None),
    ],
)
def test_a_remark_points_at_its_place(path, place, tmp_path):
    (tmp_path / "s.yaml").write_text(ROOM)
    prepared = load(
        tmp_path / "s.yaml",
        [GROUPS, SCREEN, "obstacles=[{kind: box, center: [2, 1, 0.15], size: [0.4, 0.3, 0.3]}]"],
    )
    found = numbered(["duration: is short", f"{path}: is: odd"], prepared.resources.context)
    if place is None:
        assert found == []
    else:
        ((number, where),) = found
        assert number == 2
        assert where == pytest.approx(place)
