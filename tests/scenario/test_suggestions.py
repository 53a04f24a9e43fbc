"""Messages about mistakes of newcomers name what was meant: the key, the kind, the unit, or the form of a value."""

import re

import pytest
from test_loading import GOOD, fault

from taichi_plume.quantities import SCALES, parse, short, units_like, with_unit
from taichi_plume.scenario import suggestions
from taichi_plume.scenario.keys import misspelt, places
from taichi_plume.scenario.species import SPECIES

KINDS = {
    *(kind for place in places().values() for kind in place.kinds),
    *("ultrasonic", "thermal", "ideal"),  # of anemometers, which are one section
}


def test_every_advice_names_kinds_and_sections_that_exist():
    known = {path.replace("[]", "") for path in places()}
    for advice in {one for found in suggestions._everyday().values() for one in found}:
        assert set(re.findall(r"kind: (\w+)", advice)) <= KINDS, advice
        assert set(re.findall(r"species: ([\w-]+)", advice)) <= set(SPECIES), advice
        assert set(re.findall(r"\bin ((?:wind|gas|obstacles|robots)[\w.]*\w)", advice)) <= known, advice


def test_no_everyday_word_is_a_kind_wherever_its_advice_leads():
    """A word that is a kind itself would be taken, so its advice could never be read."""
    for word, found in suggestions._everyday().items():
        for advice in found:
            kinds = set(re.findall(r"kind: (\w+)", advice))
            there = [place.kinds for place in places().values() if kinds & set(place.kinds)]
            assert not there or any(word not in map(suggestions.plain, names) for names in there), (
                word,
                advice,
            )


@pytest.mark.parametrize(
    ("override", "where", "meant"),
    [
        ("wind.openings.0.kind=door", "wind.openings[0]", "kind: outlet"),
        ("wind.openings.0.kind=Window", "wind.openings[0]", "kind: outlet"),
        ("wind.openings.0.kind=box", "wind.openings[0]", "obstacles[]"),
        ("wind.openings.0.face=left", "wind.openings[0].face", "x- is left"),
        ("wind.openings.0.face=X-", "wind.openings[0].face", "'x-'"),
        ("obstacles.0.kind=door", "obstacles[0]", "wind.openings"),
        ("obstacles.0.kind=table", "obstacles[0]", "kind: box"),
        ("obstacles.0.kind=wall", "obstacles[0]", "kind: box"),
        ("obstacles.0.kind=person", "obstacles[0]", "kind: cylinder"),
        ("obstacles.0.kind=chair", "obstacles[0]", "kind: box"),
        ("obstacles.0.kind=heater", "obstacles[0]", "wind.buoyancy.heat.heaters"),
        ("obstacles.0.kind=fan", "obstacles[0]", "wind.openings[]"),
        ("robots.0.sensors={gas: {kind: co2}}", "robots[0].sensors.gas", "kind: ideal"),
        ("robots.0.sensors={gas: {kind: lidar}}", "robots[0].sensors.gas", "no sensor of this kind"),
        ("robots.0.sensors={gas: {kind: TGS 2620}}", "robots[0].sensors.gas", "model: tgs2620"),
        ("robots.0.sensors={gas: {kind: mox, model: TGS2620}}", "robots[0].sensors.gas.model", "'tgs2620'"),
        ("robots.0.sensors={wind: {kind: hot-wire}}", "robots[0].sensors.wind.kind", "kind: thermal"),
        ("robots.0.algorithm.kind=SPIRAL", "robots[0].algorithm", "'spiral'"),
        ("robots.0.algorithm.kind=Surge-Cast", "robots[0].algorithm", "'surge_cast'"),
        ("robots.0.start.kind=random", "robots[0].start", "kind: area"),
        ("gas.species=Ethanol", "gas.species", "'ethanol'"),
        ("gas.species=CO2", "gas.species", "carbon_dioxide"),
        ("gas.kind=gaussian", "gas", "kind: gaussian_plume"),
        ("robots.0.algorithm=casting", "robots[0].algorithm", "{kind: casting}"),
        ("robots.0.algorithm={type: casting}", "robots[0].algorithm", "write kind: casting, not type"),
        ("robots.0.algorithm={'kind:casting': 1}", "robots[0].algorithm", "space after the colon"),
        # keys of other sections
        ("sources=[]", "unknown key ", "key of gas"),
        ("sensors={}", "unknown key ", "key of robots[]"),
        ("openings=[]", "unknown key ", "key of wind (kind: cfd, frozen)"),
        ("robots.0.speed=1", "robots[0]: unknown key ", "robots[].algorithm"),
        ("wind.openings.1.swirl=1", "wind.openings[1]: unknown key ", "(kind: fan)"),
        ("wind.openings.0.velocity=1", "wind.openings[0]: unknown key ", "'speed'"),
        ("gas.sources.0.location=[1, 1]", "gas.sources[0]: unknown key ", "'position'"),
        ("domain.resolution=0.1", "domain: unknown key ", "'spacing'"),
        ("doors=[]", "unknown key ", "kind: outlet"),
        ("Robots=[]", "unknown key ", "'robots'"),
        ("warmUp=1", "unknown key ", "'warm_up'"),
        # steps of paths
        ("robot.0.count=6", "override 'robot.0.count", "did you mean 'robots'?"),
        ("Robots.0.count=6", "override 'Robots.0.count", "did you mean 'robots'?"),
        ("gas.source.0.rate=6", "override 'gas.source.0.rate", "did you mean 'gas.sources'?"),
        ("wind.opening.0.speed=6", "override 'wind.opening.0.speed", "did you mean 'wind.openings'?"),
        (
            "robots.0.sensors.gass.0.kind=6",
            "override 'robots.0.sensors.gass.0.kind",
            "did you mean 'robots.0.sensors.gas'?",
        ),
    ],
)
def test_what_is_unknown_gets_what_was_meant(tmp_path, override, where, meant):
    line = fault(tmp_path, GOOD, override)
    assert line.startswith(where)
    assert meant in re.split(" kinds: |allowed: ", line)[0]


def test_a_path_of_known_keys_is_not_misspelt():
    for path in ("robots.0.count", "gas.sources.0.rate", "robots.0.sensors.gas.correction.ethanol"):
        assert misspelt(path.split(".")) is None


@pytest.mark.parametrize(
    ("text", "line", "meant"),
    [
        ("name: a\nduration 75 s\nseed: 1\n", 2, "colon"),
        ("name: 'a\nseed: 1\n", 1, "quote"),
        ("a: 1\n---\nb: 1\n", 2, "second document"),
        ("a: {b: [1, 2}\nc: 1\n", 1, "'['"),
        ("a: {position: 0.7, 1.45}\n", 1, "brackets"),
        ("a:\n  b: 1\n    c: 2\n", 3, "indentation"),
    ],
)
def test_what_is_no_yaml_gets_its_line_and_what_to_write(tmp_path, text, line, meant):
    reported = fault(tmp_path, text)
    assert reported.startswith(f"line {line}, column ")
    assert meant in reported


@pytest.mark.parametrize("unit", SCALES)
def test_units_that_messages_name_are_taken(unit):
    for name in SCALES[unit]:
        assert name in units_like(unit).split(", ")
        value = parse(f"2.5 {name}", unit)
        assert value == pytest.approx(275.65 if name == "degC" else 2.5 * SCALES[unit][name], rel=1e-12)


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (20 * 1e-6, "kg/s", "20 mg/s"),
        (0.1 + 0.2, "m", "0.3 m"),
        (0.04, "m", "4 cm"),
        (1.56e-5, "m^2/s", "15.6 mm^2/s"),
        (75.0, "s", "75 s"),
        (0.0, "m/s", "0 m/s"),
        (-0.02, "m/s", "-2 cm/s"),
        (5.0, "1/s", "5 Hz"),
        (0.00341, "1/K", "0.00341"),
        (2e-5, "", "2e-5"),
        (298.15, "K", "298.15 K"),
    ],
)
def test_a_number_is_printed_with_a_unit_of_a_sensible_scale(value, unit, text):
    assert with_unit(value, unit) == text


def test_what_is_printed_reads_back_as_the_same_value():
    for unit in ("", *SCALES):
        for value in (1 / 3, 2e-5, 1.9e-7, 123456.789, 86400.0, 1e-12, 3.5, 9.81e8):
            text = with_unit(value, unit)
            assert len(re.sub(r"\D", "", text.split("e")[0].split(" ")[0]).strip("0")) <= 15
            assert parse(text, unit) == pytest.approx(value, rel=2e-15)
    assert short(1.9999999999999998e-05) == "2e-5"


def test_every_group_of_synonyms_has_a_key():
    keys = {key for place in places().values() for model in place.models for key in model.model_fields}
    for group in suggestions._SYNONYMS:
        assert group & keys, group
