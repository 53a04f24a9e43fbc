"""A run's scenario is the base with its changes, whatever the base shares by aliases."""

import pytest
import yaml
from small_study import ROOM

from taichi_plume.scenario.changes import changed
from taichi_plume.scenario.loading import scenario_of
from taichi_plume.study.model import canonical
from taichi_plume.study.resolving import value_at


def test_changes_may_be_numbers_sections_and_lists():
    spiral = {"kind": "spiral"}
    changes = {"wind.openings.0.speed": "20 cm/s", "robots[0].algorithm": spiral, "domain.size": [3, 1]}
    scenario = scenario_of(ROOM, changes)
    assert value_at(scenario, "wind.openings.0.speed") == (pytest.approx(0.2), "m/s")
    assert scenario.robots[0].algorithm.kind == "spiral"
    assert scenario.domain.extent == (3.0, 1.0)
    assert ROOM["wind"]["openings"][0]["speed"] == 0.5
    assert scenario_of(ROOM, {}) == scenario_of(ROOM, {"seed": 3})


def test_what_aliases_share_changes_in_one_place_alone():
    text = """
    a: &part {list: [1, {x: 1}]}
    b: *part
    """
    data = yaml.safe_load(text)
    section = {"y": 1}
    new = changed(data, {"a.list.1.x": 2, "b.more": section, "b.more.y": 5, "a.list.0": 9})
    assert new == {"a": {"list": [9, {"x": 2}]}, "b": {"list": [1, {"x": 1}], "more": {"y": 5}}}
    assert section == {"y": 1}
    assert data == yaml.safe_load(text)


def test_a_path_has_one_way_of_writing():
    assert canonical("robots.0.count") == canonical(" robots[0].count") == canonical("robots[00].count")
