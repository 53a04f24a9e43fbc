"""Projects laid out as GADEN's repository has them, not preprocessed yet: same paths, keys and numbers.

test_env/scenarios/10x6_empty_room in the form of GADEN 2 (ROS 2) and 10x6_central_obstacle in that of GADEN 3. The
rooms are 10 m x 6 m x 2.6 m between walls of 0.2 m, with a door at each end; models and wind are made here.
"""

from pathlib import Path

import numpy as np
import pytest
from test_meshes import box_triangles, write_stl

from taichi_plume.assembly.preparation import load
from taichi_plume.cli import run
from taichi_plume.files import gaden, gaden_project
from taichi_plume.scenario.loading import ScenarioError

PREPROCESSING = """
gaden_preprocessing:
  ros__parameters:
    # Cell size
    cell_size: 0.1

    # CAD models of the enviroment (.stl)
    models:
      - "$(var pkg_dir)/scenarios/$(var scenario)/cad_models/10x6_walls.stl"

    # CAD model of the outlets (.stl)2
    outlets_models:
      - "$(var pkg_dir)/scenarios/$(var scenario)/cad_models/10x6_door_right.stl"
      - "$(var pkg_dir)/scenarios/$(var scenario)/cad_models/10x6_door_left.stl"

    empty_point_x: 1.0      ### (m)
    empty_point_y: 1.0      ### (m)
    empty_point_z: 0.5      ### (m)

    uniformWind: false
    wind_files: "$(var pkg_dir)/scenarios/$(var scenario)/wind_simulations/$(var wind_sim_path)"
    output_path: "$(var pkg_dir)/scenarios/$(var scenario)"
"""
SIM_2 = """
source_x: 2.0
source_y: 3.0
source_z: 0.50

gas_type: 0

wind_sim_path: "dynamic/wind_at_cell_centers" # _i.csv automatically appended
"""
CONFIG = """
models:
  - ../../cad_models/10x6_central_obstacle.stl
  - ../../cad_models/10x6_walls.stl
outlets_models:
  - "!color [0.89, 0.27, 0.27, 1.00]"
  - ../../cad_models/10x6_door_left.stl
  - ../../cad_models/10x6_door_right.stl
unprocessed_wind_files: ../../wind_simulations/1ms/wind_at_cell_centers
empty_point: [1.35, 2.05, 0]
cell_size: 0.1
uniformWind: false
"""
SIM_3 = """
gasType: 0
sourcePosition: [2.0, 3.0, 0.50]

deltaTime: 0.1
numFilaments_sec: 10
windIterationDeltaTime: 1.0

temperature: 298.0
pressure: 1.0
filament_ppm_center: 10.0
filament_initial_std: 10.0
filament_growth_gamma: 10.0
filament_noise_std: 0.02

saveResults: true
saveDeltaTime: 0.5

# Wind Loop options
wind_looping:
  loop: true
  from: 0
  to: 24
"""


def models(folder: Path, sheets: bool = False, sealed: bool = False) -> None:
    """Walls with gaps for doors, the doors, the volume of the air, and an obstacle.

    sheets: doors without thickness, at the inner side of the walls; sealed: walls are a box within a box, without gaps.
    """
    folder.mkdir(parents=True)
    low, high = (-0.2, -0.2, -0.2), (10.2, 6.2, 2.8)
    plates = [
        ((-0.2, -0.2, -0.2), (10.2, 6.2, 0.0)), ((-0.2, -0.2, 2.6), (10.2, 6.2, 2.8)),
        ((-0.2, -0.2, 0.0), (10.2, 0.0, 2.6)), ((-0.2, 6.0, 0.0), (10.2, 6.2, 2.6)),
    ]  # fmt: skip
    for a, b in ((-0.2, 0.0), (10.0, 10.2)):
        plates += [
            ((a, 0.0, 0.0), (b, 2.0, 2.6)),
            ((a, 4.0, 0.0), (b, 6.0, 2.6)),
            ((a, 2.0, 2.0), (b, 4.0, 2.6)),
        ]
    inner = box_triangles((0, 0, 0), (10, 6, 2.6))
    walls = [box_triangles(low, high), inner] if sealed else [box_triangles(*plate) for plate in plates]
    write_stl(folder / "10x6_walls.stl", np.concatenate(walls))
    write_stl(folder / "10x6_inner.stl", inner)
    write_stl(folder / "10x6_central_obstacle.stl", box_triangles((4.5, 2.5, 0), (5.5, 3.5, 2.0)))
    for name, a, b in (("left", -0.2, 0.0), ("right", 10.0, 10.2)):
        door = box_triangles((a, 2.0, 0.0), (b, 4.0, 2.0))
        edge = 0.0 if name == "left" else 10.0
        door = door[(np.abs(door[..., 0] - edge) < 1e-9).all(axis=1)] if sheets else door
        write_stl(folder / f"10x6_door_{name}.stl", door)


def wind(folder: Path) -> None:
    """Points as of the cells of a mesh that is refined towards the walls, in the room alone."""
    folder.mkdir(parents=True)
    axes = [(0.5 - 0.5 * np.cos(np.pi * (np.arange(n) + 0.5) / n)) for n in (40, 30, 15)]
    places = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3) * [10.0, 6.0, 2.6]
    speed = np.zeros_like(places)
    speed[:, 0] = 0.1
    np.savetxt(
        folder / "wind_at_cell_centers_0.csv", np.hstack([speed, places]), "%.5g", ",",
        header='"U:0","U:1","U:2","Points:0","Points:1","Points:2"', comments="",
    )  # fmt: skip


def laid_out(folder: Path, room: str, air: str, files: dict[str, str], **keys: bool) -> Path:
    """Write a project; returns the scenario that names it."""
    home = folder / f"test_env/scenarios/{room}"
    models(home / "cad_models", **keys)
    wind(home / f"wind_simulations/{air}")
    for name, text in files.items():
        (home / name).parent.mkdir(parents=True, exist_ok=True)
        (home / name).write_text(text)
    path = folder / "room.yaml"
    path.write_text(f"gaden: test_env/scenarios/{room}\nduration: 0.5\n")
    return path


def version_2(folder: Path, **keys: bool) -> Path:
    files = {"params/preproc_params.yaml": PREPROCESSING, "simulations/sim1.yaml": SIM_2}
    return laid_out(folder, "10x6_empty_room", "dynamic", files, **keys)


def version_3(folder: Path, **keys: bool) -> Path:
    config = "environment_configurations/config1"
    files = {f"{config}/config.yaml": CONFIG, f"{config}/simulations/sim1/sim.yaml": SIM_3}
    files["gaden.gproj"] = "versionMajor: 3\nversionMinor: 0\n"
    return laid_out(folder, "10x6_central_obstacle", "1ms", files, **keys)


@pytest.mark.parametrize("keys", [{}, {"sheets": True}, {"sealed": True}])
def test_the_air_is_that_of_the_room(tmp_path, keys):
    version_3(tmp_path, **keys)
    home = tmp_path / "test_env/scenarios/10x6_central_obstacle"
    grid = gaden.read(home / "environment_configurations/config1/config.yaml")
    centres = [grid.low + 0.1 * (np.argwhere(grid.cubes == value) + 0.5) for value in (0, 2)]
    room = np.concatenate(centres)
    room = room[(room[:, 0] > 0) & (room[:, 0] < 10)]
    assert len(room) == 100 * 60 * 26 - 10 * 10 * 20
    ends = [room.min(axis=0), room.max(axis=0)]
    np.testing.assert_allclose(ends, [[0.05] * 3, [9.95, 5.95, 2.55]], atol=1e-6)
    doors = centres[1]
    assert (np.abs(doors[:, 0] - 5) > 4.8).all()
    ends = [doors.min(axis=0)[1:], doors.max(axis=0)[1:]]
    np.testing.assert_allclose(ends, [[2.05, 0.05], [3.95, 1.95]], atol=1e-6)


@pytest.mark.parametrize("made", [version_2, version_3])
def test_one_line_loads_a_published_project(tmp_path, made):
    scenario, resources = load(made(tmp_path))
    assert set(scenario.wind.walls) == {"y-", "y+", "z-", "z+"}
    source = np.array(scenario.wind.origin) + scenario.gases[0][1].sources[0].position
    assert source == pytest.approx([2.0, 3.0, 0.5])
    assert resources.site is not None


@pytest.mark.usefixtures("taichi")
@pytest.mark.slow
@pytest.mark.parametrize("made", [version_2, version_3])
def test_one_line_runs_a_published_project(tmp_path, made):
    path = made(tmp_path)
    options = ["--quiet", "--no-recording", "--no-report", "--out"]
    assert run.main([str(path), *options, str(tmp_path / "out")]) == 0
    again = [str(tmp_path / "out/scenario.yaml"), "--allow-outside"]
    assert run.main([*again, *options, str(tmp_path / "again")]) == 0


@pytest.mark.parametrize(
    ("made", "name", "reported"),
    [
        (version_2, "cad_models/10x6_door_left.stl", r"10x6_door_left\.stl: no such file"),
        (version_2, "params/preproc_params.yaml", r"params/preproc_params\.yaml"),
        (version_2, "wind_simulations/dynamic/wind_at_cell_centers_0.csv", r"centers_0\.csv does not exist"),
        (version_2, "simulations/sim1.yaml", "holds no simulation"),
        (version_3, "cad_models/10x6_walls.stl", r"10x6_walls\.stl: no such file"),
        (version_3, "environment_configurations/config1/config.yaml", r"config\.yaml: .*No such file"),
        (version_3, "wind_simulations/1ms/wind_at_cell_centers_0.csv", r"centers_0\.csv does not exist"),
    ],
)
def test_a_missing_file_is_named_in_a_line(tmp_path, made, name, reported):
    path = made(tmp_path)
    next((tmp_path / "test_env/scenarios").glob(f"*/{name}")).unlink()
    with pytest.raises(ScenarioError, match=reported) as caught:
        load(path)
    assert len(caught.value.faults) == 1


@pytest.mark.parametrize(
    "name",
    [
        "$(find test_env)/10x6_empty_room/cad_models/10x6_walls.stl",
        "$(find-pkg-share test_env)/scenarios/10x6_empty_room/cad_models/10x6_walls.stl",
        "package://test_env/scenarios/10x6_empty_room/cad_models/10x6_walls.stl",
        "cad_models/10x6_walls.stl",
    ],
)
def test_names_by_packages_of_ros(tmp_path, name):
    version_2(tmp_path)
    file = tmp_path / "test_env/scenarios/10x6_empty_room/params/preproc_params.yaml"
    walls = "$(var pkg_dir)/scenarios/$(var scenario)/cad_models/10x6_walls.stl"
    old = PREPROCESSING.replace("models:\n      - ", f'model_0: "{name}" # ', 1)
    for text in (PREPROCESSING.replace(walls, name), old):
        file.write_text(text)
        assert (gaden.read(file).cubes == 2).any()


@pytest.mark.parametrize(
    ("old", "new", "reported"),
    [
        ("cell_size: 0.1", "cell_size: 0.0011", "cells of the models"),
        ("cell_size: 0.1", "cell_size: 1" + 400 * "0", "cell_size: got 1000"),
        ("cell_size: 0.1", "cell_size: !!bool 3", "cell_size|bool|YAML"),
        ("empty_point_x: 1.0", "empty_point_x: 50", "empty_point: lies outside"),
        ("empty_point_x: 1.0", "empty_point_x: 1" + 400 * "0", "empty_point: got"),
        ("models:", "models: 5\n    other:", "models: got 5, must be a list"),
        ("models:", "models: []\n    other:", "models: lists no STL file"),
        ("10x6_walls.stl", "../../../../../../away.stl", r"away\.stl"),
        ("gaden_preprocessing:", "other:", "has no gaden_preprocessing"),
        ("  ros__parameters:", "  other:", "has no ros__parameters"),
    ],
)
def test_faults_of_a_listing_are_reported_in_a_line(tmp_path, old, new, reported):
    path = version_2(tmp_path)
    (tmp_path.parent / "away.stl").touch()
    file = tmp_path / "test_env/scenarios/10x6_empty_room/params/preproc_params.yaml"
    assert old in PREPROCESSING
    file.write_text(PREPROCESSING.replace(old, new, 1))
    with pytest.raises(ScenarioError, match=reported) as caught:
        load(path)
    assert len(caught.value.faults) == 1


def test_a_grid_of_gaden_comes_first_and_of_several_winds_one_has_to_be_named(tmp_path):
    path = version_2(tmp_path)
    home = tmp_path / "test_env/scenarios/10x6_empty_room"
    (home / "simulations/sim1.yaml").write_text(SIM_2.replace("wind_sim_path", "#"))
    assert "dynamic" in load(path).scenario.wind.files
    wind(home / "wind_simulations/1ms")
    with pytest.raises(ScenarioError, match=r"wind_sim_path: is missing.*1ms/wind.*, dynamic/wind"):
        load(path)
    (home / "OccupancyGrid3D.csv").write_text("#env_min(m) 0 0 0\n")
    with pytest.raises(ScenarioError, match=r"OccupancyGrid3D\.csv"):
        load(path)


def test_a_simulation_at_the_root_of_a_path(monkeypatch):
    """A path has fewer parents there."""
    monkeypatch.setattr(gaden_project, "read_mapping", lambda path, needs: {})
    monkeypatch.setattr(gaden_project, "configuration", lambda path: {})
    monkeypatch.setattr(gaden_project.os.path, "isfile", lambda path: True)
    for name in ("/sim.yaml", "/sim1.yaml", "/a/sim.yaml", "/a/sim1.yaml"):
        assert gaden_project._project_at(Path(name)).home == Path("/")
