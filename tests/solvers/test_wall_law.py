from collections.abc import Callable
from functools import cache
from math import sqrt

import numpy as np
import pytest
from rooms import blocks, cfd, flow_in
from scipy.integrate import quad
from scipy.optimize import brentq

from taichi_plume.engine import ti
from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.grid import Grid
from taichi_plume.scenario.heat import Heat
from taichi_plume.solvers.flow import FlowSolver
from taichi_plume.solvers.heat import HeatSolver
from taichi_plume.solvers.prescribed_wind import PrescribedWind
from taichi_plume.solvers.wall_law import (
    law_of_the_wall,
    near_surface,
    transfer_velocity,
    y_plus,
)
from taichi_plume.solvers.walls import distances
from taichi_plume.validation.flow_cases import periodic

pytestmark = pytest.mark.usefixtures("taichi")
NU = 1.5e-5


@pytest.fixture(scope="module")
def law(taichi):
    """u_tau, nu_w, bend and the transfer velocity of cells at a surface, of arrays."""

    @ti.kernel
    def found(numbers: ti.types.ndarray(), out: ti.types.ndarray()):
        for n in range(numbers.shape[0]):
            speed, y, roughness, diffusivity = numbers[n, 0], numbers[n, 1], numbers[n, 2], numbers[n, 3]
            out[n, 1], out[n, 2] = near_surface(speed, y, NU, roughness, True)
            out[n, 0] = ti.sqrt(out[n, 1] * speed / y)
            out[n, 3] = transfer_velocity(speed, y, NU, diffusivity)

    def of(speed, y, roughness=0.0, diffusivity=NU):
        numbers = np.stack(np.broadcast_arrays(speed, y, roughness, diffusivity), axis=-1).astype(np.float32)
        out = np.zeros((len(numbers), 4), np.float32)
        found(numbers, out)
        return out.astype(float).T

    return of


def root(function: Callable[[float], float]) -> float:
    """Where a function of a friction velocity is 0."""
    return float(brentq(function, 1e-4, 1.0))  # type: ignore[arg-type]


def mean_of_the_law(y_plus: float) -> float:
    """u+ of a cell from the surface to 2 y+, by quadrature."""
    return quad(law_of_the_wall, 0.0, 2.0 * y_plus, limit=500)[0] / (2.0 * y_plus)


def test_friction_is_that_of_the_law_from_the_viscous_layer_outwards(law):
    y_plus = np.geomspace(0.1, 1e5, 200)
    y, u_tau = 0.025, y_plus * NU / 0.025
    outer = y_plus > 30
    log = np.log(y_plus[outer]) / 0.41 + 5.2
    np.testing.assert_allclose(law_of_the_wall(y_plus[outer]), log, rtol=0.02)
    speed = u_tau * [mean_of_the_law(one) for one in y_plus]
    found = law(speed, np.full_like(y_plus, y))
    np.testing.assert_allclose(found[0], u_tau, rtol=8e-3)
    viscous = y_plus < 1.45
    np.testing.assert_allclose(found[1][viscous], NU, rtol=1e-5)
    np.testing.assert_array_equal(found[2][viscous], 1.0)
    np.testing.assert_allclose(found[1] * speed / y, u_tau**2, rtol=0.02)
    slope = np.gradient(law_of_the_wall(y_plus), y_plus) * u_tau**2 / NU
    np.testing.assert_allclose((found[2] * speed / y / slope)[5:-5], 1.0, atol=0.05)


def test_wholly_rough_walls_follow_nikuradse(law):
    y, grain, speed = 0.02, 0.005, 5.0
    (u_tau,) = law([speed], [y], [grain])[0]
    assert grain * u_tau / NU > 100
    mean = quad(lambda x: np.log(1.0 + x / (grain * np.exp(-0.41 * 8.5))) / 0.41, 0.0, 2 * y)[0] / (2 * y)
    assert speed / u_tau == pytest.approx(mean, rel=0.03)


@pytest.mark.parametrize("schmidt", [0.71, 2.0, 1000.0])
def test_transfer_is_the_integral_of_the_diffusivities(law, schmidt):
    """In the viscous layer D/y; far out that of a mixing length with van Driest's damping, to the 10 % of its fit."""
    k = law([1e-4], [0.001], 0.0, [NU / schmidt])[3][0]
    assert k == pytest.approx(NU / schmidt / 0.001, rel=3e-3)
    y_plus, u_tau = 500.0, 0.3
    y = y_plus * NU / u_tau
    k = law([u_tau * mean_of_the_law(y_plus)], [y], 0.0, [NU / schmidt])[3][0]
    assert k == pytest.approx(u_tau / resistance(y_plus, schmidt), rel=0.12)


def resistance(y_plus: float, schmidt: float) -> float:
    """u_tau over the transfer velocity: the integral of 1/(1/Sc + nu_t/(0.85 nu)) over y+."""

    def share(log_y: float) -> float:
        y = np.exp(log_y)
        length = 0.41 * y * (1.0 - np.exp(-y / 26.0))
        eddies = 0.5 * (sqrt(1.0 + 4.0 * length**2) - 1.0)
        return y / (1.0 / schmidt + eddies / 0.85)

    return quad(share, np.log(1e-6), np.log(y_plus), limit=500)[0]


# ---------------------------------------------------------------- in the flow


@pytest.fixture(scope="module")
def channel(taichi) -> Callable[..., FlowSolver]:
    @cache
    def made(kind: str, roughness: float | None = None) -> FlowSolver:
        wind = cfd(periodic("x"), viscosity=NU, turbulence={"kind": kind}, roughness=roughness)
        return flow_in(Grid((8, 8), 0.05, periodic=(True, False)), wind)

    return made


def lost(flow: FlowSolver, speed: float) -> float:
    """Momentum [m²/s²] that each wall takes per area and second from a uniform flow."""
    flow.start_from(lambda x: np.stack([np.full(x.shape[:-1], speed), np.zeros(x.shape[:-1])], axis=-1))
    before = flow.grid.read(flow.u[0]).astype(float).mean()
    flow.advance(0.0, 1e-3)
    after = flow.grid.read(flow.u[0]).astype(float).mean()
    return (before - after) / 1e-3 * 0.4 / 2


@pytest.mark.parametrize("kind", ["vreman", pytest.param("smagorinsky", marks=pytest.mark.slow)])
def test_walls_take_the_momentum_that_the_law_says(channel, kind):
    u_tau = root(lambda v: v * mean_of_the_law(0.025 * v / NU) - 1.0)
    assert lost(channel(kind), 1.0) == pytest.approx(u_tau**2, rel=5e-3)


@pytest.mark.slow
def test_rough_walls_take_more_and_slow_air_feels_viscosity_alone(channel):
    smooth = lost(channel("vreman"), 1.0)
    assert 1.4 * smooth < lost(channel("vreman", 0.003), 1.0) < 2.0 * smooth
    slow = lost(channel("vreman"), 1e-4)
    assert slow == pytest.approx(lost(channel("none"), 1e-4), rel=1e-3)


@pytest.mark.parametrize(
    ("kind", "rel"), [("vreman", 0.15), pytest.param("none", 1e-3, marks=pytest.mark.slow)]
)
def test_a_warm_wall_gives_what_the_wind_takes_along(taichi, kind, rel):
    """With a model of eddies by the law; without, by conduction across half a cell."""
    diffusivity, speed, y = 2e-5, 1.0, 0.025
    grid = Grid((8, 8), 0.05, periodic=(True, False))
    wind = PrescribedWind(lambda x: np.broadcast_to((speed, 0.0), x.shape), grid)
    wind.viscosity = NU
    if kind == "vreman":
        wind.nu = grid.field()
        wind.nu.fill(NU)
    model = {"reference": 300.0, "diffusivity": diffusivity, "walls": [{"face": "y-", "temperature": 310.0}]}
    heat = HeatSolver(Heat.model_validate(model), grid, wind, (), Air.everywhere(grid))
    heat.advance(0.0, 1e-3)
    k = heat.budget()["surfaces_J"] / (1e-3 * 10.0 * 0.4 * 1191.0)  # of 0.4 m², a slab of 1 m
    u_tau = root(lambda v: v * mean_of_the_law(y * v / NU) - speed)
    by_law = u_tau / resistance(y * u_tau / NU, NU / diffusivity)
    assert k == pytest.approx(by_law if kind == "vreman" else diffusivity / y, rel=rel)


def test_distances_are_those_of_walls_and_of_true_surfaces():
    """A wall below, none above; a block whose surface lies within a cell."""
    grid = Grid((6, 8), 0.1)
    walls = [np.zeros((2, 8), bool), np.zeros((6, 2), bool)]
    walls[1][:, 0] = True
    y = grid.centers()[..., 1]
    np.testing.assert_allclose(distances(Air.everywhere(grid), walls, grid), y, rtol=1e-5)
    away = distances(Air.of(blocks(grid.shape, np.s_[:, -1]), grid), walls, grid)
    np.testing.assert_allclose(away[:, :-1], np.minimum(y, 0.7 - y)[:, :-1], atol=1e-6)


@pytest.mark.parametrize("speed", [0.002, 0.05, 0.5, 5.0])
def test_y_plus_is_that_of_the_law_of_the_wall(speed):
    """Uniform air along two walls: u+ of Reichardt's law, averaged over the cell, is u/u_tau."""
    flow = flow_in(Grid((8, 10), 0.05, periodic=(True, False)), cfd(periodic("x"), viscosity=NU))
    flow.start_from(lambda points: np.broadcast_to((speed, 0.0), points.shape))
    y = 0.025

    def excess(height: float) -> float:
        return mean_of_the_law(height) * height - speed * y / NU

    expected = float(brentq(excess, 1e-3, 1e5))  # type: ignore[arg-type]
    found = flow.walls.y_plus([field.to_numpy().astype(float) for field in flow.u])
    assert found.shape == (2 * 8,)
    np.testing.assert_allclose(found, expected, rtol=0.01)
    assert flow.diagnostics()["wall_y_plus_max"] == pytest.approx(found.max())


@pytest.mark.parametrize("roughness", [0.0, 1e-3, 1e-2])
def test_y_plus_is_that_of_the_friction_in_the_kernels(law, roughness):
    speed, y = np.geomspace(0.01, 10.0, 9), 0.02
    u_tau = law(speed, y, roughness)[0]
    np.testing.assert_allclose(y_plus(speed, y, NU, roughness), u_tau * y / NU, rtol=0.01)


def test_air_without_viscosity_has_no_y_plus():
    flow = flow_in(Grid((8, 10), 0.05, periodic=(True, False)), cfd(periodic("x"), viscosity=0.0))
    assert "wall_y_plus_max" not in flow.diagnostics()


def test_y_plus_counts_the_speed_of_the_air_over_a_moving_wall_and_no_openings():
    wall = {"kind": "wall", "face": "y-", "velocity": [0.5, 0.0]}
    flow = flow_in(Grid((8, 10), 0.05, periodic=(True, False)), cfd([*periodic("x"), wall], viscosity=NU))
    flow.start_from(lambda points: np.broadcast_to((0.5, 0.0), points.shape))
    u = [field.to_numpy().astype(float) for field in flow.u]
    assert len(flow.walls.y_plus(u)) == 8  # of the wall at rest alone: the other moves with the air
