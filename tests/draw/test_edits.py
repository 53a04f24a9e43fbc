"""Edits by a pointer: where a handle is dragged the object is, and random sequences of edits can all be undone."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from outlines import surrounding
from test_document import ROOT

from taichi_plume.draw import edits, forms
from taichi_plume.draw.document import EditError, data_of, value_at
from taichi_plume.draw.history import History
from taichi_plume.draw.objects import scene
from taichi_plume.draw.parts import Pane, Rectangle
from taichi_plume.quantities import split
from taichi_plume.report.theme import ABOVE, SIDE
from taichi_plume.scenario.checks import every
from taichi_plume.scenario.loading import read_scenario

HERE = Path()
SOLID_ROOM = edits.BLANK.replace("[4 m, 3 m]", "[4 m, 3 m, 2 m]")
BASES = {
    "flat": edits.BLANK,
    "solid": SOLID_ROOM,
    "casting_room": (ROOT / "configs/casting_room.yaml").read_text(),
    "arena_3d": (ROOT / "configs/arena_3d.yaml").read_text(),
    "moving_obstacle": (ROOT / "configs/moving_obstacle.yaml").read_text(),
}


def drawn(text, kind, *points, **more):
    return edits.create(text, scene(text, HERE), kind, points, **more)


def dragged(text, path, handle, to, plane=ABOVE):
    return edits.move_handle(text, scene(text, HERE), path, handle, plane, to)


def shifted(text, paths, by, plane=ABOVE):
    of = scene(text, HERE)
    return edits.move(text, of, edits.moves(of, paths, plane, by), plane)


DRAGS = {
    "inlet": [(0.02, 1.0), (0.05, 2.0)],
    "outlet": [(4.0, 0.5), (4.1, 1.5)],
    "honeycomb": [(1.0, 0.0), (2.0, 0.1)],
    "fan": [(1.0, 3.0), (1.5, 3.0)],
    "box": [(1.0, 1.0), (1.5, 1.4)],
    "cylinder": [(3.0, 2.0), (3.2, 2.0)],
    "sphere": [(2.0, 2.0), (2.2, 2.0)],
    "polygon": [(2.0, 0.5), (2.4, 0.5), (2.2, 0.9)],
    "walker": [(1.0, 2.5), (2.0, 2.5), (2.5, 2.2)],
    "heater": [(3.0, 1.0)],
    "source": [(0.5, 1.5)],
    "robots": [(3.5, 1.0)],
    "robot line": [(3.7, 1.0), (3.7, 2.0)],
    "robot area": [(3.0, 0.2), (3.9, 0.8)],
    "arena": [(0.1, 0.1), (3.9, 2.9)],
    "probe": [(2.0, 1.0)],
    "probe line": [(2.5, 1.0), (2.5, 2.0)],
}


@pytest.mark.parametrize("base", [edits.BLANK, SOLID_ROOM], ids=["2d", "3d"])
@pytest.mark.parametrize("kind", DRAGS)
def test_an_object_is_where_it_was_drawn(base, kind):
    if kind == "heater" and base == edits.BLANK:
        with pytest.raises(edits.EditError, match=r"domain\.size"):
            drawn(base, kind, *DRAGS[kind])
        return
    text, path = drawn(base, kind, *DRAGS[kind])
    thing = scene(text, HERE).thing(path)
    low, high = surrounding(thing.outlines(ABOVE))
    points = np.array(DRAGS[kind])
    if kind in ("box", "polygon", "robot area", "arena"):
        assert (*low, *high) == pytest.approx((*points.min(axis=0), *points.max(axis=0)), abs=1e-3)
    elif kind in ("inlet", "outlet", "honeycomb", "fan"):
        along = 1 if kind in ("inlet", "outlet") else 0
        assert (low[along], high[along]) == pytest.approx(np.sort(points[:, along]), abs=1e-3)
        wall = {"inlet": 0, "outlet": 4, "honeycomb": 0, "fan": 3}[kind]
        assert low[1 - along] == pytest.approx(wall)
    else:
        assert (low <= points.min(axis=0) + 1e-3).all()
        assert (high >= points.max(axis=0) - 1e-3).all()
    for handle in thing.handles(ABOVE):
        dragged(text, path, handle, (1.3, 1.7))


def test_a_room_drawn_from_nothing_can_be_run():
    from taichi_plume.draw.checks import check

    text = edits.BLANK
    for kind in ("inlet", "outlet", "box", "source", "robots"):
        text, path = drawn(text, kind, *DRAGS[kind])
    text, _ = drawn(text, "robots", (3.5, 2.0), selected=path)
    text, _ = drawn(text, "box", (2.0, 2.0), (2.4, 2.6))
    findings = check(text, HERE)
    assert findings.sound, findings.remarks
    assert value_at(data_of(text), "robots[0].count") == 2


@pytest.mark.parametrize("name", ["1", "[a]", "''"])
def test_a_group_with_a_wrong_name_is_copied_under_a_right_one(name):
    text, path = drawn(edits.BLANK, "robots", (1, 1))
    text = text.replace("name: team", f"name: {name}")
    copied, (new,) = edits.copy(text, [path], HERE)
    assert value_at(data_of(copied), f"{new}.name") == "robots2"


@pytest.mark.parametrize("yaw", [0, 25])
def test_a_corner_of_a_box_follows_the_pointer_and_the_opposite_one_stays(yaw):
    text, path = drawn(edits.BLANK, "box", (1, 1), (1.6, 1.4))
    text = edits.turn(text, [path], yaw)
    before = scene(text, HERE).thing(path).handles(ABOVE)
    new = dragged(text, path, "+1+1", (2.0, 2.0))
    after = scene(new, HERE).thing(path).handles(ABOVE)
    assert after["+1+1"] == pytest.approx((2.0, 2.0), abs=2e-3)
    assert after["-1-1"] == pytest.approx(before["-1-1"], abs=2e-3)


def test_lengths_keep_the_unit_in_which_they_were_written():
    text = "domain: {size: [4 m, 300 cm], spacing: 5 cm}\n"
    text += "gas: {kind: eulerian, sources: [{position: [1, 1], rate: 1e-5, radius: 50 mm}]}\n"
    moved = dragged(text, "domain", "+0+1", (0, 2.5))
    assert "[4 m, 250 cm]" in moved
    assert "radius: 80 mm" in dragged(text, "gas.sources[0]", "rim", (1.08, 1.0))


@pytest.mark.parametrize("base", [edits.BLANK, SOLID_ROOM], ids=["2d", "3d"])
@pytest.mark.parametrize("kind", ["inlet", "fan"])
def test_an_opening_is_dragged_to_another_wall(base, kind):
    text, path = drawn(base, kind, (0, 1), (0, 2))
    before = scene(text, HERE).thing(path).part.model
    moved = dragged(text, path, "center", (2.5, 2.9))
    opening = scene(moved, HERE).thing(path).part.model
    assert (opening.face, opening.center[0]) == ("y+", 2.5)
    assert opening.center[1:] == before.center[1:]
    assert (opening.size, opening.diameter) == (before.size, before.diameter)
    corner = dragged(moved, path, "center", (0.1, 2.95))
    assert scene(corner, HERE).thing(path).part.model.face in ("x-", "y+")
    whole = base.replace("openings: []", "openings: [{kind: inlet, face: x-, speed: 0.5}]")
    assert "face: x+, speed: 0.5" in dragged(whole, path, "center", (3.9, 1.5))


def test_an_opening_slides_along_its_wall_and_its_edges_can_be_dragged():
    text, path = drawn(edits.BLANK, "inlet", (0, 1), (0, 2))
    moved = dragged(text, path, "center", (0.05, 2.9))
    assert value_at(data_of(moved), f"{path}.center") == [2.5]
    wider = dragged(text, path, "+0+1", (0, 2.4))
    assert value_at(data_of(wider), f"{path}.center") == [1.7]
    assert value_at(data_of(wider), f"{path}.size") == [1.4]
    whole = "domain: {size: [4, 3], spacing: 0.05}\nwind: {kind: cfd, openings: [{kind: outlet, face: x+}]}\n"
    part = dragged(whole, "wind.openings[0]", "+0-1", (4, 1))
    assert value_at(data_of(part), "wind.openings[0]") == {
        "kind": "outlet",
        "face": "x+",
        "center": [2],
        "size": [2],
    }


def test_heights_are_dragged_in_the_view_from_the_side():
    text, path = drawn(SOLID_ROOM, "box", (1, 1), (1.6, 1.4))
    taller = dragged(text, path, "+0+1", (0, 1.2), SIDE)
    assert value_at(data_of(taller), f"{path}.size[2]") == 1.2
    assert value_at(data_of(taller), f"{path}.center[2]") == 0.6
    text, path = drawn(SOLID_ROOM, "cylinder", (1, 1), (1.2, 1))
    shorter = dragged(text, path, "+0+1", (0, 0.9), SIDE)
    assert value_at(data_of(shorter), f"{path}.height") == 0.9
    text, path = drawn(SOLID_ROOM, "source", (1, 1))
    higher = dragged(text, path, "center", (1, 1.5), SIDE)
    assert value_at(data_of(higher), f"{path}.position") == [1, 1, 1.5]
    text, path = drawn(SOLID_ROOM, "outlet", (4, 1), (4, 2))
    low = dragged(text, path, "+0+1", (4, 1), SIDE)
    assert value_at(data_of(low), path)["size"] == [1, 1]


def test_a_walker_is_moved_with_its_way():
    text, path = drawn(edits.BLANK, "walker", (1, 1), (2, 1))
    moved = shifted(text, [path], (0.5, 0.25))
    obstacle = value_at(data_of(moved), path)
    assert obstacle["center"] == [1.5, 1.25]
    assert [point[1:] for point in obstacle["motion"]["path"]] == [[2.5, 1.25], [1.5, 1.25]]
    assert [point[0] for point in obstacle["motion"]["path"]] == [2, 4], "times stay"


@pytest.mark.parametrize("base", ["casting_room", "arena_3d"])
def test_several_objects_are_moved_copied_and_removed_as_each_alone(base):
    text = BASES[base]
    of = scene(text, HERE)
    paths = [t.path for t in of.things if t.path.startswith(("obstacles", "gas.sources", "robots"))]
    assert len(paths) > 4
    one_by_one = text
    for path in paths:
        one_by_one = shifted(one_by_one, [path], (0.15, -0.1))
    assert shifted(text, paths, (0.15, -0.1)) == one_by_one
    copied, new = edits.copy(text, paths, HERE)
    assert len(scene(copied, HERE).things) == len(of.things) + len(paths)
    assert edits.remove(copied, new) == text
    assert edits.remove(copied, [*new, "domain"]) == text, "the room stays"
    left = {thing.path for thing in scene(edits.remove(text, paths), HERE).things}
    assert not [path for path in paths if path in left]


def test_a_new_probe_has_a_free_name():
    text = BASES["casting_room"]
    for _ in range(2):
        text, _ = edits.create(text, scene(text, HERE), "probe", [(1.0, 1.0)])
    text = edits.remove(text, ["probes.points[0]"])
    for _ in range(2):
        text, _ = edits.create(text, scene(text, HERE), "probe", [(1.0, 1.0)])
    assert [each["name"] for each in data_of(text)["probes"]["points"]] == ["p2", "p1", "p3"]


def test_objects_are_pasted_together_at_a_point_under_free_names():
    text = BASES["casting_room"]
    paths = ["obstacles[0]", "obstacles[2]", "robots[0]", "domain", ""]
    copied = edits.clip(scene(text, HERE), paths)
    pasted, new = edits.paste(text, copied, HERE, (2.0, 1.0))
    assert new == ["obstacles[3]", "obstacles[4]", "robots[2]"]
    before, after = scene(text, HERE), scene(pasted, HERE)
    old_and_new = [
        (before.thing(a).place(), after.thing(b).place()) for a, b in zip(paths, new, strict=False)
    ]
    shifts = [np.subtract(b, a) for a, b in old_and_new if a is not None and b is not None]
    assert shifts[1] == pytest.approx(shifts[0], abs=2e-3)
    assert shifts[2] == pytest.approx(shifts[0], abs=2e-3)
    places = np.array([after.thing(path).place() for path in new])
    assert (places.min(axis=0) + places.max(axis=0)) / 2 == pytest.approx((2.0, 1.0), abs=2e-3)
    data = data_of(pasted)
    assert value_at(data, "robots[2].name") not in (
        "",
        *(value_at(data, f"robots[{n}].name") for n in (0, 1)),
    )
    gone = edits.remove(text, paths[:3])
    again, _ = edits.paste(gone, copied, HERE)
    assert value_at(data_of(again), "robots[1].name") == value_at(data, "robots[0].name")


@pytest.mark.parametrize("at", [(-0.5, -0.4), (0.02, 0.01), (4.6, 1.5), (2.0, 3.4), (2.1, 1.4), (4.3, 3.2)])
@pytest.mark.parametrize("kind", edits.OPENINGS)
def test_an_opening_dropped_anywhere_lies_on_the_nearest_wall(kind, at):
    text, path = drawn(edits.BLANK, kind, at)
    low, high = surrounding(scene(text, HERE).thing(path).outlines(ABOVE))
    assert (low >= 0).all()
    assert (high <= (4, 3)).all()
    face = value_at(data_of(text), f"{path}.face")
    apart = {"x-": at[0], "x+": 4 - at[0], "y-": at[1], "y+": 3 - at[1]}
    assert abs(apart[face]) == min(map(abs, apart.values()))
    assert (high - low).max() == pytest.approx(0.6 if face[0] == "x" else 0.8, abs=2e-3)


@pytest.mark.parametrize("kind", DRAGS)
def test_a_sketch_is_where_the_object_will_be(kind):
    a, b = DRAGS[kind][0], DRAGS[kind][-1]
    line, size = edits.sketch(kind, a, b, (4.0, 3.0))
    assert size.endswith(" m")
    if kind in (*edits.OPENINGS, *edits.AREAS, *edits.ROUND):
        text, path = drawn(edits.BLANK, kind, a, b)
        assert np.ravel([np.min(line, axis=0), np.max(line, axis=0)]) == pytest.approx(
            boxes(scene(text, HERE).thing(path)), abs=2e-3
        )


def test_a_new_kind_keeps_what_both_kinds_have():
    text = BASES["casting_room"]
    new = forms.entered(text, data_of(text), "obstacles[1].kind", "sphere")
    assert value_at(data_of(new), "obstacles[1]") == {"kind": "sphere", "center": [1.7, 0.75]}
    plain = forms.entered(text, data_of(text), "obstacles[1].yaw_deg", "")
    assert "yaw_deg" not in value_at(data_of(plain), "obstacles[1]")


@pytest.mark.parametrize("name", ["casting_room", "arena_3d", "moving_obstacle"])
def test_forms_list_every_key_of_every_section_with_its_meaning(name):
    """Compared with the sections of the scenario that the text makes."""
    data, scenario = data_of(BASES[name]), read_scenario(ROOT / f"configs/{name}.yaml")
    for path, section in every(scenario):
        rows = forms.rows(data, path)
        assert {row.key for row in rows} >= set(type(section).model_fields)
        assert all(row.meaning for row in rows), path
        written = section.model_fields_set if path == "" or value_at(data, path) is not None else set()
        assert {row.key for row in rows if row.value} == written, path


# ---------------------------------------------------------------- random sequences

points = st.tuples(st.floats(-0.5, 4.5), st.floats(-0.5, 3.5)).map(lambda p: (round(p[0], 3), round(p[1], 3)))
ENTRIES = ["", "1", "0.2", "20 cm", "[1, 2]"]
actions = st.one_of(
    st.tuples(st.just("create"), st.sampled_from(sorted(DRAGS)), st.lists(points, min_size=3, max_size=4)),
    st.tuples(st.just("drag"), st.integers(0, 99), st.integers(0, 99), st.booleans(), points),
    st.tuples(st.just("shift"), st.integers(0, 99), points),
    st.tuples(st.just("turn"), st.integers(0, 99), st.sampled_from([-90, -15, 15, 90])),
    st.tuples(st.just("copy"), st.integers(0, 99)),
    st.tuples(st.just("remove"), st.integers(0, 99)),
    st.tuples(st.just("form"), st.integers(0, 99), st.integers(0, 99), st.sampled_from(ENTRIES)),
    st.tuples(st.just("type"), st.sampled_from(["", "# note\n", "x", "robots: [", "\n"])),
    st.tuples(st.just("undo")),
    st.tuples(st.just("redo")),
)  # fmt: skip


def carried_out(text, action):
    """Carry out one action of a user; check that the drawing then shows it."""
    of = scene(text, HERE)
    things = [thing for thing in of.things if thing.part is not None]
    kind, *rest = action
    if kind == "create":
        new, path = edits.create(text, of, rest[0], rest[1])
        assert scene(new, HERE).thing(path) is not None
        return new
    if kind == "type":
        return text + rest[0]
    if not things:
        raise EditError("nothing is drawn")
    thing = things[rest[0] % len(things)]
    if kind == "drag":
        plane = of.planes[-1] if rest[2] else ABOVE
        handles = sorted(thing.handles(plane))
        if not handles:
            raise EditError("no handle")
        handle = handles[rest[1] % len(handles)]
        new = edits.move_handle(text, of, thing.path, handle, plane, rest[3])
        after = scene(new, HERE).thing(thing.path)
        if handle == "center" and after.part is not None and not isinstance(after.part, Pane | Rectangle):
            horizontal = after.handles(plane)["center"][0]
            assert horizontal == pytest.approx(rest[3][0], abs=2e-3)
        return new
    if kind == "shift":
        new = shifted(text, [thing.path], rest[1])
        others = [t.path for t in things if t.path != thing.path]
        after = scene(new, HERE)
        for path in others:
            now, before = after.thing(path), of.thing(path)
            if now.part is not None and path != "arena":
                assert boxes(now) == pytest.approx(boxes(before)), "only the moved object moves"
        return new
    if kind == "turn":
        return edits.turn(text, [thing.path], rest[1])
    if kind == "copy":
        new, (path,) = edits.copy(text, [thing.path], HERE)
        assert len(scene(new, HERE).things) == len(of.things) + 1
        return new
    if kind == "remove":
        new = edits.remove(text, [thing.path])
        assert len(scene(new, HERE).things) == len(of.things) - 1
        return new
    rows = forms.rows(of.data, thing.path)
    row = rows[rest[1] % len(rows)]
    new = forms.entered(text, of.data, row.path, rest[2])
    if rest[2]:
        old, given = value_at(of.data, row.path), value_at(data_of(new), row.path)
        unit = split(old) if isinstance(old, str) else None  # stays beside a number
        allowed = [
            rest[2] if row.about.is_text else data_of(f"x: {rest[2]}")["x"],
            f"{rest[2]} {unit[1]}" if unit else None,
        ]
        assert given in allowed, "the text has what the form says"
    return new


def boxes(thing):
    low, high = surrounding(thing.outlines(ABOVE))
    return [*low, *high]


def live_through(base, sequence):
    """Carry out a sequence of actions; every text that there was comes back by undo, byte for byte."""
    history, past, at = History(base), [base], 0
    for action in sequence:
        if action[0] in ("undo", "redo"):
            getattr(history, action[0])()
            at = max(0, at - 1) if action[0] == "undo" else min(len(past) - 1, at + 1)
        else:
            try:
                new = carried_out(past[at], action)
            except EditError:
                new = past[at]
            if new != past[at]:
                past[at + 1 :] = [new]
                at += 1
            history.put(new)
            top = base.splitlines()[0]
            assert new.startswith(top), "the comment at the top stays"
        assert history.text == past[at]
    while history.can_redo:
        history.redo()
    assert [history.text, *(history.undo() for _ in past[1:])] == past[::-1]
    assert not history.can_undo


QUIET = {"deadline": None, "derandomize": True, "suppress_health_check": list(HealthCheck)}
sequences = st.lists(actions, min_size=1, max_size=8)


@settings(max_examples=10, **QUIET)
@given(base=st.sampled_from(sorted(BASES)), sequence=sequences)
def test_random_edits_are_drawn_and_undone(base, sequence):
    live_through(BASES[base], sequence)


@pytest.mark.slow
@settings(max_examples=1000, **QUIET)
@given(base=st.sampled_from(sorted(BASES)), sequence=sequences)
def test_a_thousand_random_sequences_of_edits_are_drawn_and_undone(base, sequence):
    live_through(BASES[base], sequence)
