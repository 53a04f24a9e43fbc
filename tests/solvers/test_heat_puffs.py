"""Heaters release heat in puffs: the power stays exact, and the puffs follow from the seed and the time alone."""

from collections.abc import Callable

import numpy as np
import pytest
from rooms import cfd, eulerian, flow_in

from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.state import State
from taichi_plume.scenario.heat import Heat
from taichi_plume.scenario.winds import CfdWind
from taichi_plume.solvers.flow import FlowSolver
from taichi_plume.solvers.gas import EulerianSolver
from taichi_plume.solvers.heat import HeatSolver
from taichi_plume.solvers.momentum import BuoyantScalar
from taichi_plume.solvers.prescribed_wind import PrescribedWind
from taichi_plume.solvers.transport import Scalar

pytestmark = pytest.mark.usefixtures("taichi")
DX = 0.05


def warm_wind(dim: int, turbulence: str = "smagorinsky", **heat) -> CfdWind:
    """Still air with a heater of 30 W beside a wall, so that the wall cuts the ball."""
    heater = {"position": (0.09,) + (0.3,) * (dim - 1), "radius": 0.12, "power": 30.0}
    warm = {"gravity": (0.0,) * (dim - 1) + (-9.81,), "heat": {"heaters": [heater], **heat}}
    return cfd(turbulence={"kind": turbulence}, buoyancy=warm)


@pytest.fixture(scope="module")
def warm_box(taichi) -> Callable[..., FlowSolver]:
    """A box of still air, by its wind, shape and seed."""

    def made(wind: CfdWind, shape=(12, 14), periodic=(), seed=0) -> FlowSolver:
        return flow_in(Grid(shape, DX, depth=0.4, periodic=periodic), wind, seed=seed)

    return made


@pytest.mark.parametrize("shape", [(12, 14), pytest.param((10, 8, 12), marks=pytest.mark.slow)])
def test_the_shares_of_every_puff_sum_to_one_and_their_mean_is_at_the_heater(warm_box, shape):
    puffs = warm_box(warm_wind(len(shape)), shape).heat.puffs
    cells, even = puffs.release.balls[0]
    found = np.array([puffs.shares(0, k) for k in range(-50, 350)])
    np.testing.assert_allclose(found.sum(axis=1), 1.0, rtol=1e-12)
    assert found.min() >= 0.0
    middles = found @ cells
    error = middles.std(axis=0) / np.sqrt(len(found))
    assert np.all(np.abs(middles.mean(axis=0) - even @ cells) < 4.0 * error + 0.05)
    assert np.all(middles.std(axis=0) * DX > 0.02)  # puffs wander within the ball


def test_the_seed_and_the_number_of_a_puff_determine_its_shares(warm_box):
    flow = warm_box(warm_wind(2), seed=3)
    first = [flow.heat.puffs.shares(0, k) for k in (0, 1, 2)]
    again = [flow.heat.puffs.shares(0, k) for k in (2, 1, 0)][::-1]
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first[0], first[1])
    flow = warm_box(warm_wind(2), seed=4)
    assert not np.array_equal(first[0], flow.heat.puffs.shares(0, 0))
    flow = warm_box(warm_wind(2, unsteadiness=0.25), seed=3)
    even = flow.heat.release.balls[0][1]
    np.testing.assert_allclose(flow.heat.puffs.shares(0, 0), 0.75 * even + 0.25 * first[0], rtol=1e-12)


@pytest.mark.slow
def test_a_puff_reaches_across_a_periodic_boundary(warm_box):
    """Moved by half a domain, the heater releases the same puff in the cells that have moved with it."""
    here, there = np.zeros((2, 12, 14))
    for x, out in ((0.09, here), (0.39, there)):
        heaters = [{"position": (x, 0.3), "radius": 0.12, "power": 30.0}]
        heat = warm_box(warm_wind(2, heaters=heaters), periodic=(True, False)).heat
        for k in range(4):
            out[tuple(heat.release.balls[0][0].T)] += heat.puffs.shares(0, k)
    np.testing.assert_allclose(np.roll(here, 6, axis=0), there, rtol=1e-9, atol=1e-12)


def test_the_power_is_exact_and_a_restored_state_goes_on_to_the_bit(warm_box):
    flow = warm_box(warm_wind(2))
    heat, state = flow.heat, State(flow)
    rate = heat.puffs._rates[0]

    def advance(begin: float, end: float) -> np.ndarray:
        steps = 24
        for k in range(steps):
            flow.advance(begin + k * (end - begin) / steps, (end - begin) / steps)
        return heat.grid.read(heat.theta)

    advance(0.0, 1.5 / rate)  # into the second puff
    saved = state.save()
    ahead = advance(1.5 / rate, 3.2 / rate)
    warmth = heat.budget()
    assert warmth["in_air_J"] == pytest.approx(30.0 * 3.2 / rate, rel=1e-6)
    advance(0.0, 0.5 / rate)
    state.restore(saved)
    np.testing.assert_array_equal(advance(1.5 / rate, 3.2 / rate), ahead)
    assert heat.budget() == warmth


@pytest.mark.slow
def test_without_eddies_or_at_zero_the_release_is_even(warm_box):
    """Heat that is released evenly stays symmetric about a heater in the middle."""
    cases = (("none", 1.0, True), ("smagorinsky", 0.0, True), ("smagorinsky", 1.0, False))
    for turbulence, unsteadiness, symmetric in cases:
        heaters = [{"position": (0.3, 0.2), "radius": 0.12, "power": 30.0}]
        wind = warm_wind(2, turbulence, heaters=heaters, unsteadiness=unsteadiness)
        assert wind.by_chance is not symmetric
        flow = warm_box(wind) if turbulence != "none" else flow_in(Grid((12, 14), DX, depth=0.4), wind)
        for k in range(5):
            flow.advance(0.02 * k, 0.02)
        theta = flow.grid.read(flow.heat.theta)
        difference = float(np.abs(theta - theta[::-1]).max() / theta.max())
        assert difference < 1e-5 if symmetric else difference > 0.1


@pytest.mark.parametrize(
    ("power", "radius", "length"), [(-30.0, 0.12, 0.12), (30.0, 0.01, DX), (0.0, 0.12, 0.12)]
)
def test_a_puff_lasts_as_long_as_air_takes_to_rise_through_the_heater(warm_box, power, radius, length):
    """A ball smaller than a cell counts as wide as a cell; without power there is only one puff."""
    heater = {"position": (0.3, 0.2), "radius": radius, "power": power}
    puffs = warm_box(warm_wind(2, heaters=[heater])).heat.puffs
    speed = (9.81 / 298.15 * abs(power) / (1191.0 * length)) ** (1 / 3)
    lasts = length / speed if power else np.inf
    for t, number in ((0.0, 0), (min(2.9 * lasts, 1e6), 0), (min(3.1 * lasts, 1e7), int(power != 0))):
        puffs.advance(t)
        assert puffs._numbers == [number]


PLACES = ((0.3, 0.35), (0.325, 0.35), (0.307, 0.361))


@pytest.mark.parametrize("radius", [0.03, 0.08, 0.12, 0.2])
@pytest.mark.parametrize("shape", [(14, 14), pytest.param((14, 14, 13), marks=pytest.mark.slow)])
def test_steady_heat_is_as_wide_as_the_ball_or_as_the_kernel_if_that_is_wider(warm_box, shape, radius):
    """The variance along an axis is R²/4 of a disc and R²/5 of a ball, at least 5/6 cells²."""
    dim = len(shape)
    expected = max(radius**2 / (dim + 2), 5.0 / 6.0 * DX**2)
    for place in PLACES:
        where = np.array([*place, 0.3][:dim])
        heater = {"position": tuple(where), "radius": radius, "power": 30.0}
        heat = HeatSolver(
            Heat.model_validate({"heaters": [heater], "unsteadiness": 0.0}),
            grid := Grid(shape, DX, depth=0.4),
            PrescribedWind(np.zeros_like, grid),
            [],
            Air.everywhere(grid),
        )
        cells, share = heat.release.balls[0]
        f = (where / DX - 0.5) % 1.0  # linear interpolation adds f (1 - f)
        found = share @ ((cells + 0.5) * DX - where) ** 2 + f * (1.0 - f) * DX**2
        np.testing.assert_allclose(found, expected, rtol=0.09)  # four samples per cell and axis make a disc


@pytest.mark.slow
@pytest.mark.parametrize("radius", [0.05, 0.1])
def test_a_heater_drives_the_wind_of_a_gas_of_the_same_buoyancy(radius):
    where, shape = (0.31, 0.29), (12, 16)
    still = {"gravity": (0.0, -9.81)}
    heater = {"position": where, "radius": radius, "power": 30.0}
    heat = {"heaters": [heater], "diffusivity": 2e-5}
    warm = flow_in(
        Grid(shape, DX, depth=0.4), cfd(turbulence={"kind": "none"}, buoyancy=still | {"heat": heat})
    )
    grid = Grid(shape, DX, depth=0.4)
    lift = 30.0 / 1191.0 / 298.15  # m³/s: beta P/(rho c_p)
    species = {"molar_mass": 0.046, "diffusivity": 2e-5}
    weight = eulerian(where, 1.0, radius=radius, species=species).vapour.weight_per_density
    model = eulerian(where, lift / weight, radius=radius, species=species)
    scalar = Scalar(grid)
    heavy = BuoyantScalar(scalar.q, weight)
    salt = flow_in(grid, cfd(turbulence={"kind": "none"}, buoyancy=still), weighing=[heavy])
    gas = EulerianSolver(model, grid, salt, Air.everywhere(grid), scalar=scalar)
    for k in range(40):
        warm.advance(0.02 * k, 0.02)
        salt.advance(0.02 * k, 0.02)
        gas.advance(0.02 * k, 0.02)
    up, down = (flow.grid.read(flow.u[1]).astype(float) for flow in (warm, salt))
    assert np.abs(down).max() > 0.005
    np.testing.assert_allclose(up, -down, atol=0.07 * np.abs(down).max())  # their convection schemes differ
