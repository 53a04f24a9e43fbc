from itertools import permutations, product
from math import pi
from pathlib import Path

import numpy as np
import pytest

from taichi_plume.grid.cut_cells import Air, _integrate, air_of
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.shapes import Shape
from taichi_plume.scenario.domain import Domain
from taichi_plume.scenario.obstacles import Box, Cylinder, Sphere
from taichi_plume.scenario.shapes import shape


def one(obstacle, grid: Grid) -> Shape:
    return shape(obstacle, Domain(size=grid.extent, spacing=grid.dx), Path())


def blocked(air: Air, grid: Grid) -> float:
    return float((1.0 - air.volume).sum() * grid.dx**grid.dim)


@pytest.mark.parametrize(
    ("obstacle", "dim", "volume"),
    [
        (Cylinder(kind="cylinder", center=(0.51, 0.48), radius=0.3), 2, pi * 0.09),
        (Box(kind="box", center=(0.5, 0.47), size=(0.5, 0.3), yaw_deg=20.0), 2, 0.15),
        (Sphere(kind="sphere", center=(0.5, 0.52, 0.48), radius=0.33), 3, 4.0 / 3.0 * pi * 0.33**3),
    ],
)
def test_what_is_cut_off_converges_to_the_volume(obstacle, dim, volume):
    errors = []
    for n in (10, 20):
        grid = Grid((n,) * dim, 1.0 / n)
        errors.append(abs(blocked(air_of([one(obstacle, grid)], grid), grid) / volume - 1.0))
    assert errors[0] < 0.02
    assert errors[1] < 0.006


def test_the_surface_is_closed_and_as_large_as_the_circle():
    grid = Grid((40, 40), 1.0 / 40)
    air = air_of([one(Cylinder(kind="cylinder", center=(0.5, 0.5), radius=0.3), grid)], grid)
    surface = air.surface()
    np.testing.assert_allclose(surface.sum(axis=(0, 1)), 0.0, atol=1e-5)
    length = np.linalg.norm(surface, axis=-1).sum() * grid.dx
    assert length == pytest.approx(2.0 * pi * 0.3, rel=0.01)
    x = grid.centers() - 0.5
    assert ((surface * x).sum(axis=-1) <= 1e-6).all()  # out of the air: towards the middle


@pytest.mark.parametrize("dim", [2, 3])
def test_a_box_along_the_cells_is_made_of_whole_cells(dim):
    grid = Grid((10, 12, 8)[:dim], 0.1)
    box = Box(kind="box", center=(0.5, 0.6, 0.3)[:dim], size=(0.2, 0.4, 0.2)[:dim])
    solid = np.zeros(grid.shape, bool)
    solid[(slice(4, 6), slice(4, 8), slice(2, 4))[:dim]] = True
    cut, whole = air_of([one(box, grid)], grid), Air.of(solid, grid)
    np.testing.assert_array_equal(cut.volume, whole.volume)
    for a, b in zip(cut.area, whole.area, strict=True):
        np.testing.assert_array_equal(a, b)
    beside = cut.distance[0][5, 3, ...]  # a face that the box is below of
    np.testing.assert_allclose(beside[..., 2:4] if dim == 3 else beside, 0.5)


def test_half_a_cell_of_a_wall_leaves_half_the_face():
    grid = Grid((10, 10), 0.1)
    air = air_of([one(Box(kind="box", center=(0.5, 0.075), size=(2.0, 0.15)), grid)], grid)
    assert air.solid[:, 0].all()
    np.testing.assert_allclose(air.volume[:, 1], 0.5)
    np.testing.assert_allclose(air.area[0][1:-1, 1], 0.5)
    np.testing.assert_allclose(air.distance[0][1:-1, 1], 0.25)


def test_a_wall_half_a_cell_thick_is_not_missed():
    grid = Grid((20, 20), 0.1)
    wall = Box(kind="box", center=(1.05, 1.0), size=(0.06, 1.0))
    air = air_of([one(wall, grid)], grid)
    np.testing.assert_allclose(blocked(air, grid), 0.06, rtol=0.2)
    assert (air.area[1][10, 6:14] < 1.0).all()


def test_sealed_air_becomes_solid():
    """A square ring of four walls around a closed room."""
    grid = Grid((30, 30), 0.1)
    walls = []
    for a in (0.9, 2.1):
        walls.append(one(Box(kind="box", center=(1.5, a), size=(1.4, 0.2)), grid))
        walls.append(one(Box(kind="box", center=(a, 1.5), size=(0.2, 1.4)), grid))
    solid = air_of(walls, grid).solid
    assert solid.sum() == 14 * 14
    assert not solid[0, 0]
    assert solid[15, 15]


def test_sealed_air_stays_where_it_has_an_opening_or_is_the_larger_part():
    grid = Grid((30, 30), 0.1)
    divider = [one(Box(kind="box", center=(1.05, 1.5), size=(0.1, 3.0)), grid)]
    openings = np.zeros(grid.shape, bool)
    solid = air_of(divider, grid, openings).solid
    assert solid[:11].all()  # the smaller room, and the divider
    assert not solid[11:].any()
    openings[0, 4] = True
    assert air_of(divider, grid, openings).solid.sum() == 30
    around = Grid(grid.shape, grid.dx, periodic=(True, False))
    assert air_of(divider, around, np.zeros(grid.shape, bool)).solid.sum() == 30


def test_what_is_slit_off_on_all_sides_is_solid():
    grid = Grid((12, 12), 0.1)
    rng = np.random.default_rng(3)
    balls = [Sphere(kind="sphere", center=tuple(rng.uniform(0.2, 1.0, 2)), radius=0.17) for _ in range(6)]
    air = air_of([one(b, grid) for b in balls], grid)
    for d, area in enumerate(air.area):
        inner = np.moveaxis(area, d, 0)[1:-1]
        cells = np.moveaxis(air.solid, d, 0)
        assert np.all(inner[cells[1:] | cells[:-1]] == 0.0)
    assert np.all((air.room > 0) == ~air.solid)
    assert np.all(air.room >= air.volume)


BALL = Sphere(kind="sphere", center=(0.47, 0.53, 0.51), radius=0.27)


@pytest.mark.parametrize("swapped", list(permutations(range(3))))
def test_the_air_beside_a_sphere_turns_with_it(swapped):
    """All 48 symmetries of the cube: no axis is preferred."""
    grid = Grid((12,) * 3, 1.0 / 12)
    air = air_of([one(BALL, grid)], grid)
    for mirrored in product((False, True), repeat=3):
        center = np.array(BALL.center)[list(swapped)]
        there = Sphere(kind="sphere", center=tuple(np.where(mirrored, 1.0 - center, center)), radius=0.27)
        turned = air_of([one(there, grid)], grid)
        flipped = tuple(axis for axis in range(3) if mirrored[axis])
        for d, axis in enumerate(swapped):
            for name in ("area", "distance"):
                here = np.flip(getattr(air, name)[axis].transpose(swapped), flipped)
                np.testing.assert_allclose(getattr(turned, name)[d], here, atol=1e-6)
        np.testing.assert_allclose(turned.volume, np.flip(air.volume.transpose(swapped), flipped), atol=1e-6)


def test_faces_cut_by_a_sphere_have_the_area_outside_their_disc():
    """The plane of a face cuts a sphere in a disc; 100² samples a face measure what the disc leaves open."""
    grid, samples = Grid((24,) * 3, 1.0 / 24), 100
    air = air_of([one(BALL, grid)], grid)
    sub = (np.arange(24 * samples) + 0.5) / (24 * samples)
    for d in range(3):
        first, second = (c for axis, c in enumerate(BALL.center) if axis != d)
        squared = (sub[:, None] - first) ** 2 + (sub - second) ** 2
        for layer in (7, 10, 12, 15):
            outside = squared > BALL.radius**2 - (layer / 24 - BALL.center[d]) ** 2
            expected = outside.reshape(24, samples, 24, samples).mean(axis=(1, 3))
            found = air.area[d].take(layer, axis=d)
            cut = (found > 0.0) & (found < 1.0)
            assert cut.any()
            np.testing.assert_allclose(found[cut], expected[cut], atol=0.02)


def test_oblique_planes_cut_squares_and_cubes_exactly():
    """The corner that a plane cuts off a square or cube; its mirror image leaves the rest."""
    for dim in (2, 3):
        x = np.stack(np.meshgrid(*[[0.0, 1.0]] * dim, indexing="ij"))
        slopes, cut = np.array([1.0, 0.8, 0.7])[:dim], 0.6
        plane = cut - np.tensordot(
            slopes, x, 1
        )  # positive near the origin, up to less than 1 along each axis
        volume = np.prod(cut / slopes) / (2.0 if dim == 2 else 6.0)
        shares, totals = _integrate(np.stack([plane, -plane]))
        np.testing.assert_allclose(shares, [volume, 1.0 - volume], rtol=1e-12)
        beneath = volume * cut / (dim + 1)
        np.testing.assert_allclose(totals, [beneath, beneath - plane.mean()], rtol=1e-12)
