"""Meshes are the bodies that they enclose, in 3-D and in section, and faulty ones are reported."""

import struct
from math import pi, sqrt
from pathlib import Path

import numpy as np
import pytest
from bodies import FLOOR, ROOM, SHAPES, is_inside, random_points

from taichi_plume.grid.grid import Grid
from taichi_plume.grid.meshes import MeshError, Solid
from taichi_plume.scenario.domain import Domain
from taichi_plume.scenario.obstacles import Mesh
from taichi_plume.scenario.shapes import shape

centers = Grid.of(Domain(size=(4.0, 3.0, 1.0), spacing=0.05)).centers()


def box_triangles(low, high):
    """Return the 12 triangles (12, 3, 3) of an upright box."""
    low, high = np.array(low, float), np.array(high, float)
    corner = np.array([[low[0], high[0]], [low[1], high[1]], [low[2], high[2]]])
    triangles = []
    for axis in range(3):
        first, second = (axis + 1) % 3, (axis + 2) % 3
        for side in range(2):
            quad = np.zeros((4, 3))
            quad[:, axis] = corner[axis, side]
            quad[:, first] = corner[first, [0, 1, 1, 0]]
            quad[:, second] = corner[second, [0, 0, 1, 1]]
            triangles += [quad[[0, 1, 2]], quad[[0, 2, 3]]]
    return np.array(triangles)


def stl_bytes(triangles):
    facets = [struct.pack("<12fH", 0, 0, 0, *triangle.ravel(), 0) for triangle in triangles]
    return b"\0" * 80 + struct.pack("<I", len(triangles)) + b"".join(facets)


def write_stl(path, triangles):
    path.write_bytes(stl_bytes(triangles))
    return path.name


def write_obj(path, vertices, quads):
    lines = [f"v {x} {y} {z}" for x, y, z in vertices]
    lines += [f"f {a + 1} {b + 1} {c + 1}\nf {a + 1} {c + 1} {d + 1}" for a, b, c, d in quads]
    path.write_text("\n".join(lines) + "\n")
    return path.name


def torus(n=60, m=40, ring_radius=0.6, tube=0.2):
    """Return vertices and quads of a torus about the z axis."""
    a, b = np.meshgrid(np.arange(n), np.arange(m), indexing="ij")
    u, v = 2 * pi * a / n, 2 * pi * b / m
    across = ring_radius + tube * np.cos(v)
    vertices = np.stack([across * np.cos(u), across * np.sin(u), tube * np.sin(v)], axis=-1).reshape(-1, 3)
    right, up = (a + 1) % n, (b + 1) % m
    quads = np.stack([a * m + b, right * m + b, right * m + up, a * m + up], axis=-1).reshape(-1, 4)
    return vertices, quads


def test_mesh_box_is_the_box(tmp_path):
    file = write_stl(tmp_path / "box.stl", box_triangles((-50, -25, 0), (50, 25, 40)))  # in cm
    mesh = Mesh(kind="mesh", file=file, scale=0.01, yaw_deg=30.0, translate=(2.0, 1.4, 0.1))
    one = shape(mesh, ROOM, tmp_path)
    box = shape(SHAPES["box"], ROOM, Path())
    p = random_points(5000)
    np.testing.assert_allclose(one.signed_distance(p), box.signed_distance(p), atol=1e-5)
    np.testing.assert_allclose([one.low, one.high], [box.low, box.high], atol=1e-6)
    assert isinstance(one, Solid)
    assert one.vertices.shape == (8, 3)
    assert one.triangles.shape == (12, 3)
    for height in (0.05, 0.2, 0.9):
        away = box.horizontal_distance(p[:, :2], 0.0, height)
        mine = one.horizontal_distance(p[:, :2], 0.0, height)
        assert ((mine < 0) == (away < 0)).all()
        np.testing.assert_allclose(mine[away > 0], away[away > 0], atol=1e-5)
    np.testing.assert_array_equal(one.inside(centers), is_inside("box", centers))


def test_mesh_section_is_a_2d_shape(tmp_path):
    file = write_obj(tmp_path / "torus.obj", *torus())
    p = random_points(dim=2)
    radius = np.hypot(p[:, 0] - 2.0, p[:, 1] - 1.5)
    for section in (0.3, 0.4):  # the torus lies at z = 0.3
        one = shape(Mesh(kind="mesh", file=file, translate=(2.0, 1.5, 0.3), section=section), FLOOR, tmp_path)
        half = sqrt(0.2**2 - (section - 0.3) ** 2)
        np.testing.assert_allclose(one.signed_distance(p), abs(radius - 0.6) - half, atol=0.003)
        np.testing.assert_array_equal(one.inside(p), one.signed_distance(p) < 0)


def test_a_section_along_the_bottom_of_a_mesh_is_its_footprint(tmp_path):
    file = write_stl(tmp_path / "box.stl", box_triangles((1, 1, 0), (2, 2, 0.5)))
    one = shape(Mesh(kind="mesh", file=file), FLOOR, tmp_path)
    at = np.array([[1.5, 1.4], [0.5, 1.5], [3.0, 3.0]])
    np.testing.assert_allclose(one.signed_distance(at), [-0.4, 0.5, sqrt(2)], atol=1e-5)


def test_mesh_torus_in_3d(tmp_path):
    file = write_obj(tmp_path / "torus.obj", *torus())
    one = shape(Mesh(kind="mesh", file=file, translate=(2.0, 1.5, 0.3)), ROOM, tmp_path)
    p = random_points(5000)
    exact = np.hypot(np.hypot(p[:, 0] - 2.0, p[:, 1] - 1.5) - 0.6, p[:, 2] - 0.3) - 0.2
    np.testing.assert_allclose(one.signed_distance(p), exact, atol=0.003)
    volume = one.inside(centers).sum() * 0.05**3
    assert volume == pytest.approx(2 * pi**2 * 0.6 * 0.2**2, rel=0.03)
    # a robot 0.2 m high meets the lower part alone: its shadow is narrower than the torus seen from above
    truth = abs(np.hypot(p[:, 0] - 2.0, p[:, 1] - 1.5) - 0.6) - sqrt(0.2**2 - 0.1**2)
    shadow = one.horizontal_distance(p[:, :2], 0.0, 0.2)
    np.testing.assert_allclose(shadow[truth > 0.003], truth[truth > 0.003], atol=0.003)
    assert (shadow[truth < -0.003] <= 0).all()


def test_overlapping_bodies_of_a_mesh_are_united(tmp_path):
    bodies = [((1, 1, 0), (2, 2, 0.6)), ((1.5, 1.5, 0.2), (2.5, 2.5, 0.8))]
    file = write_stl(tmp_path / "two.stl", np.concatenate([box_triangles(*b) for b in bodies]))
    one = shape(Mesh(kind="mesh", file=file), ROOM, tmp_path)
    expected = [((centers > low) & (centers < high)).all(axis=-1) for low, high in bodies]
    np.testing.assert_array_equal(one.inside(centers), expected[0] | expected[1])


def test_faulty_meshes_are_reported(tmp_path):
    triangles = box_triangles((1, 1, 0), (2, 2, 0.5))
    beside = np.concatenate([box_triangles((3, 1, 0), (4, 2, 1)), triangles[:10]])
    faults = {
        "none.stl": "no such file",
        write_stl(tmp_path / "hole.stl", triangles[1:]): "body 0 is not watertight: 3 open",
        write_stl(tmp_path / "lid.stl", beside): "body 1 is not watertight: 4 open",
    }
    for file, reported in faults.items():
        with pytest.raises(MeshError, match=reported):
            shape(Mesh(kind="mesh", file=file), ROOM, tmp_path)
    with pytest.raises(MeshError, match=r"section 0\.7 m does not cut it"):
        shape(Mesh(kind="mesh", file=write_stl(tmp_path / "b.stl", triangles), section=0.7), FLOOR, tmp_path)
