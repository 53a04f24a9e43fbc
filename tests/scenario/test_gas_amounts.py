"""Releases in volumes and moles are the mass that they have by the ideal gas law, wherever a scenario has releases."""

from typing import Any

import pytest
import yaml
from scipy import constants

from taichi_plume import Scenario
from taichi_plume.scenario.loading import ScenarioError
from taichi_plume.scenario.sources import Source

STANDARD = constants.physical_constants["molar volume of ideal gas (273.15 K, 101.325 kPa)"][0]  # m³/mol
AT_25_DEGREES = STANDARD * 298.15 / 273.15
PROPANE = 44.097e-3  # kg/mol


def scenario(gas: dict[str, Any]) -> dict[str, Any]:
    return {
        "duration": 5.0,
        "domain": {"size": [4.0, 3.0], "spacing": 0.1},
        "wind": {"kind": "uniform", "velocity": [0.3, 0.0]},
        "gas": gas,
    }


def rate(text: object, kind: str = "eulerian", species: object = "propane", **keys: Any) -> float:
    source = {"position": [0.5, 1.5], "rate": text}
    gas = {"kind": kind, "species": species, "sources": [source], **keys}
    return vars(vars(Scenario.from_dict(scenario(gas)).gas)["sources"][0])["rate"]


@pytest.mark.parametrize(
    ("text", "moles"),
    [
        ("250 sccm", 250e-6 / 60 / STANDARD),
        ("250sccm", 250e-6 / 60 / STANDARD),
        ("1.5 slpm", 1.5e-3 / 60 / STANDARD),
        ("1.5 SLPM", 1.5e-3 / 60 / STANDARD),
        ("2 slm", 2e-3 / 60 / STANDARD),
        ("3 sccs", 3e-6 / STANDARD),
        ("0.4 NL/min", 0.4e-3 / 60 / STANDARD),
        ("40 NmL/min", 40e-6 / 60 / STANDARD),
        ("0.02 Nm3/h", 0.02 / 3600 / STANDARD),
        ("0.02 Nm^3/h", 0.02 / 3600 / STANDARD),
        ("2 ln/min", 2e-3 / 60 / STANDARD),
        ("3 L/min", 3e-3 / 60 / AT_25_DEGREES),
        ("3 l/min", 3e-3 / 60 / AT_25_DEGREES),
        ("3 lpm", 3e-3 / 60 / AT_25_DEGREES),
        ("15 mL/min", 15e-6 / 60 / AT_25_DEGREES),
        ("15 cc/min", 15e-6 / 60 / AT_25_DEGREES),
        ("7 cm3/s", 7e-6 / AT_25_DEGREES),
        ("0.01 m^3/h", 0.01 / 3600 / AT_25_DEGREES),
        ("2e-3 mol/h", 2e-3 / 3600),
        ("30 umol/s", 30e-6),
        ("0 sccm", 0.0),
        ("1 scfh", 0.3048**3 / 3600 / STANDARD),
        ("0.1 SCFM", 0.1 * 0.3048**3 / 60 / STANDARD),
        ("6 slph", 6e-3 / 3600 / STANDARD),
        ("1e-4 scmm", 1e-4 / 60 / STANDARD),
        ("0.02 scmh", 0.02 / 3600 / STANDARD),
        ("250 scm3/min", 250e-6 / 60 / STANDARD),
        ("250 std cm^3/min", 250e-6 / 60 / STANDARD),
        ("250 std. cc/min", 250e-6 / 60 / STANDARD),
        ("2 NLM", 2e-3 / 60 / STANDARD),
        ("2 Nl/min", 2e-3 / 60 / STANDARD),
        ("2 nlpm", 2e-3 / 60 / STANDARD),
        ("30 mln/min", 30e-6 / 60 / STANDARD),
        ("15 mlpm", 15e-6 / 60 / AT_25_DEGREES),
        ("0.1 cfh", 0.1 * 0.3048**3 / 3600 / AT_25_DEGREES),
        ("0.01 m3 h-1", 0.01 / 3600 / AT_25_DEGREES),
        ("2 mmol.h-1", 2e-3 / 3600),
    ],
)
@pytest.mark.parametrize("kind", ["eulerian", "puffs", "continuous", "meandering"])
def test_rates_in_volumes_and_moles(text, moles, kind):
    assert rate(text, kind) == pytest.approx(moles * PROPANE, rel=1e-9)


def test_masses_of_puffs():
    for text, moles in (("5 mL", 5e-6 / AT_25_DEGREES), ("5 scc", 5e-6 / STANDARD), ("2 mmol", 2e-3)):
        release = {"position": [1.0, 1.0], "mass": text}
        gas = {"kind": "gaussian_puff", "species": "propane", "releases": [release]}
        (found,) = vars(Scenario.from_dict(scenario(gas)).gas)["releases"]
        assert found.mass == pytest.approx(moles * PROPANE, rel=1e-9)


@pytest.mark.parametrize("molar_mass", [0.0461, "46.1 g/mol"])
def test_the_molar_mass_is_that_of_the_gas(molar_mass):
    other = {"name": "mine", "molar_mass": molar_mass, "diffusivity": 1e-5}
    assert rate("1 mmol/s", species=other) == pytest.approx(4.61e-5, rel=1e-12)
    ethanol = {"kind": "eulerian", "sources": [{"position": [1, 1], "rate": "1 mmol/s"}]}  # by default
    assert vars(Scenario.from_dict(scenario(ethanol)).gas)["sources"][0].rate == pytest.approx(
        46.069e-6, rel=1e-12
    )
    parts = [ethanol | {"species": species} for species in ("hydrogen", "methane")]
    mixture = Scenario.from_dict(scenario({"kind": "mixture", "parts": parts}))
    rates = [vars(source)["rate"] for _, source in mixture.sources]
    assert rates == pytest.approx([2.016e-6, 16.043e-6], rel=1e-12)


def test_changes_and_written_files_have_the_same_rate(tmp_path):
    first = Scenario.from_dict(
        scenario({"kind": "eulerian", "sources": [{"position": [1, 1], "rate": "333 sccm"}]})
    )
    for defaults in (False, True):
        first.to_yaml(tmp_path / "s.yaml", defaults=defaults)
        assert Scenario.from_file(tmp_path / "s.yaml").sources == first.sources
    changed = first.with_({"gas.sources.0.rate": "1 mol/h", "gas.species": "methane"})
    assert vars(changed.sources[0][1])["rate"] == pytest.approx(16.043e-3 / 3600, rel=1e-9)
    (tmp_path / "t.yaml").write_text(yaml.safe_dump(first.keys_set()))
    overridden = Scenario.from_file(tmp_path / "t.yaml", ["gas.sources.0.rate=1 slpm"])
    assert vars(overridden.sources[0][1])["rate"] == pytest.approx(1e-3 / 60 / STANDARD * 46.069e-3, rel=1e-9)


@pytest.mark.parametrize(
    ("text", "reported"),
    [
        ("50 m^3/s", r"sources\[0\]\.rate: got .* kg/s; .*1 kg/s"),
        ("-3 sccm", r"sources\[0\]\.rate: got .*at least 0 kg/s"),
        ("3 furlong", r"sources\[0\]\.rate: .*'3 furlong'.*sccm, L/min, mol/h"),
        ("3 nl/min", r"sources\[0\]\.rate: .*'3 nl/min'"),  # nano or normal?
        ("3 nm3/h", r"sources\[0\]\.rate: .*'3 nm3/h'"),
        ("3 ls", r"sources\[0\]\.rate: .*'3 ls'"),
        ("3 cm/s", r"sources\[0\]\.rate: .*'3 cm/s'"),
        ("3 counts/s", r"sources\[0\]\.rate: .*'3 counts/s'"),
        ("sccm", r"sources\[0\]\.rate: .*'sccm'"),
        ([1], r"sources\[0\]\.rate: "),
    ],
)
def test_other_rates_are_refused_at_their_key(text, reported):
    with pytest.raises(ScenarioError, match=reported):
        rate(text)


def test_without_a_species_there_is_no_mass():
    with pytest.raises(ScenarioError, match=r"gas\.species: got 'gold'"):
        rate("3 sccm", species="gold")
    with pytest.raises(ValueError, match="species"):
        Source.model_validate({"position": [1, 1], "rate": "3 sccm"})
    with pytest.raises(ScenarioError, match=r"gas\.sources\[0\]\.rate: .*species"):
        rate("3 sccm", "playback", None, file="fields.zarr")
