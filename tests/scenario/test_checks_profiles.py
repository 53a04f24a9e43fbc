"""What is told of profiles of inlets that cannot be; through the loader, as a user meets it."""

import pytest

from taichi_plume.assembly.prepare import load_scenario
from taichi_plume.scenario.loading import ScenarioError

SCENARIO = """
duration: 10
domain: {size: [4, 3, 0.5], spacing: 0.1}
wind: {kind: cfd, openings: [{kind: inlet, face: x-, speed: 0.5}, {kind: outlet, face: x+}]}
gas: {kind: eulerian, sources: [{position: [1, 1.5, 0.2], rate: 1e-5}]}
"""


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "s.yaml"
    path.write_text(SCENARIO)
    return path


@pytest.mark.parametrize(
    "profile",
    [
        "parabolic",
        "{kind: log, walls: z-, roughness: 1 mm}",
        "{kind: log, walls: [y-, y+, z-, z+], friction: 0.05}",
        "{kind: power, walls: z+}",
        "{kind: table, walls: z-, heights: [0, 50 cm], speeds: [0, 1]}",
    ],
)
def test_good_profiles_have_no_problems(path, profile):
    load_scenario(path, [f"wind.openings.0.profile={profile}"])


@pytest.mark.parametrize(
    ("profile", "begins", "has"),
    [
        ("{kind: power, walls: x-}", ".walls: the inlet is on face x- itself", "name a face"),
        ("{kind: power, walls: floor}", ".walls: got 'floor'; ", "allowed: x-, x+"),
        ("{kind: power}", ": missing key 'walls'", ""),
        ("{kind: log, walls: z-}", ": takes either roughness or friction", ""),
        ("{kind: log, walls: z-, roughness: 2}", ": no air comes in", "at 0 to 0.5 m over z-"),
        (
            "{kind: table, walls: z-, heights: [0, 0.3], speeds: [0, 1]}",
            ".heights: 0 to 0.3 m do not cover the inlet",
            "at 0 to 0.5 m over z-",
        ),
        (
            "{kind: table, walls: z-, heights: [0.1, 0.6], speeds: [0, 1]}",
            ".heights: 0.1 to 0.6 m do not cover",
            "",
        ),
        ("{kind: table, walls: z-, heights: [0, 1], speeds: [0, 0]}", ": no air comes in", ""),
        ("{kind: table, walls: z-, heights: [0, 1], speeds: [1]}", ".speeds: must have at least 2 items", ""),
        (
            "{kind: table, walls: z-, heights: [0, 1], speeds: [1, 1, 1]}",
            ": has 2 heights and 3 speeds",
            "one speed per",
        ),
        ("{kind: table, walls: z-, heights: [1, 1], speeds: [1, 2]}", ": heights must grow", ""),
        ("parabolc", ": got 'parabolc'; did you mean 'parabolic'?", "allowed: uniform, parabolic"),
        ("{kind: logg, walls: z-}", ": unknown kind 'logg'; did you mean 'log'?", ""),
        ("{walls: z-}", ": missing key 'kind'", "log, power, table"),
    ],
)
def test_each_fault_is_one_line(path, profile, begins, has):
    with pytest.raises(ScenarioError) as error:
        load_scenario(path, [f"wind.openings.0.profile={profile}"])
    (line,) = error.value.lines
    assert line.startswith(f"{path}: wind.openings[0].profile{begins}")
    assert has in line


def test_a_2d_run_has_no_floor(path):
    with pytest.raises(ScenarioError, match=r"profile\.walls: 'z-' does not exist in a 2-D run"):
        load_scenario(
            path,
            [
                "domain={size: [4, 3], spacing: 0.1, depth: 1}",
                "gas.sources.0.position=[1, 1]",
                "wind.openings.0.profile={kind: power, walls: z-}",
            ],
        )
