from itertools import product

import numpy as np
import pytest

from taichi_plume.record import drawing


def volume(vertices: np.ndarray, triangles: np.ndarray) -> float:
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def test_robot_points_along_x_and_covers_its_disc():
    vertices, triangles, _ = drawing.robot_mesh(0.1, 0.2)
    assert vertices[:, 0].max() > 0.1
    assert np.abs(vertices[:, 1]).max() <= 0.1 + 1e-9
    assert volume(vertices, triangles) > 0.99 * np.pi * 0.1**2 * 0.2


EXTENTS = [(4.0, 3.0, 0.5), (24.0, 4.0, 0.1), (2.0, 30.0, 5.0), (400.0, 300.0, 80.0)]


@pytest.mark.parametrize("extent", EXTENTS)
def test_camera_frames_any_arena(extent):
    for aspect, elevation in product([0.8, 1.2, 2.5], [30.0, 48.0, 90.0]):
        assert 0.85 < framed(extent, aspect, elevation) <= 1.0  # all of it, and not from far away


def framed(extent: tuple[float, ...], aspect: float, elevation: float) -> float:
    """Return the fraction of the panel that the arena's corners reach, over its height or width."""
    corners = np.array([[x, y, z] for x in (0, extent[0]) for y in (0, extent[1]) for z in (0, extent[2])])
    position, target, up = drawing.camera(corners, aspect, elevation)
    forward = (target - position) / np.linalg.norm(target - position)
    right = np.cross(forward, up)
    depth = (corners - position) @ forward
    assert depth.min() > 0
    half = np.tan(drawing.FIELD_OF_VIEW / 2)
    high = np.abs((corners - position) @ up / depth).max() / half
    wide = np.abs((corners - position) @ right / depth).max() / half / aspect
    return max(high, wide)
