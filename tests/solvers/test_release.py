"""Where sources bring their gas: in still air without diffusion it stays there."""

from itertools import product

import numpy as np
import pytest
from rooms import blocks, eulerian

from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.fields import concentration_at
from taichi_plume.grid.grid import Grid
from taichi_plume.scenario.gases import EulerianGas
from taichi_plume.solvers.gas import EulerianSolver
from taichi_plume.solvers.prescribed_wind import PrescribedWind

pytestmark = pytest.mark.usefixtures("taichi")

DX = 0.1


class Room:
    """Gas in a room of 16 x 12 x 10 cells, in which a wall of one cell stands, as high as half of it."""

    def __init__(self):
        self.grid = Grid((16, 12, 10), DX)
        self.air = Air.of(blocks(self.grid.shape, np.s_[8, :, :5]), self.grid)

    def model(self, place, radius: float = 0.01) -> EulerianGas:
        return eulerian(place, 1e-3, radius=radius, species={"molar_mass": 0.046, "diffusivity": 0.0})

    def released(self, place, span: float = 1.0, **keys) -> np.ndarray:
        """Shares of what a source releases, of the grid's shape."""
        wind = PrescribedWind(np.zeros_like, self.grid)
        self.gas = EulerianSolver(self.model(place, **keys), self.grid, wind, self.air)
        self.gas.advance(0.0, span)
        return self.gas.cells(0.0).astype(float) * self.grid.cell_volume / (1e-3 * span)

    def centroid(self, share: np.ndarray) -> np.ndarray:
        return (share[..., None] * self.grid.centers()).sum(axis=(0, 1, 2))


@pytest.fixture(scope="module")
def still(taichi) -> Room:
    return Room()


@pytest.mark.parametrize("place", list(product((0.0, 0.21, 0.5, 0.93), (0.0, 0.5), (0.37,))))
def test_a_small_source_is_spread_alike_wherever_in_a_cell_it_sits(still, place):
    where = np.add(place, (3, 5, 4)) * DX
    share = still.released(where)
    assert share.min() >= 0.0
    assert share.sum() == pytest.approx(1.0, rel=1e-6)
    np.testing.assert_allclose(still.centroid(share), where, atol=1e-6)
    # with what linear interpolation adds on the axis, f (1 - f), the variance is the same everywhere
    f = (where / DX - 0.5) % 1.0
    spread = (share[..., None] * ((still.grid.centers() - where) / DX) ** 2).sum(axis=(0, 1, 2))
    np.testing.assert_allclose(spread + f * (1.0 - f), 5.0 / 6.0, atol=1e-5)
    seen = concentration_at(still.gas, where, 0.0) * still.grid.cell_volume / 1e-3
    assert seen == pytest.approx((5.0 / 12.0) ** 3, rel=0.05)


@pytest.mark.parametrize("where", [(0.4, 0.6, 0.5), (0.413, 0.572, 0.55)])
def test_a_source_is_as_wide_as_its_ball_or_as_the_kernel_if_that_is_wider(still, where):
    variances = []
    radii = np.linspace(0.02, 0.38, 19)
    for radius in radii:
        share = still.released(where, radius=radius)
        assert share.sum() == pytest.approx(1.0, rel=1e-6)
        np.testing.assert_allclose(still.centroid(share), where, atol=1e-6)
        f = (where[0] / DX - 0.5) % 1.0  # linear interpolation of readings adds f (1 - f)
        variances.append((share * (still.grid.centers() - where)[..., 0] ** 2).sum() + f * (1.0 - f) * DX**2)
    expected = np.maximum(radii**2 / 5.0, 5.0 / 6.0 * DX**2)  # R²/5 is the variance of a ball along an axis
    np.testing.assert_allclose(variances, expected, rtol=0.05)  # four samples per cell and axis make a ball
    assert np.all(np.diff(variances) >= -1e-9)


def test_what_begins_in_an_obstacle_reaches_the_air_around(still):
    share = still.released((0.85, 0.6, 0.2), radius=0.2)
    assert share.sum() == pytest.approx(1.0, rel=1e-6)
    assert share[:8].sum() == pytest.approx(share[9:].sum(), rel=1e-5)
    assert np.all(share[8, :, :5] == 0.0)


@pytest.mark.parametrize("place", [(0.75, 0.6, 0.2), (0.79, 0.61, 0.13), (0.71, 0.1, 0.3)])
def test_nothing_comes_through_a_thin_wall_and_all_of_it_stays_in_the_air(still, place):
    share = still.released(place)
    assert share.sum() == pytest.approx(1.0, rel=1e-6)
    assert np.all(share[8:, :, :5] == 0.0)
    assert np.all(share >= 0.0)


@pytest.mark.parametrize(
    ("place", "nearest"),
    [
        ((0.35, 0.62, 0.08), (0.35, 0.62, 0.08)),  # above the floor's first centres
        ((0.08, 0.06, 0.31), (0.08, 0.06, 0.31)),  # in a corner
        ((0.69, 0.6, 0.2), (0.69, 0.6, 0.2)),  # beside the wall
        ((0.35, 0.62, 0.0), (0.35, 0.62, 0.05)),  # on the floor: the first layer
    ],
)
def test_at_walls_the_centroid_is_kept_where_cells_can(still, place, nearest):
    np.testing.assert_allclose(still.centroid(still.released(place)), nearest, atol=0.04 * DX)


def test_a_ball_larger_than_the_room_fills_it_evenly(still):
    gas = EulerianSolver(still.model((0.8, 0.6, 0.5), 1e5), still.grid, still.gas.transport.wind, still.air)
    gas.advance(0.0, 1.0)
    c = gas.cells(1.0)[~still.air.solid]
    assert c.min() > 0.0
    assert c.sum() * still.grid.cell_volume == pytest.approx(1e-3, rel=1e-6)
    # the shares are even but for the tilt that keeps the centroid of the air's part
    np.testing.assert_allclose(c, c.mean(), rtol=0.1)
