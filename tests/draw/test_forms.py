"""Forms: typed entries, units, limits and defaults; each entry changes its own characters of the text alone."""

import pytest

pytest.importorskip("bokeh", reason="the extra draw is not installed")

from test_document import ROOT
from test_drawn_page import ROOM, opened
from test_edits import every

from taichi_plume.draw import forms
from taichi_plume.draw.document import EditError, data_of, value_at
from taichi_plume.scenario.loading import read_scenario

HALL = (ROOT / "configs/arena_3d.yaml").read_text()


def entered(path, entry, text=ROOM):
    return forms.entered(text, data_of(text), path, entry)


def by_key(path, text=ROOM):
    return {row.key: row for row in forms.rows(data_of(text), path)}


@pytest.fixture
def page(tmp_path):
    return opened(tmp_path)[1]


@pytest.mark.parametrize(
    ("path", "entry", "old", "new"),
    [
        ("obstacles[0].center[1]", "2.25", "center: [1.5, 2.1]", "center: [1.5, 2.25]"),
        ("obstacles[0].center[0]", "120 cm", "center: [1.5, 2.1]", "center: [120 cm, 2.1]"),
        ("domain.size[0]", "5", "size: [4 m, 3 m]", "size: [5 m, 3 m]"),
        ("domain.size[2]", "0.5", "size: [4 m, 3 m]", "size: [4 m, 3 m, 0.5]"),
        ("duration", "80", "duration: 75 s", "duration: 80 s"),
        ("duration", "3 min", "duration: 75 s", "duration: 3 min"),
        ("seed", "3", "seed: 2\n", "seed: 3\n"),
        ("robots[0].name", "7", "name: casters", "name: '7'"),
    ],
)
def test_an_entry_changes_its_own_characters_alone(path, entry, old, new):
    assert ROOM.count(old) == 1
    assert entered(path, entry) == ROOM.replace(old, new)


def test_a_key_of_a_list_where_a_section_should_be_is_not_removed():
    text = "robots: [[1]]\n"
    assert entered("robots[0].wake", "", text) == text


def test_a_slider_of_a_value_with_a_word_that_is_no_unit_changes_nothing(page):
    text = ROOM.replace("duration:", "tick: 5 foo\nduration:")
    page.put(text)
    line = page.form.lines["tick"]
    page.form.slid(line, 0.5)
    assert page.workplace.text == text
    assert "tick: must have a unit" in line.note.text


@pytest.mark.parametrize("name", ["casting_room", "arena_3d", "moving_obstacle"])
def test_what_a_form_shows_is_what_the_text_has(name):
    text = (ROOT / f"configs/{name}.yaml").read_text()
    shown = 0
    for path, _ in every(read_scenario(ROOT / f"configs/{name}.yaml")):
        for row in by_key(path, text).values():
            if row.field in ("number", "point") and row.value:
                for n, (number, _unit) in enumerate(row.numbers):
                    place = f"{row.path}[{n}]" if row.field == "point" else row.path
                    assert entered(place, number, text) == text, place
                    shown += 1
            elif row.field in ("choice", "switch", "text") and row.value:
                assert entered(row.path, row.value, text) == text, row.path
    assert shown > 15


@pytest.mark.parametrize(
    ("path", "entry", "words"),
    [
        ("obstacles[0].radius", "-1", ["radius", "-1", "1e-06 m"]),
        ("obstacles[0].radius", "3 kg", ["radius", "3 kg", "m"]),
        ("obstacles[0].center[0]", "far", ["center[0]", "far", "m"]),
        ("obstacles[0].radius", "[1, ", ["radius"]),
        ("obstacles[0].radius", "", ["radius", "has to be given"]),
        ("obstacles[0].center[0]", "", ["center[0]", "has to be given"]),
        ("seed", "1.5", ["seed", "1.5", "whole number"]),
        ("robots[0].count", "0", ["count", "0", "1"]),
        ("obstacles[0].kind", "ball", ["kind", "ball", "cylinder"]),
    ],
)
def test_an_entry_that_the_key_cannot_have_is_refused(path, entry, words):
    with pytest.raises(EditError) as caught:
        entered(path, entry)
    (line,) = caught.value.lines
    assert all(word in line for word in words), line


def test_what_is_wrong_with_the_whole_scenario_or_with_other_keys_is_no_refusal():
    inside = entered("gas.sources[0].position[0]", "1.5")
    assert value_at(data_of(inside), "gas.sources[0].position") == [1.5, 1.45]
    broken = ROOM.replace("radius: 0.15", "radius: -1")
    assert "center: [1, 2.1]" in entered("obstacles[0].center[0]", "1", broken)
    assert "seed: 5\n" in entered("seed", "5", broken + "nonsense: 1\n")


def test_keys_are_entered_by_their_type():
    cylinder = by_key("obstacles[0]")
    assert {key: row.field for key, row in cylinder.items()} == {
        "kind": "choice", "center": "point", "radius": "number", "base": "number", "height": "number",
        "motion": "section",
    }  # fmt: skip
    assert cylinder["center"].axes == ("x", "y")
    assert cylinder["center"].numbers == [("1.5", "m"), ("2.1", "m")]
    assert by_key("domain")["size"].numbers == [("4", "m"), ("3", "m"), ("", "m")], (
        "a height would make it 3-D"
    )
    assert by_key("")["stop_early"].field == "switch"
    assert by_key("")["obstacles"].field == "list"
    assert by_key("gas")["species"].field == "choice"
    assert by_key("gas")["inflow"].field == "text", "a list that has no items yet"
    boxes = by_key("obstacles[1]", HALL)
    assert boxes["center"].axes == ("x", "y", "z")
    face = HALL.replace("{kind: honeycomb, face: x+}", "{kind: outlet, face: y+, size: [1, 0.2]}")
    assert by_key("wind.openings[1]", face)["size"].axes == ("x", "z")
    assert by_key("wind.openings[1]", face)["center"].axes == ("x", "z")
    assert by_key("wind.openings[0]")["center"].axes == ("y",)
    flat = ROOM.replace("center: [1.5, 2.1]", "center: everywhere").replace("radius: 0.15", "radius: [1]")
    assert {by_key("obstacles[0]", flat)[key].field for key in ("center", "radius")} == {"text"}


@pytest.mark.parametrize(
    ("path", "key", "limits"),
    [
        ("robots[0].algorithm", "peak_fraction", (0, 1)),
        ("robots[0].algorithm", "upwind_angle_deg", (0, 80)),
        ("wind.openings[0]", "turbulence_intensity", (0, 1)),
        ("wind.openings[0]", "speed", None),  # 0 to 100 m/s excludes slips
        ("obstacles[0]", "radius", None),
    ],
)
def test_a_slider_is_offered_for_a_narrow_range_of_the_model(path, key, limits):
    slider = by_key(path)[key].about.slider
    assert (slider and slider[:2]) == limits


def test_a_slider_writes_in_the_unit_of_the_text():
    text = ROOM.replace("face: x-,", "face: x-, temperature: 25 degC,")
    row = by_key("wind.openings[0]", text)["temperature"]
    assert row.position == pytest.approx(298.15)
    new = entered(row.path, row.slid(306.0), text)
    given = by_key("wind.openings[0]", new)["temperature"]
    assert (given.position, given.numbers[0][1]) == (pytest.approx(306.0), "degC")


def test_a_summary_tells_the_kind_first():
    assert forms.summary({"start": {"kind": "line"}, "kind": "cfd", "n": 2}) == "cfd, start line, n 2"
    assert by_key("robots[0]")["start"].field == "section"


def test_a_drag_of_a_slider_is_one_step(page):
    page.choose("robots[0].algorithm")
    page.form._unfold()
    slider = page.form.lines["robots[0].algorithm.peak_fraction"].slider
    for value in (0.5, 0.4, 0.3):
        slider.value = value
    assert page.workplace.text == ROOM, "while it is dragged"
    slider.trigger("value_throttled", 0.7, 0.3)  # readonly in Python: as the browser sets it
    assert value_at(page.scene.data, "robots[0].algorithm.peak_fraction") == 0.3
    page._undo()
    assert page.workplace.text == ROOM
    assert slider.value == 0.7, "the default"


def test_a_refused_entry_says_so_at_its_field_and_does_not_stay(page):
    page.choose("obstacles[0]")
    page.form.widgets["obstacles[0].radius"].value = "-1"
    line = page.form.lines["obstacles[0].radius"]
    assert page.workplace.text == ROOM
    assert line.fields[0].value == "0.15"
    assert all(word in line.note.text for word in ("radius", "-1", "1e-06 m"))
    assert line.note in line.layout.children
    page.form.widgets["obstacles[0].radius"].value = "0.2"
    assert line.note not in line.layout.children
    page.form.widgets["obstacles[0].radius"].value = "0.20"
    assert line.fields[0].value == "0.2", "what the text has"


def test_a_default_is_grey_and_returned_to(page):
    page.choose("robots[0].algorithm")
    page.form._unfold()
    line = page.form.lines["robots[0].algorithm.peak_fraction"]
    assert (line.fields[0].value, line.fields[0].placeholder, line.reset.disabled) == ("", "0.7", True)
    line.fields[0].value = "0.5"
    assert not line.reset.disabled
    page.form.entered(line, "")
    assert page.workplace.text == ROOM
    needed = page.form.lines["robots[0].algorithm.kind"]
    assert needed.reset.disabled
    page.choose("obstacles[0]")
    assert page.form.lines["obstacles[0].radius"].reset.disabled


def test_a_change_of_kind_says_which_keys_went(page):
    page.choose("obstacles[1]")
    page.form.widgets["obstacles[1].kind"].value = "sphere"
    note = page.form.lines["obstacles[1].kind"].note.text
    assert all(key in note for key in ("size", "yaw_deg"))
    assert "center" not in note
    page._undo()
    assert page.workplace.text == ROOM
    assert (
        page.form.lines["obstacles[1].kind"].note not in page.form.lines["obstacles[1].kind"].layout.children
    )


def test_a_point_is_taken_once_all_of_its_numbers_are_given(page):
    page.choose("wind.openings[1]")
    page.choose("arena")
    low = page.form.lines["arena.low"]
    low.fields[0].value = "0.5"
    assert page.workplace.text == ROOM
    assert "y" in low.note.text
    assert low.fields[0].value == "0.5"
    low.fields[1].value = "20 cm"
    assert value_at(page.scene.data, "arena") == {"low": [0.5, "20 cm"]}
    assert low.fields[1].suffix == "cm"


def test_fields_stay_while_the_text_changes_elsewhere(page):
    page.choose("obstacles[0]")
    children = page.form.rows.children[-1].children
    fields = dict(page.form.widgets)
    page._typed(ROOM.replace("seed: 2", "seed: 9").replace("radius: 0.15", "radius: 0.15, height: 0.3"))
    assert page.form.rows.children[-1].children is children
    assert page.form.widgets == fields
    page.choose("obstacles[1]")
    field = page.form.widgets["obstacles[1].center[0]"]
    page.choose("obstacles[2]")
    assert page.form.widgets["obstacles[2].center[0]"] is field
    field.value = "2.8"
    assert value_at(page.scene.data, "obstacles[1].center") == [1.7, 0.75], (
        "the field is that of the other box now"
    )
    assert value_at(page.scene.data, "obstacles[2].center") == [2.8, 1.9]
    assert [form.visible for form in page.form.rows.children].count(True) == 1


def test_rare_keys_are_folded(page):
    page.choose("robots[0]")
    assert "robots[0].first_trial" not in page.form.lines
    assert page.form.more.visible
    page.form._unfold()
    assert "robots[0].first_trial" in page.form.lines
    assert not page.form.more.visible


def test_an_item_of_a_list_is_opened_or_copied(page):
    page.choose("gas")
    menu = page.form.widgets["gas.sources"]
    assert [value for value, _ in menu.options] == ["", "gas.sources[0]", "+"]
    menu.value = "+"
    assert page.chosen == "gas.sources[1]"
    assert value_at(page.scene.data, "gas.sources[1]") == value_at(page.scene.data, "gas.sources[0]")
