"""Columns of point clouds: each cell with air is a point, too many cells are averaged by their air."""

import numpy as np
import pytest

from taichi_plume.files import point_clouds

PLACES = [(np.arange(n) + 0.5) * 0.1 for n in (3, 4)]


def test_cells_with_air_are_points_at_the_level_of_the_plane():
    kelvin = np.linspace(290, 301, 12, dtype=np.float32).reshape(3, 4)
    kelvin[1, 2] = np.nan
    columns = point_clouds.columns(kelvin, PLACES, "K", level=0.4)
    assert list(columns) == ["x", "y", "z", "K"]
    there = np.isfinite(kelvin)
    np.testing.assert_array_equal(columns["K"], kelvin[there])
    np.testing.assert_allclose(columns["x"], np.tile(PLACES[1], 3)[there.ravel()])
    np.testing.assert_allclose(columns["y"], np.repeat(PLACES[0], 4)[there.ravel()])
    assert set(columns["z"]) == {0.4}


def test_little_gas_is_no_point_but_little_of_others_is():
    values = np.array([[0.0, 0.05, 0.1, 7.0]] * 3, np.float32)
    assert set(point_clouds.columns(values, PLACES, "ppm")["ppm"]) == {np.float32(0.1), np.float32(7.0)}
    assert len(point_clouds.columns(values, PLACES, "1")["value"]) == 12
    assert len(point_clouds.columns(values, PLACES, "m s-1")["value"]) == 12


@pytest.mark.parametrize("most", [1, 5, 30, 119])
def test_blocks_hold_the_gas_of_their_cells(most):
    """Sum of mean times air, over volumes of 5 x 4 x 6 cells, of which some are solid."""
    rng = np.random.default_rng(most)
    shape = (5, 4, 6)
    air = rng.choice([0.0, 0.4, 1.0], shape)
    ppm = np.where(air > 0, rng.uniform(1, 9, shape), np.nan)
    places = [np.arange(n, dtype=float) for n in shape]
    found = point_clouds.columns(ppm, places, "ppm", air=air, most=most, least=0.0)
    shares = point_clouds.columns(np.ones(shape), places, "1", air=air, most=most)
    assert 0 < len(found["ppm"]) == len(shares["x"]) <= most
    side = next(n for n in range(1, 7) if np.prod([-(-k // n) for k in shape]) <= most)
    blocks = [(places[axis] // side).astype(int) for axis in range(3)]
    block = np.ravel_multi_index(np.meshgrid(*blocks, indexing="ij"), shape)
    held = np.array([air[block == b].sum() for b in np.unique(block) if air[block == b].sum()])
    assert (held * found["ppm"]).sum() == pytest.approx(np.nansum(ppm * air))
