"""What is told of gas at the borders of the air that cannot be; through the loader, as a user meets it."""

import pytest

from taichi_plume.assembly.prepare import load_scenario
from taichi_plume.scenario.loading import ScenarioError

SCENARIO = """
duration: 10
domain: {size: [4, 3, 2], spacing: 0.1}
wind: {kind: cfd, openings: [{kind: inlet, face: x-, speed: 0.5}, {kind: outlet, face: x+}, {kind: slip, face: z+}]}
obstacles: [{kind: sphere, center: [2, 1.5, 1], radius: 0.3}]
gas: {kind: eulerian, sources: [{position: [1, 1.5, 0.5], rate: 1e-5}]}
"""


def loaded(tmp_path, *overrides: str):
    path = tmp_path / "s.yaml"
    path.write_text(SCENARIO)
    return load_scenario(path, list(overrides)).gas


def test_air_may_bring_gas_by_a_schedule_and_surfaces_take_it_up(tmp_path):
    inflow = (
        "gas.inflow=[{opening: 0, concentration: 2 percent, schedule: [{at: 2 min, concentration: 7 ppm}]}]"
    )
    walls = "gas.surfaces.walls=[{face: z-, uptake: 1 mm/s}, {face: y-, concentration: 0}]"
    gas = loaded(
        tmp_path, inflow, walls, "gas.surfaces.obstacles=[{number: 0, uptake: 2 mm/s, transfer: 3 mm/s}]"
    )
    assert [gas.inflow[0].at(t) for t in (-5.0, 119.0, 120.0)] == [20_000.0, 20_000.0, 7.0]
    wall, _ = gas.surfaces.walls
    assert wall.uptake == pytest.approx(1e-3)
    assert gas.surfaces.obstacles[0].transfer == pytest.approx(3e-3)


@pytest.mark.parametrize(
    ("override", "line"),
    [
        ("gas.inflow=[{opening: 7, concentration: 3}]", "inflow[0].opening: there is no wind.openings[7]; use 0 to 2"),
        ("gas.inflow=[{opening: 2, concentration: 3}]", "no air comes in through wind.openings[2]"),
        ("gas.inflow=[{opening: 0, concentration: 3 mg}]", "gas.inflow[0].concentration: got '3 mg': must have a unit"),
        ("gas.inflow=[{opening: 0, concentration: 2}, {opening: 0, concentration: 3}]", "gas.inflow[1].opening: "),
        ("gas.surfaces={}", "gas.surfaces: names no walls and no obstacles"),
        ("gas.surfaces.walls=[{face: y-}]", "gas.surfaces.walls[0]: takes an uptake or a concentration, got neither"),
        ("gas.surfaces.walls=[{face: y-, uptake: 1, concentration: 1}]", "got both"),
        ("gas.surfaces.walls=[{face: y-, uptake: 20}]", "did you mean '20 mm/s'?"),
        ("gas.surfaces.walls=[{face: y-, uptake: 1}, {face: y-, uptake: 1}]", "overlaps gas.surfaces.walls[0]"),
        ("gas.surfaces.obstacles=[{number: 1, uptake: 1}]", "obstacles[0].number: there is no obstacles[1]"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_told_in_a_line(tmp_path, override, line):
    with pytest.raises(ScenarioError) as error:
        loaded(tmp_path, override)
    assert line in str(error.value)
    assert "\n" not in str(error.value).strip()
