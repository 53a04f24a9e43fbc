from functools import partial

import numpy as np
import pytest
from rooms import TUNNEL, assert_same, blocks, cfd, flow_in

from taichi_plume.engine.program import compiled
from taichi_plume.grid.cut_cells import air_of
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.shapes import Ball
from taichi_plume.grid.state import State
from taichi_plume.scenario.obstacles import Cylinder, Sphere
from taichi_plume.scenario.winds import CfdWind
from taichi_plume.solvers.bodies import MovingObstacle
from taichi_plume.solvers.flow import FlowSolver
from taichi_plume.solvers.momentum import BuoyantScalar
from taichi_plume.validation.flow_cases import advance

pytestmark = pytest.mark.usefixtures("taichi")

INLET, OUTLET = TUNNEL[0], TUNNEL[1] | {"loss_coefficient": 2.0}
ARENA = (60, 45)
SOLID = blocks(ARENA, np.s_[15:20, 15:22], np.s_[40:45, 10:30])


def wind(**changes) -> CfdWind:
    return cfd(**{"openings": [INLET, OUTLET]} | changes)


def swirls(p: np.ndarray) -> np.ndarray:
    """A wide, fast vortex on the left and narrow, slower ones, which make eddies, on the right: velocity at points."""
    x, y = p[..., 0], p[..., 1]
    size, speed = np.where(x < 1.0, 1.0, 0.2), np.where(x < 1.0, 1.0, 0.7)
    a, b = np.pi * x / size, np.pi * y / size
    return speed[..., None] * np.stack([np.sin(a) * np.cos(b), -np.cos(a) * np.sin(b)], -1)


@pytest.mark.parametrize("turbulence", ["smagorinsky", "none"])
def test_the_step_is_as_long_as_the_most_limiting_cell_allows(turbulence):
    """Fast air in one cell and eddies in another do not limit the step together."""
    grid = Grid((40, 20), 0.05, depth=0.05)
    flow = flow_in(grid, cfd(turbulence={"kind": turbulence}, viscosity=2e-4, courant=0.9))
    flow.start_from(swirls)
    faces = [np.abs(u.to_numpy()).astype(float) for u in flow.u]
    speed = sum(grid.inner(np.maximum(u, np.roll(u, -1, axis=d))) for d, u in enumerate(faces))
    viscosity = np.full(grid.shape, 2e-4) if flow.nu is None else np.maximum(grid.read(flow.nu), 2e-4)
    convection = speed / (0.9 * 0.05)
    diffusion = (2.5 if turbulence == "none" else 3.75) * 2 * viscosity / 0.05**2
    assert flow.stable_dt() == pytest.approx(1.0 / (convection + diffusion).max(), rel=1e-5)
    if turbulence == "smagorinsky":
        assert (convection + diffusion).max() < 0.95 * (convection.max() + diffusion.max())


SLIP = [{"kind": "slip", "face": face} for face in ("y-", "y+")]


@pytest.mark.parametrize("courant", [0.5, 1.2, 1.4])
def test_the_pressure_follows_an_inlet_that_speeds_up(courant: float):
    """Air that moves as a whole: dp/dx = -du/dt, and 0 at the outlet."""
    schedule = [{"at": 1.0, "speed": 2.0}]
    inlet = {"kind": "inlet", "face": "x-", "speed": 1.0, "schedule": schedule, "ramp": 0.5}
    flow = flow_in(Grid((32, 4), 0.1), cfd([inlet, {"kind": "outlet", "face": "x+"}, *SLIP], courant=courant))
    centers = flow.grid.centers()[..., 0]
    advance(flow, 1.0)
    for begin, end, rise in ((1.0, 1.4, 2.0), (1.4, 2.4, 0.0), (2.4, 4.0, 0.0)):
        advance(flow, end, begin)
        np.testing.assert_allclose(flow.grid.read(flow.p), rise * (3.2 - centers), atol=0.05)
        assert flow.max_speed < 2.01


@pytest.mark.parametrize("courant", [0.3, 1.2])
def test_air_that_enters_through_an_outlet_was_at_rest_outside(courant: float):
    """Bernoulli: u²/2 less than the ambient pressure behind the outlet, with a loss K another K u²/2."""
    for loss in (0.0, 2.0):
        vent = {"kind": "honeycomb", "face": "x-", "loss_coefficient": loss}
        fan = {"kind": "inlet", "face": "x+", "speed": -0.8}
        flow = flow_in(Grid((16, 4), 0.1), cfd([vent, fan, *SLIP], courant=courant))
        advance(flow, 4.0)
        expected = -0.5 * (1.0 + loss) * 0.8**2
        np.testing.assert_allclose(flow.grid.read(flow.p), expected, rtol=0.03)


@pytest.mark.slow
def test_a_resistant_outlet_evens_out_the_outflow(taichi):
    """The larger the loss coefficient, the more uniform the flow through the honeycomb."""
    spread = []
    grid = Grid(ARENA, 4.0 / 60, depth=4.0 / 60)
    for loss in (0.0, 20.0):
        flow = flow_in(grid, wind(openings=[INLET, OUTLET | {"loss_coefficient": loss}]), SOLID)
        advance(flow, 4.0)
        g = flow.grid.ghost
        spread.append(flow.u[0].to_numpy()[g + 60, g : g + 45].std())
    assert spread[1] < 0.5 * spread[0]


@pytest.mark.slow
def test_a_fan_turns_the_air_the_right_way_and_follows_its_schedule():
    """Right-handed about the jet: above the axis of a jet along +x the air moves towards -y."""
    fan = {
        "kind": "fan", "face": "x-", "center": [0.5, 0.5], "diameter": 0.6, "speed": 1.0, "swirl": 0.5,
        "schedule": [{"at": 1.0, "speed": 0.0}], "ramp": 0.1,
    }  # fmt: skip
    flow = flow_in(Grid((16, 20, 20), 0.05), wind(openings=[fan, {"kind": "outlet", "face": "x+"}]))
    advance(flow, 0.3)
    u, v, w = (flow.grid.inner(field.to_numpy()) for field in flow.u)
    assert u[0].sum() * 0.05**2 == pytest.approx(np.pi * 0.3**2, rel=1e-5)
    assert v[2, 10, 14] < -0.05 < 0.05 < v[2, 10, 5]
    assert w[2, 14, 10] > 0.05 > -0.05 > w[2, 5, 10]
    flow.advance(1.2, 0.005)
    assert flow.grid.inner(flow.u[0].to_numpy())[0].sum() == pytest.approx(0.0, abs=4e-5)


# ---------------------------------------------------------------- state and numbers


def busy(**other) -> CfdWind:
    """Air with all that has numbers: n of them, given as x: (once, otherwise)."""
    numbers = {
        "viscosity": 1e-4, "constant": 0.15, "force": 0.1, "speed": 0.7, "intensity": 0.1, "length": 0.2,
        "loss": 2.0, "wall": 0.1, "pressure": 20.0, "screen": 3.0, "courant": 0.8, "gravity": -9.81,
    } | other  # fmt: skip
    inlet = {
        "kind": "inlet", "face": "x-", "center": [0.5], "size": [0.4], "speed": numbers["speed"],
        "turbulence_intensity": numbers["intensity"], "turbulence_length": numbers["length"],
        "schedule": [{"at": 0.03, "speed": 2 * numbers["speed"]}], "ramp": 0.02,
    }  # fmt: skip
    curve = {"pressure": numbers["pressure"], "flow": 0.3}
    fan = {"kind": "fan", "face": "y-", "center": [0.6], "size": [0.3], "curve": curve}
    wall = {
        "kind": "wall", "face": "y+", "velocity": [numbers["wall"], 0.0], "ramp": 0.02,
        "schedule": [{"at": 0.015, "velocity": [-3 * numbers["wall"], 0.0]}],
    }  # fmt: skip
    return cfd(
        [inlet, fan, OUTLET | {"loss_coefficient": numbers["loss"]}, wall],
        viscosity=numbers["viscosity"],
        turbulence={"kind": "smagorinsky", "constant": numbers["constant"]},
        screens=[
            {"kind": "perforated", "axis": "x", "at": 0.9, "loss_coefficient": numbers["screen"]},
            {"kind": "honeycomb", "axis": "x", "at": 1.1, "cell": 0.002 * numbers["screen"]},
        ],
        acceleration=[numbers["force"], 0.0],
        buoyancy={"gravity": [0.0, numbers["gravity"]]},
        courant=numbers["courant"],
    )


def walker(speed: float, radius: float = 0.1) -> Cylinder:
    outline = {"kind": "cylinder", "center": [0.2, 0.2], "radius": radius}
    return Cylinder.model_validate(outline | {"motion": {"path": [[1.0, 0.2 + speed, 0.2]]}})


def made(model: CfdWind, obstacle: Cylinder, seed: int, weight: float = 0.3) -> FlowSolver:
    grid = Grid((24, 20), 0.06, depth=0.5)
    air = air_of([Ball(Sphere(kind="sphere", center=(0.6, 0.8), radius=0.14), 2)], grid)
    heavy = BuoyantScalar(grid.field(), weight)
    heavy.field.from_numpy(np.random.default_rng(0).uniform(0, 0.1, grid.padded).astype(np.float32))
    return FlowSolver(model, grid, air, 0.0, seed, [heavy], [partial(MovingObstacle, obstacle, grid)])


def found(flow: FlowSolver, begin: float, steps: int = 4) -> list[np.ndarray]:
    """What comes of some steps."""
    for n in range(steps):
        flow.advance(begin + 0.01 * n, 0.01)
    limits = (flow.stable_dt(begin), flow.max_courant, flow.max_speed, flow.outflow_rate, flow.max_viscosity)
    fields = [field.to_numpy() for field in (*flow.u, flow.p, flow.nu)]
    return [*fields, np.array(limits), np.array(flow.boundaries.speeds(begin))]


OTHERS = {
    "viscosity": 3e-4, "constant": 0.2, "force": -0.2, "speed": 0.5, "intensity": 0.2, "length": 0.1,
    "loss": 5.0, "wall": -0.2, "pressure": 10.0, "screen": 1.5, "courant": 0.5, "gravity": -5.0,
}  # fmt: skip


def test_faces_within_obstacles_hold_still(taichi):
    flow = made(busy(), walker(0.4), 3)
    found(flow, 0.0)
    for u, area in zip(flow.u, flow._area, strict=True):
        shut = flow.grid.inner(area) == 0.0
        assert shut.sum() > 10
        np.testing.assert_array_equal(flow.grid.read(u)[shut], 0.0)


def test_other_numbers_compile_nothing(taichi):
    found(made(busy(), walker(0.4), 3), 0.0)
    before = compiled()
    found(made(busy(**OTHERS), walker(-0.3, 0.13), 4, 0.2), 0.0)
    assert compiled() == before


@pytest.mark.parametrize("name", OTHERS)
def test_each_number_counts(taichi, name):
    results = [found(made(model, walker(0.4), 3), 0.0) for model in (busy(), busy(**{name: OTHERS[name]}))]
    assert any(not np.array_equal(a, b) for a, b in zip(*results, strict=True))


def test_a_saved_flow_goes_on_to_the_bit(taichi):
    flow = made(busy(), walker(0.4), 3)
    state = State(flow)
    found(flow, 0.0)
    saved, loss = state.save(), flow.momentum_loss()
    wanted = found(flow, 0.04)
    found(flow, 0.08)
    state.restore(saved)
    assert_same(flow.momentum_loss(), loss)
    assert_same(found(flow, 0.04), wanted)


@pytest.mark.parametrize("change", [{"swirl": 0.5}, {"diameter": 0.6}, {"speed": 2.0}, {"wall": 1.0}])
def test_other_openings_blow_from_the_next_step_on(change):
    """A saved flow goes on with the targets of openings that have changed since."""

    def room(wall: float = 0.5, **keys: float) -> FlowSolver:
        fan = {"kind": "fan", "face": "x-", "center": [0.4, 0.4], "diameter": 0.4, "speed": 1.0} | keys
        sliding = {"kind": "wall", "face": "y+", "velocity": [wall, 0.0, 0.0]}
        return flow_in(Grid((12, 8, 8), 0.1), cfd([fan, {"kind": "outlet", "face": "x+"}, sliding]))

    before, other, fresh = room(), room(**change), room(**change)
    before.advance(0.0, 0.02)
    State(other).restore(State(before).save())
    for flow in (other, fresh):
        flow.advance(0.02, 0.02)
    assert_same(
        [a.to_numpy() for a in other.boundaries.target], [a.to_numpy() for a in fresh.boundaries.target]
    )


@pytest.mark.slow
def test_the_flow_past_a_sphere_has_no_preferred_axis():
    """A room whose axes are exchanged in turn, x to y to z to x, has the same flow."""
    grid, center = Grid((14,) * 3, 0.07), (0.43, 0.52, 0.47)

    def after_a_second(axis: str, middle: tuple[float, ...]) -> list[np.ndarray]:
        openings = [
            {"kind": "honeycomb", "face": f"{axis}-", "speed": 0.5},
            {"kind": "outlet", "face": f"{axis}+"},
        ]
        ball = Ball(Sphere(kind="sphere", center=middle, radius=0.18), 3)
        flow = FlowSolver(cfd(openings), grid, air_of([ball], grid))
        advance(flow, 1.0)
        return [grid.read(u) for u in flow.u]

    first, other = after_a_second("x", center), after_a_second("y", (center[2], center[0], center[1]))
    largest = max(np.abs(u).max() for u in first)
    for d in range(3):
        np.testing.assert_allclose(other[(d + 1) % 3].transpose(1, 2, 0), first[d], atol=1e-4 * largest)


@pytest.mark.parametrize("shape", [(1, 9), (2, 9), (9, 2), (12, 9), (2, 3, 4)])
def test_ghost_values_of_periodic_axes_repeat_the_air_inside(shape):
    grid = Grid(shape, 0.1, periodic=(True,) * len(shape))
    flow, g = flow_in(grid, cfd()), grid.ghost
    rng = np.random.default_rng(1)
    inner = [rng.standard_normal(shape).astype(np.float32) for _ in shape]
    for u, values in zip(flow.u, inner, strict=True):
        u.from_numpy(grid.pad(values))
    flow._fill()
    for u, values in zip(flow.u, inner, strict=True):
        for a in range(grid.dim):
            beside = tuple(slice(None) if b == a else slice(g, g + n) for b, n in enumerate(shape))
            width = [(g, g) if b == a else (0, 0) for b in range(grid.dim)]
            np.testing.assert_array_equal(u.to_numpy()[beside], np.pad(values, width, mode="wrap"))
