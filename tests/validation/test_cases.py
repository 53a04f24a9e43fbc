"""Every case of the validation at its coarse resolutions, by the same verdict as the command's, and every experiment
with a few trials, which must not refute what is expected of many.
"""

import pytest

from taichi_plume.validation import experiment
from taichi_plume.validation.case import Case, examine
from taichi_plume.validation.cases import CASES
from taichi_plume.validation.experiment import Experiment

QUICK = {"puff_at_rest_2d"}


def of_kind(kind):
    """The names of the cases, marked as slow but for one."""
    return [
        pytest.param(name, marks=() if name in QUICK else pytest.mark.slow)
        for name, case in CASES.items()
        if isinstance(case, kind) and getattr(case, "coarse", getattr(case, "test_trials", 1))
    ]


@pytest.mark.parametrize("name", of_kind(Experiment))
def test_experiment_is_as_expected(name):
    case = CASES[name]
    assert isinstance(case, Experiment)
    rows, _ = experiment.examine(case, case.test_trials)
    wrong = [
        f"{row.condition}, {row.quantity}: {row.found}, not {row.expected}" for row in rows if row.refuted
    ]
    assert not wrong


@pytest.mark.parametrize("name", of_kind(Case))
def test_case_is_as_expected(name):
    case = CASES[name]
    assert isinstance(case, Case)
    findings, _ = examine(case, case.coarse)
    assert any(finding.met is not None for finding in findings)
    wrong = [f"{f.norm}: {f.errors}, expected {f.expected}" for f in findings if f.met is False]
    assert not wrong
