"""Errors in a study are reported before its first run, a line each; `bad_studies.txt` lists them."""

from pathlib import Path
from typing import Any

import pytest
import yaml
from small_study import ROOM, SPEED, faults, write

from taichi_plume.studies.plan import load_plan


def rows() -> list[tuple[dict[str, Any], list[str]]]:
    """Keys of a study, and the beginnings of the errors that are expected."""
    found: list[tuple[dict[str, Any], list[str]]] = []
    for line in Path(__file__).with_name("bad_studies.txt").read_text(encoding="utf-8").splitlines():
        if line.startswith("    "):
            found[-1][1].append(line.strip())
        elif not line.startswith("#"):
            kind, _, text = line.partition(": ")
            keys = yaml.safe_load(text)
            found.append(({"axes": {"a": keys}} if kind == "axis" else keys, []))
    return found


@pytest.mark.parametrize(("keys", "expected"), rows())
def test_errors(tmp_path, keys, expected):
    found = [
        line.replace(f"{tmp_path}/", "").replace(f"{tmp_path}", ".")
        for line in faults(write(tmp_path, **keys))
    ]
    assert len(found) == len(expected), found
    for line, begin in zip(found, expected, strict=True):
        assert line.startswith(begin), line


def test_probes_are_those_of_the_scenario(tmp_path):
    room = ROOM | {"probes": {"points": [{"kind": "point", "name": "a.b", "at": [1, 0.5]}]}}
    good = {"a": "probes.a.b.wind_x", "b": "probes.a.b.ethanol_ppm", "c": "probes.a.b.pressure"}
    assert load_plan(write(tmp_path, room, outcomes=good, keep=["probes.parquet"])).study.outcomes == good
    bad = {
        "a": "probes.a.wind_x",
        "b": "probes.a.b.wind_z",
        "c": "probes.a.b.temperature",
        "d": "probes.wind_x",
    }
    found = faults(write(tmp_path, room, outcomes=bad))
    assert found[0] == "outcomes.a: there is no probe 'a'; the scenario has a.b"
    has = "they have wind_x, wind_y, ethanol_ppm, pressure"
    assert found[1:3] == [f"outcomes.{key}: probes have no quantity '{name}'; {has}" for key, name in
                          (("b", "wind_z"), ("c", "temperature"))]  # fmt: skip
    assert found[3].startswith("outcomes.d: probes.wind_x is not the path of a probe")


def test_an_outcome_of_some_points_alone_can_be(tmp_path):
    maps = {"variants": {"none": {"maps": []}, "gmrf": {"maps": [{"kind": "gmrf"}]}}}
    assert load_plan(write(tmp_path, axes={"maps": maps}, outcomes={"c": "maps.0.correlation"}))


def test_a_fault_of_many_points_is_reported_once_with_the_values_that_have_it(tmp_path):
    place = {"key": "gas.sources.0.position", "values": [[0.3, 0.5], [5, 0.5]]}
    ceiling = {"key": "robots.0.reach", "values": [0.1, 0.2, 0.3]}
    (line,) = faults(write(tmp_path, axes={"speed": SPEED, "place": place, "reach": ceiling}))
    assert line.startswith("axes.place: [5, 0.5] (6 points): gas.sources[0].position: x = 5 m is outside")
    slow = {"key": "wind.openings.0.speed", "low": 0.1, "high": 0.3}
    room = ROOM | {"obstacles": [{"kind": "box", "center": [0.3, 0.5], "size": [0.3, 0.3]}]}
    sampling = {"kind": "sobol", "count": 8}
    (line,) = faults(write(tmp_path, room, axes={"speed": slow}, sampling=sampling))
    assert line.startswith("axes.speed: 0.")
    assert " and 5 more (8 points): gas.sources[0].position: (0.3, 0.5) m is inside obstacles[0]" in line


def test_what_is_wrong_with_the_base_is_reported_as_such(tmp_path):
    bad = ROOM | {"duration": "4 kg"}
    (line,) = faults(write(tmp_path, bad))
    assert line.startswith("room.yaml: duration: got '4 kg'")
    repaired = {"key": "duration", "values": [4, "5 s"]}
    assert load_plan(write(tmp_path, bad, axes={"duration": repaired}))
    inside = ROOM | {"robots": [ROOM["robots"][0] | {"arena": 3}]}
    (line,) = faults(write(tmp_path, inside))
    assert line.startswith("room.yaml: robots[0]: unknown key 'arena'")
