"""The room with persons, and the ratio by which the case judges its air."""

import numpy as np
import pytest

from taichi_plume.validation import spiral_persons
from taichi_plume.validation.searches import scenario_of
from taichi_plume.validation.spiral_index import HEIGHTS, PLACES, SHORT, TIMES, Records
from taichi_plume.validation.spiral_persons import AIRS, CASES, airs_of, occupied, steadiness
from taichi_plume.validation.spiral_room import room


def test_only_the_air_differs_from_the_room_of_table_2():
    """The heat that comes in is that of two persons and a computer, outside the arena; the walls are as warm as air."""
    usual, persons = (scene(2, [], 10.0) for scene in (room, occupied))
    assert {key for key in usual if usual[key] != persons[key]} == {"name", "wind"}
    scenario = scenario_of(persons)
    assert scenario.buoyancy is not None
    assert scenario.buoyancy.solutal
    heat = scenario.buoyancy.heat
    assert heat is not None
    assert sum(heater.power for heater in heat.heaters) == 200.0
    assert all(heater.position[1] + heater.radius < scenario.floor.low[1] for heater in heat.heaters)
    assert {wall.temperature for wall in heat.walls} == {heat.reference}


def test_steadiness(monkeypatch):
    """The ratio of the standard deviations of the logarithms, here normal ones, at the place asked for."""
    rng = np.random.default_rng(1)
    place = PLACES.index((150, 180))

    def heard(air, scene):
        records = {}
        for key, sigma in (((TIMES[-1], HEIGHTS[0]), 0.1), ((SHORT, HEIGHTS[0]), 0.4)):
            values = np.ones((4000, len(PLACES)))
            values[:, place] = np.exp(sigma * rng.normal(size=4000))
            records[key] = Records(values, values)
        return np.zeros(1), records

    monkeypatch.setattr(spiral_persons, "heard", heard)
    assert steadiness(2, "with persons", 150) == pytest.approx([0.25, 0.25], rel=0.1)


def test_trials_are_in_as_many_airs_as_there_are():
    assert [airs_of(trials) for trials in (1, AIRS, CASES[0].trials)] == [1, AIRS, AIRS]
