"""Every key of the vocabulary is described, from the models alone: in the schema, and by `--explain`."""

import json
import re
from collections.abc import Iterator

import pytest

from taichi_plume.cli import scenario as command
from taichi_plume.scenario.key_facts import facts, first_sentence
from taichi_plume.scenario.keys import all_keys, flat, look_up, near, places
from taichi_plume.scenario.maps import KernelMap
from taichi_plume.scenario.openings import Fan, Inlet
from taichi_plume.scenario.robots import Group
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.sensors import PidSensor
from taichi_plume.scenario.starts import StartArea
from taichi_plume.scenario.winds import CfdWind

SCHEMA = Scenario.model_json_schema()
SECTIONS = [("Scenario", SCHEMA), *SCHEMA["$defs"].items()]
DESCRIBED = [
    (f"{name}.{key}", key, reported.get("description", ""))
    for name, section in SECTIONS
    for key, reported in section.get("properties", {}).items()
]


def paths(node: dict, path: str, seen: tuple[str, ...] = ()) -> Iterator[str]:
    """Every path below a part of the schema, read from that alone."""
    if "$ref" in node:
        name = node["$ref"].rpartition("/")[2]
        if name not in seen:
            yield from paths(SCHEMA["$defs"][name], path, (*seen, name))
    for key, reported in node.get("properties", {}).items():
        yield f"{path}.{key}".lstrip(".")
        yield from paths(reported, f"{path}.{key}", seen)
    for several in ("anyOf", "oneOf"):
        for one in node.get(several, []):
            yield from paths(one, path, seen)
    if isinstance(node.get("items"), dict):
        yield from paths(node["items"], f"{path}[]", seen)


PATHS = dict.fromkeys(paths(SCHEMA, ""))


def test_every_key_is_described_in_words_of_its_own():
    assert len(DESCRIBED) > 600
    assert len(PATHS) > 400
    assert {"wind.openings[].turbulence_intensity", "gas.parts[].sources[].dish.cooling"} <= set(PATHS)
    for where, key, text in DESCRIBED:
        meaning = text.split("\n\n")[0]
        words = re.findall(r"[\w']+", meaning.lower())
        assert len(words) >= 4, (where, meaning)
        assert set(words) - set(key.split("_")) - {"the", "a", "of", "is", "it", "its"}, where
        assert meaning[0].isupper() or meaning[0].isdigit(), (where, meaning)
        assert len(first_sentence(meaning)) <= 115, (where, len(first_sentence(meaning)))
        assert not re.search(r"\[[a-zA-Z/°²³%]+\]", meaning), (where, "its unit comes from its type")
    for name, section in SECTIONS:
        assert len(section.get("description", "").split()) >= 3, name


def test_units_limits_and_defaults_are_those_of_the_models():
    speed = facts(Inlet, "speed")
    assert (speed.type, speed.unit, speed.limits, speed.default) == ("quantity", "m/s", "-100 to 100", "")
    assert facts(Fan, "speed").default == "not given"
    assert facts(Fan, "turbulence_intensity").limits == "0 to 1"
    assert facts(Fan, "center").type == "list of quantities, one in 2-D, two in 3-D"
    assert facts(Scenario, "warm_up").limits == "0, or 1e-6 to 1e9"
    assert facts(Scenario, "tick").limits == "0.0001 to 1"
    assert facts(Group, "capture").type == "one of disc, square"
    assert facts(PidSensor, "correction").default == "none"
    assert facts(PidSensor, "noise_ppm").unit == "ppm"
    assert facts(StartArea, "heading_deg").unit == "deg"
    assert facts(CfdWind, "turbulence").default == "{kind: smagorinsky}"
    assert facts(KernelMap, "cell").default == "0.1"
    for key in all_keys():  # and each is what loading tells
        assert key.facts.default or key.facts.figures.endswith("has to be given")


def test_the_schema_tells_an_editor_units_and_limits():
    spacing = SCHEMA["$defs"]["Domain"]["properties"]["spacing"]
    assert "quantity [m]; 1e-6 to 100000; has to be given" in spacing["description"]
    assert {"type": "number", "minimum": 1e-6, "maximum": 1e5} in spacing["anyOf"]
    assert {"type": "string"} in spacing["anyOf"]


def test_every_path_of_the_schema_is_explained():
    for path in PATHS:
        sections, keys = look_up(path)
        kind = path.rpartition(".")[2] == "kind"  # what names the kinds is reported with their sections
        assert sections or keys or kind, path
    assert {flat(key.path) for key in all_keys()} <= {flat(path) for path in PATHS}


@pytest.fixture
def explained(capsys):
    """Output of `--explain KEY`."""

    def output(key: str) -> str:
        assert command.main(["--explain", key]) == 0
        return capsys.readouterr().out

    return output


def test_a_key_is_explained_by_its_path_its_place_or_its_name(explained):
    text = explained("wind.openings.turbulence_intensity")
    assert text.startswith("wind.openings[].turbulence_intensity   (kind: fan, inlet, honeycomb)\n")
    assert "Standard deviation of each velocity component" in text
    assert "number; 0 to 1; default: 0" in text
    assert explained("wind.openings[2].turbulence_intensity") == text
    assert explained("wind.openings.2.turbulence_intensity") == text
    assert explained("turbulence_intensity") == text
    assert explained("gas.parts[1].sources[0].rate") == explained("gas.sources.rate")
    assert explained("speed").count("quantity [m/s]") >= 5


def test_a_section_is_explained_with_its_keys_and_a_kind_alone(explained):
    text = explained("wind.openings")
    assert "kind: fan" in text
    assert "swirl (fan): " in text
    assert re.search(r"diameter .*\[m\]; default: not given", " ".join(text.split()))
    text = explained("casting")
    assert re.search(r"threshold_ppm: [^:]*\[ppm\]; default: 5 lost_distance:", " ".join(text.split()))
    assert text.startswith("robots[].algorithm\n")
    assert "cast_distance: " in text
    assert "arms" not in text
    assert "kind: honeycomb" in explained("honeycomb")


@pytest.mark.parametrize(
    ("written", "meant"),
    [
        ("turbulance_intensity", "turbulence_intensity"),
        ("wind.opening.speed", "wind.openings.speed"),
        ("castin", "casting"),
        ("robots.0.sensor.gas.model", "robots.sensors.gas.model"),
        ("\x1b]0;x\x07", None),  # commands of a terminal, far from all keys
    ],
)
def test_a_misspelt_key_gets_one_line_with_what_is_near(written, meant, capsys):
    assert command.main(["--explain", written]) == 2
    reported = capsys.readouterr()
    assert reported.out == ""
    if meant is None:
        assert reported.err == r"no key '\x1b]0;x\x07'; --schema prints all" + "\n"
    else:
        assert reported.err.count("\n") == 1
        assert f"no key '{written}'; did you mean " in reported.err
        assert meant in near(written)
        assert meant in reported.err


def test_the_schema_is_printed_whole(capsys):
    assert command.main(["--schema"]) == 0
    assert json.loads(capsys.readouterr().out) == json.loads(json.dumps(SCHEMA))


def test_places_that_hold_the_same_are_reported_once():
    assert {path: one.same_as for path, one in places().items() if one.same_as} == {
        "gas.parts[]": "gas",
        "robots[].algorithm.map": "maps[]",
        "robots[].sensors.gas[]": "robots[].sensors.gas",
    }
