"""Gas that comes in with the air, and walls and obstacles that take it up."""

from math import erf, exp, pi, sqrt
from typing import Any

import numpy as np
import pytest
from rooms import blocks, cfd, eulerian, march
from scipy.optimize import brentq

from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.state import State
from taichi_plume.scenario.gases import EulerianGas
from taichi_plume.solvers.gas import EulerianSolver
from taichi_plume.solvers.prescribed_wind import PrescribedWind

pytestmark = pytest.mark.usefixtures("taichi")

MOLAR_MASS = 0.046


def gas_of(diffusivity: float, **keys) -> EulerianGas:
    return eulerian(species={"molar_mass": MOLAR_MASS, "diffusivity": diffusivity}, **keys)


PER_PPM = 1.0 / gas_of(0.0).vapour.ppm_per_density  # kg/m³


class Duct:
    """Air that blows through a duct, in at one opening and out at another, or through one it is drawn in by."""

    def __init__(self, convection: str):
        self.grid, self.convection = Grid((24, 6), 0.05, depth=0.4), convection
        ends = [{"kind": "inlet", "face": "x-", "speed": 0.5}, {"kind": "outlet", "face": "x+"}]
        self.openings = cfd(ends).openings

    def gas(self, concentration: float, until: float) -> EulerianSolver:
        wind = PrescribedWind(lambda x: np.broadcast_to((0.5, 0.0), x.shape), self.grid)
        air = Air.everywhere(self.grid)
        model = self.model(concentration, until)
        return EulerianSolver(model, self.grid, wind, air, openings=self.openings)

    def model(self, concentration: float, until: float) -> EulerianGas:
        steps = [{"at": until, "concentration": "0 ppm"}]
        inflow = [{"opening": 0, "concentration": concentration, "schedule": steps}]
        inflow.append({"opening": 1, "concentration": "1 percent"})
        return gas_of(1e-5, inflow=inflow, convection=self.convection)


@pytest.mark.parametrize("convection", ["koren", "weno5"])
def test_air_comes_in_with_what_it_carries(taichi, convection):
    duct = Duct(convection)
    gas = duct.gas(20.0, 5.0)
    area = 0.3 * 0.4
    march(50, 0.1, gas)
    np.testing.assert_allclose(gas.cells(5.0), 20.0 * PER_PPM, rtol=1e-5)  # nothing of the air at the outlet
    brought = 0.5 * area * 5.0 * 20.0 * PER_PPM
    budget = gas.budget()
    assert budget["inflow_kg"] == pytest.approx(brought, rel=1e-5)
    assert budget["in_domain_kg"] + budget["outflow_kg"] == pytest.approx(budget["inflow_kg"], rel=1e-6)
    saved = State(gas).save()
    march((50, 90), 0.1, gas)
    late = gas.cells(9.0)
    assert late.max() < 1e-3 * 20.0 * PER_PPM
    assert gas.budget()["inflow_kg"] == pytest.approx(brought, rel=1e-5)
    gas = duct.gas(20.0, 5.0)  # a run that is resumed goes on with what is due
    State(gas).restore(saved)
    march((50, 90), 0.1, gas)
    np.testing.assert_array_equal(gas.cells(9.0), late)


class Box:
    """Still air between two walls that exchange gas, 40 cells apart."""

    def __init__(self):
        self.grid = Grid((40, 3), 0.025, depth=0.5)
        self.length, self.area = 1.0, 3 * 0.025 * 0.5
        self.x = self.grid.centers()[:, 0, 0]

    def model(self, diffusivity: float, left: dict, right: dict) -> EulerianGas:
        walls = [{"face": "x-", **left}, {"face": "x+", **right}]
        return gas_of(diffusivity, surfaces={"walls": walls})

    def after(self, end: float, *model, start=np.zeros_like) -> np.ndarray:
        """Concentration [kg/m³] along the box."""
        wind = PrescribedWind(np.zeros_like, self.grid)
        self.gas = EulerianSolver(self.model(*model), self.grid, wind, Air.everywhere(self.grid))
        self.gas.start_from(lambda x: start(x[..., 0]))
        held = self.gas.budget()["in_domain_kg"]
        for _ in range(50):
            self.gas.advance(0.0, end / 50)
        budget = self.gas.budget()
        exchanged = abs(budget["taken_up_kg"]) + held
        assert budget["in_domain_kg"] + budget["taken_up_kg"] - held == pytest.approx(
            0.0, abs=1e-6 * exchanged
        )
        assert self.gas.least() >= 0.0
        return self.gas.cells(end)[:, 1].astype(float)


@pytest.fixture(scope="module")
def box(taichi) -> Box:
    return Box()


CLOSED = {"uptake": 1e-9}


def test_an_absorbing_wall_is_diffused_to(box):
    diffusivity, end = 1e-4, 100.0
    c = box.after(end, diffusivity, {"concentration": 0.0}, CLOSED, start=np.ones_like)
    exact = [erf(x / (2.0 * sqrt(diffusivity * end))) for x in box.x]
    np.testing.assert_allclose(c, exact, atol=3e-3)
    taken = 2.0 * sqrt(diffusivity * end / pi) * box.area
    assert box.gas.budget()["taken_up_kg"] == pytest.approx(taken, rel=5e-3)


def test_between_two_concentrations_the_profile_is_linear(box):
    diffusivity, end = 1e-2, 400.0
    c = box.after(end, diffusivity, {"concentration": "300 ppm"}, {"concentration": "100 ppm"})
    np.testing.assert_allclose(c / PER_PPM, 300.0 - 200.0 * box.x, atol=0.01)
    before = box.gas.budget()["in_domain_kg"]
    assert before == pytest.approx(200.0 * PER_PPM * box.area, rel=1e-4)


def test_gas_decays_as_fast_as_a_wall_takes_it_up(box):
    """The slowest mode of a slab: cos(k x) with D k tan(k L) = v, which decays by D k²."""
    diffusivity, uptake = 1e-3, 2e-3
    k: Any = brentq(lambda k: diffusivity * k * np.tan(k * box.length) - uptake, 1e-6, pi / 2 - 1e-6)
    start = lambda x: np.cos(k * x)  # noqa: E731
    c = box.after(300.0, diffusivity, CLOSED, {"uptake": uptake}, start=start)
    np.testing.assert_allclose(c / start(box.x), exp(-diffusivity * k**2 * 300.0), rtol=2e-3)


@pytest.mark.slow
def test_a_well_mixed_room_decays_by_uptake_times_area_over_volume(box):
    """Eddies that mix it at once: uptake and film then pass gas one after the other."""
    uptake, transfer, end = 2e-3, 3e-3, 200.0
    c = box.after(end, 1.0, CLOSED, {"uptake": uptake, "transfer": transfer}, start=np.ones_like)
    rate = 1.0 / (1.0 / uptake + 1.0 / transfer) / box.length
    np.testing.assert_allclose(c, exp(-rate * end), rtol=3e-3)


def test_obstacles_take_gas_up_over_their_surface(taichi):
    grid = Grid((20, 20), 0.05, depth=0.5)
    solid = blocks(grid.shape, np.s_[8:12, 6:13])
    surfaces = {"obstacles": [{"number": 0, "uptake": 1e-3, "transfer": 1e-3}]}
    still = PrescribedWind(np.zeros_like, grid)
    gas = EulerianSolver(gas_of(0.0, surfaces=surfaces), grid, still, Air.of(solid, grid))
    gas.start_from(lambda _: np.where(solid, 0.0, 1.0))
    gas.advance(0.0, 0.1)
    surface = 2 * (4 + 7) * 0.05 * 0.5
    assert gas.budget()["taken_up_kg"] == pytest.approx(0.5e-3 * surface * 0.1, rel=1e-3)
    assert np.all(gas.cells(0.1)[solid] == 0.0)
