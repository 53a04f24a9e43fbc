"""Objects of a text: all shipped scenarios are drawn, where their checked scenario says that things are."""

import re
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from outlines import surrounding
from test_document import CONFIGS

from taichi_plume.assembly.preparation import load
from taichi_plume.draw import checks
from taichi_plume.draw.canvas import Canvas
from taichi_plume.draw.document import data_of
from taichi_plume.draw.objects import named, names, scene
from taichi_plume.report.theme import ABOVE, FRONT, SIDE
from taichi_plume.scenario.changes import changed
from taichi_plume.scenario.loading import ScenarioError, read_scenario

SCENARIOS = [path for path in CONFIGS if "axes:" not in path.read_text()]


@pytest.mark.parametrize("path", SCENARIOS, ids=lambda path: path.stem)
def test_shipped_scenarios_are_drawn_where_they_are(path):
    of, scenario = scene(path.read_text(), path.parent), load(path).scenario
    assert of.room == pytest.approx(scenario.domain.extent)
    drawn = [thing for thing in of.things if thing.part is not None]
    counted = Counter(re.split(r"[.\[]", thing.path)[0] for thing in drawn)
    assert counted["obstacles"] == len(scenario.obstacles)
    assert counted["robots"] == len(scenario.robots)
    assert counted["gas"] == len(scenario.sources)
    assert len([t for t in drawn if t.path.startswith("wind.openings")]) == len(scenario.openings)
    for where, source in scenario.sources:
        thing = of.thing(where)
        assert thing is not None
        for plane in of.planes:
            assert thing.handles(plane)["center"] == pytest.approx([source.position[d] for d in plane])
            low, high = surrounding([outline for outline in thing.outlines(plane) if outline.closed])
            assert (high - low) / 2 == pytest.approx([source.radius] * 2, rel=1e-6)
    shapes = load(path).resources.shapes
    for where, shape in shapes.items():
        outlines = [outline for outline in of.thing(where).outlines(ABOVE) if outline.closed]
        low, high = surrounding(outlines)
        assert low == pytest.approx(shape.low[:2], abs=1e-6)
        assert high == pytest.approx(shape.high[:2], abs=1e-6)
    for n, group in enumerate(scenario.robots):
        places = group.places(scenario.floor)
        low, high = surrounding(of.thing(f"robots[{n}]").outlines(ABOVE))
        if places is not None:
            assert low == pytest.approx(places.min(axis=0) - group.body.radius, abs=1e-6)
            assert high == pytest.approx(places.max(axis=0) + group.body.radius, abs=1e-6)
    for thing in drawn:
        for plane in of.planes:
            points = [outline.points for outline in thing.outlines(plane)]
            assert all(part.shape[1] == 2 for part in points)


def test_heights_are_drawn_in_the_view_from_the_side():
    path = next(path for path in SCENARIOS if path.stem == "arena_3d")
    of = scene(path.read_text(), path.parent)
    assert of.planes == [ABOVE, SIDE, FRONT]
    low, high = surrounding(of.thing("obstacles[2]").outlines(SIDE))
    assert (low[1], high[1]) == pytest.approx((0.0, 0.3))
    assert set(of.thing("obstacles[2]").handles(SIDE)) == {"center", "+0+1", "+0-1"}


def test_the_middle_one_of_three_robots_can_be_moved_alone():
    path = next(path for path in SCENARIOS if path.stem == "drone_search")
    text = (
        path.read_text().replace("[[4.6, 0.5]]", "[[1, 1], [2, 1], [3, 1]]").replace("count: 1", "count: 3")
    )
    of = scene(text, path.parent)
    assert Canvas(ABOVE).handle_at(of, ["robots[0]"], (2.0, 1.0)) == ("robots[0]", "positions[1]")


def test_a_text_with_mistakes_is_drawn_as_far_as_it_can_be_read():
    text = """\
domain: {size: [4, 3], spacing: 0.05}
obstacles:
  - {kind: box, center: [1, 2], size: [0.5, wide]}
  - {kind: cylinder, center: [2, 1], radius: 0.2}
robots:
  - {count: 2, start: {kind: line, begin: [3, 1], end: [3, 2]}, algorithm: {kind: castng}}
"""
    of = scene(text, Path())
    assert of.thing("obstacles[0]").part is None
    assert of.thing("obstacles[0]").place() == (1, 2)
    assert of.thing("obstacles[1]").part is not None
    assert of.thing("robots[0]").part is not None, "a misspelt algorithm does not hide the robots"
    assert scene("a: [", Path()).things == ()
    assert scene("", Path()).room is None


def test_a_mesh_and_a_map_are_drawn_as_footprints(tmp_path):
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], float)
    faces = [(0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)]
    lines = [f"v {x} {y} {z}" for x, y, z in corners] + [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces]
    (tmp_path / "body.obj").write_text("\n".join(lines))
    (tmp_path / "plan.pgm").write_bytes(b"P5 4 3 255\n" + bytes([0, 0, 0, 0, 0, 255, 255, 0, 0, 0, 0, 0]))
    (tmp_path / "plan.yaml").write_text(
        "{image: plan.pgm, resolution: 1, origin: [0, 0, 0], negate: 0, occupied_thresh: 0.65, free_thresh: 0.2}"
    )
    text = """\
domain: {size: [4, 3, 2], spacing: 0.1}
obstacles:
  - {kind: mesh, file: body.obj, translate: [2, 1, 0.5]}
  - {kind: map, file: plan.yaml}
"""
    of = scene(text, tmp_path)
    pixel = 1.0 / 200
    (mesh,) = of.thing("obstacles[0]").outlines(ABOVE)
    low, high = surrounding([mesh])
    assert (*low, *high) == pytest.approx((2, 1, 3, 2), abs=pixel)
    x, y = mesh.points[:-1].T  # the last point is the first again
    area = 0.5 * abs(np.dot(x, np.roll(y, 1)) - np.dot(y, np.roll(x, 1)))
    assert area == pytest.approx(0.5, abs=3 * pixel), "triangles that cover each other leave no hole"
    low, high = surrounding(of.thing("obstacles[0]").outlines(SIDE))
    assert (*low, *high) == pytest.approx((2, 0.5, 3, 1.5), abs=pixel)
    low, high = surrounding(of.thing("obstacles[1]").outlines(ABOVE))
    assert (*low, *high) == pytest.approx((0, 0, 4, 3))
    outside = text.replace("body.obj", "../body.obj")
    (tmp_path.parent / "body.obj").write_text((tmp_path / "body.obj").read_text())
    assert scene(outside, tmp_path).thing("obstacles[0]").part is None, (
        "files outside the folder are not read"
    )


# ---------------------------------------------------------------- mistakes at the right object


def mistakes():
    import sys

    sys.path.insert(0, str(Path(__file__).parents[1] / "scenario"))
    from test_messages import SCENARIOS as BASES
    from test_messages import rows

    return [
        pytest.param(BASES[name], changes, expected, id=changes[-1])
        for name, changes, expected in rows()
        if expected and not expected[0].startswith("override")
    ]


@pytest.mark.parametrize(("base", "changes", "expected"), mistakes())
def test_a_mistake_is_shown_at_its_object(base, changes, expected, tmp_path, monkeypatch):
    """The lines are those of ``--check``; an independent reading of their paths says which object each belongs to."""
    from types import SimpleNamespace

    import yaml

    from taichi_plume.scenario import size

    monkeypatch.setattr(size.psutil, "virtual_memory", lambda: SimpleNamespace(available=3e9))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "s.yaml").write_text(base)
    data = changed_data(tmp_path / "s.yaml", changes)
    text = yaml.safe_dump(data, sort_keys=False)
    findings, of = checks.check(text, tmp_path), scene(text, tmp_path)
    try:
        lines = [(line, False) for line in load(data, (), folder=tmp_path).resources.warnings]
    except ScenarioError as error:
        lines = [(line, True) for line in error.faults]
    assert [(remark.line, remark.is_error) for remark in findings.remarks] == lines
    assert len(lines) >= len(expected) or len(lines) == 0
    for remark in findings.remarks:
        path = re.match(r"(?:[a-z_0-9]+(?:\[\d+\])*\.?)*(?=: )", remark.line)
        named = re.match(
            r"(obstacles|robots|maps|wind\.openings|wind\.screens|probes\.points|wind\.buoyancy\.heat\.heaters|"
            r"wind\.buoyancy\.heat\.walls|gas(?:\.parts\[\d+\])?\.(?:sources|releases))\[\d+\]",
            path[0] if path else "",
        )
        owner = of.owner(remark.path)
        items = data
        if named is not None and item_exists(items, named[0]):
            assert owner == named[0], remark.line
        else:
            assert owner == "" or remark.line.startswith(owner), remark.line


def item_exists(data, path):
    for step in re.findall(r"[a-z_]+|\d+", path):
        try:
            data = data[int(step)] if step.isdigit() else data[step]
        except (LookupError, TypeError):
            return False
    return True


def changed_data(path, changes):
    from taichi_plume.scenario.loading import _overridden, read_mapping

    return _overridden(read_mapping(path, ""), changes)


def test_the_drawing_has_the_sections_of_the_experiment():
    path = next(path for path in SCENARIOS if path.stem == "casting_room")
    of = scene(path.read_text(), path.parent)
    assert of.owner("duration") == ""
    assert of.owner("gas.species") == "gas"
    assert of.owner("gas.sources[0].rate") == "gas.sources[0]"
    assert of.owner("maps[1].cell") == "maps[1]"
    assert of.owner("obstacles[1].size[0]") == "obstacles[1]"
    assert of.owner("obstacles[10].size") == ""


@pytest.mark.parametrize("path", SCENARIOS, ids=lambda path: path.stem)
def test_shipped_scenarios_have_the_remarks_and_size_of_the_command(path):
    findings = checks.check(path.read_text(), path.parent)
    assert findings.sound
    assert [remark.line for remark in findings.remarks] == load(path).resources.warnings
    assert findings.amounts.startswith(f"{int(np.prod(read_scenario(path).domain.shape)):,} cells")


def test_mistakes_in_yaml_name_their_line():
    findings = checks.check("a: 1\nb: [", Path())
    assert not findings.sound
    assert "line" in findings.remarks[0].line
    assert changed(data_of("a: 1"), {"b": 2}) == {"a": 1, "b": 2}


NAMED = """\
domain: {size: [4, 3], spacing: 0.1}
wind:
  kind: cfd
  openings: [{kind: inlet, face: x-}, {kind: outlet, face: x+}]
obstacles:
  - {kind: cylinder, center: [1, 1], radius: 0.2}
  - {kind: box, center: [2, 1], size: [0.2, 0.2]}
  - {kind: box, center: [3, 1], size: [0.2, 0.2]}
gas:
  parts: [{sources: [{position: [1, 2]}]}, {sources: [{position: [1.5, 2]}]}]
probes: {points: [{kind: point, at: [1, 1]}]}
robots: [{name: team}, {name: team}, {name: box 1}, {}]
"""


def test_objects_of_a_kind_are_numbered_from_1_and_no_two_have_one_name():
    by_path = names(data_of(NAMED))
    assert by_path["wind.openings[1]"] == "outlet 1", "the only outlet"
    assert [by_path[f"obstacles[{n}]"] for n in range(3)] == ["cylinder 1", "box 1", "box 2"]
    assert [by_path[f"gas.parts[{n}].sources[0]"] for n in range(2)] == ["source 1", "source 2"]
    assert by_path["probes.points[0]"] == "probe 1"
    assert len(set(by_path.values())) == len(by_path)


def test_names_of_shipped_scenarios_are_unique():
    counts = {path: Counter(names(data_of(path.read_text())).values()) for path in SCENARIOS}
    assert {path: count.most_common(1) for path, count in counts.items() if max(count.values()) > 1} == {}


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("obstacles[2].center[0]: got -1", "box 2, center[0]: got -1"),
        ("gas.parts[1].sources[0].rate: got -1", "source 2, rate: got -1"),
        (
            "robots[0].start.positions[1]: is inside obstacles[1] (box)",
            "team, start.positions[1]: is inside box 1",
        ),
        (
            "wind.openings[1]: overlaps wind.openings[0] (inlet) on face x-",
            "outlet 1: overlaps inlet 1 on face x-",
        ),
        (
            "obstacles[2].size: got 3; there is no obstacles[9]",
            "box 2, size: got 3; there is no obstacles[9]",
        ),
        ("my.obstacles[0] and obstacles[0]", "my.obstacles[0] and cylinder 1"),
    ],
)
def test_a_message_names_an_object_as_the_plan_does(line, expected):
    assert named(line, names(data_of(NAMED))) == expected
