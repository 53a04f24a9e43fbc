"""The mapping experiment: its statistics, and that the configs tell the same."""

from pathlib import Path

import numpy as np
import pytest

from taichi_plume import load_scenario
from taichi_plume.validation import mapping_cases
from taichi_plume.validation.case import Curve
from taichi_plume.validation.experiment import Lines, Mean
from taichi_plume.validation.mapping_cases import ALPHAS, arena, least, mapped
from taichi_plume.validation.report import page
from taichi_plume.validation.searches import scenario_of

pytestmark = pytest.mark.usefixtures("taichi")

CONFIGS = Path(__file__).parents[2] / "configs"


@pytest.mark.parametrize(
    ("name", "source", "navigation"),
    [("dapso", (1.7, 2.0), "DAPSO"), ("lineup", (2.5, 1.2), "line-up")],
)
def test_the_configs_are_conditions_of_the_experiment(name, source, navigation):
    ours = scenario_of(arena(source, [navigation]))
    theirs = load_scenario(CONFIGS / f"odor_mapping_{name}.yaml")
    shown = {key: getattr(theirs, key) for key in ("name", "maps", "recording", "rivals")}
    team = ours.robots[0].model_copy(update={"name": theirs.robots[0].name})
    assert ours.model_copy(update={**shown, "robots": (team,)}) == theirs


def test_the_least_error_is_where_the_mean_is_least():
    errors = np.ones((len(ALPHAS), 8))
    errors[2] = 0.5
    errors[4, 0] = 0.1
    found = least(errors)
    assert (found.mean, found.low, found.high) == (ALPHAS[2],) * 3


@pytest.mark.slow
def test_a_short_run_tells_everything(monkeypatch):
    """Ten seconds after the errors begin to count."""
    monkeypatch.setattr(mapping_cases, "DURATION", 40.0)
    mapping_cases.in_all.cache_clear()
    told = mapped(2, (1.7, 2.0), "DAPSO", "here")
    means = {name: part for name, part in told.items() if isinstance(part, Mean)}
    assert len(means) == 1 + len(ALPHAS) + 1 + len(ALPHAS) + 4
    assert {mean.n for mean in means.values()} == {2}
    (condition, *_) = mapping_cases.MAPPING_CASES[0].conditions
    assert condition.published.keys() | condition.expected.keys() <= means.keys()
    errors = told["Forecast error, here"]
    assert isinstance(errors, Lines)
    assert errors.x == pytest.approx([35.0, 40.0])
    assert {len(values) for values in errors.lines.values()} == {2}
    others = mapped(2, (1.7, 2.0), "line-up", "here")
    assert others["pure interpolation [ppm]"] != told["pure interpolation [ppm]"]


def test_lines_are_drawn():
    x = np.arange(3.0)
    case = {
        "name": "maps",
        "about": "",
        "reference": "",
        "discussion": "",
        "wall_s": 1.0,
        "passed": True,
        "message": "",
    }
    report = {"passed": True, "cases": [case], "wall_s": 1.0, "backend": "cpu", "versions": {}}
    drawn = page(report, {"maps": {"errors": Lines("t", "MAE", x, {"one": x, "two": 2 * x})}})
    assert drawn.count("<img") == 1
    assert drawn != page(report, {"maps": {"errors": Curve("t", "MAE", x, x, x)}})
