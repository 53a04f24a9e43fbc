"""What is told of puffs that cannot be; through the loader, as a user meets it."""

import pytest

from taichi_plume.assembly.prepare import load_scenario
from taichi_plume.scenario.loading import ScenarioError

SCENARIO = """
duration: 10
domain: {size: [4, 3, 2], spacing: 0.1}
wind: {kind: cfd, openings: [{kind: inlet, face: x-, speed: 0.5}, {kind: outlet, face: x+}]}
gas: {kind: puffs, sources: [{position: [1, 1.5, 0.5], rate: 1e-5}]}
"""


def told(tmp_path, *overrides: str) -> str:
    path = tmp_path / "s.yaml"
    path.write_text(SCENARIO)
    with pytest.raises(ScenarioError) as error:
        load_scenario(path, list(overrides))
    return str(error.value)


def test_puffs_are_a_gas_with_defaults(tmp_path):
    path = tmp_path / "s.yaml"
    path.write_text(SCENARIO)
    overrides = [
        "gas.growth={kind: inertial, dissipation: 10 cm^2/s^3}",
        "gas.fluctuation=3 cm/s",
        "gas.buoyancy=true",
    ]
    gas = load_scenario(path, overrides).gas
    assert gas.growth.dissipation == pytest.approx(1e-3)
    assert gas.fluctuation == pytest.approx(0.03)


@pytest.mark.parametrize(
    ("overrides", "line"),
    [
        (["gas.initial_size=1.5"], "gas.initial_size: puffs of 1.5 m do not fit"),
        (["gas.most=10"], "gas.most: got 10"),
        (["gas.cutoff=1"], "gas.cutoff: got 1"),
        (["gas.growth={kind: fast}"], "gas.growth: unknown kind 'fast'"),
        (["gas.release=5"], "gas: unknown key 'release'; did you mean 'release_rate'?"),
        (
            ["gas.handover=true", "gas.buoyancy=true"],
            "gas.handover: gas on the grid does not sink by itself; remove it, or gas.buoyancy",
        ),
        (["wind.buoyancy={}"], "gas.kind: puffs do not weigh on the air"),
        (
            ["domain.size=[4, 3]", "gas.sources=[{position: [1, 1], rate: 1e-5}]", "gas.buoyancy=true"],
            "gas.buoyancy: is for 3-D runs",
        ),
        (["gas.sources=[{position: [1, 1, 5], rate: 1e-5}]"], "gas.sources[0].position: z = 5 m is outside"),
    ],
)
def test_faults_are_told_in_a_line(tmp_path, overrides, line):
    assert line in told(tmp_path, *overrides)
