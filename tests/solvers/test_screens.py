import numpy as np
import pytest
from rooms import LAMINAR, cfd, flow_in

from taichi_plume.grid.grid import Grid
from taichi_plume.scenario.winds import CfdWind
from taichi_plume.solvers.flow import FlowSolver
from taichi_plume.solvers.openings import periodic_axes
from taichi_plume.solvers.screens import ScreenResistance
from taichi_plume.validation.flow_cases import advance

SPEED = 0.7
SLIP = [{"kind": "slip", "face": face} for face in ("y-", "y+", "z-", "z+")]


pytestmark = [pytest.mark.usefixtures("taichi"), pytest.mark.slow]


def model(dim: int, screen: dict, inlet: dict | None = None, walls=SLIP, **more) -> CfdWind:
    """A frictionless duct along x with one screen."""
    openings = [
        inlet or {"kind": "inlet", "face": "x-", "speed": SPEED},
        {"kind": "outlet", "face": "x+"},
        *walls[: 2 * (dim - 1)],
    ]
    return cfd(openings, screens=[{"kind": "honeycomb", "axis": "x", "at": 1.2} | screen], **LAMINAR, **more)


def duct(shape, screen: dict, dx: float = 0.05, **more) -> FlowSolver:
    wind = model(len(shape), screen, **more)
    return flow_in(Grid(shape, dx, periodic=periodic_axes(wind.openings, len(shape))), wind)


def straight(screen: dict) -> FlowSolver:
    return duct((48, 6), screen)


@pytest.mark.parametrize(
    ("screen", "drop"),
    [
        ({"loss_coefficient": 2.0}, SPEED**2),
        ({"loss_coefficient": 40.0, "thickness": 0.15}, 20 * SPEED**2),
        ({"kind": "perforated", "loss_coefficient": 5.0}, 2.5 * SPEED**2),
        # 8 mm channels of 50 mm: f Re = 60.2 in air makes 0.91 times the dynamic pressure, the ends 1.2
        ({"cell": 0.008}, 0.5 * SPEED**2 * (1.2 + 60.2 * 1.56e-5 * 0.05 / (0.008**2 * SPEED))),
    ],
)
def test_the_pressure_drop_is_that_of_its_loss_coefficient(screen, drop):
    flow = straight(screen)
    advance(flow, 3.0)
    p = flow.grid.read(flow.p).astype(float)
    assert p[4].mean() - p[-4].mean() == pytest.approx(drop, rel=0.005)
    np.testing.assert_allclose(flow.grid.read(flow.u[0]), SPEED, rtol=1e-3)


def test_it_straightens_an_oblique_stream():
    """Periodic across, so that nothing but the screen turns the air."""
    flow = duct((48, 8), {"at": 1.2}, walls=[{"kind": "periodic", "axis": "y"}])
    flow.boundaries.target[0][0, :, 1] = 0.5  # the blown-in air moves along y as well
    advance(flow, 6.0)
    v = np.abs(flow.grid.inner(flow.u[1].to_numpy())).mean(axis=1)
    assert v[10] == pytest.approx(0.5, rel=0.02)
    assert v[26:].max() < 0.05 * v[10]


def test_it_takes_the_swirl_out_of_a_jet():
    fan = {"kind": "fan", "face": "x-", "center": [0.4, 0.4], "diameter": 0.5, "speed": SPEED, "swirl": 0.4}
    flow = duct((12, 10, 10), {"at": 0.36}, 0.08, inlet=fan)
    advance(flow, 2.5)
    y, z = np.meshgrid(*2 * [(np.arange(10) + 0.5) * 0.08 - 0.4], indexing="ij")
    v, w = (flow.grid.inner(flow.u[d].to_numpy()) for d in (1, 2))
    swirl = (y * w - z * v).sum(axis=(1, 2))
    assert abs(swirl[2]) > 1.0
    assert np.abs(swirl[5:]).max() < 0.1 * abs(swirl[2])
    assert flow.diagnostics()["max_divergence"] < 1e-4


def test_the_air_goes_round_a_screen_that_covers_half_the_duct():
    flow = duct((60, 20), {"center": [0.25], "size": [0.5], "loss_coefficient": 10.0})
    advance(flow, 4.0)
    u = flow.grid.inner(flow.u[0].to_numpy().astype(float))
    assert 0.05 * SPEED < u[24, :10].mean() < 0.7 * SPEED
    np.testing.assert_allclose(u.sum(axis=1), 20 * SPEED, rtol=1e-4)


def test_a_screen_in_a_disc_leaves_the_rest_alone():
    grid = Grid((32, 16, 16), 0.05)
    (disc,) = model(3, {"center": [0.4, 0.4], "diameter": 0.4}).screens
    screen = ScreenResistance(disc, grid, [np.ones(grid.padded)] * 3, 1.5e-5)
    index = screen.faces[0].to_numpy() - grid.ghost
    middle = (index[:, 1:] + 0.5) * 0.05
    assert np.hypot(*(middle - 0.4).T).max() <= 0.2
    assert len(index) == pytest.approx(2 * np.pi * 0.2**2 / 0.05**2, rel=0.05)  # both sides of a layer
    assert screen.share.to_numpy().sum() == pytest.approx(len(index) / 2)
