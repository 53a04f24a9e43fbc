"""Unresolved fluctuations of gas at sensors, against closed forms in a steady linear gradient."""

import numpy as np
import pytest
from robots import NOWHERE, Floor, group

from taichi_plume.agents.sensors import Sensors
from taichi_plume.agents.swarm import Swarm
from taichi_plume.engine import ti
from taichi_plume.grid.fields import GridGas, Mixture
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.kernels import Template
from taichi_plume.grid.state import State
from taichi_plume.scenario.species import SPECIES
from taichi_plume.solvers.prescribed_wind import PrescribedWind
from taichi_plume.solvers.unresolved import EDDIES, MIXING, Unresolved

pytestmark = pytest.mark.usefixtures("taichi")

TICK, MANY = 0.25, 4000
SLOPE, SHEAR, SPEED = 2e-6, 0.3, 0.04  # kg/m³ per m along x, 1/s, m/s


def relative(dx: float = 0.1, shear: float = SHEAR) -> float:
    """Standard deviation of the gas over its mean in the middle, by the equilibrium of production and mixing."""
    K, D = EDDIES * dx**2 * shear, SPECIES["ethanol"].diffusivity
    return dx * SLOPE / 1e-6 * np.sqrt(K / (K + D) / MIXING)


class Slope(GridGas):
    """Gas whose concentration rises evenly along x, 1e-6 kg/m³ in the middle of 2 m."""

    def __init__(self, grid: Grid, species):
        self.grid, self.species, self.air = grid, species, grid.filled(np.ones(grid.padded))
        x = (np.arange(grid.padded[0]) - grid.ghost + 0.5) * grid.dx
        self.c = grid.filled(np.broadcast_to(self.at(x)[:, *[None] * (grid.dim - 1)], grid.padded))

    @staticmethod
    def at(x):
        return 1e-6 + SLOPE * (x - 1.0)


def air(
    dim: int, cells: int = 20, species=("ethanol",), shear: float = SHEAR
) -> tuple[Mixture, PrescribedWind]:
    """A sheared wind along x over 2 m, and a gas of each species."""
    grid = Grid((cells, cells, 4)[:dim], 2.0 / cells)

    def velocity(x: np.ndarray) -> np.ndarray:
        u = np.zeros(x.shape)
        u[..., 0] = SPEED + shear * (x[..., 1] - 1.0)
        return u

    wind = PrescribedWind(velocity, grid)
    gases = [Slope(grid, SPECIES[name]) for name in species]  # pyright: ignore[reportAbstractUsage]
    diffusivity = SPECIES["ethanol"].diffusivity
    return Mixture(gases, [Unresolved(gas, wind, diffusivity) for gas in gases]), wind


@ti.kernel
def moments(gas: Template, x: ti.types.vector(2, ti.f32)) -> ti.types.vector(2, ti.f32):
    deviation, turnover = gas.fluctuations(x, ti.Vector([0.0, 0.0]), 0.0)
    return ti.Vector([deviation.sum(), turnover])


@pytest.mark.parametrize("cells", [20, 40])
def test_moments_are_those_of_a_linear_gradient(cells: int):
    gas, _ = air(2, cells)
    dx = 2.0 / cells
    deviation, turnover = moments(gas, ti.Vector([0.83, 1.1]))
    mean = 1e-6 * SPECIES["ethanol"].ppm_per_density
    assert deviation == pytest.approx(relative(dx) * mean, rel=1e-3)
    speed = SPEED + SHEAR * 0.1
    assert turnover == pytest.approx((speed + dx * SHEAR / np.sqrt(MIXING)) / dx, rel=1e-3)


def test_air_without_eddies_makes_no_fluctuations():
    gas, _ = air(2, shear=0.0)
    assert moments(gas, ti.Vector([0.83, 1.1]))[0] == 0.0


class Lab:
    """MANY ideal sensors that stand in the middle, or at another x [m]."""

    def __init__(self, dim: int, fluctuates: bool = True, species=("ethanol",), x: float = 1.0):
        self.gas, self.wind = air(dim, species=species)
        robots = group(count=MANY, sensors={"gas": {"kind": "ideal"}})
        self.swarm = Swarm([robots], np.tile([x, 1.0], (MANY, 1)), np.zeros(MANY), Floor(), NOWHERE, 3)
        self.sensors = Sensors(self.swarm, dim, TICK, self.gas.species, fluctuates=fluctuates)

    def series(self, begin: int, end: int) -> np.ndarray:
        """True gas [ppm] in the ticks from `begin` to before `end`, (ticks, MANY)."""
        kept = []
        for n in range(begin, end):
            self.sensors.measure(self.gas, self.wind, n, n * TICK)
            kept.append(self.swarm.true_ppm.to_numpy())
            np.testing.assert_array_equal(self.swarm.reading.to_numpy(), kept[-1])
        return np.array(kept)


@pytest.mark.parametrize("dim", [2, 3])
def test_gas_is_log_normal_about_the_mean_of_the_cells(dim: int):
    true = Lab(dim).series(1, 9)
    mean = 1e-6 * SPECIES["ethanol"].ppm_per_density
    for ppm in (true[0], true[-1]):  # from the first reading on
        assert ppm.min() > 0.0
        assert ppm.mean() == pytest.approx(mean, abs=4.0 * relative() * mean / np.sqrt(MANY))
        assert ppm.std() == pytest.approx(relative() * mean, rel=0.06)
    logarithm = np.log(true)
    assert np.abs(((logarithm[-1] - logarithm[-1].mean()) ** 3).mean() / logarithm[-1].std() ** 3) < 0.15
    turnover = (SPEED + 0.1 * SHEAR / np.sqrt(MIXING)) / 0.1
    for lag in (1, 4):
        correlation = np.corrcoef(logarithm[-1], logarithm[-1 - lag])[0, 1]
        assert correlation == pytest.approx(np.exp(-lag * TICK * turnover), abs=0.05)


def test_gases_at_one_sensor_fluctuate_together():
    true = Lab(2, species=("ethanol", "acetone")).series(1, 2)[0]
    assert true.std() / true.mean() == pytest.approx(relative(), rel=0.06)


def test_without_fluctuations_the_gas_is_that_of_the_cells():
    true = Lab(2, fluctuates=False).series(1, 4)
    np.testing.assert_allclose(true, 1e-6 * SPECIES["ethanol"].ppm_per_density, rtol=1e-5)


def test_sensors_go_on_where_they_were():
    lab = Lab(2)
    lab.series(1, 4)
    saved = State(lab.sensors).save()
    further = lab.series(4, 8)
    again = Lab(2)
    State(again.sensors).restore(saved)
    np.testing.assert_array_equal(again.series(4, 8), further)


def test_clean_air_beside_gas_stays_clean():
    lab = Lab(2, x=0.97)
    (gas,) = lab.gas.gases
    c = np.zeros(gas.c.shape, np.float32)
    c[: gas.grid.ghost + 9] = 1e-3  # to x = 0.9 m: clean about the sensors, but not half a cell away
    gas.c.from_numpy(c)
    np.testing.assert_array_equal(lab.series(1, 4), 0.0)
