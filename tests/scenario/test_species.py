"""The gases by name, against what others give for them; and how sensors take them."""

import re
from typing import get_args

import numpy as np
import pytest

from taichi_plume.scenario.gas_sensors import PID_FACTORS, UNSEEN, PidSensor
from taichi_plume.scenario.metal_oxides import INERT, MOX_MODELS, OXIDISING, MoxName, MoxSensor
from taichi_plume.scenario.species import SPECIES, SpeciesName

FORMULAS = {
    "ethanol": "C2 H6 O1",
    "acetone": "C3 H6 O1",
    "methanol": "C1 H4 O1",
    "1-propanol": "C3 H8 O1",
    "2-propanol": "C3 H8 O1",
    "ethyl_acetate": "C4 H8 O2",
    "hexane": "C6 H14",
    "benzene": "C6 H6",
    "toluene": "C7 H8",
    "methane": "C1 H4",
    "propane": "C3 H8",
    "butane": "C4 H10",
    "isobutane": "C4 H10",
    "ethylene": "C2 H4",
    "isobutylene": "C4 H8",
    "hydrogen": "H2",
    "ammonia": "N1 H3",
    "carbon_monoxide": "C1 O1",
    "carbon_dioxide": "C1 O2",
    "hydrogen_sulfide": "H2 S1",
    "sulfur_dioxide": "S1 O2",
    "nitrogen_dioxide": "N1 O2",
    "chlorine": "Cl2",
    "helium": "He1",
    "neon": "Ne1",
    "sulfur_hexafluoride": "S1 F6",
}
WEIGHTS = {
    "C": 12.011, "H": 1.008, "O": 15.999, "N": 14.007, "S": 32.06, "F": 18.998, "Cl": 35.45, "He": 4.0026,
    "Ne": 20.180,
}  # fmt: skip
# of Fuller, Ensley & Giddings 1969: of molecules, and of the atoms of others
MOLECULES = {
    "hydrogen": 6.12, "helium": 2.67, "neon": 5.98, "carbon_monoxide": 18.0, "carbon_dioxide": 26.9, "ammonia": 20.7,
    "chlorine": 38.4, "sulfur_dioxide": 41.8, "sulfur_hexafluoride": 71.3,
}  # fmt: skip
ATOMS = {"C": 15.9, "H": 2.31, "O": 6.11, "N": 4.54, "S": 22.9}
RING, AIR = -18.3, 19.7
AT_25_DEGREES = {  # kPa, measured vapour pressures
    "ethanol": 7.87, "acetone": 30.8, "methanol": 16.9, "1-propanol": 2.76, "2-propanol": 6.02, "ethyl_acetate": 12.6,
    "hexane": 20.2, "benzene": 12.7, "toluene": 3.79,
}  # fmt: skip
VAPORISATION = {  # kJ/mol at 25 degrees
    "ethanol": 42.3, "acetone": 31.0, "methanol": 37.4, "1-propanol": 47.5, "2-propanol": 45.4, "ethyl_acetate": 35.6,
    "hexane": 31.6, "benzene": 33.8, "toluene": 38.0,
}  # fmt: skip


def atoms(name: str) -> list[tuple[str, int]]:
    return [(atom, int(n)) for atom, n in re.findall(r"([A-Z][a-z]?)(\d+)", FORMULAS[name])]


def test_every_name_has_an_entry_and_a_formula():
    assert list(get_args(SpeciesName)) == list(SPECIES)
    assert SPECIES.keys() - FORMULAS.keys() == set(), "FORMULAS: add the formula of each"
    assert FORMULAS.keys() - SPECIES.keys() == set()
    every = {atom for name in FORMULAS for atom, _ in atoms(name)}
    assert every - WEIGHTS.keys() == set(), "WEIGHTS: add the standard atomic weight of each"
    unknown = {
        name for name in FORMULAS if name not in MOLECULES and ATOMS.keys().isdisjoint(dict(atoms(name)))
    }
    assert unknown == set(), "MOLECULES: add the diffusion volume of each"
    assert all(name == one.name for name, one in SPECIES.items())
    assert list(get_args(MoxName)) == list(MOX_MODELS)


@pytest.mark.parametrize("name", FORMULAS)
def test_molar_masses_are_those_of_the_atoms(name):
    assert SPECIES[name].molar_mass == pytest.approx(
        1e-3 * sum(n * WEIGHTS[a] for a, n in atoms(name)), rel=2e-4
    )


@pytest.mark.parametrize("name", FORMULAS)
def test_diffusivities_are_near_the_method_of_fuller(name):
    """D = 0.00143 T^1.75 / (p M^½ (Σv^⅓ + Σv^⅓)²) [cm²/s], p [bar], M = 2 / (1/M1 + 1/M2) [g/mol]; errs by some %."""
    one = SPECIES[name]
    volume = MOLECULES.get(name) or sum(n * ATOMS[a] for a, n in atoms(name) if a in ATOMS)
    volume += RING * (name in ("benzene", "toluene"))
    mass = 2.0 / (1.0 / 28.965 + 1e-3 / one.molar_mass)
    d = 0.00143 * 298.15**1.75 / (1.01325 * np.sqrt(mass) * (np.cbrt(volume) + np.cbrt(AIR)) ** 2)
    off = 0.14 if name == "nitrogen_dioxide" else 0.1  # of which the atoms tell least
    assert one.diffusivity == pytest.approx(1e-4 * d, rel=off)


@pytest.mark.parametrize("name", AT_25_DEGREES)
def test_liquids_evaporate_as_measured(name):
    one = SPECIES[name]
    assert one.saturation(298.15, 298.15) == pytest.approx(1e3 * AT_25_DEGREES[name], rel=0.02)
    assert one.latent_heat is not None
    assert one.latent_heat == pytest.approx(1e3 * VAPORISATION[name] / one.molar_mass, rel=0.03)


def test_the_others_are_no_liquids():
    liquids = {name for name, one in SPECIES.items() if one.antoine}
    assert liquids - AT_25_DEGREES.keys() == set(), "AT_25_DEGREES, VAPORISATION: add measured values of each"
    assert liquids == AT_25_DEGREES.keys() == VAPORISATION.keys()


# ---------------------------------------------------------------- sensors

POWER_LAWS = {  # GADEN's R/R0 = a c^-b and R_air/R0
    ("tgs2600", "methane"): (1.018, 0.07284, 1.0),
    ("tgs2600", "hydrogen"): (0.6821, 0.3532, 1.0),
    ("tgs2620", "methane"): (120.6, 0.4877, 21.0),
    ("tgs2620", "hydrogen"): (24.45, 0.5546, 21.0),
    ("tgs2611", "methane"): (38.46, 0.4289, 8.8),
    ("tgs2611", "ethanol"): (51.11, 0.3658, 8.8),
    ("tgs2611", "hydrogen"): (41.3, 0.3614, 8.8),
    ("tgs2610", "methane"): (63.91, 0.5372, 10.3),
    ("tgs2610", "ethanol"): (106.1, 0.5008, 10.3),
    ("tgs2610", "hydrogen"): (66.78, 0.4888, 10.3),
    ("tgs2612", "methane"): (146.2, 0.5916, 19.5),
    ("tgs2612", "ethanol"): (31.35, 0.09115, 19.5),
}


@pytest.mark.parametrize(("model", "gas"), POWER_LAWS)
def test_curves_go_over_into_the_published_power_laws(model, gas):
    a, b, air = POWER_LAWS[model, gas]
    curve = MOX_MODELS[model].curve(gas)
    assert curve is not None
    c = 1e7  # far above c0, where 1 + c/c0 is c/c0
    assert (1.0 + c / curve[0]) ** -curve[1] == pytest.approx(a * c**-b / air, rel=2e-3)


@pytest.mark.parametrize("model", MOX_MODELS)
def test_every_model_reads_its_own_gas_rightly_and_tells_of_all_others(model):
    sensor = MoxSensor.model_validate({"kind": "mox", "model": model})
    own = MOX_MODELS[model].gas
    assert (sensor.weight(own), sensor.bend(own), sensor.reads(own, 33.0)) == (1.0, None, 33.0)
    for gas in SPECIES:
        felt = gas in MOX_MODELS[model].others or gas not in INERT | OXIDISING | MOX_MODELS[model].filtered
        assert (sensor.weight(gas) > 0) == (sensor.reads(gas, 10.0) > 0) == felt


def test_a_metal_oxide_calibrated_for_another_gas_reads_that_rightly():
    sensor = MoxSensor.model_validate({"kind": "mox", "model": "tgs2620", "calibrated_for": "methane"})
    assert sensor.reads("methane", 200.0) == pytest.approx(200.0)
    assert sensor.reads("ethanol", 50.0) > 500.0  # which it feels far better


def test_what_is_given_for_a_species_counts_before_the_curve():
    sensor = MoxSensor(kind="mox", model="tgs2620", sensitivity={"methane": 0.25, "hydrogen": 0.0})
    assert (sensor.weight("methane"), sensor.bend("methane")) == (0.25, None)
    assert sensor.weight("hydrogen") == sensor.reads("hydrogen", 9.0) == 0.0


def test_detectors_have_a_factor_of_all_gases_or_do_not_see_them():
    missing = SPECIES.keys() - (PID_FACTORS.keys() | UNSEEN)
    assert missing == set(), "taichi_plume/scenario/gas_sensors.py: add each to PID_FACTORS or UNSEEN"
    assert PID_FACTORS.keys() | UNSEEN == SPECIES.keys()
    assert not set(PID_FACTORS) & UNSEEN
    pid = PidSensor(kind="pid", correction={"toluene": 0.4})
    assert pid.weight("toluene") == 2.5
    assert pid.weight("ethanol") == 0.1
    assert pid.weight("methane") == 0.0
    assert pid.weight("xylene") == 1.0
    assert PidSensor(kind="pid", correction={"methane": 50.0}).weight("methane") == 0.02
