"""Hands on the page without a browser: several objects at once, keys, the context menu, guides and sizes."""

import numpy as np
import pytest

pytest.importorskip("bokeh", reason="the extra draw is not installed")
from test_document import ROOT
from test_drawn_page import drag, opened, use

from taichi_plume.draw import edits, palette
from taichi_plume.report.theme import ABOVE, FRONT, SIDE

ROOM = (ROOT / "configs/casting_room.yaml").read_text()


@pytest.fixture
def page(tmp_path):
    return opened(tmp_path)[1]


def places(page):
    return {thing.path: thing.place() for thing in page.scene.things if thing.part is not None}


def shown(page, layer, key):
    return page.canvases[ABOVE].sources[layer].data[key]


def hold(page, start, *way, plane=ABOVE, **modifiers):
    """Begin a drag and do not end it."""
    canvas = page.canvases[plane]
    page.pointer.start(canvas, start, **modifiers)
    for at in way:
        page.pointer.drag(canvas, at, (1, 1), **modifiers)


def test_shift_clicks_and_a_rectangle_select_several(page):
    canvas = page.canvases[ABOVE]
    page.pointer.tap(canvas, (2.75, 1.9))
    page.pointer.tap(canvas, (1.5, 2.1), shift=True)
    assert page.selection == ["obstacles[2]", "obstacles[0]"]
    assert page.chosen == "obstacles[0]"
    assert shown(page, "handles", "name") == [], "handles are those of a single object"
    page.pointer.tap(canvas, (1.5, 2.1), ctrl=True)
    assert page.selection == ["obstacles[2]"]
    page.pointer.tap(canvas, (1.0, 0.5), shift=True)
    assert page.selection == ["obstacles[2]"], "a click beside all with Shift keeps the selection"
    hold(page, (0.9, 0.2), (3.2, 2.6), shift=True)
    assert len(shown(page, "sketch", "x")) == 5
    page.pointer.end(canvas, (3.2, 2.6), shift=True)
    assert set(page.selection) == {"obstacles[0]", "obstacles[1]", "obstacles[2]"}
    assert shown(page, "sketch", "x") == []
    assert page.workplace.text == ROOM


@pytest.mark.parametrize(
    ("action", "by"),
    [
        (lambda page: drag(page, (2.75, 1.9), (2.6, 1.8), (2.5, 1.7)), (-0.25, -0.2)),
        (lambda page: page._act("move:-1 0 1"), (-0.05, 0.0)),
        (lambda page: page._act("move:0 1 10"), (0.0, 0.5)),
    ],
    ids=["drag", "arrow", "shift-arrow"],
)
def test_all_selected_move_in_one_step(page, action, by):
    page.select(["obstacles[0]", "gas.sources[0]", "obstacles[2]"])
    before = places(page)
    action(page)
    for path, place in places(page).items():
        expected = np.add(before[path], by if path in page.selection else 0.0)
        assert place == pytest.approx(tuple(expected), abs=1e-3)
    assert page.selection == ["obstacles[0]", "gas.sources[0]", "obstacles[2]"]
    page._act("undo")
    assert page.workplace.text == ROOM


def test_all_are_copied_pasted_and_deleted_in_one_step_each(page):
    page._act("all")
    everything = page.selection
    assert {path for path in places(page) if path not in ("domain", "arena")} == set(everything)
    page._act("delete")
    assert not [path for path in places(page) if path not in ("domain", "arena")]
    page._act("undo")
    assert page.workplace.text == ROOM
    page.select(["obstacles[0]", "obstacles[1]"])
    page._act("clip")
    page._act("paste:above 2.5 1.0")
    assert page.selection == ["obstacles[3]", "obstacles[4]"]
    pasted = np.array([places(page)[path] for path in page.selection])
    assert (pasted.min(axis=0) + pasted.max(axis=0)) / 2 == pytest.approx((2.5, 1.0), abs=1e-3)
    page._act("paste:side 2.5 1.0")
    assert len(page.scene.data["obstacles"]) == 7
    page._act("undo")
    page._act("undo")
    assert page.workplace.text == ROOM


def test_the_size_is_shown_while_something_is_drawn_and_the_position_while_it_moves(page):
    use(page, "box")
    hold(page, (3.0, 0.3), (3.4, 0.9))
    assert shown(page, "size", "text") == ["0.40 × 0.60 m"]
    page._act("escape")
    assert shown(page, "size", "text") == shown(page, "sketch", "x") == []
    page.pointer.end(page.canvases[ABOVE], (3.4, 0.9))
    assert page.workplace.text == ROOM, "Escape gives up the drag"
    hold(page, (2.75, 1.9), (2.5, 1.4))
    assert shown(page, "size", "text") == ["x 2.50 y 1.40 m"]
    page.pointer.end(page.canvases[ABOVE], (2.5, 1.4))
    x, y = page.scene.thing("obstacles[2]").handles(ABOVE)["turn"]
    hold(page, (x, y), (2.5, 1.7))
    assert shown(page, "size", "text") == ["90°"]
    page._act("escape")
    page.choose("obstacles[0]")
    hold(page, page.scene.thing("obstacles[0]").handles(ABOVE)["rim"], (1.75, 2.1))
    assert shown(page, "size", "text") == ["radius 0.25 m"]


def test_a_box_stops_at_the_edge_of_another_object_unless_alt_is_held(page):
    low = 2.1 - 0.15  # of the cylinder
    start, to = (2.75, 1.9), (2.5, low + 0.175 + 0.01)
    for alt in (False, True):
        hold(page, start, to, alt=alt)
        assert len(shown(page, "guides", "xs")) == (0 if alt else 1)
        page.pointer.end(page.canvases[ABOVE], to, alt=alt)
        bottom = page.scene.thing("obstacles[2]").outlines(ABOVE)[0].points[:, 1].min()
        assert bottom == pytest.approx(low + 0.01 * alt, abs=1e-3)
        assert shown(page, "guides", "xs") == []
        page._act("undo")


def test_walls_are_dragged_without_being_chosen_before(page):
    assert "+0+1" in shown(page, "handles", "name")
    drag(page, (2.0, 3.0), (2.0, 3.4))
    assert page.scene.room == (4.0, 3.4)
    assert page.chosen == "domain"
    page._act("escape")
    page.pointer.tap(page.canvases[ABOVE], (0.9, 3.4))
    assert page.chosen == "domain"


def test_a_movable_opening_goes_before_the_handle_of_its_wall(tmp_path):
    text, path = edits.create(edits.BLANK, opened(tmp_path, edits.BLANK)[1].scene, "outlet", [(4, 1), (4, 2)])
    _, page = opened(tmp_path, text)
    assert set(shown(page, "handles", "name")) == {"+0+1", "+1+1"}
    drag(page, (4.0, 1.5), (4.0, 1.2))
    assert page.scene.room == (4.0, 3.0)
    assert page.scene.thing(path).place() == pytest.approx((4.0, 1.2), abs=1e-3)


@pytest.mark.parametrize(
    ("at", "path", "has", "lacks"),
    [
        ((2.75, 1.9), "obstacles[2]", {"Copy", "Delete", "Turn left 15°", "Open its form"}, {"Whole room"}),
        ((0.0, 0.8), "wind.openings[0]", {"Copy", "Delete"}, {"Turn left 15°", "Paste here"}),
        ((1.0, 0.4), "", {"Paste here", "Whole room"}, {"Copy", "Delete"}),
    ],
)
def test_the_context_menu_has_what_can_be_done_there(page, at, path, has, lacks):
    page._act(f"menu:above {at[0]} {at[1]} 300 200")
    seen = {label for label, item in page.menu.items.items() if item.visible}
    assert page.menu.layout.visible
    assert page.chosen == path
    assert has <= seen
    assert not lacks & seen
    page._act("escape")
    assert not page.menu.layout.visible


def test_the_context_menu_keeps_a_selection_and_pastes_where_it_was_opened(page):
    page.select(["obstacles[0]", "obstacles[2]"])
    page._act("menu:above 2.75 1.9 300 200")
    assert page.selection == ["obstacles[0]", "obstacles[2]"]
    page.menu._do(page.take_clip)
    page._act("menu:above 1.0 0.4 300 200")
    assert not page.menu.items["Paste here"].disabled
    page.menu._do(lambda: page.paste(page.menu.at))
    new = np.array([places(page)[path] for path in page.selection])
    assert (new.min(axis=0) + new.max(axis=0)) / 2 == pytest.approx((1.0, 0.4), abs=1e-3)


@pytest.mark.parametrize("words", ["move:", "move:1 x 1", "move:1 0 nan", "menu:", "menu:above 1", "x"])
def test_broken_acts_of_a_browser_change_nothing(page, words):
    page.select(["obstacles[0]"])
    page._act(words)
    assert page.workplace.text == ROOM
    assert not page.menu.layout.visible


def test_several_objects_move_in_height_from_the_side(tmp_path):
    boxes = "[{kind: box, center: [1, 1, 1], size: [0.4, 0.4, 0.4]}, {kind: box, center: [3, 2, 0.5], size: [1, 1, 1]}]"
    _, page = opened(tmp_path, f"domain: {{size: [4, 3, 2], spacing: 0.1}}\nobstacles: {boxes}\n")
    page.select(["obstacles[1]", "obstacles[0]"])
    drag(page, (1.0, 1.0), (1.2, 1.3), plane=SIDE)
    centers = [box["center"] for box in page.scene.data["obstacles"]]
    assert centers == [[1.2, 1, 1.3], [3.2, 2, 0.8]]


def test_every_kind_is_in_the_palette_once_with_an_icon_and_one_button_is_pressed(page):
    kinds = [kind for group in palette.GROUPS.values() for kind in group]
    assert sorted(kinds) == sorted([palette.SELECT, *edits.KINDS])
    assert set(palette.ICONS) == set(kinds)
    for kind in kinds:
        page.pointer.palette.take(kind)
        assert page.pointer.kind == kind
        pressed = [group for group in page.pointer.palette.groups.values() if group.active is not None]
        assert [group.labels[group.active] for group in pressed] == [kind]


def test_the_views_from_the_side_keep_the_scale_and_the_range_of_the_plan(tmp_path):
    _, page = opened(tmp_path, (ROOT / "configs/arena_3d.yaml").read_text())
    plan, side, front = page.canvases.values()

    def pixels(canvas) -> list[float]:
        return [(end - start) / count for (start, end), count in zip(canvas.view, canvas.pixels, strict=True)]

    def are_aligned() -> None:
        step = plan.pixel()
        assert pixels(plan) == pytest.approx([step, step])
        shown = [canvas for canvas in (side, front) if canvas.figure.visible]
        assert len(shown) == 1
        for canvas in shown:
            assert pixels(canvas) == pytest.approx([step, step])
            beside = plan.view[canvas.plane[0]]
            assert sum(canvas.view[0]) == pytest.approx(sum(beside)), "the same middle"
        assert not side.figure.visible or side.view[0] == plan.view[0]

    for active, canvas in enumerate((side, front)):
        page.side.active = active
        are_aligned()
        canvas.zoom((1.0, 0.2), 0.5)
        are_aligned()
        plan.pan(plan.view, 30, 40)
        are_aligned()
        before = canvas.view
        canvas.pan(before, 50, 10)
        are_aligned()
        step = plan.pixel()
        assert canvas.view[0][0] == pytest.approx(before[0][0] - 50 * step), "right of it is less"
        assert canvas.view[1][0] == pytest.approx(before[1][0] + 10 * step)
        page.fit()
        are_aligned()


def test_a_room_that_is_too_high_for_the_scale_is_squeezed(tmp_path):
    _, page = opened(tmp_path, "domain: {size: [4, 3, 40], spacing: 0.1}\n")
    plan, side, _ = page.canvases.values()
    (left, right), (bottom, top) = side.view
    assert (left, right) == plan.view[0]
    assert bottom < 0 < 40 < top


def test_objects_are_dragged_in_both_views_from_the_side(tmp_path):
    boxes = "[{kind: box, center: [1, 1, 1], size: [0.4, 0.4, 0.4]}, {kind: cylinder, center: [3, 2], radius: 0.2}]"
    robots = "[{count: 2, start: {kind: positions, positions: [[1, 0.5], [2, 2.5]]}}]"
    text = f"domain: {{size: [4, 3, 2], spacing: 0.1}}\nobstacles: {boxes}\nrobots: {robots}\n"
    _, page = opened(tmp_path, text)
    page.side.active = 1
    assert [canvas.figure.visible for canvas in page.canvases.values()] == [True, False, True]
    drag(page, (1.0, 1.0), (1.25, 1.3), plane=FRONT)
    assert page.scene.data["obstacles"][0]["center"] == [1, 1.25, 1.3]
    drag(page, (2.0, 1.0), (1.5, 1.0), plane=FRONT)
    assert page.scene.data["obstacles"][1]["center"] == [3, 1.5]
    middles = [
        outline.points.mean(axis=0)[0] for outline in page.scene.thing("robots[0]").outlines(FRONT)[:2]
    ]
    assert middles == pytest.approx([0.5, 2.5]), "robots are drawn at their y"
    page.side.active = 0
    assert page.canvases[FRONT].plan is page.canvases[ABOVE]
    drag(page, (1.0, 1.3), (1.5, 1.3), plane=SIDE)
    assert page.scene.data["obstacles"][0]["center"] == [1.5, 1.25, 1.3]


@pytest.mark.parametrize("room", ["[4, 3, 2]", "[4, 3]"])
def test_a_mesh_is_placed_and_turned_about_its_middle(tmp_path, room):
    """The origin of its file is far from it, as that of a building's coordinates."""
    corners, faces = ("5 7 0", "6 7 0", "5 7.4 0", "5 7 1"), ("1 3 2", "1 2 4", "2 3 4", "3 1 4")
    lines = [f"v {corner}" for corner in corners] + [f"f {face}" for face in faces]
    (tmp_path / "body.obj").write_text("\n".join(lines))
    mesh = "{kind: mesh, file: body.obj, translate: [-4, -6, 0], section: 0.1}"
    text = f"domain: {{size: {room}, spacing: 0.1}}\nobstacles: [{mesh}]\n"
    _, page = opened(tmp_path, text)

    def handles():
        return page.scene.thing("obstacles[0]").handles(ABOVE)

    page.select(["obstacles[0]"])
    assert handles()["center"] == pytest.approx((1.5, 1.2))
    assert handles()["turn"] == pytest.approx((1.5 + 0.5 + 0.25, 1.2)), "a quarter of a metre from its end"
    drag(page, handles()["center"], (2.0, 1.5), plane=ABOVE)
    assert handles()["center"] == pytest.approx((2.0, 1.5))
    for angle in (40, -100):
        to = np.add((2.0, 1.5), [0.9 * np.cos(np.radians(angle)), 0.9 * np.sin(np.radians(angle))])
        drag(page, handles()["turn"], tuple(to))
        assert page.scene.data["obstacles"][0]["yaw_deg"] == angle
        assert handles()["center"] == pytest.approx((2.0, 1.5), abs=1e-3), "its middle stays, to a millimetre"
        arm = 0.75 * np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
        assert handles()["turn"] == pytest.approx(np.add((2.0, 1.5), arm), abs=2e-3), "points to the pointer"
    page.turn(100)
    assert page.scene.data["obstacles"][0]["yaw_deg"] == 0
    assert page.scene.data["obstacles"][0]["translate"] == pytest.approx([-3.5, -5.7, 0], abs=3e-3)
    for _ in range(4):
        page._undo()
    assert page.workplace.text == text
