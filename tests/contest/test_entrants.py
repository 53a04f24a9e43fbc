"""Algorithms that take part in a contest, and the keys that they are given; nothing is run."""

from pathlib import Path

import numpy as np
import pytest

from taichi_plume.api.own import Own
from taichi_plume.assembly.preparation import prepare
from taichi_plume.contests import page
from taichi_plume.contests.entrants import (
    FILES,
    FLOOR,
    TEAM,
    entrants,
    kinds,
    known,
    learnt,
    own,
    shipped,
)
from taichi_plume.contests.execution import (
    FOLDER,
    NAMES,
    Choice,
    Contest,
    contest_of,
    fixed,
    plans,
    scenarios,
)
from taichi_plume.scenario.changes import changed
from taichi_plume.scenario.loading import ScenarioError, scenario_from

OWN = "class Mine:\n    def act(self, robots):\n        robots.speed[:] = 0.1\n"


def test_all_that_search_take_part_and_the_floor_is_last():
    names = [one.name for one in shipped()]
    searching = {name for name, kind in kinds().items() if kind.searches}
    assert searching <= {*names, *FILES}
    assert {"casting", "infotaxis", "dapso"} <= set(names)
    assert names[-1] == FLOOR
    assert not {"own", "lineup", "sweep", "least_known"} & set(names)


@pytest.mark.parametrize("name", NAMES)
def test_a_fixed_scenario_is_sound(name):
    """Nothing is wrong or unlikely, its head puts a question, and each who takes part fits into it."""
    one = fixed(name, 3, 5)
    prepared = prepare(one.scenario, FOLDER)
    assert not prepared.resources.faults
    assert not prepared.resources.warnings
    assert one.scenario.seed == 3
    assert one.scenario.robots[0].trials == 5
    assert one.about[1].startswith("The question: ")
    assert one.about[1].rstrip().endswith((".", "?"))
    assert set(one.facts) == {"threshold_ppm", "wind_speed"}
    for each in Contest(FOLDER, (one,), shipped(), 1).entrants_in(one):
        scenario = scenario_from(changed(one.data, each.changes(one.facts)))
        group = scenario.robots[0]
        assert group.count == (TEAM if each.name == "dapso" else 1)
        assert not prepare(scenario, FOLDER).resources.faults


def test_all_scenarios_have_the_same_robot_and_chances():
    """But for the height of a sensor, which only 3-D has, and for the drone."""
    drone = fixed("drone").scenario.robots[0]
    assert drone.body.flies
    assert drone.reach == 0.25
    groups = [fixed(name).scenario.robots[0] for name in NAMES if name != "drone"]
    gas = [group.sensors.gas.model_copy(update={"height": 0}) for group in groups]
    assert all(one == gas[0] for one in gas)
    for group in groups:
        assert group.body == groups[0].body
        assert group.reach == 0.25  # as the page says
    assert {fixed(name).scenario.duration for name in NAMES} == {300.0}


def test_who_climbs_takes_part_where_robots_fly():
    there = Contest(FOLDER, (fixed("open_3d"), fixed("drone")), shipped(), 1)
    floor, air = ({each.name for each in there.entrants_in(one)} for one in there.scenarios)
    assert air - floor == {name for name, kind in kinds().items() if kind.in_space and name not in FILES}
    assert floor < air
    with pytest.raises(ScenarioError, match="scenario open_2d"):
        contest_of(Choice(["casting_3d"], scenarios=["open_2d", "drone"]))


def test_each_is_given_what_it_has_a_key_for():
    one, there = fixed("closed_room"), {each.name: each for each in shipped()}
    expected = {name: each.changes(one.facts)["robots.0.algorithm"] for name, each in there.items()}
    assert expected["casting"] == {"kind": "casting", "threshold_ppm": one.facts["threshold_ppm"]}
    assert expected["infotaxis"]["wind_speed"] == one.facts["wind_speed"]
    assert expected["spiral"] == {"kind": "spiral", "minimum_ppm": one.facts["threshold_ppm"]}
    assert expected["random_walk"] == {"kind": "random_walk"}


def test_what_is_written_is_a_study_that_can_be_run_by_itself(tmp_path):
    (tmp_path / "mine.py").write_text(OWN)
    some = entrants(["casting", "dapso"], [tmp_path / "mine.py"])
    contest = Contest(tmp_path / "out", (fixed("open_2d", 4, 3),), tuple(some), 6)
    (plan,) = plans(contest)
    assert plan.file == tmp_path / "out" / "scenarios" / "open_2d.study.yaml"
    assert len(plan.requests) == 3 * 6
    assert plan.requests[0].changes["robots[0].found"] == "reached"
    assert len({one.air for one in plan.requests}) == 6
    assert {one.values["algorithm"] for one in plan.requests} == {"casting", "dapso", "mine"}


def test_an_unknown_name_is_shown_harmless():
    with pytest.raises(ScenarioError, match=r"algorithm '\\x1b\[2J': there is none"):
        known("algorithm", ["\x1b[2J"], ["casting"])


@pytest.mark.parametrize(
    ("name", "text", "expected"),
    [
        ("none.py", None, "does not exist"),
        ("list.txt", OWN, "is no Python file"),
        ("empty.py", "x = 1\n", "holds not exactly one class with a method act; there are: none"),
        ("broken.py", "def act(:\n", "line 1"),
        ("casting.py", OWN, "another algorithm of the contest is called casting; rename the file"),
        ("infotaxis_declares.py", OWN, "another algorithm of the contest is called infotaxis_declares"),
    ],
)
@pytest.mark.parametrize("names", [None, ["casting"]])
def test_a_file_that_is_no_algorithm_is_refused(tmp_path, name, text, expected, names):
    if text is not None:
        (tmp_path / name).write_text(text)
    with pytest.raises(ScenarioError) as error:
        entrants(names, [tmp_path / name])
    assert expected in str(error.value)
    assert "\n" not in str(error.value)


def test_names_are_given_once_and_in_order():
    assert scenarios(["obstacles", "open_2d", "obstacles"], ()) == ["open_2d", "obstacles"]
    assert scenarios(None, NAMES) == list(NAMES)


def test_an_own_file_is_found_from_anywhere(tmp_path, monkeypatch):
    (tmp_path / "mine.py").write_text(OWN)
    monkeypatch.chdir(tmp_path)
    assert own(Path("mine.py")).section == {"kind": "own", "file": str(tmp_path / "mine.py")}


def test_a_policy_is_a_network_or_that_of_a_scenario(tmp_path):
    (tmp_path / "seeker.onnx").write_bytes(b"")
    network = str(tmp_path / "seeker.onnx")
    assert learnt(tmp_path / "seeker.onnx").section == {"kind": "policy", "file": network}
    section = "{kind: policy, file: seeker.onnx, observe: [gas], period: 1 s}"
    text = f"robots: [{{algorithm: {{kind: casting}}}}, {{algorithm: {section}}}]"
    (tmp_path / "task.yaml").write_text(text)
    mine = learnt(tmp_path / "task.yaml")
    assert mine.name == "task"
    assert mine.section["file"] == network
    assert mine.section["observe"] == ["gas"]
    (tmp_path / "other.yaml").write_text("robots: []")
    with pytest.raises(ScenarioError, match="has no robots with algorithm"):
        learnt(tmp_path / "other.yaml")


def test_who_can_say_where_the_source_is_takes_part_twice(tmp_path):
    (tmp_path / "silent.py").write_text(OWN)
    (tmp_path / "sure.py").write_text(OWN + "        robots.declare(robots.reading > 9, robots.position)\n")
    some = entrants(["casting", "infotaxis"], [tmp_path / "silent.py", tmp_path / "sure.py"])
    assert [one.changes(fixed("open_2d").facts)["stop_early"] for one in some[:3]] == [True, True, False]
    assert [(one.name, one.found) for one in some] == [
        ("casting", "reached"),
        ("infotaxis", "reached"),
        ("infotaxis_declares", "declared"),
        ("silent", "reached"),
        ("sure", "reached"),
        ("sure_declares", "declared"),
    ]


def test_a_picture_that_was_cut_off_is_made_again(tmp_path, monkeypatch):
    made = []
    monkeypatch.setattr(page, "_computed", lambda scenario: made.append(1) or np.ones((2, 3), np.float32))
    one = fixed("meandering")
    for content in (None, b"", b"PK\x03\x04 and no more"):
        if content is not None:
            (tmp_path / "meandering.plume.npz").write_bytes(content)
        assert page.mean_plume(one, tmp_path).shape == (2, 3)
        assert page.mean_plume(one, tmp_path).shape == (2, 3)
    assert len(made) == 3
    assert [file.name for file in tmp_path.iterdir()] == ["meandering.plume.npz"]


def law(points, t):
    return 1.0


def test_a_law_takes_no_part():
    with pytest.raises(ScenarioError, match=r"algorithms: law.* is a function"):
        entrants([Own(law)], [], [])
