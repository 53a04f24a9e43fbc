"""Obstacles of cubes, as an occupancy grid of GADEN's has them."""

from pathlib import Path

import numpy as np

from taichi_plume.files.gaden import Cubes, Occupancy
from taichi_plume.grid.grid import Grid


def test_shares_and_distances_of_cubes():
    rng = np.random.default_rng(4)
    solid = rng.uniform(size=(5, 4)) < 0.4
    cells = np.repeat(solid[:, :, None], 3, axis=2).astype(np.int8)
    table = Occupancy(Path("o.csv"), np.zeros(3), 0.2, cells)
    cubes = Cubes(table, 2, np.array([0.1, 0.0]), 0.3)
    volume, area = cubes.shares(Grid((4, 4), 0.2))
    np.testing.assert_allclose(volume, 0.5 * (~solid[:-1]).astype(float) + 0.5 * ~solid[1:], atol=1e-9)
    np.testing.assert_array_equal(area[0], ~solid)
    lower = ~solid[:, :-1] & ~solid[:, 1:]
    np.testing.assert_allclose(area[1][:, 1:-1], 0.5 * lower[:-1] + 0.5 * lower[1:], atol=1e-9)
    points = rng.uniform(-0.3, 1.1, (300, 2))
    low = 0.2 * np.argwhere(solid) - [0.1, 0.0]
    beyond = np.maximum(low - points[:, None], points[:, None] - low - 0.2)
    away = np.linalg.norm(np.maximum(beyond, 0), axis=-1)
    inside = cubes.inside(points)
    found = cubes.horizontal_distance(points, 0.0, 0.1)
    np.testing.assert_allclose(np.maximum(found, 0.0), away.min(axis=1), atol=1e-12)
    np.testing.assert_array_equal(inside, away.min(axis=1) == 0.0)
    assert inside.any()


def test_walls_are_seen_and_ceilings_are_not():
    cubes = np.zeros((7, 6, 5), np.int8)
    cubes[:, :, 0] = cubes[:, :, 4] = 1  # below the domain, and the ceiling
    cubes[2, :, :] = 1
    cubes[4, 1:4, 1] = 1
    cubes[0] = 1  # outside the domain
    shape = Cubes(Occupancy(Path("o.csv"), np.zeros(3), 0.5, cubes), 3, np.array([0.5, 0.0, 0.5]), 0.0)
    boxes = shape.boxes(0, (3.0, 3.0, 2.0))
    np.testing.assert_allclose(boxes[:, 1] - boxes[:, 0], 0.5)
    seen = np.round(boxes[:, 0] / 0.5).astype(int)
    wall = [(1, y, z) for y in range(6) for z in range(4)]
    assert sorted(map(tuple, seen)) == sorted([*wall, (3, 1, 0), (3, 2, 0), (3, 3, 0)])
