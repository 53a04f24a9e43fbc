"""Files that files of a scenario name, by content or by links: they lie in the scenario's folder, and are listed."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from foam_case import Writer, box, decomposed
from test_gaden_project import models, project

from taichi_plume.assembly.preparation import load
from taichi_plume.files import openfoam
from taichi_plume.scenario.input_files import input_paths
from taichi_plume.scenario.loading import ScenarioError
from taichi_plume.studies.plan import load_plan

ROOM = """
duration: 1
domain: {size: [2.0, 1.2], spacing: 0.1}
wind: {kind: imported, files: case}
gas: {kind: eulerian, sources: [{position: [0.5, 0.6], rate: 1 mg/s}]}
"""


@pytest.fixture
def room(tmp_path) -> Iterator[Path]:
    """The scenario of a case of three times, in a folder of its own."""
    points, cells = box((20, 12, 1), lambda x: x * [2.0, 1.2, 0.1])
    writer = Writer(tmp_path / "home/case")
    writer.mesh(points, cells)
    for time in "012":
        writer.field(time, "U", np.full((len(cells), 3), 0.1))
        writer.field(time, "nut", np.full(len(cells), 1e-3))
    path = tmp_path / "home/room.yaml"
    path.write_text(ROOM)
    openfoam._mesh_of.cache_clear()
    yield path
    openfoam._mesh_of.cache_clear()


def moved_away(path: Path, away: Path) -> None:
    """Put a file or folder elsewhere, and a link in its place."""
    shutil.move(path, away)
    path.symlink_to(away)


def refused(path: Path, name: str) -> None:
    with pytest.raises(ScenarioError, match=r"--allow-outside") as caught:
        load(path)
    assert any(name in line for line in caught.value.faults)


@pytest.mark.parametrize(
    "name",
    ["0/U", "1/U", "2/U", "1/nut", "1", "constant", "constant/polyMesh", "constant/polyMesh/owner", ""],
)
def test_links_of_a_case_may_not_lead_outside(room, tmp_path, name):
    load(room)  # a mesh in a cache is refused as well
    moved_away(room.parent / "case" / name, tmp_path / "away")
    refused(room, name.replace("constant/polyMesh", "") if name else "case")
    prepared = load(room, allow_outside=True)
    paths = input_paths(prepared.scenario, room, prepared.resources.files)
    assert all(path.is_file() for path in paths)
    assert {path.relative_to(room.parent).as_posix() for path in paths} == {
        "room.yaml",
        *(f"case/{time}/{field}" for time in "012" for field in ("U", "nut")),
        *(f"case/constant/polyMesh/{part}" for part in openfoam.PARTS),
    }
    assert load(room, ["wind.files=case"])  # a file that the user names may lead anywhere


def test_links_of_a_decomposed_case_and_inside(room, tmp_path):
    points, cells = box((20, 12, 1), lambda x: x * [2.0, 1.2, 0.1])
    shutil.rmtree(room.parent / "case")
    parts = np.split(np.arange(len(cells)), 2)
    for writer in decomposed(room.parent / "case", points, cells, parts):
        writer.field("1", "U", np.full((len(cells) // 2, 3), 0.1))
    room.write_text(ROOM.replace("case", "case/1"))
    moved_away(room.parent / "case/processor1/1/U", room.parent / "case/U1")
    assert len(input_paths(load(room).scenario, room, load(room).resources.files)) == 11
    moved_away(room.parent / "case/processor0/1/U", tmp_path / "away")
    refused(room, "processor0/1/U")


def test_ids_depend_on_files_that_others_name(room):
    room.write_text(ROOM.replace("case", "case/1"))
    study = room.with_name("study.yaml")
    study.write_text("name: two\nbase: room.yaml\naxes: {size: {key: seed, values: [1]}}\n")
    before = load_plan(study).requests[0].air
    points = room.parent / "case/constant/polyMesh/points"
    points.write_text(points.read_text().replace("(1.0 ", "(1.01 "))
    assert load_plan(study).requests[0].air != before


HOME = "10x6_room/environment_configurations/config1"


@pytest.mark.parametrize(
    "name", ["config.yaml", "simulations/sim1/sim.yaml", "simulations", "OccupancyGrid3D.csv", ""]
)
def test_links_of_a_project_may_not_lead_outside(tmp_path, name):
    (tmp_path / "home").mkdir()
    room = project(tmp_path / "home")
    moved_away(room.parent / HOME / name, tmp_path / "away")
    refused(room, Path(name).name)


def test_models_of_a_project_may_not_lie_outside(tmp_path):
    (tmp_path / "home").mkdir()
    models(tmp_path / "away")
    for name in (str(tmp_path / "away/10x6_walls.stl"), "../../../../away/10x6_walls.stl"):
        shutil.rmtree(tmp_path / "home")
        (tmp_path / "home").mkdir()
        room = project(tmp_path / "home", config={"models": [name]})
        (room.parent / HOME / "OccupancyGrid3D.csv").unlink()
        refused(room, "10x6_walls.stl")


def test_files_of_a_project_are_inputs(tmp_path):
    room = project(tmp_path)
    prepared = load(room)
    paths = {
        path.relative_to(tmp_path).as_posix()
        for path in input_paths(prepared.scenario, room, prepared.resources.files)
    }
    assert paths == {
        "room.yaml",
        f"{HOME}/simulations/sim1/sim.yaml",
        f"{HOME}/config.yaml",
        f"{HOME}/OccupancyGrid3D.csv",
        "10x6_room/wind_simulations/1ms/wind_at_cell_centers_0.csv",
        "10x6_room/wind_simulations/1ms/wind_at_cell_centers_1.csv",
    }
