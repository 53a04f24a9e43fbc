from math import pi

import numpy as np
import pytest
from rooms import TUNNEL, air_in, blocks, cfd, eulerian, flow_in, missing

from taichi_plume.engine import ti
from taichi_plume.grid.grid import Grid
from taichi_plume.solvers.convection import FLUXES, LIMITED
from taichi_plume.solvers.gas import EulerianSolver
from taichi_plume.solvers.prescribed_wind import PrescribedWind
from taichi_plume.validation.flow_cases import advance, faces, laminar_flow, periodic, rms, velocities

pytestmark = pytest.mark.usefixtures("taichi")

SCHEMES = (*FLUXES, *(f"limited {name}" for name in LIMITED))
OF_GAS = ("koren", "weno5")
CELLS = 40


@pytest.fixture(scope="module")
def reconstructed(taichi):
    """Values by a scheme on the lower faces of up to CELLS periodic cells with these averages, as air of v goes by."""
    q, out = ti.field(ti.f32, CELLS + 6), {scheme: ti.field(ti.f32, CELLS + 6) for scheme in SCHEMES}
    limited = {scheme: out[f"limited {scheme}"] for scheme in LIMITED}

    @ti.kernel
    def at_faces(v: float):
        for i in range(3, CELLS + 3):
            I, e = ti.Vector([i]), ti.Vector([1])
            for scheme in ti.static(tuple(FLUXES)):
                out[scheme][i] = FLUXES[scheme](q, I, e, 0.5 * v, q[I + 2]) / v
            for scheme in ti.static(tuple(LIMITED)):
                limited[scheme][i] = LIMITED[scheme].value(q, I, e, v)

    def values(scheme: str, averages: np.ndarray, v: float) -> np.ndarray:
        n = len(averages)
        q.from_numpy(averages[(np.arange(CELLS + 6) - 3) % n])
        at_faces(v)
        return out[scheme].to_numpy()[3 : 3 + n].astype(float)

    return values


@pytest.mark.parametrize("v", [1.0, -1.0])
@pytest.mark.parametrize("scheme", ["upwind5", "weno5", "limited weno5"])
def test_the_order_of_fifth_order_on_cell_averages(reconstructed, scheme, v):
    errors = []
    for n in (12, 24):
        edges = np.linspace(0.0, 2 * pi, n + 1)
        averages = 2.0 + np.diff(np.sin(edges)) / np.diff(edges)  # of 2 + cos x
        errors.append(np.abs(reconstructed(scheme, averages, v) - 2.0 - np.cos(edges[:-1])).max())
    assert errors[1] > 1e-6  # more than rounding
    assert np.log2(errors[0] / errors[1]) >= 4.5


@pytest.mark.parametrize("scale", [1.0, 1e-9, 1e6])
@pytest.mark.parametrize("v", [1.0, -1.0])
def test_a_step_makes_no_wiggles_whatever_the_unit(reconstructed, scale, v):
    averages = scale * np.where(np.arange(40) < 20, 1.0, 2.0)
    for scheme in SCHEMES:
        overshoot = 0.01 if scheme == "weno5" else 1e-6
        value = reconstructed(scheme, averages, v)
        assert value.min() >= (1.0 - overshoot) * scale
        assert value.max() <= (2.0 + overshoot) * scale


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_uniform_field_stays_to_the_bit(reconstructed, scheme):
    assert np.all(reconstructed(scheme, np.full(16, 0.3), 1.0) == np.float32(0.3))


@pytest.mark.parametrize("v", [1.0, -1.0])
@pytest.mark.parametrize("scheme", LIMITED)
def test_no_cell_is_asked_for_more_than_the_steps_allow(reconstructed, scheme, v):
    averages = np.random.default_rng(1).lognormal(sigma=3.0, size=40)
    upwind = np.roll(averages, 1) if v > 0 else averages
    value = reconstructed(f"limited {scheme}", averages, v)
    assert np.all(value >= 0.0)
    assert np.all(value <= LIMITED[scheme].steepest * upwind * (1.0 + 1e-6))


@pytest.mark.slow
def test_weno5_decays_vortices_more_exactly():
    """Taylor-Green vortices on 16² cells, short steps so that the error of space shows."""
    viscosity, end, error = 1e-3, 2.0, {}

    def exact(x: np.ndarray, t: float) -> np.ndarray:
        u = np.stack([np.sin(x[..., 0]) * np.cos(x[..., 1]), -np.cos(x[..., 0]) * np.sin(x[..., 1])], axis=-1)
        return u * np.exp(-2.0 * viscosity * t)

    for scheme in OF_GAS:
        flow = laminar_flow((16, 16), 2 * pi / 16, viscosity, periodic("xy"), convection=scheme, courant=0.15)
        flow.start_from(lambda x: exact(x, 0.0))
        advance(flow, end)
        error[scheme] = rms(
            *(u - exact(faces(flow.grid, d), end)[..., d] for d, u in enumerate(velocities(flow)))
        )
    assert error["weno5"] <= 0.25 * error["koren"]


@pytest.fixture(scope="module")
def carried(taichi):
    """Gas before and after a ride with air that turns as a solid body, 48² cells of 1 m / 48."""
    n = 48
    grid = Grid((n, n), 1.0 / n)
    wind = PrescribedWind(lambda x: np.stack([0.5 - x[..., 1], x[..., 0] - 0.5], axis=-1), grid)
    species = {"molar_mass": 0.046, "diffusivity": 0.0}
    models = {scheme: eulerian((0.5, 0.5), species=species, convection=scheme) for scheme in OF_GAS}
    gases = {scheme: EulerianSolver(model, grid, wind, air_in(grid)) for scheme, model in models.items()}

    def ride(scheme: str, start) -> tuple[np.ndarray, np.ndarray]:
        gas = gases[scheme]
        gas.start_from(start)
        before = grid.read(gas.c).astype(float)
        for step in range(20):
            gas.advance(0.0, 2 * pi / 20)
            assert gas.least() >= 0.0, step
        return before, grid.read(gas.c).astype(float)

    return ride


@pytest.mark.slow
def test_weno5_keeps_a_turning_puff_better(carried):
    def puff(x: np.ndarray) -> np.ndarray:
        return np.exp(-((x[..., 0] - 0.7) ** 2 + (x[..., 1] - 0.5) ** 2) / (2 * 0.05**2))

    error, peak = {}, {}
    for scheme in OF_GAS:
        before, after = carried(scheme, puff)
        error[scheme], peak[scheme] = rms(after - before), after.max() / before.max()
        assert after.sum() == pytest.approx(before.sum(), rel=1e-5)
    assert error["weno5"] <= 0.5 * error["koren"]
    assert abs(1.0 - peak["weno5"]) < abs(1.0 - peak["koren"])


@pytest.mark.parametrize("shape", [(40, 30), (40, 30, 5)])
@pytest.mark.slow
def test_a_room_with_weno5(shape):
    """Air and gas around a box, with outlets: finite, divergence-free, well-mixed, accounted for."""
    grid = Grid(shape, 0.1, depth=0.5)
    solid = blocks(shape, np.s_[12:16, 10:16])
    openings = [TUNNEL[0], {"kind": "outlet", "face": "x+"}, {"kind": "outlet", "face": "y+"}]
    flow = flow_in(grid, cfd(openings, convection="weno5"), solid)

    def gas(rate: float) -> EulerianSolver:
        model = eulerian((0.6, 1.3, 0.25)[: len(shape)], rate, convection="weno5")
        return EulerianSolver(model, grid, flow, air_in(grid, solid))

    plume, even = gas(2e-5), gas(0.0)
    even.start_from(lambda x: np.ones(x.shape[:-1]))
    for n in range(40):
        dt = min(0.05, flow.stable_dt())
        flow.advance(n * dt, dt)
        plume.advance(n * dt, dt)
        if n < 10:
            even.advance(n * dt, dt)
        assert plume.least() >= 0.0
    assert flow.diagnostics()["max_divergence"] <= 1e-4
    assert flow.diagnostics()["max_speed"] < 3.0
    air = ~solid
    air[:20], air[:, -6:] = False, False  # clean air comes in
    np.testing.assert_allclose(grid.inner(even.c.to_numpy())[air], 1.0, rtol=1e-5)
    assert abs(missing(plume)) <= 1e-6
