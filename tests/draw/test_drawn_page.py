"""The page without a browser: its views are always those of a fresh page on the same text; two tabs are alike."""

import errno
import json
import os
import re
from base64 import b64encode
from contextlib import suppress
from hashlib import sha256
from itertools import product
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("bokeh", reason="the extra draw is not installed")

from bokeh.document import Document
from hypothesis import given, settings
from hypothesis import strategies as st
from test_document import ROOT
from test_edits import DRAGS, QUIET, points
from test_workplace import full, killed

from taichi_plume.draw import edits, file_menu, workplace
from taichi_plume.draw.document import data_of
from taichi_plume.draw.page import Page
from taichi_plume.draw.runs import Run
from taichi_plume.draw.workplace import Workplace
from taichi_plume.execution.latest_instant import Instant, Picture
from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.yaml_text import LineError
from taichi_plume.observed.scales import Scale
from taichi_plume.report.theme import ABOVE, FRONT, SIDE

ROOM = (ROOT / "configs/casting_room.yaml").read_text()


class Tab(Document):
    """Document of a tab whose callbacks of the next tick are called at once."""

    def add_next_tick_callback(self, callback):
        callback()

    def add_timeout_callback(self, callback, milliseconds):
        callback()


def opened(folder, text=ROOM):
    (folder / "s.yaml").write_text(text)
    place = Workplace(folder, folder / "s.yaml")
    return place, Page(Tab(), place)


@pytest.fixture
def page(tmp_path):
    return opened(tmp_path)[1]


def views(page):
    """All that the views of a page show."""
    return {
        (plane, name): {
            key: [np.asarray(part).tolist() for part in values] for key, values in source.data.items()
        }
        for plane, canvas in page.canvases.items()
        if canvas.figure.visible
        for name, source in canvas.sources.items()
    }


def drag(page, *way, plane=ABOVE):
    canvas = page.canvases[plane]
    page.pointer.start(canvas, way[0])
    for at in way:
        page.pointer.drag(canvas, at, (1, 1))
    page.pointer.end(canvas, way[-1])


def use(page, kind):
    page.pointer.palette.take(kind)


def test_a_drawn_object_is_in_the_text_and_chosen(page):
    use(page, "box")
    drag(page, (3.0, 0.3), (3.2, 0.5), (3.3, 0.6))
    assert "{kind: box, center: [3.15, 0.45], size: [0.3, 0.3]}" in page.workplace.text
    assert page.chosen == "obstacles[3]"
    assert page.text.value_input == page.workplace.text


def test_an_object_is_chosen_and_dragged(page):
    use(page, "select")
    page.pointer.tap(page.canvases[ABOVE], (2.75, 1.9))
    assert page.chosen == "obstacles[2]"
    drag(page, (2.75, 1.9), (2.5, 1.5), (2.25, 1.4))
    assert "{kind: box, center: [2.25, 1.4], size: [0.25, 0.35]}" in page.workplace.text
    page._undo()
    assert page.workplace.text == ROOM


def test_quick_clicks_at_two_places_are_clicks_and_at_one_a_double_click(page):
    """To Bokeh any second click within 0.3 s is a double one."""
    canvas = page.canvases[ABOVE]
    use(page, "source")
    page.pointer.tap(canvas, (1.0, 0.5))
    page.pointer.double_tap(canvas, (1.0, 2.5))
    places = [source["position"] for source in page.scene.data["gas"]["sources"]]
    assert places[1:] == [[1, 0.5], [1, 2.5]]
    use(page, "polygon")
    page.pointer.tap(canvas, (3.0, 0.3))
    page.pointer.double_tap(canvas, (3.3, 0.3))
    page.pointer.tap(canvas, (3.3, 0.6))
    assert len(page.scene.data["obstacles"]) == 3
    page.pointer.double_tap(canvas, (3.3, 0.6))
    assert page.scene.data["obstacles"][3]["vertices"] == [[3, 0.3], [3.3, 0.3], [3.3, 0.6]]


def test_a_handle_of_the_chosen_object_resizes_it(page):
    page.choose("obstacles[2]")
    x, y = page.scene.thing("obstacles[2]").handles(ABOVE)["+1+1"]
    drag(page, (x, y), (3.0, 2.2))
    box = page.scene.thing("obstacles[2]").part.model
    assert box.center == pytest.approx((2.8125, 1.9625), abs=2e-3)


def test_typing_moves_the_drawing_and_the_form(page):
    page.choose("obstacles[0]")
    page.text.value_input = ROOM.replace("center: [1.5, 2.1]", "center: [1.0, 2.0]")
    assert page.scene.thing("obstacles[0]").place() == (1.0, 2.0)
    assert [page.form.widgets[f"obstacles[0].center[{n}]"].value for n in (0, 1)] == ["1.0", "2.0"]
    assert page.workplace.text == page.text.value_input
    page._undo()
    assert page.text.value_input == ROOM, "undo takes back what was typed"


def test_the_form_changes_the_text(page):
    page.choose("obstacles[0]")
    page.form.widgets["obstacles[0].radius"].value = "25 cm"
    assert "radius: 25 cm" in page.workplace.text
    page.form.widgets["obstacles[0].kind"].value = "sphere"
    assert "{kind: sphere, center: [1.5, 2.1], radius: 25 cm}" in page.workplace.text
    page.form.widgets["obstacles[0].radius"].value = "[1, "
    assert "radius: 25 cm" in page.workplace.text


def test_a_mistake_is_marked_at_its_object(page):
    page._typed(ROOM.replace("position: [0.7, 1.45]", "position: [1.5, 2.1]"))
    page.workplace.found(*page.workplace.check())
    marks = page.canvases[ABOVE].sources["marks"].data
    assert (marks["x"], marks["y"]) == ([1.5], [2.1])
    assert "source 1, position" in page.remarks.text
    assert "is inside cylinder 1," in page.remarks.text
    areas = page.canvases[ABOVE].sources["areas"].data
    edges = dict(zip(areas["path"], areas["edge"], strict=True))
    assert edges["gas.sources[0]"] == "#d32f2f"
    assert edges["obstacles[1]"] != "#d32f2f"
    assert "1 error" in page.size.text
    page._undo()
    page.workplace.found(*page.workplace.check())
    assert page.canvases[ABOVE].sources["marks"].data["x"] == []
    assert "7,500 cells" in page.size.text


SECTIONS = {
    "wind": "{kind: cfd, openings: [%s]}",
    "obstacles": "[%s]",
    "robots": "[%s]",
    "gas": "{kind: eulerian, sources: [%s]}",
    "probes": "{points: [%s]}",
    "arena": "%s",
}


ITEMS = ["null", "3", "[2]", "{kind: 5}", "{kind: inlet, face: q}", "{position: [1]}"]


@pytest.mark.parametrize("section", SECTIONS)
def test_sections_with_mistakes_leave_the_page_alive(page, section):
    for size, item in product(("[4, 3]", "[4, 3, 2]"), ITEMS):
        page._typed(f"domain: {{size: {size}, spacing: 0.1}}\n{section}: {SECTIONS[section] % item}\n")
        page.choose(page.scene.things[-1].path)
        page.workplace.found(*page.workplace.check())
        assert page.remarks.text.count(" error</b>") >= 1, item
        assert "missing key" in page.size.text, item


def test_texts_are_shown_as_they_are_and_never_as_html(tmp_path):
    evil = "<img src=x onerror=alert(1)>"
    place, page = opened(tmp_path, ROOM.replace("name: casters", f'name: "{evil}"') + f'"{evil}": 1\n')
    page.choose("robots[0]")
    place.found(*place.check())
    page.say(evil)
    page.ask(evil, lambda: None)
    shown = [
        page.remarks,
        page.message,
        page.banner,
        page.size,
        page.title,
        page.form.purpose,
        page.runs.output,
    ]
    assert all("<img" not in div.text for div in shown)


def test_two_tabs_show_the_same_text(tmp_path):
    place, first = opened(tmp_path)
    second = Page(Tab(), place)
    use(first, "source")
    first.pointer.tap(first.canvases[ABOVE], (1.0, 1.0))
    assert len(second.scene.data["gas"]["sources"]) == 2
    second.form.widgets["seed"].value = "9"
    assert "seed: 9" in first.text.value_input
    assert "position: [1, 1]" in first.text.value_input, "neither tab takes back the other one's edit"
    first.choose("")
    second.choose("")
    assert views(first) == views(second)
    second.leave()
    first._undo()
    assert "seed: 2" in first.text.value_input


class Waiting(Document):
    """Document of a tab whose callbacks wait in a list that all tabs of the test share."""

    def __init__(self, waiting):
        super().__init__()
        self.waiting = waiting

    def add_timeout_callback(self, callback, milliseconds):
        self.waiting.append(callback)


@pytest.fixture
def tabs(tmp_path, monkeypatch):
    """Three pages of a workplace, their waiting callbacks, and a list in which each page that is refreshed is noted."""
    (tmp_path / "s.yaml").write_text(ROOM)
    place, waiting, shown = Workplace(tmp_path, tmp_path / "s.yaml"), [], []
    pages = [Page(Waiting(waiting), place) for _ in range(3)]
    refresh = Page.refresh
    monkeypatch.setattr(Page, "refresh", lambda page: (shown.append(pages.index(page)), refresh(page)))
    return pages, waiting, shown


def work_off(waiting):
    """Call waiting callbacks, one at a time as the server does."""
    while waiting:
        waiting.pop(0)()


def test_the_page_of_an_edit_comes_first_and_the_others_follow(tabs):
    pages, waiting, shown = tabs
    pages[2].edit(lambda: ROOM + "# 1\n")
    assert shown == [2]
    pages[2].edit(lambda: ROOM + "# 2\n")
    assert shown == [2, 2]
    work_off(waiting)
    assert shown == [2, 2, 0, 1], "two edits are shown at once"
    assert [page.text.value_input for page in pages] == 3 * [ROOM + "# 2\n"]


def test_a_tab_in_the_background_shows_changes_once_it_is_seen(tabs):
    pages, waiting, shown = tabs
    pages[1].seen.value = "hidden"
    for n in range(3):
        pages[0].edit(lambda n=n: ROOM + f"# {n}\n")
        work_off(waiting)
    assert 1 not in shown
    assert pages[1].text.value_input == ROOM
    pages[1].seen.value = "visible"
    assert shown.count(1) == 1
    assert pages[1].text.value_input == ROOM + "# 2\n"
    assert views(pages[1]) == views(pages[0])


def test_a_closed_page_follows_no_more(tabs):
    pages, waiting, shown = tabs
    pages[0].leave()
    pages[2].edit(lambda: ROOM + "# 1\n")
    work_off(waiting)
    assert shown == [2, 1]


def test_a_text_is_read_once_for_all_pages(tabs, monkeypatch):
    pages, waiting, _ = tabs
    read = []
    scene = workplace.scene
    monkeypatch.setattr(workplace, "scene", lambda *given: read.append(given) or scene(*given))
    pages[0].edit(lambda: ROOM + "# 1\n")
    work_off(waiting)
    for page in pages:
        page.choose("obstacles[0]")
    assert len(read) == 1


def test_a_file_that_changes_is_read_again(tmp_path):
    (tmp_path / "a.obj").write_text(
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"
    )
    _, page = opened(
        tmp_path, "domain: {size: [4, 3, 2], spacing: 0.1}\nobstacles: [{kind: mesh, file: a.obj}]\n"
    )
    page.choose("obstacles[0]")
    assert np.nanmax(page.scene.thing("obstacles[0]").outlines(ABOVE)[0].points[:, 0]) == pytest.approx(
        1, abs=0.1
    )
    (tmp_path / "a.obj").write_text((tmp_path / "a.obj").read_text().replace("v 1 0 0", "v 2.5 0 0"))
    page.choose("obstacles[0]")
    assert np.nanmax(page.scene.thing("obstacles[0]").outlines(ABOVE)[0].points[:, 0]) == pytest.approx(
        2.5, abs=0.1
    )


def test_pages_do_nothing_while_nothing_changes(tabs):
    pages, waiting, shown = tabs
    for _ in range(3):
        pages[0].workplace.watch()  # as the server does
    assert (waiting, shown) == ([], [])
    assert [page.document.session_callbacks for page in pages] == [[], [], []]


def test_heights_are_dragged_from_the_side(tmp_path):
    _, page = opened(tmp_path, (ROOT / "configs/arena_3d.yaml").read_text())
    assert page.canvases[SIDE].figure.visible
    page.choose("obstacles[2]")
    x, z = page.scene.thing("obstacles[2]").handles(SIDE)["+0+1"]
    drag(page, (x, z), (x, 0.45), plane=SIDE)
    assert page.scene.thing("obstacles[2]").part.model.size[2] == pytest.approx(0.45)


def test_a_file_changed_on_disk_is_asked_about(tmp_path):
    place, page = opened(tmp_path)
    page._typed(ROOM + "# mine\n")
    place.file.write_text(ROOM + "# theirs\n")
    page.save()
    assert page.question.visible
    assert "another program has changed this file" in page.banner.text
    page._no()
    assert place.file.read_text() == ROOM + "# theirs\n"
    assert "Take the file" in page.banner.text
    page._no()
    page.save()
    page._yes()
    assert place.file.read_text() == ROOM + "# mine\n"


def test_another_name_makes_another_file(tmp_path):
    _, page = opened(tmp_path)
    page._typed(ROOM + "# mine\n")
    page.name.value = "other.yaml"
    assert (tmp_path / "other.yaml").read_text() == ROOM + "# mine\n"
    assert (tmp_path / "s.yaml").read_text() == ROOM
    page.name.value = "../other.yaml"
    assert "lies outside" in page.message.text
    assert page.name.value == "other.yaml"
    page.name.value = ""
    assert page.name.value == "other.yaml"
    assert page.message.text == ""


def test_half_a_character_is_refused_in_a_line(page):
    for put in (page._typed, page.put, page.workplace.put):
        text = ROOM.replace("casters", "\ud800")
        if put == page.workplace.put:
            with pytest.raises(InputError, match=r"line \d+ .*U\+D800"):
                put(text)
            continue
        put(text)
        assert "U+D800" in page.message.text
        assert page.workplace.text == page.text.value_input == ROOM
    page.choose("robots[0]")
    page.form.widgets["robots[0].name"].value = "\udfff"
    assert page.workplace.text == ROOM
    page.name.value = "a\0.yaml"
    assert "a\\x00.yaml" in page.message.text or "null byte" in page.message.text
    assert page.name.value == "s.yaml"


def test_a_second_delete_deletes_no_other_object(page):
    page.choose("obstacles[0]")
    page._act("delete")
    once = page.workplace.text
    assert once != ROOM
    page._act("delete")
    assert page.workplace.text == once


def test_a_robot_is_dragged_without_being_chosen_before(page):
    use(page, "robots")
    drag(page, (3.0, 0.3))
    use(page, "select")
    page.choose("")
    drag(page, (3.0, 0.3), (3.2, 0.5))
    assert "positions: [[3.2, 0.5]]" in page.workplace.text


def test_scenarios_are_not_offered_as_maps(page):
    (page.workplace.folder / "hall.yaml").write_text("image: hall.png\nresolution: 0.05\n")
    (page.workplace.folder / "broken.yaml").write_text("[")
    use(page, "map")
    assert page.pointer.file.options == ["hall.yaml"]


def test_a_mesh_is_chosen_by_a_click_inside(tmp_path):
    """From above its upper and its lower triangles cover each other."""
    corners, faces = ("0 0 0", "1 0 0", "0 1 0", "0 0 1"), ("1 3 2", "1 2 4", "2 3 4", "3 1 4")
    lines = [f"v {corner}" for corner in corners] + [f"f {face}" for face in faces]
    (tmp_path / "body.obj").write_text("\n".join(lines))
    _, page = opened(
        tmp_path,
        "domain: {size: [4, 3, 2], spacing: 0.1}\nobstacles: [{kind: mesh, file: body.obj, translate: [2, 1, 0.5]}]",
    )
    canvas = page.canvases[ABOVE]
    assert canvas.thing_at(page.scene, (2.3, 1.3)) == "obstacles[0]"
    assert canvas.thing_at(page.scene, (2.8, 1.8)) is None


CODE = "class Mine:\n    def act(self, robots):\n        pass\n"


@pytest.fixture
def coded(tmp_path, monkeypatch):
    """A page whose text names Python code, and the list of (text, flags) of the runs that it starts."""
    (tmp_path / "mine.py").write_text(CODE)
    text = ROOM.replace("{kind: casting, threshold_ppm: 5}", "{kind: own, file: mine.py}", 1)
    page, started = opened(tmp_path, text)[1], []

    monkeypatch.setattr(Run, "start", lambda run, folder, root, flags: started.append((run.text, flags)))
    return page, started


def flags_of(code: str) -> list[str]:
    return ["--allow-sha256", sha256(code.encode()).hexdigest()]


def test_own_code_is_run_after_the_question_of_the_command_alone(coded):
    page, started = coded
    page.run()
    assert not started
    assert "holds Python code, which will run with all your rights (SHA-256" in page.banner.text
    page._no()
    assert not started
    page.run()
    page._yes()
    assert started == [(page.workplace.text, flags_of(CODE))]


@pytest.mark.parametrize("here", [True, False])
def test_a_text_that_changes_before_the_answer_is_not_run(coded, here):
    page, started = coded
    (page.workplace.folder / "other.py").write_text(CODE + "# other\n")
    asked = page.workplace.text
    page.run()
    editor = page if here else Page(Tab(), page.workplace)
    editor._typed(asked.replace("mine.py", "other.py"))
    page._yes()
    assert started == [(asked, flags_of(CODE))]
    assert page.workplace.text != asked


def test_code_that_changes_before_the_answer_is_asked_about_again(coded):
    page, started = coded
    page.run()
    other = CODE + "# other\n"
    (page.workplace.folder / "mine.py").write_text(other)
    page._yes()
    assert not started
    assert sha256(other.encode()).hexdigest()[:16] in page.banner.text
    page._yes()
    assert started == [(page.workplace.text, flags_of(other))]


def test_questions_and_messages_name_the_objects_of_their_text(coded):
    page, _ = coded
    asked = page.workplace.text
    (name,) = {thing.name for thing in page.scene.things if thing.path == "robots[0]"}
    page.run()
    page._typed(asked.replace(name, "others"))
    (page.workplace.folder / "mine.py").write_text(CODE + "# other\n")
    assert page.scene.named("robots[0]") == "others"
    page._yes()
    assert page.banner.text.startswith(f"{name}, algorithm.file: {page.workplace.folder}")
    page.say("robots[0].start: is wrong")
    Page(Tab(), page.workplace)._typed(asked)
    assert page.message.text == "others, start: is wrong", "also after the page has followed another text"


def sight_at(t):
    gas = np.array([[0.0, 0.01], [10.0, 1e6]], np.float32)
    warmth = np.array([[293.0, 294.0], [295.0, np.nan]], np.float32)
    pictures = {
        "gas_slice": Picture("ethanol", "ppm", Scale(0.1, 1000.0, "log"), 2.0, gas),
        "temperature_slice": Picture("temperature", "K", Scale(293.0, 295.0, "linear"), 2.0, warmth),
    }
    arrays = {"slice": np.ones((4, 3))}, np.ones((3, 2)), np.ones((5, 3))
    return Instant(t, 10.0, 0.1, 2.0, "running", *arrays, pictures)


def test_the_picture_of_a_run_lies_under_the_objects(page):
    canvas: Any = page.canvases[ABOVE]
    run = running(page, 1.0)

    def image():
        rgba = canvas.sources["image"].data["image"][0]
        return rgba.view(np.uint8).reshape(*rgba.shape, 4)[:: len(rgba) - 1, :: len(rgba) - 1]

    assert image()[..., 3].tolist() == [[0, 0], [255, 255]], "air without gas is transparent"
    assert page.hint.text.startswith("ethanol from 0.1 ppm (white) to 1000 ppm (dark), logarithmic")
    select = page.runs.quantity
    assert select.visible
    assert select.options == [("gas_slice", "ethanol"), ("temperature_slice", "temperature")]
    select.value = "temperature_slice"
    assert image()[..., 3].tolist() == [[255, 255], [255, 0]], "solids are transparent"
    low, middle, high = image().reshape(4, 4)[:3, :3].astype(int)  # corners
    assert low[2] > low[0], "blue"
    assert high[0] > high[2], "red"
    assert middle.min() > 150, "pale"
    assert page.hint.text.startswith("temperature from 293 K (blue) to 295 K (red); lines")
    run.sight = sight_at(2.0)
    page.look()
    assert select.value == "temperature_slice", "the choice stays"
    run.sight = run.sight._replace(pictures=dict([*run.sight.pictures.items()][:1]))
    page.look()
    assert not select.visible
    assert page.runs.picture.unit == "ppm"
    assert len(canvas.sources["robots"].data["x"]) == 2
    canvas.show_run(None)
    assert canvas.sources["image"].data["image"] == []


def running(page, t):
    """Let a run of the present text be alive at a time [s]."""
    runs = page.workplace.runs
    run = Run(len(runs) + 1, page.workplace.root / "runs", page.workplace.text, scene=page.scene)
    process: Any = SimpleNamespace(poll=lambda: None)
    run.process = process
    run.sight = sight_at(t)
    runs.append(run)
    page.look()
    return run


@pytest.mark.parametrize(
    ("t", "y"), [(-1.0, 0.5), (0.0, 0.5), (2.5, 1.5), (5.5, 2.5), (8.5, 1.5), (14.5, 1.5)]
)
def test_a_walker_is_drawn_where_it_is_at_the_time_of_the_run(tmp_path, t, y):
    """By hand: 2 m in 5 s to and in 5 s fro, with 1 s of rest at both ends, from (1.8, 0.5)."""
    page = opened(tmp_path, (ROOT / "configs/moving_obstacle.yaml").read_text())[1]
    canvas: Any = page.canvases[ABOVE]

    def start():
        areas = canvas.sources["areas"].data
        return areas["alpha"][areas["path"].index("obstacles[0]")]

    as_drawn = start()
    run = running(page, t)
    xs, ys = (np.asarray(canvas.sources["walkers"].data[key][0]) for key in ("xs", "ys"))
    assert len(canvas.sources["walkers"].data["xs"]) == 1
    assert ((xs.min() + xs.max()) / 2, (ys.min() + ys.max()) / 2) == pytest.approx((1.8, y))
    assert (xs.max() - xs.min(), ys.max() - ys.min()) == pytest.approx((0.4, 0.4))
    assert start() < 0.5 * as_drawn, "the walker is not drawn as a body where it started"
    assert canvas.note.text == ""
    run.process, run.sight = None, None
    page.look()
    assert canvas.sources["walkers"].data["xs"] == []
    assert start() == as_drawn


def test_a_walker_of_a_room_in_3d_moves_in_both_views(tmp_path):
    text = (ROOT / "configs/arena_3d.yaml").read_text() + "# a walker\n"
    page = opened(tmp_path, text)[1]
    edited = edits.create(text, page.scene, "walker", [(1.0, 1.0), (2.0, 1.0)])[0]
    page.put(edited)
    running(page, 1.0)  # at 0.5 m/s
    for plane, canvas in page.canvases.items():
        page.side.active = int(plane == FRONT)
        walkers: Any = canvas.sources["walkers"].data
        xs = np.asarray(walkers["xs"])
        assert len(xs) == 1
        assert (xs.min() + xs.max()) / 2 == pytest.approx(1.0 if plane == FRONT else 1.5), "along x"


def test_the_gas_of_a_run_is_said_to_belong_to_an_older_room(page):
    canvas: Any = page.canvases[ABOVE]
    running(page, 1.0)
    assert canvas.note.text == ""
    page.choose("obstacles[0]")
    for number, value in enumerate(("1.0", "2.0")):
        page.form.widgets[f"obstacles[0].center[{number}]"].value = value
    page.form.widgets["obstacles[0].radius"].value = "0.3"
    page.put(edits.with_values(page.workplace.text, "domain", {"size": [8.0, 3.0]}))
    assert "run 1" in canvas.note.text
    earlier = canvas.sources["earlier"].data
    ends = [(min(xs), max(xs), min(ys), max(ys)) for xs, ys in zip(earlier["xs"], earlier["ys"], strict=True)]
    assert sorted(ends) == [pytest.approx((0, 4, 0, 3)), pytest.approx((1.35, 1.65, 1.95, 2.25))]
    assert canvas.sources["image"].data["dw"] == [4.0], "the gas is as wide as the room of the run"
    page._typed("robots: [")
    assert len(canvas.sources["earlier"].data["xs"]) == 2, "the last room stays while the text cannot be read"
    assert page.chosen == "obstacles[0]"
    for _ in range(5):
        page._undo()
    assert canvas.note.text == ""
    assert canvas.sources["earlier"].data["xs"] == []
    assert "ppm" in page.hint.text
    use(page, "inlet")
    assert "ppm" not in page.hint.text, "the use of the tool"
    use(page, "select")
    assert "ppm" in page.hint.text
    page.workplace.runs[0].process = None
    page._typed(page.workplace.text + "# more\n")
    assert canvas.sources["image"].data["image"] == []
    assert "ppm" not in page.hint.text, "the scale goes with the gas"


def test_the_answer_to_a_question_about_a_draft(tmp_path):
    place, page = opened(tmp_path)
    page._typed(ROOM + "# mine\n")
    killed(place)
    again = Workplace(tmp_path, place.file)
    first, second = Page(Tab(), again), Page(Tab(), again)
    assert "Take them?" in first.banner.text
    assert second.question.visible
    first._yes()
    assert again.text == ROOM + "# mine\n"
    assert not second.question.visible, "a question is answered on one page for all"


def test_a_draft_that_cannot_be_written_is_mentioned_until_it_can(page, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr(Path, "write_bytes", full)
        page._typed(ROOM + "# mine\n")
        page.say("")
        assert f"draft: {os.strerror(errno.ENOSPC)}" in page.message.text
    page.workplace.retry_draft()
    assert page.message.text == ""


moves = st.lists(
    st.one_of(
        st.tuples(st.just("draw"), st.sampled_from(sorted(DRAGS)), points, points),
        st.tuples(st.just("drag"), points, points),
        st.tuples(st.just("tap"), points),
        st.tuples(st.sampled_from(["_undo", "_redo", "copy", "delete", "_escape", "select_all", "take_clip", "paste"])),
        st.tuples(st.just("turn"), st.sampled_from([15, -15])),
        st.tuples(st.just("type"), st.sampled_from(["# note\n", "robots: [", ""])),
    ),
    min_size=1, max_size=8,
)  # fmt: skip


def live_through(folder, name, sequence):
    """Use a page as by a pointer; afterwards its views are those of a fresh page on the same text."""
    place, page = opened(folder, (ROOT / f"configs/{name}.yaml").read_text())
    last = place.text  # that could be read
    for kind, *rest in sequence:
        if kind == "draw":
            use(page, rest[0])
            drag(page, *rest[1:])
        elif kind in ("drag", "tap"):
            use(page, "select")
            drag(page, *rest) if kind == "drag" else page.pointer.tap(page.canvases[ABOVE], *rest)
        elif kind == "turn":
            page.turn(*rest)
        elif kind == "type":
            page._typed(place.text + rest[0])
        else:
            getattr(page, kind)()
        assert page.text.value_input == place.text
        with suppress(LineError):
            data_of(place.text)
            last = place.text
    fresh = Page(Tab(), Workplace(folder, place.file))
    fresh.workplace.put(last)
    fresh.workplace.put(place.text)
    fresh.choose(page.chosen)
    page.choose(page.chosen)
    use(page, "select")
    use(fresh, "select")
    assert views(page) == views(fresh)


@settings(max_examples=3, **QUIET)
@given(name=st.sampled_from(["casting_room", "arena_3d"]), sequence=moves)
def test_the_views_are_those_of_the_text(tmp_path_factory, name, sequence):
    live_through(tmp_path_factory.mktemp("page"), name, sequence)


@pytest.mark.slow
@settings(max_examples=60, **QUIET)
@given(name=st.sampled_from(["casting_room", "arena_3d", "moving_obstacle"]), sequence=moves)
def test_the_views_are_those_of_the_text_after_many_moves(tmp_path_factory, name, sequence):
    live_through(tmp_path_factory.mktemp("page"), name, sequence)


def test_a_text_between_dollar_signs_is_no_mathematics(page):
    """Bokeh's TeX has links that run scripts."""
    page.ask("Delete $$x$$?", lambda: None)
    assert page.banner.disable_math
    assert page.runs.output.disable_math


def test_a_draft_that_cannot_be_read_is_said_once_its_file_is_opened(page):
    folder = page.workplace.folder
    (folder / "other.yaml").write_text(ROOM)
    (folder / ".other.yaml.01234567.draft").symlink_to(folder / "s.yaml")
    page.files.chosen(file_menu.OPEN)
    page.files.work()
    assert page.workplace.file.name == "other.yaml"
    assert "01234567" in page.message.text


def test_files_are_opened_brought_and_named_from_the_menu(page, tmp_path):
    place, menu = page.workplace, page.files
    (tmp_path / "other.yaml").write_text(edits.BLANK)
    menu.chosen(file_menu.OPEN)
    assert menu.list.options == ["other.yaml"]
    menu.work()
    assert (place.file.name, place.text, menu.layout.visible) == ("other.yaml", edits.BLANK, False)
    menu.chosen(file_menu.NAME)
    menu.entry.value = "s.yaml"
    menu.work()
    assert "s.yaml: exists already" in page.message.text
    assert menu.layout.visible, "another name can be given"
    menu.entry.value = "third.yaml"
    menu.work()
    assert (tmp_path / "third.yaml").read_text() == edits.BLANK
    menu.chosen(file_menu.BRING)
    menu.brought = SimpleNamespace(filename="mine.yaml", value=b64encode(ROOM.encode()).decode())
    menu.bring()
    assert (place.file.name, place.text) == ("mine.yaml", ROOM)
    menu.chosen(file_menu.EXAMPLE)
    menu.list.value = "gaussian"
    menu.work()
    assert place.file.name == "gaussian.yaml"
    menu.chosen(file_menu.NEW)
    assert (place.text, page.text.value_input) == (edits.BLANK, edits.BLANK)


def test_an_empty_room_lists_what_a_run_lacks_until_it_has_it(tmp_path):
    place, page = opened(tmp_path, edits.BLANK)
    place.found(*place.check())
    assert re.findall("data-act=.draw:([a-z]+)", page.size.text) == ["inlet", "outlet", "source", "robots"]
    page._act("draw:source")
    assert page.pointer.kind == "source"
    page.pointer.tap(page.canvases[ABOVE], (1.0, 1.0))
    for kind, x in (("inlet", 0.0), ("outlet", 4.0)):
        page._act(f"draw:{kind}")
        drag(page, (x, 1.0), (x, 2.0))
    place.found(*place.check())
    assert "cells" in page.size.text


def test_a_remark_chooses_its_object_and_its_line(page):
    page._typed(ROOM.replace("position: [0.7, 1.45]", "position: [1.5, 2.1]"))
    page.workplace.found(*page.workplace.check())
    (act,) = re.findall("data-act='([^']+)'", page.remarks.text)
    page._act(act)
    assert page.chosen == "gas.sources[0]"
    notes = json.loads(page.notes.value)
    line = next(n for n, line in enumerate(ROOM.splitlines()) if "position:" in line)
    assert [mark["row"] for mark in notes["marks"]] == [line]
    assert notes["row"] == line
