"""Completions of the text: keys that a section lacks, values that a key allows, at any place of a text."""

import pytest
import yaml
from test_document import ROOT

pytest.importorskip("bokeh", reason="the extra draw is not installed")
from taichi_plume.draw.checks import check
from taichi_plume.draw.completions import completions
from taichi_plume.scenario.robots import Group
from taichi_plume.scenario.scenario import Scenario

ROOM = (ROOT / "configs/casting_room.yaml").read_text()


def words(before: str, after: str = "") -> list[str]:
    return [each.word for each in completions(before + after, len(before))]


@pytest.mark.parametrize(
    ("before", "after", "has", "lacks"),
    [
        ("", "", "domain: ", "radius: "),
        ("name: a\n", "", "domain: ", "name: "),
        ("obstacles:\n  - ", "", "kind: ", "domain: "),
        ("obstacles:\n  - {kind: box, ", "", "size: ", "radius: "),
        ("obstacles:\n  - {kind: cyl", "}", "cylinder", "size: "),
        ("robots:\n  - name: a\n    algorithm:\n      kind: ", "", "casting", "name: "),
        ("robots:\n  - algorithm:\n      ", "\n    name: a\n", "kind: ", "name: "),
        ("gas:\n  spec", "\n  kind: eulerian\n", "species: ", "kind: "),
        ("stop_early: ", "", "true", "domain: "),
    ],
)
def test_what_may_stand_at_a_place(before, after, has, lacks):
    found = words(before, after)
    assert has in found
    assert lacks not in found


@pytest.mark.parametrize(
    "before", ["# ga", "name: [{", "a: b: c", "name: 'a", "- - ]", "robots: {name: {x: "]
)
def test_places_where_nothing_is_known_offer_nothing(before):
    assert words(before) == []


def test_a_long_word_is_read_in_a_time_in_proportion():
    """A search for the end of a word from each of its characters would take minutes."""
    assert words("a" * 300_000 + " ") == []


def test_all_keys_of_a_section_are_offered_or_given_already():
    assert {word.removesuffix(": ") for word in words("")} == set(Scenario.model_fields)
    found = words(ROOM[: ROOM.index("    count: 4")] + "    ", ROOM[ROOM.index("    count: 4") + 4 :])
    given = set(yaml.safe_load(ROOM)["robots"][0]) - {"count"}  # the key that is being typed
    assert {word.removesuffix(": ") for word in found} == set(Group.model_fields) - given


def test_each_obstacle_that_is_offered_is_a_kind_of_obstacle(tmp_path):
    head = ROOM[: ROOM.index("{kind: cylinder, center: [1.5, 2.1], radius: 0.15}")]
    for word in words(head + "{kind: "):
        faults = check(ROOM.replace("{kind: cylinder,", f"{{kind: {word},"), tmp_path).remarks
        assert not any("obstacles[0].kind" in remark.line for remark in faults)
