"""Clearance maps are tight lower bounds of the distance to the next surface."""

from math import sqrt
from pathlib import Path

import numpy as np
import pytest
from bodies import FLOOR, ROOM, SHAPES, random_points

from taichi_plume.engine import ti
from taichi_plume.grid.clearance import ClearanceMap
from taichi_plume.grid.kernels import Template
from taichi_plume.scenario.obstacles import Box, Cylinder
from taichi_plume.scenario.shapes import shape

pytestmark = [pytest.mark.usefixtures("taichi"), pytest.mark.slow]


@ti.kernel
def clearance_of(clearance: Template, points: Template, distance: Template, normal: Template):
    for n in range(points.shape[0]):
        distance[n] = clearance.distance(points[n])
        normal[n] = clearance.normal(points[n])


def sample(clearance, at):
    points, normal = ti.vector_field(2, ti.f32, len(at)), ti.vector_field(2, ti.f32, len(at))
    distance = ti.field(ti.f32, len(at))
    points.from_numpy(at.astype(np.float32))
    clearance_of(clearance, points, distance, normal)
    return distance.to_numpy(), normal.to_numpy()


def to_walls(p, low=(0.0, 0.0), high=(4.0, 3.0)):
    return np.minimum(p - low, high - p).min(axis=1)


def assert_tight(clearance, p, truth):
    distance, normal = sample(clearance, p)
    assert (distance <= truth + 1e-5).all()
    assert (distance >= truth - sqrt(2) * clearance.resolution - 1e-5).all()
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1.0, atol=1e-5)
    np.testing.assert_allclose(clearance.distance_at(p), distance, atol=1e-5)


COLUMN = shape(Cylinder(kind="cylinder", center=(2.0, 1.5), radius=0.5), ROOM, Path())


@pytest.mark.parametrize("resolution", [0.1, None])
def test_clearance_is_a_tight_lower_bound(resolution):
    obstacles = [shape(SHAPES[name], ROOM, Path()) for name in ("box", "sphere")]
    obstacles.append(shape(Cylinder(kind="cylinder", center=(0.9, 2.2), radius=0.2), ROOM, Path()))
    height = 0.25
    p = random_points(dim=2)
    truth = to_walls(p)
    for one in obstacles:
        truth = np.minimum(truth, one.horizontal_distance(p, 0.0, height))
    assert_tight(ClearanceMap(obstacles, ROOM.extent, height, resolution), p, truth)


def test_normals_point_away_from_the_nearest_surface():
    p = np.array([[2.6, 1.5], [2.0, 0.9], [2.4, 1.9], [0.1, 1.5], [3.95, 0.5], [1.0, 2.9], [0.5, 0.1]])
    s = sqrt(0.5)
    expected = [[1, 0], [0, -1], [s, s], [1, 0], [-1, 0], [0, -1], [0, 1]]
    normal = sample(ClearanceMap([COLUMN], ROOM.extent, 0.2), p)[1]
    np.testing.assert_allclose(normal, expected, atol=0.02)


def test_clearance_without_obstacles_is_the_distance_to_the_walls():
    p = random_points(dim=2)
    clearance = ClearanceMap([], FLOOR.extent, 0.2)
    np.testing.assert_allclose(sample(clearance, p)[0], to_walls(p), atol=1e-6)
    np.testing.assert_allclose(clearance.distance_at(np.array([4.5, 1.0])), -0.5)


def test_clearance_of_a_part_of_the_floor():
    low, high = (0.7, 0.4), (3.1, 2.8)
    p = random_points(dim=2)
    p = p[to_walls(p, low, high) > 0.0]
    truth = np.minimum(to_walls(p, low, high), np.hypot(*(p - [2.0, 1.5]).T) - 0.5)
    assert_tight(ClearanceMap([COLUMN], high, 0.2, low=low), p, truth)


def test_robots_pass_under_what_is_above_them():
    table = shape(Box(kind="box", center=(2.0, 1.5, 0.5), size=(2.0, 2.0, 0.1)), ROOM, Path())
    under = np.array([[2.0, 1.5]])
    assert ClearanceMap([table], ROOM.extent, 0.3).distance_at(under) == pytest.approx(1.5)
    assert ClearanceMap([table], ROOM.extent, 0.5).distance_at(under) < -0.9


def test_clearance_grid_is_bounded_for_large_arenas():
    nodes = ClearanceMap([COLUMN], (200.0, 100.0), 0.2).nodes
    assert 300_000 < nodes[0] * nodes[1] < 420_000
