"""Gas sensors in a background of gas: what they measure in all, and what algorithms read above clean air."""

import numpy as np
import pytest
from robots import NOWHERE, Air, Floor, group
from test_unresolved import TICK, air

from taichi_plume.agents.sensors import Sensors
from taichi_plume.agents.swarm import Swarm
from taichi_plume.engine import program
from taichi_plume.grid.fields import Mixture, excess_at, ppm_at
from taichi_plume.scenario.metal_oxides import MOX_MODELS
from taichi_plume.scenario.species import SPECIES

pytestmark = pytest.mark.usefixtures("taichi")

CO2 = 420.0
METHANE = 1.9


class Bench:
    """Robots with these sensors at (1, 1), in air of one species with a background [ppm], which `level` contains."""

    def __init__(self, species: str, background: float, *sensors: dict, count: int = 1):
        program.start("cpu")
        self.air, self.background, self.tick = Air(), background, 0
        self.air.species = (SPECIES[species],)
        groups = [
            group(name=f"group {n}", count=count, sensors={"gas": one, "wind": {"kind": "ideal"}})
            for n, one in enumerate(sensors)
        ]
        size = count * len(sensors)
        self.swarm = Swarm(
            groups, np.ones((size, 2)), np.zeros(size), Floor(), NOWHERE, 3, background=background > 0
        )
        levels = (background,) if background else ()
        self.sensors = Sensors(self.swarm, 2, TICK, self.air.species, background=levels)

    def measure(self, excess: float, ticks: int = 1) -> dict[str, np.ndarray]:
        """The robots' columns after some ticks in so much gas above the background [ppm]."""
        self.air.level[None] = self.background + excess
        for _ in range(ticks):
            self.tick += 1
            self.sensors.measure(self.air, self.air, self.tick, self.tick * TICK)
        return self.swarm.snapshot()


def test_an_ideal_sensor_measures_all_gas_and_algorithms_read_the_excess():
    bench = Bench("carbon_dioxide", CO2, {"kind": "ideal"})
    first = bench.swarm.snapshot()
    assert (first["reading_ppm"], first["true_ppm"], first["above_ppm"]) == (CO2, CO2, 0.0)
    for excess in (0.0, 12.5, 80.0):
        now = bench.measure(excess)
        assert now["reading_ppm"] == now["true_ppm"] == CO2 + excess
        assert now["above_ppm"] == excess
        assert bench.swarm.reading[0] == excess


def test_a_slow_sensor_begins_in_the_background_and_follows_from_there():
    bench = Bench("carbon_dioxide", CO2, {"kind": "ideal", "rise_time": 2.0, "decay_time": 2.0})
    assert bench.measure(0.0)["reading_ppm"] == pytest.approx(CO2, rel=1e-6)
    now = bench.measure(50.0, ticks=10)
    share = 1.0 - np.exp(-10 * TICK / 2.0)
    assert now["reading_ppm"] == pytest.approx(CO2 + 50.0 * share, rel=1e-6)
    assert now["above_ppm"] == pytest.approx(50.0 * share, rel=1e-4)


@pytest.mark.parametrize("keys", [{}, {"heater": {}}, {"slow_share": 0.4}])
def test_the_resistance_of_a_metal_oxide_is_that_of_its_law_in_all_gas(keys):
    bench = Bench("methane", METHANE, {"kind": "mox", "model": "tgs2611", "noise": 0, **keys})
    model = MOX_MODELS["tgs2611"]
    air = np.sqrt(np.prod(model.air))
    clean = bench.measure(0.0)
    assert clean["resistance_ohm"] == pytest.approx(air * (1.0 + METHANE / model.c0) ** -model.b, rel=1e-5)
    assert clean["reading_ppm"] == pytest.approx(METHANE, rel=1e-3)
    assert clean["above_ppm"] == pytest.approx(0.0, abs=1e-3)
    now = bench.measure(100.0, ticks=3000)
    assert now["resistance_ohm"] == pytest.approx(
        air * (1.0 + (METHANE + 100.0) / model.c0) ** -model.b, rel=1e-4
    )
    assert now["above_ppm"] == pytest.approx(100.0, rel=1e-3)


def test_a_gas_with_another_exponent_bends_from_its_background_on():
    """A TGS 2600 has a curve of methane of its own: R = R_air (1 + c/1.278 ppm)^-0.07284."""
    bench = Bench("methane", METHANE, {"kind": "mox", "model": "tgs2600", "noise": 0})
    now = bench.measure(0.0)
    expected = np.sqrt(np.prod(MOX_MODELS["tgs2600"].air)) * (1.0 + METHANE / 1.278) ** -0.07284
    assert now["resistance_ohm"] == pytest.approx(expected, rel=1e-4)
    assert now["above_ppm"] == pytest.approx(0.0, abs=1e-4)


def test_each_unit_is_zeroed_by_itself():
    sensor = {"kind": "mox", "model": "tgs2611", "noise": 0, "spread": 1.0, "calibration": "cubic"}
    now = Bench("methane", METHANE, sensor, count=20).measure(0.0)
    assert np.ptp(now["resistance_ohm"]) > 1e3
    np.testing.assert_allclose(now["above_ppm"], 0.0, atol=1e-4)


def test_noise_about_the_background_is_cut_for_algorithms_alone():
    sensor = {"kind": "ideal", "noise_ppm": 5.0}
    many, clean = (
        Bench("carbon_dioxide", CO2, sensor, count=2000),
        Bench("carbon_dioxide", 0.0, sensor, count=2000),
    )
    measured = many.measure(0.0)
    assert measured["reading_ppm"].mean() == pytest.approx(CO2, abs=0.5)
    assert measured["reading_ppm"].std() == pytest.approx(5.0, rel=0.1)
    assert measured["above_ppm"].min() == 0.0
    alone = clean.measure(0.0)
    np.testing.assert_allclose(measured["above_ppm"], alone["reading_ppm"], atol=1e-4)
    assert clean.swarm.reading is clean.swarm.measured, "without a background both are one field"


def test_a_blind_detector_reads_nothing_of_the_background():
    now = Bench("carbon_dioxide", CO2, {"kind": "pid", "noise_ppm": 0}).measure(0.0)
    assert (now["reading_ppm"], now["above_ppm"], now["true_ppm"]) == (0.0, 0.0, CO2)


def test_the_background_counts_once_for_each_species():
    plain, _ = air(2, species=("ethanol", "methane", "ethanol"))
    whole = Mixture(plain.gases, background={"ethanol": 3.0, "methane": METHANE})
    points = np.array([[0.7, 1.1], [1.3, 0.4]])
    np.testing.assert_array_equal(excess_at(whole, points, 0.0), ppm_at(plain, points, 0.0))
    np.testing.assert_allclose(
        ppm_at(whole, points, 0.0) - ppm_at(plain, points, 0.0), [[3.0, METHANE]] * 2, rtol=1e-5
    )


@pytest.mark.parametrize("dim", [2, 3])
def test_fluctuations_are_those_of_the_excess(dim: int):
    """The same random peaks about the same mean, on top of the background."""
    found = []
    for background in ((), (CO2,)):
        gas, wind = air(dim)
        if background:
            gas = Mixture(gas.gases, gas.unresolved, {"ethanol": CO2})
        robots = group(count=500, sensors={"gas": {"kind": "ideal"}})
        swarm = Swarm(
            [robots], np.ones((500, 2)), np.zeros(500), Floor(), NOWHERE, 3, background=bool(background)
        )
        sensors = Sensors(swarm, dim, TICK, gas.species, fluctuates=True, background=background)
        for n in range(1, 4):
            sensors.measure(gas, wind, n, n * TICK)
        found.append(swarm.snapshot())
    alone, both = found
    assert alone["true_ppm"].std() > 0.0
    np.testing.assert_allclose(both["true_ppm"] - CO2, alone["true_ppm"], atol=1e-4)
    np.testing.assert_allclose(both["above_ppm"], alone["reading_ppm"], atol=1e-4)
