"""The larger area around the dish of the SPIRAL room: only its borders move away."""

import numpy as np
import pytest

from taichi_plume.validation import spiral_area
from taichi_plume.validation.searches import scenario_of
from taichi_plume.validation.spiral_area import CASES, TIME, area, start
from taichi_plume.validation.spiral_room import at, momo, room


def test_the_usual_area_is_that_of_table_2():
    robots = [momo("momo", 1, at(180), {"kind": "spiral"})]
    assert scenario_of(area(0, robots, 100.0, 1)) == scenario_of(room(0, robots, 100.0))


def test_the_borders_move_away_from_the_dish():
    usual, larger = (
        scenario_of(area(0, [momo("momo", 1, start(150, factor), {"kind": "spiral"})], 100.0, factor))
        for factor in (1, 2)
    )
    for scenario, factor in ((usual, 1), (larger, 2)):
        sides = np.subtract(scenario.arena.high, scenario.arena.low)
        np.testing.assert_allclose(sides, factor * np.array([3.0, 2.1]))
        walls = [box.center[1] for box in scenario.obstacles]
        np.testing.assert_allclose(np.diff(walls), sides[1] + 0.1)
        ((_, dish),), (place,) = scenario.sources, scenario.robots[0].start.positions
        assert np.hypot(*np.subtract(place, dish.position[:2])) == pytest.approx(1.5)
    ((_, dish),), ((_, other),) = usual.sources, larger.sources
    for end in ("low", "high"):
        near = np.abs(np.subtract(getattr(usual.arena, end), dish.position[:2]))
        far = np.abs(np.subtract(getattr(larger.arena, end), other.position[:2]))
        assert (far > near + 1.0).all()


@pytest.mark.slow
@pytest.mark.usefixtures("taichi")
def test_every_row_has_its_trials(monkeypatch):
    monkeypatch.setattr(spiral_area, "AIRS", 1)
    monkeypatch.setattr(spiral_area, "HOUR", 20.0)
    monkeypatch.setattr(spiral_area, "least_index", lambda factor: 1.0)
    (experiment,) = CASES
    for condition in experiment.conditions:
        results = condition.run(2)
        assert results[TIME].mean == 1.0  # nobody finds the dish in 20 s
        assert results["success, larger area"].n == 2
        least = 3 if condition.name.startswith("E. coli") else 0  # acquisitions of 3 s, and those of 30 s
        mean = results["acquisitions, larger area"].mean
        assert mean is not None
        assert least <= mean <= 5 * (least > 0)
