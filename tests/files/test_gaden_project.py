"""Projects of GADEN's as its public examples are laid out, made here in the same form: they run with one line."""

from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from test_meshes import box_triangles, write_stl

from taichi_plume.assembly.assemble import assemble
from taichi_plume.assembly.preparation import load
from taichi_plume.files import gaden, gaden_models
from taichi_plume.scenario.loading import ScenarioError, scenario_from, scenario_of
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.studies.plan import load_plan

CELL, SHAPE, LOW = 0.2, (20, 15, 6), np.array([-1.0, 2.0, 0.0])
SIM = {
    "source": {"sourceType": "point", "position": [-0.2, 3.5, 0.5], "gasType": 6},
    "deltaTime": 0.1, "windIterationDeltaTime": 2, "temperature": 298, "pressure": 1,
    "filamentPPMcenter": 20, "filamentInitialSigma": 10, "filamentGrowthGamma": 12, "filamentNoise_std": 0.02,
    "numFilaments_sec": 10, "expectedNumIterations": 600, "saveResults": True, "saveDeltaTime": 0.5,
    "preCalculateConcentrations": False, "windLooping": {"loop": True, "from": 0, "to": 1},
}  # fmt: skip
CONFIG = {
    "models": ["../../cad_models/10x6_walls.stl", "../../cad_models/10x6_box.stl"],
    "outlets_models": ["!color [0.86, 0.24, 0.24, 1.00]", "../../cad_models/10x6_door_left.stl"],
    "unprocessed_wind_files": "../../wind_simulations/1ms/wind_at_cell_centers",
    "empty_point": [0.5, 2.5, 0.5],
    "cell_size": CELL,
    "uniformWind": False,
}
OLD: dict[str, Any] = {"source_x": -0.2, "source_y": 3.5, "source_z": 0.5, "gas_type": 0}
OLD["wind_sim_path"] = "1ms/wind_at_cell_centers"


def cubes() -> np.ndarray:
    """Walls around a room, a box in it, and a door at each end."""
    solid = np.ones(SHAPE, int)
    solid[1:-1, 1:-1, 1:-1] = 0
    solid[[0, -1], 5:9, 1:4] = 2
    solid[9:11, 6:9, 1:3] = 1
    return solid


def wind(folder: Path) -> None:
    folder.mkdir(parents=True)
    places = LOW + CELL * (np.argwhere(cubes() == 0) + 0.5)
    for n in range(2):
        u = np.tile([0.2 + 0.1 * n, 0.0, 0.0], (len(places), 1))
        np.savetxt(
            folder / f"wind_at_cell_centers_{n}.csv", np.hstack([u, places]), "%.6g", ",",
            header="U:0,U:1,U:2,Points:0,Points:1,Points:2", comments="",
        )  # fmt: skip


def grid(path: Path) -> None:
    high, count = LOW + CELL * np.array(SHAPE), " ".join(map(str, SHAPE))
    head = f"#env_min(m) {LOW[0]} {LOW[1]} {LOW[2]}\n#env_max(m) {high[0]} {high[1]} {high[2]}\n"
    rows = "".join(
        "".join(" ".join(map(str, row)) + " \n" for row in layer) + ";\n"
        for layer in cubes().transpose(2, 0, 1)
    )
    path.write_text(f"{head}#num_cells {count}\n#cell_size(m) {CELL}\n{rows}")


def block(low: tuple[float, ...], high: tuple[float, ...]) -> np.ndarray:
    return box_triangles(LOW + np.array(low), LOW + np.array(high))


def models(folder: Path) -> None:
    """A room between a floor, a ceiling and side walls, open at its ends, where doors fill it; a box."""
    folder.mkdir(parents=True)
    plates = [
        block((0, 0, 0), (4.0, 3.0, 0.2)), block((0, 0, 1.0), (4.0, 3.0, 1.2)),
        block((0, 0, 0.1), (4.0, 0.2, 1.1)), block((0, 2.8, 0.1), (4.0, 3.0, 1.1)),
    ]  # fmt: skip
    write_stl(folder / "10x6_walls.stl", np.concatenate(plates))
    write_stl(folder / "10x6_box.stl", block((1.8, 1.2, 0.2), (2.2, 1.8, 0.6)))
    write_stl(folder / "10x6_door_left.stl", block((0.0, 0.2, 0.2), (0.1, 2.8, 1.0)))
    write_stl(folder / "10x6_door_right.stl", block((3.9, 0.2, 0.2), (4.0, 2.8, 1.0)))


def project(folder: Path, sim: dict[str, Any] | None = None, config: dict[str, Any] | None = None) -> Path:
    """In the form of version 3; once preprocessed. Returns the scenario that names it."""
    home = folder / "10x6_room/environment_configurations/config1"
    (home / "simulations/sim1").mkdir(parents=True)
    (home / "simulations/sim1/sim.yaml").write_text(yaml.safe_dump(SIM | (sim or {})))
    (home / "config.yaml").write_text(yaml.safe_dump(CONFIG | (config or {})))
    wind(folder / "10x6_room/wind_simulations/1ms")
    grid(home / "OccupancyGrid3D.csv")
    (folder / "room.yaml").write_text("gaden: 10x6_room\n")
    return folder / "room.yaml"


def test_one_line_is_the_scenario_of_the_project(tmp_path):
    path = project(tmp_path)
    scenario, resources = load(path)
    assert not resources.warnings
    assert scenario.domain.size == pytest.approx((4.0, 3.0, 0.8))  # without floor and ceiling
    assert scenario.wind.origin == pytest.approx((-1.0, 2.0, 0.2))
    assert scenario.domain.spacing == CELL
    assert scenario.duration == pytest.approx(60.0)
    air: Any = scenario.wind
    gas: Any = scenario.gases[0][1]
    assert (air.kind, air.interval, air.loop) == ("imported", 2.0, True)
    assert set(air.walls) == {"y-", "y+", "z-", "z+"}
    assert gas.species == "acetone"
    assert gas.sources[0].position == pytest.approx((0.8, 1.5, 0.3))
    moles = 20e-6 * 101325.0 / (8.314462618 * 298.0) * (2 * pi) ** 1.5 * 0.1**3
    assert gas.sources[0].rate == pytest.approx(10 * moles * 58.08e-3)
    assert (gas.release_rate, gas.initial_size, gas.growth.rate) == pytest.approx((10.0, 0.1, 12e-4))
    # GADEN 3 moves a filament by a normal number of 10 * 0.02 m/s times 0.1 s in each 0.1 s
    assert gas.fluctuation**2 * gas.fluctuation_time == pytest.approx(0.5 * (10 * 0.02 * 0.1) ** 2 / 0.1)
    home = "10x6_room/environment_configurations/config1"
    for name in (home, f"{home}/simulations/sim1", f"{home}/simulations/sim1/sim.yaml"):
        path.write_text(f"gaden: {name}\n")
        assert load(path).scenario == scenario


def test_a_study_of_a_project(tmp_path):
    """Its axes are keys of the scenario that the project stands for."""
    scenario = load(project(tmp_path)).scenario
    (tmp_path / "study.yaml").write_text(
        "name: two\nbase: room.yaml\nairs: 2\naxes: {size: {key: gas.initial_size, values: [0.1, 0.2]}}\n"
    )
    found = load_plan(tmp_path / "study.yaml")
    runs = [scenario_of(found.base, request.changes) for request in found.requests]
    assert [one.gas.initial_size for one in runs] == [0.1, 0.1, 0.2, 0.2]
    assert runs[0] == scenario.model_copy(update={"name": runs[0].name, **runs[0].seeds})


def test_the_key_stands_in_files_alone():
    with pytest.raises(ScenarioError, match="gaden: works in the file of a scenario alone"):
        scenario_from({"gaden": "room"})
    schema = Scenario.model_json_schema()
    assert {"required": ["gaden"]} in schema["anyOf"]
    assert "GADEN" in schema["properties"]["gaden"]["description"]


@pytest.mark.usefixtures("taichi")
@pytest.mark.slow
def test_it_runs_and_the_scenario_s_own_keys_come_first(tmp_path):
    path = project(tmp_path)
    path.write_text(
        path.read_text()
        + "duration: 3\nseed: 4\ngas: {release_rate: 40}\nrobots: [{count: 1, start: {kind: positions, "
        "positions: [[3, 1.5]]}, algorithm: {kind: surge_cast, threshold_ppm: 2}}]\n"
    )
    scenario, _ = load(path)
    gas: Any = scenario.gases[0][1]
    assert (scenario.seed, scenario.duration, gas.release_rate) == (4, 3.0, 40.0)
    assert gas.initial_size == pytest.approx(0.1)
    sim = assemble(scenario, tmp_path)
    sim.run()
    budget = sim.gas.gases[0].budget()
    assert budget["emitted_kg"] == pytest.approx(gas.sources[0].rate * 3.0, rel=0.02)
    u = sim.grid.read(sim.wind.u[0])
    assert u[1:-1, 6:8, 1:3][~sim.air.solid[1:-1, 6:8, 1:3]].mean() > 0.05  # from door to door
    assert sim.air.solid[9:11, 6:9, :2].all()


def test_the_form_of_version_2(tmp_path):
    home = tmp_path / "scenarios/room"
    (home / "simulations").mkdir(parents=True)
    for name in ("sim1", "sim2"):
        (home / f"simulations/{name}.yaml").write_text(yaml.safe_dump(OLD))
    wind(home / "wind_simulations/1ms")
    grid(home / "OccupancyGrid3D.csv")
    path = tmp_path / "room.yaml"
    path.write_text("gaden: scenarios/room/simulations/sim1.yaml\nduration: 5 s\n")
    scenario, _ = load(path)
    gas: Any = scenario.gases[0][1]
    assert gas.species == "ethanol"
    assert gas.fluctuation**2 * gas.fluctuation_time == pytest.approx(0.5 * 0.02**2 / 0.1)
    path.write_text("gaden: scenarios/room\n")
    with pytest.raises(ScenarioError, match=r"several simulations; .* simulations/sim1\.yaml, sim"):
        load(path)


DOORS = [f"../../cad_models/10x6_door_{end}.stl" for end in ("left", "right")]


def test_without_an_occupancy_grid_it_is_made_of_the_models(tmp_path):
    path = project(tmp_path, config={"outlets_models": DOORS})
    home = tmp_path / "10x6_room/environment_configurations/config1"
    (home / "OccupancyGrid3D.csv").unlink()
    models(tmp_path / "10x6_room/cad_models")
    found = gaden.read(home / "config.yaml")
    expected = np.zeros((20, 13, 4), int)
    expected[[0, -1]] = 2
    expected[9:11, 5:8, :2] = 1
    np.testing.assert_array_equal(found.cubes, expected)
    np.testing.assert_allclose(found.low, LOW + np.array([0.0, 0.2, 0.2]), atol=1e-6)
    scenario, resources = load(path)
    assert scenario.domain.size == pytest.approx((4.0, 2.6, 0.8))
    assert set(scenario.wind.walls) == {"y-", "y+", "z-", "z+"}
    assert scenario.gases[0][1].sources[0].position == pytest.approx((0.8, 1.3, 0.3))
    assert "has no OccupancyGrid3D.csv yet" in resources.warnings[0]
    names = {file.name for file in resources.files["wind"]}
    assert names > {"config.yaml", "10x6_walls.stl", "10x6_box.stl", "10x6_door_left.stl"}


def test_an_origin_of_the_scenario_moves_sources_too(tmp_path):
    path = project(tmp_path)
    path.write_text(path.read_text() + "wind: {origin: [-0.8, 2.2, 0.2]}\ndomain: {size: [3.6, 2.6, 0.8]}\n")
    scenario = load(path).scenario
    assert scenario.wind.origin == pytest.approx((-0.8, 2.2, 0.2))
    assert scenario.gases[0][1].sources[0].position == pytest.approx((0.6, 1.3, 0.3))


def test_voxels_of_triangles_are_those_that_samples_lie_in():
    """Against a dense sample of points of each triangle."""
    rng = np.random.default_rng(5)
    triangles = rng.uniform(0.5, 9.5, (20, 3, 3))
    found, sampled = np.zeros((10, 10, 10), bool), np.zeros((10, 10, 10), bool)
    for cells in gaden_models._crossed(triangles, found.shape, False):
        found[tuple(cells.T)] = True
    weights = rng.dirichlet([0.5, 0.5, 0.5], 100_000)
    for triangle in triangles:
        sampled[tuple(np.floor(weights @ triangle).astype(int).T)] = True
    assert (sampled & ~found).sum() <= 2  # points in the outermost ten thousandths of a voxel
    assert (found & ~sampled).sum() < 0.03 * found.sum()  # corners that no sample met


def test_inside_of_a_closed_body():
    """Against the closed form of an octahedron, whichever way its triangles are wound."""
    middle, radius = np.array([6.2, 5.7, 6.4]), 4.3
    ends = [middle + radius * sign * np.eye(3)[a] for a in range(3) for sign in (-1, 1)]
    faces = [[ends[i], ends[j], ends[k]] for i in (0, 1) for j in (2, 3) for k in (4, 5)]
    triangles = np.array(faces)
    assert gaden_models._is_closed(triangles)
    assert not gaden_models._is_closed(triangles[1:])
    inside = gaden_models._inside(triangles, (12, 12, 12))
    centres = np.stack(np.meshgrid(*[np.arange(12) + 0.5] * 3, indexing="ij"), -1)
    np.testing.assert_array_equal(inside, np.abs(centres - middle).sum(axis=-1) < radius)
    assert len(gaden_models._bodies(np.concatenate([triangles, triangles + 20.0]))) == 2


HUGE = 10**400


def source(**keys: Any) -> dict[str, Any]:
    return {"source": SIM["source"] | keys}


@pytest.mark.parametrize(
    ("sim", "config", "fault"),
    [
        (source(position=[0, 3]), {}, r"its source must be at three numbers, got \[0, 3\]"),
        (source(position=[0, 3, "a"]), {}, "its source must be at three numbers"),
        (source(position=[HUGE, 0, 0]), {}, "its source must be at three numbers"),
        ({"source": 5, "sourcePosition": None}, {}, "its source must be at three numbers"),
        (source(gasType=20), {}, "gasType: got 20, must be a number from 0 to 13"),
        (source(gasType=HUGE), {}, "gasType: got 1000"),
        (source(sourceType="sphere", radius=HUGE), {}, "radius: got 1000"),
        ({"deltaTime": HUGE}, {}, "deltaTime: got 1000"),
        ({"deltaTime": "fast"}, {}, "deltaTime: got 'fast', must be a number of 0 or more"),
        ({"windLooping": HUGE, "expectedNumIterations": float("inf")}, {}, "expectedNumIterations: got inf"),
        ({"filamentInitialSigma": 0}, {}, "its filaments need a size, a rate and a time step above 0"),
        ({}, {"unprocessed_wind_files": "none"}, r"its wind none_0\.csv does not exist"),
        ({}, {"unprocessed_wind_files": 5}, "names no wind files"),
        ({}, {"unprocessed_wind_files": "a" * 5000}, r"_0\.csv cannot be read"),
        ({}, {"unprocessed_wind_files": "../../../../../outside/wind"}, "does not exist|lies outside"),
        ({}, {"models": 5, "outlets_models": "a", "cell_size": "x"}, "cell_size: got 'x'"),
        (
            {},
            {"uniformWind": True, "unprocessed_wind_files": "none"},
            r"its uniform wind .*none_0\.csv does not exist",
        ),
    ],
)
def test_faults_are_reported_in_a_line(tmp_path, sim, config, fault):
    path = project(tmp_path, sim, config)
    if "models" in config:
        (tmp_path / "10x6_room/environment_configurations/config1/OccupancyGrid3D.csv").unlink()
    with pytest.raises(ScenarioError, match=fault) as caught:
        load(path)
    assert all("room.yaml: " in line for line in caught.value.faults)


@pytest.mark.parametrize(
    ("line", "fault"),
    [
        (f"gaden: {'a' * 5000}", "holds no simulation of GADEN's"),
        ("gaden: none", "gaden: .*none: holds no simulation of GADEN's"),
        ("gaden: ../..", r"gaden: \.\./\.\. lies outside the scenario's folder"),
        ("gaden: [1]", r"gaden: must be a path in a project of GADEN's, got \[1\]"),
        ('gaden: "a\\0b"', "has the character"),
        ("gaden: room.yaml", "there is neither an OccupancyGrid3D|names no wind files"),
    ],
)
def test_what_is_no_project_is_reported(tmp_path, line, fault):
    path = tmp_path / "room.yaml"
    path.write_text(f"{line}\n")
    with pytest.raises(ScenarioError, match=fault):
        load(path)


def test_a_source_of_another_shape_is_reported(tmp_path):
    line = {"sourceType": "line", "position": [-0.2, 3.5, 0.5], "lineEnd": [0, 3.5, 0.5], "gasType": 1}
    remarks = "\n".join(load(project(tmp_path, {"source": line})).resources.warnings)
    assert "a source of type line is released from a point" in remarks
