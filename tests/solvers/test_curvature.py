import numpy as np
import pytest

from taichi_plume.grid.cut_cells import air_of
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.shapes import Ball, Shape, UprightBox
from taichi_plume.scenario.obstacles import Box, Sphere
from taichi_plume.solvers.surfaces import CONVEX, curvatures
from taichi_plume.validation.body_cases import Outside

CENTRE = np.array([20.2, 19.9])


def curvature(shape: Shape, size: tuple[int, ...] = (40, 40)) -> tuple[np.ndarray, np.ndarray]:
    """Centres (n, dim) of the cells of 1 m that hold some surface; its curvature there [1/m]."""
    grid = Grid(size, 1.0)
    vectors = np.stack(
        [grid.pad(part) for part in np.moveaxis(air_of([shape], grid).surface(), -1, 0)], axis=-1
    )
    area = np.linalg.norm(vectors, axis=-1)
    cells = np.argwhere(area > 0.01)
    normals = (vectors / np.maximum(area, 1e-9)[..., None])[tuple(cells.T)]
    return cells - grid.ghost + 0.5, curvatures(vectors, cells, normals)


@pytest.mark.parametrize("radius", [4.0, 8.0, 16.0])
def test_a_disc_has_the_curvature_of_its_circle(radius):
    _, found = curvature(Ball(Sphere(kind="sphere", center=tuple(CENTRE), radius=radius), 2))
    assert np.median(found) == pytest.approx(1.0 / radius, rel=0.25)
    assert (found > CONVEX).all()


def test_a_large_disc_is_convex():
    disc = Ball(Sphere(kind="sphere", center=(50.2, 49.9), radius=32.0), 2)
    assert (curvature(disc, (100, 100))[1] > CONVEX).all()


def test_a_ball_has_twice_the_curvature():
    ball = Ball(Sphere(kind="sphere", center=(12.2, 11.9, 12.1), radius=8.0), 3)
    assert np.median(curvature(ball, (24, 24, 24))[1]) == pytest.approx(2.0 / 8.0, rel=0.25)


@pytest.mark.parametrize("radius", [4.0, 8.0, 15.0])
def test_a_bore_is_concave(radius):
    bore = Outside(Grid((40, 40), 1.0), radius, lambda x: np.linalg.norm(x - CENTRE, axis=-1))
    places, found = curvature(bore)
    inner = np.linalg.norm(places - CENTRE, axis=-1) < radius + 2.0
    assert inner.sum() > 20
    assert np.median(found[inner]) == pytest.approx(-1.0 / radius, rel=0.25)
    assert (found[inner] < 0.0).all()


@pytest.mark.parametrize("yaw", [0.0, 7.0, 20.0, 27.0, 45.0])
def test_the_edges_of_a_box_are_convex_and_its_sides_plane(yaw):
    box = Box(kind="box", center=(20.3, 20.1), size=(22.0, 18.0), yaw_deg=yaw)
    places, found = curvature(UprightBox(box, 2))
    angle = np.deg2rad(yaw)
    x, y = (places - (20.3, 20.1)).T
    along, across = np.cos(angle) * x + np.sin(angle) * y, np.cos(angle) * y - np.sin(angle) * x
    edges = (np.abs(along) > 9.5) & (np.abs(across) > 7.5)
    assert edges.sum() >= 8
    assert (found[edges] > CONVEX).all()
    sides = (np.abs(along) < 5.0) | (np.abs(across) < 3.0)
    assert sides.sum() >= 20
    assert (found[sides] < CONVEX).all()
