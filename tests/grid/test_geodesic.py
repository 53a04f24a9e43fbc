"""Shortest ways around what stands, against their closed forms: tangents and arcs."""

import numpy as np
import pytest

from taichi_plume.grid.geodesic import shortest_ways

LOW, HIGH = (0.0, 0.0), (4.0, 3.0)


def pillar(middle, radius):
    return lambda points: np.linalg.norm(np.asarray(points) - middle, axis=-1) - radius


def wall(x, top):
    """A thin wall from the floor's lower edge up."""

    return lambda points: np.hypot(points[..., 0] - x, np.maximum(points[..., 1] - top, 0.0))


def way_of(start, goal, room, reach=0.1):
    (way,) = shortest_ways(np.array([start]), np.array([goal]), reach, 0.1, room, LOW, HIGH)
    return way


def around(a, b, middle, radius, far_side=False):
    """Return the length of the taut string past a disc, on the shorter side or on the other."""
    a, b = np.asarray(a) - middle, np.asarray(b) - middle
    ra, rb = np.linalg.norm(a), np.linalg.norm(b)
    apart = np.arccos(a @ b / (ra * rb))
    apart = 2 * np.pi - apart if far_side else apart
    angle = apart - np.arccos(radius / ra) - np.arccos(radius / rb)
    return np.sqrt(ra**2 - radius**2) + np.sqrt(rb**2 - radius**2) + radius * angle


@pytest.mark.parametrize("start", [(3.5, 1.5), (3.2, 1.3), (3.7, 1.7)])
def test_around_a_pillar_it_is_the_taut_string(start):
    middle, goal = np.array([2.0, 1.5]), (0.6, 1.5)
    true = around(start, goal, middle, 0.6)
    assert true * 0.995 < way_of(start, goal, pillar(middle, 0.5)) < true * 1.02


def test_around_the_end_of_a_wall_it_is_bent_there():
    start, goal = (3.0, 0.5), (1.0, 0.5)
    true = around(start, goal, np.array([2.0, 2.0]), 0.1, far_side=True)
    assert true * 0.995 < way_of(start, goal, wall(2.0, 2.0)) < true * 1.02


def test_in_the_open_it_is_straight_and_to_the_nearest():
    goals = np.array([[0.5, 0.5], [0.5, 2.5]])
    starts = np.array([[3.0, 2.5], [3.0, 1.0]])
    ways = shortest_ways(starts, goals, 0.2, 0.1, pillar(np.array([9.0, 9.0]), 0.5), LOW, HIGH)
    assert ways == pytest.approx([2.5, np.hypot(2.5, 0.5)])


def test_a_source_that_the_disc_cannot_stand_on_is_reached_from_where_it_can():
    """A source in the pillar's edge, seen from the other side."""
    assert 2.0 < way_of((3.5, 1.5), (1.5, 1.5), pillar(np.array([2.0, 1.5]), 0.5), reach=0.25) < 3.0


def test_where_no_way_leads_there_is_none():
    shut = wall(2.0, 9.0)
    assert np.isnan(way_of((3.0, 0.5), (1.0, 0.5), shut))
    assert np.isnan(shortest_ways(np.array([[3.0, 0.5]]), np.empty((0, 2)), 0.1, 0.1, shut, LOW, HIGH)).all()


def test_a_wall_that_has_moved_a_little_is_another_floor():
    """Ways are kept by floor."""
    ways = [way_of((3.0, 0.5), (1.0, 0.5), wall(2.0, top)) for top in (1.8, 1.805, 1.9, 1.8)]
    assert ways[0] <= ways[1] < ways[2]
    assert ways[3] == ways[0]
