"""Every case of the validation at its coarse resolutions, by the same verdict as the command's."""

import pytest

from taichi_plume.validation.case import examine
from taichi_plume.validation.cases import CASES


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=pytest.mark.slow if case.slow else ()) for name, case in CASES.items()],
)
def test_case_is_as_expected(name):
    case = CASES[name]
    findings, _ = examine(case, case.coarse)
    assert any(finding.met is not None for finding in findings)
    wrong = [f"{f.norm}: {f.errors}, expected {f.expected}" for f in findings if f.met is False]
    assert not wrong
