"""Volume of released gas: sources displace air where the gas changes the air's density."""

import numpy as np
import pytest
from rooms import LAMINAR, cfd, eulerian

from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.state import State
from taichi_plume.scenario.winds import CfdWind
from taichi_plume.solvers.flow import FlowSolver
from taichi_plume.solvers.gas import EulerianSolver
from taichi_plume.solvers.momentum import BuoyantScalar
from taichi_plume.solvers.transport import Scalar

pytestmark = pytest.mark.usefixtures("taichi")

HELIUM = {"molar_mass": 4.0026e-3, "diffusivity": 7e-5}
MOLAR_VOLUME = 0.0244654  # m³/mol at 25 °C and 101,325 Pa


def box(openings: list[dict], solid: np.ndarray | None = None, **source) -> tuple[FlowSolver, EulerianSolver]:
    """Return the air and the helium of a box of 0.5 x 0.4 m, almost without gravity."""
    grid = Grid((20, 16), 0.025, depth=0.1)
    air = Air.everywhere(grid) if solid is None else Air.of(solid, grid)
    model = eulerian((0.2, 0.2), species=HELIUM, **source)
    scalar = Scalar(grid, takes_space=True)
    light = BuoyantScalar(scalar.q, model.vapour.weight_per_density, scalar.source)
    wind: CfdWind = cfd(openings, buoyancy={"gravity": (0.0, -1e-4)}, **LAMINAR)
    flow = FlowSolver(wind, grid, air, weighing=[light])
    return flow, EulerianSolver(model, grid, flow, air, scalar=scalar)


def run(flow: FlowSolver, gas: EulerianSolver, end: float, t: float = 0.0) -> None:
    """Advance air and gas from t to `end` [s]."""
    while end - t > 1e-9:
        dt = min(flow.stable_dt(t), 0.05, end - t)
        flow.advance(t, dt)
        gas.advance(t, dt)
        t += dt


def outflow(flow: FlowSolver) -> float:
    """Return the flow rate out through the upper face of x [m³/s]."""
    g, (nx, ny) = flow.grid.ghost, flow.grid.shape
    return float(flow.u[0].to_numpy()[g + nx, g : g + ny].astype(float).sum()) * 0.025 * 0.1


def test_as_much_air_leaves_as_gas_is_released():
    rate = 1e-5
    flow, gas = box([{"kind": "outlet", "face": "x+"}], rate=rate, radius=0.03)
    run(flow, gas, 0.5)
    assert outflow(flow) == pytest.approx(rate / 4.0026e-3 * MOLAR_VOLUME, rel=1e-3)
    assert flow.diagnostics()["max_divergence"] < 1e-3
    budget = gas.budget()
    assert budget["in_domain_kg"] + budget["outflow_kg"] == pytest.approx(0.5 * rate, rel=1e-5)


def test_gas_fills_the_box_and_no_cell_holds_more_than_pure_gas():
    flow, gas = box([{"kind": "outlet", "face": "x+"}], rate=2e-4, radius=0.03)
    run(flow, gas, 60.0)  # 3.7 volumes of the box
    share = gas.grid.read(gas.c).astype(float) / 4.0026e-3 * MOLAR_VOLUME
    assert share.max() < 1.01
    assert share.mean() > 0.8


@pytest.mark.parametrize("sealed", [False, True])
def test_gas_in_a_closed_part_takes_no_space(sealed):
    solid = np.zeros((20, 16), bool)
    solid[13] = True
    openings = [{"kind": "outlet", "face": "x+"}] if sealed else []
    flow, gas = box(openings, solid, rate=1e-5, radius=0.03)
    run(flow, gas, 0.5)
    assert outflow(flow) == pytest.approx(0.0, abs=1e-6)
    assert flow.diagnostics()["max_divergence"] < 1e-3
    assert gas.budget()["in_domain_kg"] == pytest.approx(5e-6, rel=1e-5)


def test_a_restored_state_displaces_as_before():
    flow, gas = box([{"kind": "outlet", "face": "x+"}], rate=1e-5, radius=0.03)
    run(flow, gas, 0.2)
    states = State(flow), State(gas)
    saved = [state.save() for state in states]
    run(flow, gas, 0.4, 0.2)
    expected = outflow(flow), gas.grid.read(gas.c)
    for state, values in zip(states, saved, strict=True):
        state.restore(values)
    run(flow, gas, 0.4, 0.2)
    assert outflow(flow) == expected[0]
    np.testing.assert_array_equal(gas.grid.read(gas.c), expected[1])


def test_the_air_that_gas_displaces_does_not_depend_on_where_a_periodic_axis_begins():
    """A source in the middle, and one in the first layer of cells."""
    flows = []
    for y in (0.2125, 0.0125):
        model = eulerian((0.2, y), species=HELIUM, rate=1e-5, radius=0.02)
        grid = Grid((20, 16), 0.025, depth=0.1, periodic=(False, True))
        scalar, air = Scalar(grid, takes_space=True), Air.everywhere(grid)
        openings = [{"kind": "outlet", "face": "x+"}, {"kind": "periodic", "axis": "y"}]
        wind: CfdWind = cfd(openings, buoyancy={"gravity": (-1e-4, 0.0)}, **LAMINAR)
        weighing = [BuoyantScalar(scalar.q, model.vapour.weight_per_density, scalar.source)]
        flow = FlowSolver(wind, grid, air, weighing=weighing)
        gas = EulerianSolver(model, grid, flow, air, scalar=scalar, openings=wind.openings)
        flow.start_from(lambda x: np.zeros_like(x) + np.array([0.0, 0.5]))
        run(flow, gas, 1.0)
        flows.append([flow.grid.inner(u.to_numpy()) for u in flow.u])
    for middle, first in zip(*flows, strict=True):
        np.testing.assert_allclose(np.roll(middle, -8, axis=1), first, rtol=0, atol=2e-5 * 0.5)
