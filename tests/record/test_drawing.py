from itertools import product

import numpy as np
import pytest

from taichi_plume.record import drawing
from taichi_plume.scenario.openings import Fan


def volume(vertices: np.ndarray, triangles: np.ndarray) -> float:
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


@pytest.mark.parametrize(
    ("outline", "expected"),
    [
        ([[0, 0], [2, 0], [2, 1], [0, 1]], 2.0),
        ([[0, 1], [2, 1], [2, 0], [0, 0]], 2.0),  # clockwise
        ([[0, 0], [2, 0], [2, 2], [1, 2], [1, 1], [0, 1]], 3.0),  # an L
        ([[0, 0], [4, 0], [4, 3], [2, 0.5], [0, 3]], 7.0),  # a notch
    ],
)
def test_prism_is_closed_and_has_its_volume(outline, expected):
    vertices, triangles, normals = drawing.prism_mesh(np.array(outline, float), 0.5, 2.0)
    assert volume(vertices, triangles) == pytest.approx(1.5 * expected)
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    faces = np.cross(b - a, c - a)
    assert np.all(np.einsum("ij,ij->i", faces, normals[triangles[:, 0]]) > 0)


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


def test_fan_lies_on_its_face():
    region = Fan(kind="fan", face="x-", center=(1.5, 0.25), diameter=0.4, speed=1.0)
    outline = drawing.opening(region, (4.0, 3.0, 0.5), 0.5)
    assert np.all(outline[:, 0] == 0)
    assert np.hypot(outline[:, 1] - 1.5, outline[:, 2] - 0.25) == pytest.approx(0.2)
