"""The SPIRAL room as the experiment and the config tell it, and what its trials come to."""

from pathlib import Path

import pytest

from taichi_plume import load_scenario
from taichi_plume.validation import spiral_cases
from taichi_plume.validation.experiment import Range
from taichi_plume.validation.searches import scenario_of
from taichi_plume.validation.spiral_cases import OPENED, SPIRAL_CASES, at, momo, room

pytestmark = pytest.mark.usefixtures("taichi")

CONFIG = Path(__file__).parents[2] / "configs" / "spiral_room.yaml"


def test_the_config_is_the_experiment_of_the_validation():
    theirs = load_scenario(CONFIG)
    robot = momo(
        "momo", 1, at(180), {"kind": "spiral", "minimum_ppm": theirs.robots[0].algorithm.minimum_ppm}
    )
    ours = scenario_of(room(0, OPENED, [robot], theirs.duration))
    assert ours.model_copy(update={"recording": theirs.recording}) == theirs


@pytest.mark.slow
def test_every_row_has_its_trials(monkeypatch):
    monkeypatch.setattr(spiral_cases, "AIRS", 1)
    monkeypatch.setattr(spiral_cases, "OPENED", 60.0)
    monkeypatch.setattr(spiral_cases, "HOUR", 150.0)
    monkeypatch.setattr(spiral_cases, "least_index", lambda: 1.0)
    (experiment,) = SPIRAL_CASES
    told = {condition.name: condition.run(6) for condition in experiment.conditions}
    quick, slow = told["E. coli 3 s, 180 cm"], told["random SPIRAL, 180 cm"]
    assert Range(least=15).met(quick["acquisitions"].mean)  # of 3 s, and 5 s of driving and turning
    assert Range(3, 4.5).met(slow["acquisitions"].mean)  # of 31 s, and 5
    assert all(told[row.name]["success"].n == 6 for row in experiment.conditions[:-1])
    ratios = experiment.conditions[-1]
    assert ratios.published.keys() >= ratios.expected.keys()
    assert told[ratios.name].keys() > ratios.expected.keys()
