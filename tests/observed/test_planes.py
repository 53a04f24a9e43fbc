from itertools import product

import fake_run
import numpy as np
import pytest

from taichi_plume.grid.grid import Grid
from taichi_plume.observed import planes
from taichi_plume.observed.planes import VOLUME, Lattice, Plane, Raster
from taichi_plume.scenario.scenario import Scenario


def random(*shape: int) -> np.ndarray:
    return np.random.default_rng(1).random(shape).astype(np.float32)


@pytest.mark.parametrize(
    ("shape", "counts"), [((12, 8, 6), (6, 4, 3)), ((13, 7, 5), (7, 4, 3)), ((9, 5, 1), (2, 5, 1))]
)
def test_a_voxel_is_the_largest_of_the_cells_that_it_touches(shape, counts):
    values = random(*shape)
    found = planes.largest(values, counts)
    assert found.shape == counts
    for index in product(*map(range, counts)):
        edges = [(i * n / c, (i + 1) * n / c) for i, n, c in zip(index, shape, counts, strict=True)]
        touched = [slice(int(np.floor(a + 1e-9)), int(np.ceil(b - 1e-9))) for a, b in edges]
        assert found[index] == values[tuple(touched)].max()


GRID = Grid((20, 16, 10), 0.1)
AIR = np.zeros(GRID.shape, bool)


def sliced(values: np.ndarray, level: float | None, solid: np.ndarray = AIR) -> np.ndarray:
    return Raster(Plane("slice", (0, 1), 2, level, ""), GRID, solid).of_cells(values)


def test_a_column_is_the_largest_over_the_height_and_slices_are_linear_between_layers_of_cells():
    values = random(*GRID.shape)
    assert np.array_equal(sliced(values, None), values.max(axis=2))
    x, y, z = np.moveaxis(GRID.centers(), -1, 0)
    for height in (0.0, 0.05, 0.1, 0.33, 0.98):
        expected = (3 * x - y)[..., 0] + 7 * np.clip(height, 0.05, 0.95)
        assert sliced(3 * x - y + 7 * z, height) == pytest.approx(expected, abs=1e-5)


def test_slices_leave_out_what_is_solid():
    """A slice of 294 K shows no rim of 0 K around obstacles."""
    values, solid = random(*GRID.shape), AIR.copy()
    solid[:, :, 2] = True
    solid[5, 5, 3] = True
    expected = values[:, :, 3].copy()
    expected[5, 5] = np.nan  # solid on both sides
    assert sliced(values, 0.32, solid) == pytest.approx(expected, nan_ok=True)
    warm, solid = np.full(GRID.shape, 294.0), random(*GRID.shape) > 0.5
    found = sliced(warm, 0.37, solid)  # between the middles of the layers 3 and 4
    assert np.array_equal(np.isnan(found), solid[..., 3] & solid[..., 4])
    assert found[~np.isnan(found)] == pytest.approx(294, rel=1e-6)


def test_pixels_without_air_are_missing():
    solid = AIR.copy()
    solid[:4, :4, :2] = solid[10, 10] = True
    column, floor = sliced(random(*GRID.shape), None, solid), sliced(random(*GRID.shape), 0.0, solid)
    assert np.argwhere(np.isnan(column)).tolist() == [[10, 10]]
    assert np.array_equal(np.isnan(floor), solid[..., 0])
    fine = Raster(Plane("slice", (0, 1), 2, 0.0, ""), GRID, solid, 2, 2)
    missing = np.isnan(fine.of_samples(np.ones(fine.samples)))
    assert np.array_equal(missing, np.kron(solid[..., 0], np.ones((2, 2))) > 0)
    voxels = Raster(VOLUME, GRID, solid)
    assert voxels.shape == (10, 8, 5)
    missing = np.argwhere(np.isnan(voxels.of_cells(random(*GRID.shape)))).tolist()
    assert missing == [[0, 0, 0], [0, 1, 0], [1, 0, 0], [1, 1, 0]]


def test_arrows_fill_a_plane_evenly():
    lattice = Lattice(Plane("section", (1, 2), 0, 0.7, ""), GRID.extent)
    counts, cell = np.array(lattice.shape), np.array(lattice.cell)
    assert counts * cell == pytest.approx([1.6, 1.0])
    assert lattice.points.shape == (*lattice.shape, 3)
    assert lattice.points.reshape(-1, 3).mean(axis=0) == pytest.approx([0.7, 0.8, 0.5])
    assert cell == pytest.approx(lattice.step, rel=0.1)


@pytest.mark.parametrize(("axes", "normal"), [((0, 2), 1), ((1, 2), 0)])
def test_section_through_a_source_has_its_peak(axes, normal):
    source = np.array([0.75, 0.85, 0.55])  # at the centre of a cell
    values = np.exp(-((GRID.centers() - source) ** 2).sum(axis=-1) / 0.02)
    raster = Raster(Plane("section", axes, normal, float(source[normal]), ""), GRID, AIR)
    pixels = raster.of_cells(values)
    assert pixels.max() == pytest.approx(values.max(), rel=1e-5)
    i, k = np.unravel_index(pixels.argmax(), pixels.shape)
    place = [raster.origin[0] + (i + 0.5) * raster.cell[0], raster.origin[1] + (k + 0.5) * raster.cell[1]]
    assert place == pytest.approx(source[list(axes)])


def test_pixels_of_large_grids_are_the_largest_of_their_cells():
    grid = Grid((1001, 30), 0.01)
    values = np.zeros(grid.shape)
    values[500, 17] = values[1000, 29] = 1.0
    raster = Raster(Plane("slice", (0, 1), None, None, ""), grid, np.zeros(grid.shape, bool))
    pixels = raster.of_cells(values)
    assert raster.cell == pytest.approx((0.03, 0.03))
    assert pixels.shape == (334, 10)
    assert np.argwhere(pixels).tolist() == [[166, 5], [333, 9]]


def test_points_are_the_samples_of_pixels():
    raster = Raster(Plane("section", (1, 2), 0, 0.7, ""), GRID, AIR, 2, 2)
    points = raster.points
    assert points.shape == (32, 20, 3)
    assert np.unique(points[..., 0]) == pytest.approx([0.7])
    assert points[0, 0, 1:] == pytest.approx([0.025, 0.025])
    assert raster.of_samples(points[..., 1]).shape == raster.shape == (32, 20)
    coarse = Raster(Plane("section", (1, 2), 0, 0.7, ""), GRID, AIR, 2)
    assert coarse.of_samples(points[..., 1])[0, 0] == pytest.approx(0.075)


def scenario(**recording: object) -> Scenario:
    source = {"kind": "eulerian", "sources": [{"position": [0.6, 1.5, 0.4], "rate": 2e-5}]}
    return fake_run.scenario(3, gas=source, recording=recording)


def levels(model: Scenario) -> dict[str, tuple[str, float | None]]:
    return {one.name: (one.letters, one.level) for one in planes.planes(model, model.domain.extent)}


def test_planes_go_through_the_source_and_the_sensors_unless_the_recording_gives_them():
    expected = {"slice": ("xy", 0.4), "slice_2": ("xy", 0.1), "column": ("xy", None), "section": ("xz", 1.5)}
    assert levels(scenario()) == expected
    assert levels(fake_run.scenario(2)) == {"slice": ("xy", None)}
    found = levels(scenario(slice_height=["20 cm", 0.3], section={"plane": "yz", "at": 2}))
    expected = {"slice": ("xy", 0.2), "slice_2": ("xy", 0.3), "column": ("xy", None), "section": ("yz", 2.0)}
    assert found == expected
    assert "section" not in levels(scenario(section=None))
    assert levels(scenario(slice_height=0.3))["slice"] == ("xy", 0.3)
