"""What a scenario's files hold is opened once, whoever needs it."""

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from test_meshes import box_triangles, write_stl

from taichi_plume.assembly import preparation
from taichi_plume.assembly.preparation import checked, load, load_scenario
from taichi_plume.files import own_class, plumesim_log
from taichi_plume.scenario import shapes
from taichi_plume.scenario.loading import ScenarioError, read_scenario

LOG = "1000,2,0.5\n" + "".join(f"+{n} 2\n1,1,0,0.5,0,{n}\n1.5,1,0,0.5,0,{n}\n" for n in (1, 2))
OWN = """
class Still:
    def act(self, robots):
        robots.speed[:] = 0
"""
GAS = {"kind": "plumesim_log", "file": "plume.pslog", "sources": [{"position": [1, 1]}]}
SCENARIO = {
    "duration": 5,
    "domain": {"size": [4, 3], "spacing": 0.1},
    "wind": {"kind": "plumesim_log", "file": "plume.pslog"},
    "gas": {"kind": "mixture", "parts": [GAS, GAS | {"species": "acetone"}]},
    "obstacles": [{"kind": "mesh", "file": "box.stl", "section": 0.1}],
    "robots": [
        {
            "count": 1,
            "start": {"kind": "positions", "positions": [[3, 2]]},
            "algorithm": {"kind": "own", "file": "still.py"},
        }
    ],
}


@pytest.fixture
def path(tmp_path) -> Path:
    (tmp_path / "plume.pslog").write_text(LOG)
    (tmp_path / "still.py").write_text(OWN)
    write_stl(tmp_path / "box.stl", box_triangles((1.8, 0.9, 0), (2.2, 1.1, 0.3)))
    (tmp_path / "s.yaml").write_text(yaml.safe_dump(SCENARIO))
    return tmp_path / "s.yaml"


def test_each_file_is_opened_once(path, monkeypatch):
    opened = Counter()
    for owner, name in (
        (plumesim_log, "read_log"),
        (own_class.OwnFile, "read"),
        (shapes, "Solid"),
    ):
        original = getattr(owner, name)

        def count(*args, name=name, original=original):
            opened[name] += 1
            return original(*args)

        monkeypatch.setattr(owner, name, count)
    scenario, resources = load(path)
    assert opened == {"read_log": 1, "read": 1, "Solid": 1}
    assert resources.frames.keys() == {"wind", "gas.parts[0]", "gas.parts[1]"}
    assert len({id(frames) for frames in resources.frames.values()}) == 1
    assert resources.code["robots[0].algorithm"].source.decode() == OWN
    assert [one.model for one in resources.obstacles] == list(scenario.obstacles)
    assert resources.faults == {}


def test_what_cannot_be_used_is_a_fault_and_reported_by_the_checks(path):
    (path.parent / "plume.pslog").unlink()
    (path.parent / "box.stl").unlink()
    scenario = read_scenario(path)
    resources = preparation.prepare(scenario, path.parent).resources
    paths = ["obstacles[0]", "gas.parts[0].file", "gas.parts[1].file", "wind.file"]
    assert list(resources.faults) == paths
    with pytest.raises(ScenarioError) as caught:
        checked(scenario, path.parent)
    assert [line.partition(": ")[0] for line in caught.value.lines] == paths


def test_load_scenario_is_the_scenario_alone(path):
    assert load_scenario(path, ["seed=3"]) == load(path, ["seed=3"]).scenario
    with pytest.raises(ScenarioError, match=r"^\S*s\.yaml: robots\[0\]\.start: robot 0"):
        load_scenario(path, ["robots.0.start.positions=[[0, 0]]"])


ROOM = {
    "duration": 1,
    "domain": {"size": [1, 1], "spacing": "5 cm"},
    "wind": {
        "kind": "cfd",
        "openings": [{"kind": "inlet", "face": "x-", "speed": 0.5}, {"kind": "outlet", "face": "x+"}],
    },
    "gas": {"kind": "eulerian", "sources": [{"position": [0.2, 0.4], "rate": "1 mg/s"}]},
}


def test_a_dict_is_loaded_as_a_file_is(tmp_path):
    (tmp_path / "s.yaml").write_text(yaml.safe_dump(ROOM))
    assert load_scenario(ROOM) == load_scenario(tmp_path / "s.yaml")
    assert load_scenario(ROOM, ["domain.spacing=0.1"]).domain.spacing == 0.1
    write_stl(tmp_path / "box.stl", box_triangles((0.5, 0.3, 0), (0.6, 0.4, 0.5)))
    meshed = ROOM | {"obstacles": [{"kind": "mesh", "file": "box.stl", "section": 0.1}]}
    load_scenario(meshed, folder=tmp_path)
    for source, line in (
        (meshed, "obstacles[0]: box.stl"),
        (ROOM | {"durtion": 2}, "did you mean 'duration'"),
        (ROOM | {"gas": ROOM["gas"] | {"sources": [{"position": [5, 1], "rate": 1e-6}]}}, "gas.sources[0]"),
        ({}, "missing key 'duration'"),
        ([ROOM], "got list"),
        (None, "got NoneType"),
    ):
        with pytest.raises(ScenarioError) as reported:
            load_scenario(source)  # type: ignore[arg-type]
        assert line in str(reported.value)


def test_a_changed_scenario_is_checked_as_by_set():
    room = load_scenario(ROOM)
    other = room.with_(
        {"duration": "2 min", "gas.sources[0].rate": 2e-6, "domain": {"size": [2, 1], "spacing": 0.1}}
    )
    assert (other.duration, other.gas.sources[0].rate, other.domain.size) == (120.0, 2e-6, (2.0, 1.0))
    assert room.duration == 1.0
    assert room.with_({}) == room
    for changes, line in (
        ({"durtion": 2}, "unknown key 'durtion'; did you mean 'duration'"),
        ({"gas.sources.1.rate": 1}, "gas.sources has 1 item"),
        ({"duration": -1}, "duration: got -1"),
        ({"": 1}, "path of a key"),
    ):
        with pytest.raises(ScenarioError) as reported:
            room.with_(changes)
        assert line in str(reported.value)


def test_a_copy_refuses_a_misspelt_key_and_a_bad_value():
    room = load_scenario(ROOM)
    assert room.model_copy(update={"duration": 2}).duration == 2.0
    for update in ({"durtion": 2}, {"duration": -1}, {"domain": 3}, {"obstacles": ({"size": [1, 1]},)}):
        with pytest.raises(ScenarioError) as copied:
            room.model_copy(update=update)
        with pytest.raises(ScenarioError) as loaded:
            load_scenario(ROOM | update)
        assert copied.value.faults == loaded.value.faults
        assert next(iter(update)) in str(copied.value)
    with pytest.raises(ScenarioError, match=r"^spacing: got -1"):
        room.domain.model_copy(update={"spacing": -1})
    assert room.model_copy(update={"seed": 3}).model_fields_set == room.model_fields_set | {"seed"}


def test_a_section_cannot_be_changed_in_place():
    room = load_scenario(ROOM)
    for name in ("duration", "durtion"):
        with pytest.raises(AttributeError, match=rf"Scenario\.{name} .*with_"):
            setattr(room, name, 3)
    assert room.duration == 1.0


def test_values_of_python_are_taken_as_those_of_yaml(tmp_path):
    room = load_scenario(
        ROOM | {"duration": np.float32(2), "domain": {"size": np.array([1, 1]), "spacing": 0.05}}
    )
    assert (room.duration, room.domain.size) == (2.0, (1.0, 1.0))
    assert load_scenario(ROOM | {"robots": ()}, ["seed=2"]).robots == ()
    assert room.with_({"seed": np.int64(3), "domain.size": (2, 1)}).domain.size == (2.0, 1.0)
    loop: dict[str, Any] = {"kind": "box"}
    loop["size"] = loop
    for bad, line in (
        ({"obstacles": ({"size": (1, 1)},)}, "obstacles[0]: missing key 'kind'"),
        ({"obstacles": [{"kind": "mesh", "file": tmp_path / "x.stl"}]}, "x.stl lies outside"),
        ({"obstacles": [loop]}, "nested deeper"),
        ({3: 1}, "the key 3 must be a text"),
    ):
        with pytest.raises(ScenarioError) as reported:
            load_scenario({**ROOM, **dict[Any, Any](bad)})
        assert line in str(reported.value)
    with pytest.raises(ScenarioError, match="give a dict"):
        room.with_(None)  # type: ignore[arg-type]
    with pytest.raises(ScenarioError, match="give a list"):
        load_scenario(ROOM, "duration=3")


def test_assemble_makes_the_checks_of_the_command():
    from taichi_plume.assembly.assemble import assemble

    room = load_scenario(ROOM)
    source = room.gas.sources[0].model_copy(update={"position": (5.0, 1.0)})
    outside = room.model_copy(update={"gas": room.gas.model_copy(update={"sources": (source,)})})
    with pytest.raises(ScenarioError, match=r"gas\.sources\[0\]"):
        assemble(outside)
    robot = {"name": "r", "count": 1, "algorithm": {"kind": "own", "name": "Unknown"}, "reach": 0.1}
    robot["start"] = {"kind": "positions", "positions": [[0.8, 0.5]]}
    with pytest.raises(ScenarioError, match=r"robots\[0\]\.algorithm.*file"):
        assemble(load_scenario(ROOM | {"robots": [robot]}))
    for other in ("room.yaml", ROOM):
        with pytest.raises(ScenarioError, match="load_scenario"):
            assemble(other)  # type: ignore[arg-type]
