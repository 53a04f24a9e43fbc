from collections.abc import Callable

import numpy as np
import pytest
from rooms import cfd, flow_in

from taichi_plume.grid.grid import Grid
from taichi_plume.scenario.winds import CfdWind
from taichi_plume.solvers.flow import FlowSolver
from taichi_plume.validation.flow_cases import advance

pytestmark = [pytest.mark.usefixtures("taichi"), pytest.mark.slow]

RHO = 1.184
WIDTH, DEPTH = 0.4, 0.5
WALLS = [{"kind": "slip", "face": "y-"}, {"kind": "slip", "face": "y+"}]


def model(curve: dict, loss: float, **more) -> CfdWind:
    """A fan as wide as a frictionless duct that ends in a resistance."""
    fan = {"kind": "fan", "face": "x-", "curve": curve} | more
    outlet = {"kind": "honeycomb", "face": "x+", "loss_coefficient": loss}
    return cfd([fan, outlet, *WALLS], viscosity=1e-2)


@pytest.fixture(scope="module")
def duct(taichi) -> Callable[..., FlowSolver]:
    """A duct of 2 m whose fan begins with a curve and a resistance."""
    grid = Grid((40, 8), 0.05, depth=DEPTH)

    def made(curve: dict, loss: float, **more) -> FlowSolver:
        return flow_in(grid, model(curve, loss, **more))

    return made


def flow_rate(flow: FlowSolver) -> float:
    u = flow.grid.read(flow.u[0]).astype(float)
    return float(u[0].sum() * flow.grid.dx * DEPTH)


@pytest.mark.parametrize(("loss", "speed"), [(8.0, None), (20.0, 1.0)])
def test_it_settles_where_its_curve_meets_the_resistance(duct, loss, speed):
    pressure, full = 2.0, 0.3
    flow = duct({"pressure": pressure, "flow": full}, loss, speed=speed)
    assert flow_rate(flow) == pytest.approx((speed or 0.0) * WIDTH * DEPTH, abs=1e-6)
    advance(flow, 12.0)
    # pressure (1 - (Q/full)²) = loss rho/2 (Q/A)²
    through = loss * RHO / 2 / (WIDTH * DEPTH) ** 2
    assert flow_rate(flow) == pytest.approx((pressure / (through + pressure / full**2)) ** 0.5, rel=0.02)


def test_in_the_open_it_blows_its_full_flow(duct):
    flow = duct({"pressure": 25.0, "flow": 0.1}, 0.0)
    advance(flow, 3.0)
    assert flow_rate(flow) == pytest.approx(0.1, rel=0.02)


def test_it_sets_the_air_of_a_duct_in_motion(duct):
    """m dU/dt = dp0/rho (1 - (U/U0)²) - K/2 U² has the solution U = V tanh(dp0 t/(rho m V)); it does not swing."""
    pressure, full, loss, length = 0.05, 0.3, 2.0, 2.0
    flow = duct({"pressure": pressure, "flow": full, "response": 1e-3}, loss)
    area = WIDTH * DEPTH
    settled = (pressure / RHO / (loss / 2 + pressure / RHO * (area / full) ** 2)) ** 0.5
    for n in range(400):
        flow.advance(0.05 * n, 0.05)
        wanted = settled * np.tanh(pressure / RHO * 0.05 * (n + 1) / (length * settled))
        assert flow_rate(flow) / area == pytest.approx(wanted, abs=0.01 * settled)
    assert wanted > 0.95 * settled
