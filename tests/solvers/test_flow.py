import numpy as np
import pytest

from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.grid import Grid
from taichi_plume.scenario.winds import CfdWind
from taichi_plume.solvers.flow import FlowSolver
from taichi_plume.validation.flow_cases import advance

pytestmark = pytest.mark.usefixtures("taichi")

ARENA = {
    "kind": "cfd",
    "openings": [
        {"kind": "honeycomb", "face": "x-", "speed": 0.7},
        {"kind": "honeycomb", "face": "x+", "loss_coefficient": 2.0},
    ],
}


def wind(**changes) -> CfdWind:
    return CfdWind.model_validate(ARENA | changes)


def room(shape: tuple[int, ...], obstacle: bool = True) -> tuple[Grid, np.ndarray]:
    grid = Grid(shape, 4.0 / shape[0], depth=4.0 / shape[0])
    solid = np.zeros(shape, bool)
    if obstacle:
        solid[shape[0] // 4 : shape[0] // 3, shape[1] // 3 : shape[1] // 2] = True
    return grid, solid


def run(flow: FlowSolver, steps: int, dt: float) -> None:
    for n in range(steps):
        flow.advance(n * dt, dt)


def test_solid_cells_hold_still():
    grid, solid = room((60, 45))
    flow = FlowSolver(wind(), grid, Air.of(solid, grid))
    run(flow, 10, 0.02)
    for d in range(2):
        u = grid.inner(flow.u[d].to_numpy())
        assert np.all(u[solid] == 0.0)
        assert np.all(np.roll(u, -1, axis=d)[solid] == 0.0)


@pytest.mark.slow
def test_a_fan_blows_what_it_is_told_along_its_schedule():
    grid = Grid((24, 20, 16), 0.05)
    fan = {
        "kind": "fan", "face": "x-", "center": [0.5, 0.4], "diameter": 0.3, "speed": 2.0, "swirl": 0.3,
        "turbulence_intensity": 0.1, "schedule": [{"at": 1.0, "speed": 0.0}], "ramp": 0.1,
    }  # fmt: skip
    flow = FlowSolver(wind(openings=[fan, {"kind": "outlet", "face": "x+"}]), grid, Air.everywhere(grid))

    def flow_rate() -> float:
        return float(grid.inner(flow.u[0].to_numpy().astype(float))[0].sum() * grid.dx**2)

    flow.advance(0.0, 0.005)
    assert flow_rate() == pytest.approx(2.0 * np.pi * 0.15**2, rel=1e-5)
    flow.advance(1.2, 0.005)
    assert flow_rate() == pytest.approx(0.0, abs=1e-7)


@pytest.mark.slow
def test_the_swirl_turns_the_right_way():
    """Right-handed about the jet: above the axis of a jet along +x the air moves towards -y."""
    grid = Grid((16, 20, 20), 0.05)
    fan = {"kind": "fan", "face": "x-", "center": [0.5, 0.5], "diameter": 0.6, "speed": 1.0, "swirl": 0.5}
    flow = FlowSolver(wind(openings=[fan, {"kind": "outlet", "face": "x+"}]), grid, Air.everywhere(grid))
    advance(flow, 0.3)
    v = grid.inner(flow.u[1].to_numpy())[2]
    w = grid.inner(flow.u[2].to_numpy())[2]
    assert v[10, 14] < -0.05 < 0.05 < v[10, 5]
    assert w[14, 10] > 0.05 > -0.05 > w[5, 10]


@pytest.mark.slow
def test_a_moving_wall_drags_the_air():
    """Couette flow: linear between a wall at rest and one that slides."""
    n = 16
    grid = Grid((8, n), 1.0 / n, periodic=(True, False))
    couette = wind(
        viscosity=1.0,
        turbulence={"kind": "none"},
        openings=[{"kind": "periodic", "axis": "x"}, {"kind": "wall", "face": "y+", "velocity": [1.0, 0.0]}],
    )
    flow = FlowSolver(couette, grid, Air.everywhere(grid))
    advance(flow, 2.0)
    y = (np.arange(n) + 0.5) / n
    np.testing.assert_allclose(grid.inner(flow.u[0].to_numpy())[4], y, atol=1e-4)


@pytest.mark.slow
def test_a_resistant_outlet_evens_out_the_outflow():
    """The larger the loss coefficient, the more uniform the flow through the honeycomb."""
    spread = []
    for loss in (0.0, 20.0):
        grid, solid = room((60, 45))
        solid[40:45, 10:30] = True
        openings = [ARENA["openings"][0], ARENA["openings"][1] | {"loss_coefficient": loss}]
        flow = FlowSolver(wind(openings=openings), grid, Air.of(solid, grid))
        advance(flow, 4.0)
        spread.append(flow.u[0].to_numpy()[grid.ghost + 60, grid.ghost : grid.ghost + 45].std())
    assert spread[1] < 0.5 * spread[0]


@pytest.mark.slow
def test_equal_seeds_blow_equal_gusts():
    def gusts(seed: int) -> np.ndarray:
        grid, solid = room((40, 30))
        openings = [ARENA["openings"][0] | {"turbulence_intensity": 0.1}, ARENA["openings"][1]]
        flow = FlowSolver(wind(openings=openings), grid, Air.of(solid, grid), seed)
        run(flow, 5, 0.02)
        return flow.u[0].to_numpy()

    np.testing.assert_array_equal(gusts(1), gusts(1))
    assert np.abs(gusts(1) - gusts(2)).max() > 1e-3


def test_inflow_turbulence_has_its_intensity_and_no_net_flux():
    grid = Grid((8, 60, 40), 0.05)
    openings = [
        ARENA["openings"][0] | {"turbulence_intensity": 0.1, "turbulence_length": 0.1},
        ARENA["openings"][1],
    ]
    flow = FlowSolver(wind(openings=openings), grid, Air.everywhere(grid))
    patch = flow.boundaries.jets[0]
    planes = np.array([flow.boundaries.noise[0].advance(0.7, 0.02) for _ in range(400)])
    assert planes.std() == pytest.approx(1.0, rel=0.1)
    assert np.abs(planes[:, patch.axis].mean(axis=(1, 2))).max() < 1e-12
