"""A movie as a gas: means over cells, between frames, and in scenarios."""

import numpy as np
import pytest

from taichi_plume.assembly.assemble import assemble
from taichi_plume.assembly.preparation import ScenarioError, load
from taichi_plume.files.movie import means
from taichi_plume.grid.fields import ppm_at

pytestmark = [pytest.mark.usefixtures("taichi"), pytest.mark.slow]
PICTURES = np.random.default_rng(5).random((3, 8, 10))  # of 10 cm: 1 x 0.8 m
SCENARIO = """
duration: 2 s
domain: {size: [1.2, 1.0], spacing: 0.25 m}
wind: {kind: uniform, velocity: [0, 0]}
gas: {kind: movie, file: m.npy, frame_rate: 2, pixel: 10 cm, origin: [0.15, 0.1], ppm_per_unit: 40}
robots: []
"""


def cell_mean(picture: np.ndarray, low: np.ndarray, dx: float, pixel: float, origin: tuple) -> float:
    """By 200 x 200 points in the cell, each in its pixel or in none."""
    at = low[:, None] + (np.arange(200) + 0.5) / 200 * dx
    i, j = (np.floor((at[a] - origin[a]) / pixel).astype(int) for a in (0, 1))
    rows, columns = np.meshgrid(j, i, indexing="ij")
    inside = (rows >= 0) & (rows < picture.shape[0]) & (columns >= 0) & (columns < picture.shape[1])
    return float((picture[rows.clip(0, 7), columns.clip(0, 9)] * inside).mean())


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("movie")
    np.save(folder / "m.npy", PICTURES)
    (folder / "s.yaml").write_text(SCENARIO.replace("[1.2, 1.0]", "[1.25, 1.0]"))
    return folder


@pytest.fixture(scope="module")
def simulation(folder):
    return assemble(load(folder / "s.yaml").scenario, folder)


def test_cells_hold_the_means_of_their_pixels(simulation):
    centres = np.stack(np.meshgrid(np.arange(5), np.arange(4), indexing="ij"), -1).reshape(-1, 2)
    wanted = [cell_mean(PICTURES[0], 0.25 * cell, 0.25, 0.1, (0.15, 0.1)) for cell in centres]
    simulation.reset()
    found = ppm_at(simulation.gas, 0.25 * (centres + 0.5), 0.0)[:, 0]
    np.testing.assert_allclose(found, 40 * np.array(wanted), rtol=0.02, atol=0.1)


@pytest.mark.parametrize("size", [0.03, 0.1, 0.17, 3.0])
def test_nothing_is_lost_on_any_grid(size):
    edges = np.arange(-2, int(2 / size) + 3) * size / 0.1
    coarse = means(means(PICTURES[0], edges, 0), edges, 1)
    assert coarse.sum() * size**2 == pytest.approx(PICTURES[0].sum() * 0.01, rel=1e-9)
    assert coarse.min() >= 0
    assert coarse.max() <= PICTURES[0].max() * (1 + 1e-9)


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("gas.origin=[3, 3]", "no pixel of .*m.npy is in the domain"),
        ("gas.start=5 s", "gas.start: 5 s is after"),
        ("gas.file=n.npy", "does not exist"),
        ("gas.file=../m.npy", "does not exist"),
    ],
)
def test_what_cannot_be_played_is_reported_in_a_line(folder, override, said):
    with pytest.raises(ScenarioError, match=said) as caught:
        load(folder / "s.yaml", [override])
    assert len(caught.value.faults) == 1


def test_it_is_the_same_at_every_height(folder):
    room = ["domain.size=[1.25, 1.0, 0.5]", "wind.velocity=[0, 0, 0]"]
    simulation = assemble(load(folder / "s.yaml", room).scenario, folder)
    points = np.array([[0.6, 0.4, z] for z in (0.1, 0.25, 0.4)])
    found = ppm_at(simulation.gas, points, 0.0)[:, 0]
    assert found[0] > 1
    assert found == pytest.approx(found[0], rel=1e-5)
