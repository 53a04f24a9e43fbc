import re

import numpy as np
import pytest
import yaml

from taichi_plume.assembly.preparation import checked, load_scenario
from taichi_plume.grid.grid import Grid
from taichi_plume.scenario.loading import ScenarioError
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.sources import Dish, Source
from taichi_plume.scenario.species import SPECIES, TEMPERATURE, Species
from taichi_plume.scenario.winds import UniformWind
from taichi_plume.solvers.emission import Emission
from taichi_plume.solvers.evaporation import Evaporation
from taichi_plume.solvers.uniform_wind import UniformSolver

pytestmark = pytest.mark.usefixtures("taichi")

ETHANOL = SPECIES["ethanol"]


def ethanol_dish(**keys) -> Evaporation:
    return Evaporation(Dish.model_validate({"diameter": "8.5 cm", "temperature": "25 degC"} | keys), ETHANOL)


@pytest.mark.parametrize(
    ("name", "celsius", "pressure"),
    [("ethanol", 20, 5.83e3), ("ethanol", 25, 7.83e3), ("acetone", 20, 24.7e3), ("acetone", 25, 30.8e3)],
)
def test_vapour_pressures(name, celsius, pressure):
    """Tables of both liquids."""
    kelvin = 273.15 + celsius
    assert SPECIES[name].saturation(kelvin, kelvin) == pytest.approx(pressure, rel=3e-3)


@pytest.mark.parametrize("name", ["ethanol", "acetone"])
def test_both_laws_of_the_vapour_pressure_agree_near_a_known_value(name):
    """As well as two digits of the latent heat let them."""
    known = SPECIES[name]
    kelvin, cooler = 298.15, 288.15
    pressure = known.saturation(kelvin, kelvin)
    other = Species("other", known.molar_mass, 1e-5, vapour_pressure=pressure, latent_heat=known.latent_heat)
    assert other.saturation(cooler, kelvin) == pytest.approx(known.saturation(cooler, kelvin), rel=0.03)


@pytest.mark.parametrize(
    ("speed", "isothermal", "cooled", "celsius"),
    [(0.02, 0.91, 0.48, 14.3), (0.05, 1.44, 0.66, 12.2), (0.10, 2.04, 0.85, 10.6), (0.50, 4.56, 1.58, 7.6)],
)
def test_a_dish_of_ethanol_in_a_wind(speed, isothermal, cooled, celsius):
    """Figures [mg/s, °C] reckoned apart from the program, with properties at the surface's temperature."""
    assert 1e6 * ethanol_dish(cooling=False).rate(speed) == pytest.approx(isothermal, rel=0.02)
    dish = ethanol_dish()
    assert 1e6 * dish.rate(speed) == pytest.approx(cooled, rel=0.03)
    assert dish.surface(speed) - 273.15 == pytest.approx(celsius, abs=0.7)


def test_still_air_takes_what_diffuses_from_a_disc():
    """4 D a c_s, and 4 % more by the vapour's own flow: 0.31 mg/s."""
    assert 1e6 * ethanol_dish(cooling=False).rate(0.0) == pytest.approx(0.31, rel=0.02)
    little = Species("little", 0.1, 1e-5, vapour_pressure=1.0)
    dish = Dish.model_validate({"diameter": 0.2, "temperature": TEMPERATURE, "cooling": False})
    density = 1.0 * 0.1 / (8.314462618 * TEMPERATURE)
    assert Evaporation(dish, little).rate(0.0) == pytest.approx(4.0 * 1e-5 * 0.1 * density, rel=1e-4)


def test_the_surface_is_where_heat_and_vapour_balance():
    """With its heat of evaporation without bounds a liquid would not evaporate; without any it would not cool."""
    dish = ethanol_dish()
    rates = [dish.rate(speed) for speed in np.linspace(0.0, 1.0, 11)]
    assert np.all(np.diff(rates) > 0.0)
    lazy = Species("lazy", ETHANOL.molar_mass, ETHANOL.diffusivity, ETHANOL.antoine, latent_heat=1.0)
    eager = Species("eager", ETHANOL.molar_mass, ETHANOL.diffusivity, ETHANOL.antoine, latent_heat=1e9)
    warm = ethanol_dish(cooling=False).rate(0.1)
    assert Evaporation(dish.dish, lazy).rate(0.1) == pytest.approx(warm, rel=1e-4)
    assert Evaporation(dish.dish, eager).rate(0.1) < 0.02 * warm


def begun(source, wind=None) -> Emission:
    return Emission("a", source, 0.0, 0, ETHANOL, wind)


def test_an_emission_follows_the_wind_over_the_dish():
    grid = Grid((8, 8, 4), 0.05)
    source = Source.model_validate(
        {"position": (0.2, 0.2, 0.02), "dish": {"diameter": 0.085}, "start": 1.0, "stop": 2.0}
    )
    assert source.dish is not None
    masses = {}
    for speed in (0.0, 0.1, 0.5):
        wind = UniformSolver(UniformWind(kind="uniform", velocity=(0.6 * speed, 0.8 * speed, 0.0)), grid)
        emission = begun(source, wind)
        masses[speed] = sum(emission.mass(0.05 * n, 0.05) for n in range(60))
        assert masses[speed] == pytest.approx(Evaporation(source.dish, ETHANOL).rate(speed), rel=1e-5)
    given = source.model_copy(update={"dish": Dish(diameter=0.085, air_speed=0.5)})
    emission = begun(given)
    assert emission.mass(1.0, 1.0) == pytest.approx(masses[0.5], rel=1e-6)


def test_the_wind_is_felt_again_as_it_changes():
    grid = Grid((8, 8), 0.05)
    weak, strong = (UniformSolver(UniformWind(kind="uniform", velocity=(u, 0.0)), grid) for u in (0.1, 0.5))
    source = Source.model_validate({"position": (0.2, 0.2), "dish": {"diameter": 0.085}})
    emission = begun(source, weak)
    calm = emission.mass(0.0, 0.1)
    emission.wind = strong
    assert emission.mass(0.05, 0.1) == calm  # not yet
    assert emission.mass(0.1, 0.1) > 1.5 * calm


# ---------------------------------------------------------------- scenarios

GOOD = {
    "duration": 1.0,
    "domain": {"size": [1.0, 1.0], "spacing": 0.05},
    "wind": {"kind": "uniform", "velocity": [0.1, 0.0]},
    "gas": {"kind": "eulerian", "sources": [{"position": [0.3, 0.5], "dish": {"diameter": "8.5 cm"}}]},
}
OTHER = {"name": "oil", "molar_mass": 0.1, "diffusivity": 1e-5}


def with_gas(**gas) -> dict:
    return GOOD | {"gas": GOOD["gas"] | gas}


def with_source(**source) -> dict:
    return with_gas(sources=[{"position": [0.3, 0.5]} | source])


@pytest.mark.parametrize(
    ("data", "lines"),
    [
        (with_source(), ["gas.sources[0]: .* got neither"]),
        (with_source(rate=1e-6, dish={"diameter": 0.1}), ["gas.sources[0]: .* got both"]),
        (with_source(dish={}), ["gas.sources[0].dish: .*'diameter'"]),
        (with_source(dish={"diameter": 0.1, "temperature": 25}), ["gas.sources[0].dish.temperature: .*25 K"]),
        (with_source(dish={"diameter": 0.1, "temperature": 360}), ["gas.sources[0].dish.temperature: .*140.9 kPa"]),
        (with_source(dish={"diameter": "20 cm"}, radius=0.05), ["gas.sources[0]: .*0.05 m.* 0.2 m"]),
        (with_source(dish={"diameter": "20 cm"}, radius=0.2), ["gas.sources[0]: .*0.2 m.* 0.2 m"]),
        (with_gas(species=OTHER), ["gas.species: .*'vapour_pressure'", "gas.species: .*'latent_heat'"]),
        (with_gas(species=OTHER | {"latent_heat": 0.5}), ["gas.species.latent_heat: .*0.5 J/kg"]),
    ],
)  # fmt: skip
def test_faults_name_the_key_and_the_value(tmp_path, data, lines):
    path = tmp_path / "a.yaml"
    path.write_text(yaml.safe_dump(data))
    with pytest.raises(ScenarioError) as caught:
        load_scenario(path)
    for found, expected in zip(caught.value.lines, lines, strict=True):
        assert re.match(re.escape(f"{path}: ") + expected.replace("[", r"\["), found)


@pytest.mark.parametrize(
    "data",
    [
        GOOD,
        with_gas(species=OTHER | {"vapour_pressure": 2000.0, "latent_heat": "0.4 MJ/kg"}),
        with_gas(
            species=OTHER | {"vapour_pressure": 2000.0},
            sources=[{"position": [0.3, 0.5], "dish": {"diameter": 0.1, "cooling": False}}],
        ),
    ],
)
def test_dishes_that_are_right(tmp_path, data):
    assert checked(Scenario.model_validate(data), tmp_path).scenario.sources


@pytest.mark.parametrize(
    ("given", "radius"), [({}, 0.02), ({"radius": "2 cm"}, 0.02), ({"radius": "5 cm"}, 0.05)]
)
def test_a_dish_says_its_radius_and_a_cell_may_spread_its_vapour(tmp_path, given, radius):
    data = with_source(dish={"diameter": "4 cm"}, **given)
    ((_, source),) = checked(Scenario.model_validate(data), tmp_path).scenario.sources
    assert source.radius == pytest.approx(radius)
