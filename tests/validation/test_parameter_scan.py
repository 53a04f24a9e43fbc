"""Scans of open parameters: the design, the response surface, and usual values that are those of the experiments."""

import numpy as np
import pytest

from taichi_plume.validation import mapping_scan, spiral_scan
from taichi_plume.validation.mapping_scan import Outputs, over_pure
from taichi_plume.validation.mapping_scenario import ALPHAS, NAVIGATIONS, SOURCES, Team, arena
from taichi_plume.validation.parameter_scan import (
    Open,
    between,
    blocks,
    least_point,
    one_at_a_time,
    rank_correlations,
    response_surface,
    usual,
)
from taichi_plume.validation.searches import scenario_of
from taichi_plume.validation.spiral_room import at, momo, room

pytestmark = pytest.mark.usefixtures("taichi")

THREE = (
    Open("a", 1.0, 3.0, 2.0),
    Open("b", 1.0, 100.0, 10.0, "log", of_air=True),
    Open("c", 0, 1, 0, "whole"),
)


@pytest.mark.parametrize("parameters", [THREE, spiral_scan.PARAMETERS, mapping_scan.PARAMETERS])
def test_usual_values_are_within_their_ranges(parameters):
    for p in parameters:
        assert p.low <= p.usual <= p.high
        assert p.value(0.0) == pytest.approx(p.low)
        assert p.value(1.0) == pytest.approx(p.high)
        assert p.value(p.share(p.usual)) == pytest.approx(p.usual)


def test_points_of_a_block_share_their_air():
    parts = blocks(THREE, 8, 16)
    airs = [{point["b"] for point in part} for part in parts]
    assert [len(values) for values in airs] == [1] * 8
    assert len(set.union(*airs)) == 8
    a = np.array([point["a"] for part in parts for point in part])
    assert np.histogram(a, 8, (1.0, 3.0))[0].tolist() == [16] * 8  # as a Sobol sequence has it
    assert {point["c"] for part in parts for point in part} == {0.0, 1.0}


def test_sides_lie_a_quarter_of_the_range_away():
    (a, low, high), (_, less, more), (_, *choices) = one_at_a_time(THREE)
    assert a.name == "a"
    assert (low["a"], high["a"]) == (1.5, 2.5)
    assert (less["b"], more["b"]) == pytest.approx((10.0**0.5, 10.0**1.5))
    assert [side["c"] for side in choices] == [0.0, 1.0]
    assert low["b"] == high["b"] == 10.0


def test_the_surface_fits_a_parabola():
    points = [point for part in blocks(THREE, 16, 4) for point in part]

    def known(point):
        return 3.0 + (point["a"] - 1.5) ** 2 - 2.0 * np.log(point["b"]) + 5.0 * point["c"]

    values = np.array([[known(point), -known(point)] for point in points])
    others = [point for part in blocks(THREE, 8, 4, seed=7) for point in part]
    fit = response_surface(THREE, points, values)(others)
    assert fit[:, 0] == pytest.approx([known(point) for point in others])
    assert fit[:, 1] == pytest.approx(-fit[:, 0])
    ranks = rank_correlations(THREE, points, np.array([point["b"] for point in points]))
    assert ranks["b"] == pytest.approx(1.0)
    assert abs(ranks["a"]) < 0.3


def test_the_least_point_and_the_way_to_it():
    end = least_point(THREE, lambda points: np.array([[p["a"] + p["b"], -3.0 * p["c"]] for p in points]))
    assert end == {"a": 1.0, "b": pytest.approx(1.0), "c": 1.0}
    half = between(THREE, end, 0.5)
    assert half == {"a": 1.5, "b": pytest.approx(10.0**0.5), "c": 1.0}


def test_usual_values_of_spiral_are_those_of_the_room():
    point = usual(spiral_scan.PARAMETERS)
    groups = [spiral_scan.searcher("momo", point, 1, at(180), spiral_scan.spiral_of(point))]
    ours = scenario_of(spiral_scan.air_of(point, 0, groups, 100.0))
    theirs = scenario_of(room(0, [momo("momo", 1, at(180), {"kind": "spiral"})], 100.0) | {"rivals": True})
    nose = theirs.robots[0].sensors.nose.model_copy(update={"rise_time": 4.0, "decay_time": 20.0})
    sensors = theirs.robots[0].sensors.model_copy(update={"gas": nose})
    assert ours.robots[0] == theirs.robots[0].model_copy(update={"sensors": sensors})
    assert (ours.gas, ours.domain, ours.wind.kind) == (theirs.gas, theirs.domain, theirs.wind.kind)


def test_usual_values_of_mapping_are_those_of_the_arena():
    point = usual(mapping_scan.PARAMETERS)
    for name in NAVIGATIONS:
        ours = scenario_of(mapping_scan.air_of(point, 0, [mapping_scan.team_of("team 0", name, point)]))
        theirs = scenario_of(arena(0, [Team(name, 0.1, "MiCS-5524", SOURCES[0])]))
        assert ours.wind == theirs.wind
        (_, gas), *_ = theirs.gases
        assert ours.gas == gas
        mine, other = ours.robots[0], theirs.robots[0]
        lags = {"rise_time": 1.5, "decay_time": 8.0, "period": 0.2}
        nose = other.sensors.nose.model_copy(update={"sensitivity": {}, **lags})
        if name == mapping_scan.LINEUP:  # from margin to margin is the default
            assert mine.algorithm.spacing == pytest.approx(3.4 / 3)
            mine = mine.model_copy(update={"algorithm": other.algorithm})
        sensors = other.sensors.model_copy(update={"gas": nose})
        assert mine == other.model_copy(update={"sensors": sensors})


def test_figure_10_is_reached_by_all_alphas_and_the_best():
    ratios = np.full((4, len(ALPHAS)), 0.99)
    ratios[0, ALPHAS.index(0.9)] = 0.5
    ratios[1, ALPHAS.index(0.98)] = 0.5
    ratios[2, ALPHAS.index(0.9)], ratios[2, 0] = 0.5, 1.01
    ratios[3, ALPHAS.index(0.8)] = 0.9
    assert mapping_scan.reaches(ratios).tolist() == [True, False, False, True]
    assert over_pure(np.array([2.0, 1.0, 3.0])).tolist() == [0.5, 1.5]


def test_spiral_is_reached_within_two_standard_errors():
    means = np.array([[11.5, 9.2], [13.7, 10.5], [13.8, 9.2], [11.5, 7.7]])
    assert spiral_scan.reaches(means).tolist() == [True, True, False, False]
    assert spiral_scan.chi_square(means[0]) == 0.0


def test_outputs_follow_the_law_of_the_sensor():
    from types import SimpleNamespace

    from taichi_plume.engine import ti

    swarm = SimpleNamespace(count=3, reading=ti.field(ti.f32, 3))
    given = ti.field(ti.f32, 3)
    given.fill(50.0)
    sensors = SimpleNamespace(measure=lambda *_: swarm.reading.copy_from(given))
    outputs = Outputs(sensors, swarm, np.array([0, 1, 2]))
    outputs.measure(None, None, 1, 0.2)
    ratio = (1.0 + 50.0 / 1.6) ** 0.644
    r = 400e3 / ratio
    volts = 5.0 * (47e3 / (47e3 + r) - 47e3 / (47e3 + 400e3))
    assert swarm.reading.to_numpy() == pytest.approx([50.0, ratio - 1.0, volts], rel=1e-4)
    sensors.measure = lambda *_: None  # holds its reading
    outputs.measure(None, None, 2, 0.4)
    assert swarm.reading.to_numpy() == pytest.approx([50.0, ratio - 1.0, volts], rel=1e-4)
