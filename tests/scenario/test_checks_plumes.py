import pytest

from taichi_plume.assembly.prepare import load_scenario
from taichi_plume.scenario.loading import ScenarioError

SOURCE = "sources: [{position: [1, 1.5, 0.1], rate: 1e-5}]"
RELEASE = "releases: [{position: [1, 1.5, 0.1], mass: 1 mg}]"
PLUME = f"gas={{kind: gaussian_plume, intensity: 0.1, {SOURCE}}}"
MEANDERING = f"gas={{kind: meandering, {SOURCE}}}"
GUSTS = "wind.gusts={intensity: 0.1}"
VERTICAL = "wind.gusts={intensity: 0, vertical: 0.1}"
FIELD = f"""\
duration: 10
warm_up: 5
domain: {{size: [4, 3, 1], spacing: 0.1}}
wind: {{kind: uniform, velocity: [0.5, 0, 0]}}
gas: {{kind: continuous, diffusivity: 0.01, {SOURCE}}}
"""


def told(tmp_path, *overrides):
    path = tmp_path / "s.yaml"
    path.write_text(FIELD)
    try:
        load_scenario(path, overrides)
    except ScenarioError as error:
        return [line.removeprefix(f"{path}: ") for line in error.lines]
    return []


@pytest.mark.parametrize(
    "overrides",
    [
        [],
        [PLUME, "gas.intensity=[0.1, 0.05]", "gas.walls=[y-, y+, z-, z+]"],
        [GUSTS, MEANDERING],
        [VERTICAL, MEANDERING],
        [GUSTS, f"gas={{kind: gaussian_puff, {RELEASE}}}", "gas.releases.0.time=-5"],
        [f"gas={{kind: gaussian_puff, diffusivity: [0.1, 0.1, 0], {RELEASE}}}", "wind.velocity=[0, 0, 0]"],
        ["wind.velocity=[0, 0, 0]", "gas.sources.0.start=-5"],
        [f"gas={{kind: mixture, parts: [{{kind: gaussian_puff, {RELEASE}}}, {{kind: eulerian, {SOURCE}}}]}}"],
    ],
)
def test_good_ones(tmp_path, overrides):
    assert told(tmp_path, *overrides) == []


@pytest.mark.parametrize(
    ("overrides", "begin", "advice"),
    [
        (["wind={kind: synthetic}"], "gas.kind: continuous takes a uniform wind", "use wind.kind: uniform"),
        ([MEANDERING], "wind.gusts: are missing", "add gusts:"),
        ([GUSTS], "gas.kind: continuous has no solution in a gusty wind", "use kind: meandering"),
        ([GUSTS, PLUME], "gas.kind: gaussian_plume is a mean over gusts", "use kind: meandering"),
        (
            ["wind.velocity=[0, 0, 0]", GUSTS, f"gas={{kind: gaussian_puff, {RELEASE}}}"],
            "wind.gusts: are a share",
            "give wind.velocity",
        ),
        (["wind.velocity=[0, 0, 0]", PLUME], "wind.velocity: is 0", "give it a speed"),
        (["wind.velocity=[0, 0, 0]"], "gas.sources[0].start: is missing", "such as -5 s"),
        (["wind.velocity=[0.5, 0, 0.1]"], "gas.walls: the wind blows through z- (z- is one", "turn the wind"),
        (["gas.walls=[x+]"], "gas.walls: the wind blows through x+, with 0.5 m/s", "take x+ out"),
        (
            [VERTICAL, f"gas={{kind: gaussian_puff, {RELEASE}}}"],
            "gas.walls: gusts blow through z- (z- is one unless walls says otherwise)",
            "calm that part",
        ),
        (
            [GUSTS, MEANDERING, "wind.gusts.time=0.1 ms"],
            "wind.gusts.time: 0.0001 s is too short",
            "use 0.00016 s",
        ),
        (["gas.diffusivity=[0.1, 0.1]"], "gas.diffusivity: has 2 numbers", "one for each of the 3 axes"),
        ([PLUME, "gas.intensity=[1, 1, 1]"], "gas.intensity: has 3 numbers", "the 2 axes across the wind"),
        (["gas.diffusivity=0"], "gas.diffusivity: must be above 0", "use kind: gaussian_plume"),
        (["gas.diffusivity=3 kg"], "gas.diffusivity: got '3 kg': must have a unit", "m^2/s"),
        ([PLUME, "gas.diffusivity=0.1"], "gas: takes either intensity or diffusivity", ""),
        (
            ["gas.sources.0.stop=3", "gas.sources.0.start=4"],
            "gas.sources[0]: stop must be later than start",
            "",
        ),
        (["gas.walls=[w]"], "gas.walls[0]: got 'w'; allowed: x-", ""),
        (
            [GUSTS, f"gas={{kind: gaussian_puff, {RELEASE}}}", "gas.releases.0.time=-6"],
            "gas.releases[0].time: -6 s is before the gusts begin, at -5 s",
            "raise warm_up",
        ),
        (
            [f"gas={{kind: gaussian_puff, {RELEASE}}}", "gas.releases.0.position=[9, 1, 0.5]"],
            "gas.releases[0].position: x = 9 m is outside",
            "move the source in",
        ),
        (
            [f"gas={{kind: gaussian_puff, {RELEASE}}}", "gas.releases.0.mass=3"],
            "gas.releases[0].mass: got 3 kg; did you mean '3 mg'?",
            "",
        ),
    ],
)
def test_each_fault_is_one_line(tmp_path, overrides, begin, advice):
    lines = told(tmp_path, *overrides)
    assert len(lines) == 1, lines
    assert lines[0].startswith(begin)
    assert advice in lines[0]


def test_what_2d_has_not(tmp_path):
    flat = ["domain.size=[4, 3]", "wind.velocity=[0.5, 0]", "gas.sources.0.position=[1, 1]"]
    assert told(tmp_path, *flat) == []
    assert told(tmp_path, *flat, "gas.walls=[z-]") == [
        "gas.walls: 'z-' does not exist in a 2-D run; use x-, x+, y- or y+"
    ]
    gas = "gas={kind: gaussian_plume, intensity: [0.1, 0.1], sources: [{position: [1, 1], rate: 1e-5}]}"
    assert told(tmp_path, *flat, gas) == ["gas.intensity: has 2 numbers; give one"]
    gas = "gas={kind: meandering, sources: [{position: [1, 1], rate: 1e-5}]}"
    lines = told(tmp_path, *flat, gas, "wind.gusts={vertical: 0.1}")
    assert [line.partition(":")[0] for line in lines] == ["wind.gusts.vertical"]
