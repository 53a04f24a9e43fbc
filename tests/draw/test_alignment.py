"""Alignment guides: a dragged object stops where an edge or a middle meets that of another object."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from taichi_plume.draw.alignment import POINT, PULL, Guides, snapped
from taichi_plume.draw.objects import scene
from taichi_plume.report.theme import ABOVE

TEXT = """\
domain: {size: [4, 3], spacing: 0.1}
obstacles:
  - {kind: box, center: [1.03, 1.0], size: [0.4, 0.2]}
  - {kind: box, center: [2.5, 2.0], size: [0.3, 0.3]}
"""
OWN = np.array([(-0.15, -0.15), (0.0, 0.0), (0.15, 0.15)])
EDGES = {0: [0, 2, 4, 0.83, 1.03, 1.23], 1: [0, 1.5, 3, 0.9, 1.0, 1.1]}
coordinate = st.floats(-0.5, 4.5)


def guides():
    return Guides(scene(TEXT, Path()), ABOVE, ["obstacles[1]"])


def test_the_grid_takes_points_to_its_corners():
    assert snapped((1.234, 0.377), 0.05) == pytest.approx((1.25, 0.4))
    assert snapped((1.234, 0.377), 0.0) == (1.234, 0.377)


def test_the_left_edge_meets_the_right_edge_of_another_box():
    (x, y), lines = guides().snapped((1.37, 2.42), 0.05, 0.03, OWN)
    assert x - 0.15 == pytest.approx(1.23)
    assert y == pytest.approx(2.4)
    (line,) = lines
    assert line[0] == pytest.approx([1.23, 1.23])
    assert line[1] == pytest.approx([0.9, y + 0.15]), "from the one object to the other"


def test_neither_grid_nor_guides_act_without_a_step():
    assert guides().snapped((1.37, 2.42), 0.0, 0.03, OWN) == ((1.37, 2.42), [])


@given(st.tuples(coordinate, coordinate), st.sampled_from([0.01, 0.05, 0.1, 0.25]), st.floats(0, 0.1))
def test_each_coordinate_is_that_of_the_grid_or_of_the_best_guide(at, step, reach):
    place, lines = guides().snapped(at, step, reach, OWN)
    grid = snapped(at, step)
    for axis in (0, 1):
        gaps = [abs(edge - own - at[axis]) for edge in EDGES[axis] for own in OWN[:, axis]]
        by_guide = min(gaps) <= min(reach, PULL * abs(grid[axis] - at[axis]))
        expected = min(gaps) if by_guide else abs(grid[axis] - at[axis])
        assert abs(place[axis] - at[axis]) == pytest.approx(expected, abs=1e-9)
    for x, y in lines:
        axis = 0 if x[0] == x[1] else 1
        value = (x, y)[axis][0]
        assert min(abs(value - edge) for edge in EDGES[axis]) < 1e-5
        assert min(abs(value - place[axis] - own) for own in OWN[:, axis]) < 1e-5


@given(st.tuples(coordinate, coordinate))
def test_an_axis_that_a_handle_cannot_change_has_no_guide(at):
    _, lines = guides().snapped(at, 0.05, 0.1, POINT, [0])
    assert all(x[0] == x[1] for x, _ in lines)
