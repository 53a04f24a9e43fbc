"""Every case of the validation at its coarse resolutions, by the same verdict as the command's."""

import pytest

from taichi_plume.validation.case import examine
from taichi_plume.validation.cases import CASES

SLOW = {
    "pipe",
    "oblique_channel",
    "conduction",
    "heated_cavity_1e4",
    "kovasznay",
    "taylor_green_3d",
    "poiseuille",
    "poiseuille_start",
    "duct_1",
    "duct_6",
    "cavity_400",
    "cavity_1000",
    "room_3d",
    "fan",
    "fan_jet",
    "one_layer",
    "couette_start",
    "heated_cavity_1e5",
}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow if name in SLOW else ()) for name in CASES]
)
def test_case_is_as_expected(name):
    case = CASES[name]
    findings = examine(case, case.coarse)
    assert any(finding.met is not None for finding in findings)
    wrong = [f"{f.norm}: {f.errors}, expected {f.expected}" for f in findings if f.met is False]
    assert not wrong
