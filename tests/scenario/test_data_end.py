"""Files whose data end before the run: each reader of a series over time warns, with the time, until they repeat."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import yaml
from small_task import task
from test_film import new_film

from taichi_plume.assembly.preparation import check, load
from taichi_plume.envs import bank
from taichi_plume.scenario.loading import scenario_from

UNIFORM = {"kind": "uniform", "velocity": [0.3, 0]}
FILM = {"kind": "playback", "file": "fields.zarr"}
LOG = {"kind": "plumesim_log", "file": "plume.pslog"}
PUFF = {"kind": "plumesim_gaussian", "release_point": [0.1, 0.4]}
ROOM = {"duration": 4, "domain": {"size": [1.0, 0.8], "spacing": 0.1}, "wind": UNIFORM, "gas": PUFF}
ROBOT = {"count": 1, "start": {"kind": "positions", "positions": [[0.5, 0.4]]}, "reach": 0}
READERS = {  # key, sections, end of the data [s]
    "imported wind": (
        "wind.files",
        {"wind": {"kind": "imported", "files": "wind_%d.csv", "interval": 0.5}},
        1.0,
    ),
    "film of wind": ("wind.file", {"wind": FILM, "domain": {"size": [0.6, 0.5, 0.4], "spacing": 0.1}}, 1.0),
    "film of gas": (
        "gas.file",
        {
            "wind": {**UNIFORM, "velocity": [0.3, 0, 0]},
            "gas": {**FILM, "start": 0.25, "rate": 0.5},
            "domain": {"size": [0.6, 0.5, 0.4], "spacing": 0.1},
        },
        1.5,
    ),
    "movie": ("gas.file", {"gas": {"kind": "movie", "file": "m.npy", "frame_rate": 2, "pixel": 0.1}}, 1.0),
    "wind of a log": ("wind.file", {"wind": LOG}, 2.0),
    "gas of a log": (
        "gas.parts[0].file",
        {"gas": {"kind": "mixture", "parts": [LOG, {**PUFF, "species": "acetone"}]}},
        2.0,
    ),
    "Fluent": ("gas.files", {"gas": {"kind": "fluent", "files": "smoke-%d.txt", "period": 0.4}}, 0.8),
    "path": (
        "robots[0].algorithm.file",
        {"robots": [ROBOT | {"algorithm": {"kind": "replay", "file": "robots.parquet"}}]},
        3.0,
    ),
}  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("ends")
    x, y = (axis.ravel() for axis in np.meshgrid(np.linspace(0, 1, 6), np.linspace(0, 0.8, 5)))
    for n in range(3):
        points = np.column_stack([x, y, 0.1 + 0 * x, 0 * x])
        np.savetxt(folder / f"wind_{n}.csv", points, delimiter=",", header="x,y,u,v", comments="")
    new_film(folder / "fields.zarr")
    np.save(folder / "m.npy", np.ones((3, 8, 10)))
    (folder / "plume.pslog").write_text("1000,2,0.2\n+0 1\n0.5,0.5,0,0.4,0,50\n+1 1\n0.5,0.5,0,0.4,0,20\n")
    for n in (1, 2):
        (folder / f"smoke-{n}.txt").write_text("nodenumber,x,y,c\n1,0.5,0.5,0.02\n")
    t = np.arange(0.0, 3.05, 0.1)
    columns = {
        "t": t, "group": pa.array(["one"] * len(t)).dictionary_encode(), "trial": np.zeros(len(t), np.int32),
        "robot": np.zeros(len(t), np.int32), "x": 0.2 + 0.1 * t, "y": 0.4 + 0 * t, "heading": 0 * t,
        "reading_ppm": t,
    }  # fmt: skip
    pq.write_table(pa.table(columns), folder / "robots.parquet")
    return folder


def ends(folder, sections, **changes) -> list[str]:
    """The warnings of a run whose data end early."""
    path = folder / "s.yaml"
    path.write_text(yaml.safe_dump(ROOM | sections | changes))
    found = check(path)
    assert found.errors == []
    return [line for line in found.warnings if "the data of" in line]


@pytest.mark.parametrize("name", READERS)
def test_data_that_end_before_the_run_are_reported_with_the_time(folder, name):
    key, sections, end = READERS[name]
    (line,) = ends(folder, sections)
    assert line.startswith(f"{key}: ")
    assert f"end at {end:g} s, the run at 4 s" in line
    assert ends(folder, sections, duration=end) == []
    assert len(ends(folder, sections, duration=end + 0.1)) == 1


@pytest.mark.parametrize("name", [name for name in READERS if name != "path"])
def test_data_that_repeat_do_not_end(folder, name):
    key, sections, _ = READERS[name]
    part = sections[key.partition(".")[0]]
    part = part | {"parts": [part["parts"][0] | {"loop": True}]} if "parts" in part else part | {"loop": True}
    assert ends(folder, sections | {key.partition(".")[0]: part}) == []


def test_a_single_frame_is_a_steady_state(folder):
    wind = {"kind": "imported", "files": "wind_0.csv"}
    assert ends(folder, {"wind": wind}) == []


def test_the_recordings_of_an_environment_are_longer_than_its_scenario(folder):
    """Films of two episodes of 4 s of a scenario that ends with its data."""
    keys = task(gas={**READERS["movie"][1]["gas"], "frame_rate": 0.5}, warm_up=0)
    keys["task"] = {"episode": 4, "airs": 2}
    (folder / "task.yaml").write_text(yaml.safe_dump(keys))
    assert not [line for line in load(folder / "task.yaml").resources.warnings if "the data of" in line]
    lines = bank.warnings(scenario_from(keys), folder)
    (line,) = [line for line in lines if "the data of" in line]
    assert line.startswith("gas.file: ")
    assert "end at 4 s, the run at 8 s" in line
