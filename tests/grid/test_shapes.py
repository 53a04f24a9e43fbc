"""Distances of boxes, cylinders, spheres and prisms, against inequalities and closed forms."""

from math import inf, sqrt
from pathlib import Path

import numpy as np
import pytest
from bodies import FLOOR, L_SHAPE, ROOM, SHAPES, is_inside, random_points

from taichi_plume.assembly.preparation import prepare
from taichi_plume.scenario.gases import EulerianGas
from taichi_plume.scenario.obstacles import Box, Cylinder, Prism, Sphere
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.shapes import shape
from taichi_plume.scenario.sources import Source
from taichi_plume.scenario.winds import CfdWind


@pytest.mark.parametrize("name", SHAPES)
def test_sign_is_that_of_the_body_and_distance_changes_by_no_more_than_the_way(name):
    one = shape(SHAPES[name], ROOM, Path())
    p, q = random_points(seed=3), random_points(seed=4)
    distance = one.signed_distance(p)
    away = abs(distance) > 1e-9
    assert ((distance < 0) == is_inside(name, p))[away].all()
    assert 100 < (distance < 0).sum() < len(p) - 100
    difference = abs(distance - one.signed_distance(q))
    assert (difference <= np.linalg.norm(p - q, axis=-1) + 1e-12).all()


@pytest.mark.parametrize("name", SHAPES)
def test_distance_is_the_radius_of_the_largest_ball_on_one_side(name):
    ways = np.random.default_rng(1).normal(size=(40_000, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    one = shape(SHAPES[name], ROOM, Path())
    for p in random_points(40, seed=2):
        distance = abs(one.signed_distance(p))
        for share in (0.5, 0.9, 0.999):
            assert (is_inside(name, p + share * distance * ways) == is_inside(name, p)).all()
        assert (is_inside(name, p + 1.1 * distance * ways) != is_inside(name, p)).any()


def test_2d_shapes_are_footprints():
    p = random_points(dim=2)
    disc = shape(Sphere(kind="sphere", center=(2.0, 1.0), radius=0.4), FLOOR, Path())
    cylinder = Cylinder(kind="cylinder", center=(2.0, 1.0), radius=0.4, base=0.3, height=0.1)
    column = shape(cylinder, FLOOR, Path())
    expected = np.hypot(p[:, 0] - 2.0, p[:, 1] - 1.0) - 0.4
    np.testing.assert_allclose(disc.signed_distance(p), expected, atol=1e-12)
    np.testing.assert_allclose(column.signed_distance(p), expected, atol=1e-12)
    box = shape(Box(kind="box", center=(2.0, 1.0), size=(0.6, 0.4)), FLOOR, Path())
    at = np.array([[2.0, 1.0], [2.0, 1.15], [2.4, 1.0], [2.6, 1.6]])
    np.testing.assert_allclose(box.signed_distance(at), [-0.2, -0.05, 0.1, 0.5], atol=1e-12)
    np.testing.assert_allclose(column.low, [1.6, 0.6])


def test_prism_may_turn_either_way():
    prisms = [Prism(kind="prism", vertices=vertices) for vertices in (L_SHAPE, L_SHAPE[::-1])]
    forth, back = (shape(prism, ROOM, Path()).signed_distance(random_points()) for prism in prisms)
    np.testing.assert_allclose(forth, back, atol=1e-12)


def test_shadow_is_what_a_low_robot_can_touch():
    at = np.array([[3.0, 1.3]])
    sphere = shape(SHAPES["sphere"], ROOM, Path())  # centre at (2.1, 1.3, 0.4), radius 0.35
    assert sphere.horizontal_distance(at, 0.0, 0.5) == pytest.approx(0.9 - 0.35)
    assert sphere.horizontal_distance(at, 0.0, 0.2) == pytest.approx(0.9 - sqrt(0.35**2 - 0.2**2))
    assert sphere.horizontal_distance(at, 0.0, 0.05) == inf
    cylinder = shape(SHAPES["cylinder"], ROOM, Path())  # from 0.2 m up
    assert cylinder.horizontal_distance(at, 0.0, 0.2) == inf
    assert cylinder.horizontal_distance(at, 0.0, 0.3) == pytest.approx(np.hypot(1.2, 0.3) - 0.5)


def test_shapes_come_in_the_order_of_the_obstacles():
    scenario = Scenario(
        duration=1.0,
        domain=ROOM,
        wind=CfdWind(kind="cfd"),
        obstacles=(SHAPES["sphere"], SHAPES["box"], SHAPES["prism"]),
        gas=EulerianGas(kind="eulerian", sources=(Source(position=(1.0, 1.0, 0.1), rate=1e-5),)),
    )
    shapes = prepare(scenario, Path()).resources.obstacles
    assert [one.model for one in shapes] == list(scenario.obstacles)
