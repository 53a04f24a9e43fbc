import numpy as np
import pytest
from rooms import LAMINAR, blocks, cfd, eulerian, flow_in

from taichi_plume.assembly.assemble import assemble
from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.state import State
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.winds import CfdWind
from taichi_plume.solvers.flow import FlowSolver
from taichi_plume.solvers.gas import EulerianSolver
from taichi_plume.solvers.momentum import BuoyantScalar
from taichi_plume.solvers.transport import Scalar
from taichi_plume.validation.flow_cases import periodic

pytestmark = pytest.mark.usefixtures("taichi")


def warm_wind(dim, gravity=None, openings=(), heat=None, **more) -> CfdWind:
    """Air of 300 K; heat: keys of `buoyancy.heat`."""
    warm = {"gravity": gravity or (0.0,) * dim, "heat": {"reference": 300.0, **(heat or {})}}
    return cfd(openings, **LAMINAR | {"buoyancy": warm} | more)


def warm_box(shape, wind: CfdWind, solid=None) -> FlowSolver:
    return flow_in(Grid(shape, 0.05, depth=0.4), wind, solid)


DOWN = (0.0, -9.81)


def layers(**keys) -> FlowSolver:
    """A closed box for layers of air."""
    return warm_box((16, 24), warm_wind(2, DOWN, **keys))


def run(flow, end, *others):
    t = 0.0
    while end - t > 1e-9:
        dt = min(flow.stable_dt(t), 0.1, end - t)
        flow.advance(t, dt)
        for other in others:
            other.advance(t, dt)
        t += dt


@pytest.mark.slow
def test_all_heat_is_accounted_for_with_warm_walls_bodies_and_openings():
    shape = (24, 20)
    solid = blocks(shape, np.s_[10:13, 6:9])

    def wind(inlet: float, wall: float, obstacle: float, power: float) -> CfdWind:
        window = {"kind": "inlet", "face": "x-", "speed": 0.2, "center": [0.7], "size": [0.2]}
        outlet = {"kind": "outlet", "face": "x+", "center": [0.3], "size": [0.2]}
        openings = [window | {"temperature": inlet}, outlet]
        heat = {
            "walls": [
                {"face": "y-", "temperature": wall, "transfer": 5.0},
                {"face": "x-", "temperature": 296.0},
            ],
            "obstacles": [{"number": 0, "temperature": obstacle}],
            "heaters": [{"position": [0.8, 0.2], "power": power}],
        }
        return warm_wind(2, DOWN, openings, heat, turbulence={"kind": "smagorinsky"})

    flow = warm_box(shape, wind(310.0, 305.0, 330.0, 30.0), solid)
    heat = flow.heat
    run(flow, 8.0)
    budget = heat.budget()
    found = budget["in_air_J"] + budget["outflow_J"]
    given = budget["heaters_J"] + budget["surfaces_J"]
    assert given > 200.0
    assert found == pytest.approx(given, rel=1e-5)
    assert budget["outflow_J"] < 0.0  # the warm inlet brings more than the outlet takes
    assert np.all(flow.grid.read(heat.theta)[solid] == 0.0)


def test_walls_give_what_their_transfer_says_and_openings_are_no_walls():
    """A wall with coefficient h warms well-mixed air along an exponential; here over its first seconds."""
    outlet = {"kind": "outlet", "face": "y+", "center": [0.25], "size": [0.2]}

    def wind(temperature: float, transfer: float, **heat) -> CfdWind:
        wall = {"face": "y+", "temperature": temperature, "transfer": transfer}
        return warm_wind(2, openings=[outlet], heat={"walls": [wall]} | heat)

    flow = warm_box((10, 10), wind(310.0, 2.0, diffusivity=1.0))
    heat = flow.heat
    heat.advance(0.0, 2.0)
    state = State(heat)
    saved = state.save()
    heat.advance(2.0, 3.0)
    area = (0.5 - 0.2) * 0.4
    warmth = heat.budget()
    assert warmth["surfaces_J"] == pytest.approx(2.0 * area * 10.0 * 5.0, rel=0.01)
    assert flow.max_speed == 0.0
    state.restore(saved)
    heat.advance(2.0, 3.0)
    assert heat.budget() == warmth


@pytest.mark.slow
def test_layered_air_waves_and_turned_over_it_falls():
    speeds = []
    nudge, slope = 0.1, 40.0
    for sign in (1.0, -1.0):
        flow = layers()
        flow.heat.transport.start_from(
            lambda x, s=sign: s * slope * x[..., 1] + nudge * np.cos(2.0 * np.pi * x[..., 0] / 0.8)
        )
        run(flow, 4.0)
        speeds.append(flow.max_speed)
    frequency = np.sqrt(9.81 * slope / 300.0)
    assert speeds[0] < 1.5 * 9.81 * nudge / 300.0 / frequency
    assert speeds[1] > 10.0 * speeds[0]


def test_still_layers_hold_still_exactly_as_long_as_nothing_disturbs_them():
    flow = layers(heat={"diffusivity": 0.0})
    flow.heat.transport.start_from(lambda x: 10.0 * np.tanh(4.0 * (x[..., 1] - 0.6)))
    run(flow, 2.0)
    fall = np.sqrt(9.81 * 20.0 / 300.0 * 1.2)
    assert flow.max_speed < 1e-4 * fall
    p = flow.grid.read(flow.p).astype(float)[3]
    y = (np.arange(24) + 0.5) * 0.05
    weight = 9.81 / 300.0 * 10.0 * np.log(np.cosh(4.0 * (y - 0.6))) / 4.0  # the integral of the lift
    np.testing.assert_allclose(p - p.mean(), weight - weight.mean(), atol=0.01 * np.ptp(weight))


@pytest.mark.slow
def test_heavy_gas_falls_as_it_should_at_first():
    """A column of gas beside air of the same width and height accelerates at +-a/2 where walls are far: the two streams
    share the weight.
    """
    shape, x_mole = (64, 64), 0.01
    grid = Grid(shape, 0.05, periodic=(True, True))
    empty = Air.everywhere(grid)
    model = eulerian((1, 1), species="acetone")
    scalar = Scalar(grid)
    heavy = BuoyantScalar(scalar.q, model.vapour.weight_per_density)
    flow = flow_in(grid, cfd(periodic("xy"), buoyancy={"gravity": DOWN}, **LAMINAR), weighing=[heavy])
    gas = EulerianSolver(model, grid, flow, empty, scalar=scalar)
    density = x_mole * 1e6 / gas.species.ppm_per_density
    gas.start_from(lambda x: density * 0.5 * (1.0 + np.sin(2.0 * np.pi * x[..., 0] / 3.2)))
    end = 0.05
    run(flow, end)
    v = grid.read(flow.u[1]).astype(float)
    excess = 58.080 / 28.965 - 1.0
    x = grid.centers()[..., 0]
    expected = -9.81 * excess * x_mole * 0.5 * np.sin(2.0 * np.pi * x / 3.2) * end
    fall = v - v.mean()
    np.testing.assert_allclose(fall, expected, atol=2e-3 * np.abs(expected).max())


def test_steps_from_rest_are_short_enough_for_the_fall():
    flow = layers()
    calm = flow.stable_dt()
    flow.heat.transport.start_from(lambda x: np.where(x[..., 0] < 0.4, 30.0, -30.0))
    dt = flow.stable_dt()
    assert dt < calm
    flow.advance(0.0, dt)
    assert flow.max_courant <= flow.courant


@pytest.mark.parametrize(
    ("keys", "where"),
    [
        ({"walls": [{"face": "x-", "center": [0.25], "size": [0.1], "temperature": 310}]}, r"walls\[0\]"),
        ({"heaters": [{"position": [0.02, 0.25], "radius": 0.01, "power": 5}]}, r"heaters\[0\]"),
    ],
)
def test_what_touches_no_air_is_reported(keys, where):
    solid = blocks((10, 10), 0)
    with pytest.raises(ValueError, match=r"buoyancy\.heat\." + where):
        warm_box((10, 10), warm_wind(2, heat=keys), solid)


def height_of_gas(**buoyancy) -> float:
    """Mean height [m] of acetone after 6 s in an upright section, released at 0.5 m."""
    domain = {"size": [1.0, 1.0], "spacing": 0.05, "depth": 0.5}
    gas = {"kind": "eulerian", "species": "acetone", "sources": [{"position": [0.5, 0.5], "rate": 1e-4}]}
    data = {"duration": 6, "domain": domain, "wind": {"kind": "cfd"} | buoyancy, "gas": gas}
    sim = assemble(Scenario.model_validate(data))
    sim.run()
    c = sim.grid.read(sim.gas.gases[0].c).astype(float)
    return float((c * sim.grid.centers()[..., 1]).sum() / c.sum())


@pytest.mark.slow
def test_acetone_sinks_when_the_scenario_says_so():
    assert height_of_gas() == pytest.approx(0.5, abs=1e-5)
    assert height_of_gas(buoyancy={"gravity": [0, -9.81]}) < 0.4
    thermal = {"gravity": [0, -9.81], "solutal": False, "heat": {}}
    assert height_of_gas(buoyancy=thermal) == pytest.approx(0.5, abs=1e-5)
