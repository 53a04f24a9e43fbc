"""Teams whose lanes, lines or messages do not fit are told so in one line."""

import pytest
from test_checks import FLOOR, scenario, told

from taichi_plume.files.run_folder import to_yaml


def team(count, algorithm, more=""):
    start = "start: {kind: area, low: [0.2, 0.2], high: [1.5, 2.8]}"
    return f"robots.0={{count: {count}, {start}, algorithm: {{{algorithm}}}{more}}}"


@pytest.mark.parametrize(
    "override",
    [
        team(5, "kind: dapso"),
        team(1, "kind: dapso, memory: 0, neighbourhood: {kind: random}"),
        team(5, "kind: dapso", ", communication: {range: null, loss: 1}"),
        team(4, "kind: lineup"),
        team(1, "kind: lineup, margin: 1.4 m"),
        team(18, "kind: lineup, wind_direction_deg: 0"),  # 0.2 m from one to the next
        team(4, "kind: lineup, spacing: 1.13, wind_direction_deg: 180"),
        team(5, "kind: sweep, lane: 3"),  # five lanes of 0.6 m
        team(10, "kind: sweep, lane: 0.17"),  # as wide as a robot
        team(2, "kind: random_walk"),
    ],
)
def test_good_teams_have_no_problems(tmp_path, override):
    assert told(tmp_path, FLOOR, override) == []


@pytest.mark.parametrize(
    ("override", "begins", "has"),
    [
        (
            team(2, "kind: dapso, avoidance: 1.45"),
            "robots[0].algorithm.avoidance: nowhere is 1.53 m to all walls",
            "lower it",
        ),
        (
            team(2, "kind: least_known, avoidance: 1.45"),
            "robots[0].algorithm.avoidance: nowhere is 1.53 m to all walls",
            "lower it",
        ),
        (
            team(40, "kind: dapso", ", trials: 20000"),
            "robots[0].count: 40 robots in 20000 trials would keep 3.2e+07 messages",
            "2e+07",
        ),
        (
            team(2, "kind: sweep, lane: 3.1"),
            "robots[0].algorithm.lane: 3.1 m is wider than the floor across the lanes, 3 m",
            "narrower",
        ),
        (
            team(2, "kind: sweep, lane: 0.1"),
            "robots[0].algorithm.lane: 30 lanes across 3 m are 0.1 m wide, and the robots in them 0.16 m",
            "wider lanes",
        ),
        (
            team(20, "kind: sweep, lane: 1"),
            "robots[0].count: 20 lanes across 3 m are 0.15 m wide, and the robots in them 0.16 m",
            "fewer robots",
        ),
        (
            team(2, "kind: lineup, margin: 1.5"),
            "robots[0].algorithm.margin: 1.5 m from all walls nothing",
            "lower",
        ),
        (
            team(4, "kind: lineup, spacing: 1.2, wind_direction_deg: 180"),
            "robots[0].algorithm.spacing: a line of 4 robots 1.2 m apart does not fit",
            "at most 1.13 m",
        ),
        (
            team(4, "kind: lineup, spacing: 0.1"),
            "robots[0].algorithm.spacing: 4 robots 0.16 m wide would touch in a line with 0.1 m",
            "fewer",
        ),
        (
            team(30, "kind: lineup, wind_direction_deg: 0"),
            "robots[0].count: 30 robots 0.16 m wide would touch in a line with 0.117 m",
            "fewer",
        ),
        (
            team(2, "kind: dapso, neighbourhood: {kind: nearest}"),
            "robots[0].algorithm.neighbourhood: unknown kind 'nearest'",
            "random",
        ),
        (team(2, "kind: dapso", ", communication: {loss: 2}"), "robots[0].communication.loss", "1"),
    ],
)
def test_each_fault_is_one_line(tmp_path, override, begins, has):
    lines = told(tmp_path, FLOOR, override)
    assert len(lines) == 1, lines
    assert lines[0].startswith(begins)
    assert has in lines[0]


def test_groups_keep_their_messages_in_one_table(tmp_path):
    """As wide as the largest team: two groups that fit alone may be too many together."""
    one = team(40, "kind: dapso", ", trials: 400, name: many").removeprefix("robots.0=")
    other = team(1200, "kind: dapso", ", body: {radius: 1 cm}, trials: 2, name: large").removeprefix(
        "robots.0="
    )
    (line,) = told(tmp_path, FLOOR, f"robots=[{one}, {other}]", "rivals=true")
    assert line.startswith(
        "robots[1].count: 1200 robots in 2 trials, with those of the groups before, would keep 2.2e+07 messages"
    )
    assert told(tmp_path, FLOOR, f"robots=[{one}]") == told(tmp_path, FLOOR, f"robots=[{other}]") == []


@pytest.mark.parametrize("kind", ["infotaxis", "space_aware_infotaxis", "hit_map"])
def test_beliefs_that_never_get_sure_say_nothing_unless_they_have_to(tmp_path, kind):
    coarse = team(1, f"kind: {kind}, cell: 0.6")
    found = scenario(tmp_path, FLOOR, coarse)
    (algorithm,) = [group.algorithm for group in found.robots]
    assert not algorithm.may_declare
    assert scenario(tmp_path, to_yaml(found)) == found, "written out, nothing more is asked for"
    (fault,) = told(tmp_path, FLOOR, team(1, f"kind: {kind}, cell: 0.6", ", found: declared"))
    assert fault.startswith("robots[0].algorithm.declare_spread: 0.2 m is never reached")
    assert told(tmp_path, FLOOR, team(1, f"kind: {kind}, cell: 0.4", ", found: declared")) == []
