"""Winds and releases of GADEN's projects: parameter files with variables, loops, uniform wind, gases without a mass."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from test_gaden_project import CONFIG, DOORS, LOW, OLD, SIM, grid, models, project

from taichi_plume.assembly.assemble import assemble
from taichi_plume.assembly.preparation import load, load_scenario
from taichi_plume.files import gaden, gaden_models
from taichi_plume.files.gaden_models import substituted
from taichi_plume.scenario.loading import ScenarioError
from taichi_plume.scenario.species import AIR_MOLAR_MASS

NAMES = (
    "sim_time", "time_step", "num_filaments_sec", "variable_rate", "filament_stop_steps", "gas_type", "temperature",
)  # fmt: skip
PARAMETERS: dict[str, Any] = {name: f"$(var {name})" for name in NAMES} | {
    "source_position_x": "$(var source_x)", "pressure": 0.9, "wind_time_step": 3.0,
    "wind_data": "$(var pkg_dir)/scenarios/$(var scenario)/wind_simulations/$(var wind_sim_path)",
    "allow_looping": True, "loop_from_step": 0, "loop_to_step": 3,
}  # fmt: skip
VALUES: dict[str, Any] = OLD | {
    "sim_time": 30.0, "time_step": 0.1, "num_filaments_sec": 20, "variable_rate": False, "filament_stop_steps": 0,
    "temperature": 300.0,
}  # fmt: skip


def winds(folder: Path, count: int = 4) -> None:
    """Files of a wind along x of 0.1, 0.2 ... m/s."""
    folder.mkdir(parents=True)
    places = LOW + 0.2 * (np.argwhere(np.ones((20, 15, 6))) + 0.5)
    for n in range(count):
        u = np.tile([0.1 * (n + 1), 0.0, 0.0], (len(places), 1))
        np.savetxt(
            folder / f"wind_at_cell_centers_{n}.csv", np.hstack([u, places]), "%.6g", ",",
            header="U:0,U:1,U:2,Points:0,Points:1,Points:2", comments="",
        )  # fmt: skip


def version_2(
    folder: Path,
    values: dict[str, Any] | None = None,
    parameters: dict[str, Any] | None = None,
    preprocessing: dict[str, Any] | None = None,
    place: str = "params/gaden_params.yaml",
) -> Path:
    """A project of version 2 with a parameter file; returns the scenario that names it."""
    home = folder / "room"
    files: dict[str, Any] = {
        "simulations/sim1.yaml": VALUES | (values or {}),
        place: {"gaden_filament_simulator": {"ros__parameters": PARAMETERS | (parameters or {})}},
    }
    if preprocessing is None:
        home.mkdir()
        grid(home / "OccupancyGrid3D.csv")
    else:
        models(home / "cad_models")
        files["params/preproc_params.yaml"] = {"gaden_preprocessing": {"ros__parameters": preprocessing}}
    for name, data in files.items():
        (home / name).parent.mkdir(parents=True, exist_ok=True)
        (home / name).write_text(yaml.safe_dump(data))
    winds(home / "wind_simulations/1ms")
    (folder / "room.yaml").write_text("gaden: room/simulations/sim1.yaml\n")
    return folder / "room.yaml"


def loaded(path: Path) -> tuple[Any, Any, str]:
    """Wind, gas and notes of a scenario."""
    scenario, resources = load(path)
    return scenario.wind, scenario.gases[0][1], "\n".join(resources.warnings)


@pytest.mark.parametrize("place", ["params/gaden_params.yaml", "ros_params/gaden_params.yaml"])
def test_parameters_of_the_simulator_are_read(tmp_path, place):
    path = version_2(tmp_path, {"source_x": -0.4}, place=place)
    air, gas, notes = loaded(path)
    assert (air.interval, air.loop, air.loop_from, air.loop_to) == (3.0, True, None, None)
    assert load(path).scenario.duration == 30.0
    assert gas.release_rate == 20.0
    moles = 20e-6 * 0.9 * 101325.0 / (8.314462618 * 300.0) * (2 * np.pi) ** 1.5 * 0.1**3
    assert gas.sources[0].rate == pytest.approx(20 * moles * 46.069e-3)
    assert gas.sources[0].position[0] == pytest.approx(-0.4 - air.origin[0])
    assert not notes


def test_a_parameter_of_its_own_wins_over_a_value_of_the_simulation(tmp_path):
    parameters = {
        "num_filaments_sec": 5,
        "gas_type": "$(var away)",
        "pressure": "$(var p)",
        "frame": "$(var map)",
    }
    air, gas, notes = loaded(version_2(tmp_path, parameters=parameters))
    assert "gaden_params.yaml: pressure: $(var p) has no value in sim1.yaml" in notes
    assert len(notes.splitlines()) == 1  # the simulation has a gas_type, and nothing uses the frame
    assert gas.release_rate == 5.0
    assert gas.species == "ethanol"
    assert air.interval == 3.0


@pytest.mark.parametrize(
    ("values", "share", "noted"),
    [
        ({"variable_rate": True}, 0.5, "variable_rate"),
        ({"variable_rate": True, "filament_stop_steps": 4}, 0.5, "variable_rate"),
        ({"filament_stop_steps": 4}, 0.2, "filament_stop_steps"),
    ],
)
def test_a_release_in_bursts_has_its_mean_rate(tmp_path, values, share, noted):
    """As GADEN 2 draws them: steps of 0.1 s with 2 filaments, or bursts with steps between."""
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    _, full, _ = loaded(version_2(tmp_path / "a"))
    _, gas, notes = loaded(version_2(tmp_path / "b", values))
    assert gas.release_rate == pytest.approx(share * full.release_rate)
    assert gas.sources[0].rate == pytest.approx(share * full.sources[0].rate)
    assert noted in notes


@pytest.mark.parametrize(
    ("parameters", "keys", "noted"),
    [
        ({"allow_looping": False}, (False, None, None), "the last frame holds"),
        ({"loop_to_step": 2}, (True, None, 6.0), ""),
        ({"loop_from_step": 1}, (True, 3.0, None), ""),
        ({"loop_from_step": 1, "loop_to_step": 2}, (True, 3.0, 6.0), ""),
        ({"loop_to_step": 24}, (True, None, None), "from file 0 to file 24, but it has the files 0 to 3"),
        ({"loop_from_step": 9, "loop_to_step": 24}, (False, None, None), "nothing is looped"),
        ({"loop_from_step": 3, "loop_to_step": 1}, (False, None, None), "nothing is looped"),
    ],
)
def test_the_loop_of_the_wind(tmp_path, parameters, keys, noted):
    air, _, notes = loaded(version_2(tmp_path, parameters=parameters))
    assert (air.loop, air.loop_from, air.loop_to) == keys
    assert noted in notes
    assert bool(noted) == bool(notes)


def test_the_loop_of_version_3(tmp_path):
    (tmp_path / "room").mkdir()
    path = project(tmp_path / "room", {"windLooping": {"loop": True, "from": 1, "to": 1}})
    air = loaded(path)[0]
    assert (air.loop, air.loop_from, air.loop_to) == (True, 2.0, None)


@pytest.mark.parametrize(
    ("looping", "loop"),
    [(True, True), (False, False), ({"loop": False, "from": 0, "to": 1}, False), ({"loop": "false"}, "got 'false'"),
     ("yes", "got 'yes'"), ([0, 1], r"got \[0, 1\]")],
)  # fmt: skip
def test_a_flag_of_the_loop_of_version_3(tmp_path, looping, loop):
    path = project(tmp_path, {"windLooping": looping})
    if isinstance(loop, bool):
        assert loaded(path)[0].loop is loop
    else:
        with pytest.raises(ScenarioError, match=loop):
            load(path)


@pytest.mark.parametrize("node", ["/lab/gaden_filament_simulator", "/**/gaden_filament_simulator", "/lab/**"])
def test_a_node_with_a_namespace(tmp_path, node):
    path = version_2(tmp_path)
    file = tmp_path / "room/params/gaden_params.yaml"
    file.write_text(file.read_text().replace("gaden_filament_simulator", node))
    assert loaded(path)[0].interval == 3.0
    file.write_text("other: {ros__parameters: {a: 1}}")
    with pytest.raises(
        ScenarioError, match="has no gaden_filament_simulator; it has the simulator's parameters"
    ):
        load(path)


@pytest.mark.parametrize(
    ("kind", "species"),
    [("smoke", "smoke"), ("Methane", "methane"), (7.0, "neon"), ("air", None), (7.5, None)],
)
def test_a_gas_by_its_name(tmp_path, kind, species):
    path = project(tmp_path, {"source": SIM["source"] | {"gasType": kind}})
    if species is None:
        with pytest.raises(ScenarioError, match="from 0 to 13 or one of ethanol, methane"):
            load(path)
    else:
        found = loaded(path)[1].species
        assert species in (found, getattr(found, "name", None))


@pytest.mark.parametrize(
    ("start", "is_noted"),
    [("package://test_env/room/", False), ("package://test_env/scenarios/A/", True), ("$(find-pkg-share env)/A/", True),
     ("/home/me/ws/room/", True), ("C:\\ws\\room\\", True), ("../elsewhere/", True)],
)  # fmt: skip
def test_files_of_another_computer(tmp_path, start, is_noted):
    """Ever shorter ends of their paths are looked up around the project."""
    config = {key: CONFIG[key] for key in ("cell_size", "empty_point")}
    config["models"] = f"{start}cad_models/10x6_walls.stl"
    wind = {"wind_data": f"{start}wind_simulations/1ms/wind_at_cell_centers"}
    path = version_2(tmp_path, parameters=wind, preprocessing=config)
    scenario, resources = load(path)
    assert scenario.wind.files == "room/wind_simulations/1ms/wind_at_cell_centers_%d.csv"
    assert {"10x6_walls.stl", "wind_at_cell_centers_0.csv"} <= {file.name for file in resources.files["wind"]}
    remarks = resources.facts["wind"].remarks
    assert any("models: " in remark and "10x6_walls.stl" in remark for remark in remarks) == is_noted
    assert any("is not there" in note and "1ms" in note for note in resources.warnings) == is_noted
    (tmp_path / "room/cad_models/10x6_walls.stl").rename(tmp_path / "room/10x6_door.stl")
    with pytest.raises(ScenarioError, match=r"10x6_walls.stl: (no such file|cannot be read)"):
        load(path)


@pytest.mark.parametrize("name", ["/home/me/10x6_room/wind_simulations/1ms/wind_at_cell_centers"])
def test_a_wind_of_another_computer_in_version_3(tmp_path, name):
    path = project(tmp_path, config={"unprocessed_wind_files": name})
    air, _, notes = loaded(path)
    assert air.files == "10x6_room/wind_simulations/1ms/wind_at_cell_centers_%d.csv"
    assert "is not there" in notes


@pytest.mark.parametrize(
    ("parameters", "fault"),
    [
        ({"allow_looping": "often"}, "allow_looping: got 'often', must be true or false"),
        ({"loop_to_step": "x"}, "loop of its wind: got 0 to 'x'"),
        ({"variable_rate": 5}, "variable_rate: got 5"),
        ({"filament_stop_steps": -1}, "filament_stop_steps: got -1"),
        ({"wind_time_step": [1]}, r"wind_time_step: got \[1\]"),
    ],
)
def test_faults_of_parameters_are_reported_in_a_line(tmp_path, parameters, fault):
    with pytest.raises(ScenarioError, match=fault) as caught:
        load(version_2(tmp_path, parameters=parameters))
    assert len(caught.value.faults) == 1


def test_models_listed_in_a_simulation(tmp_path):
    """The same grid as with a list in the parameters of the preprocessing."""
    config = {key: CONFIG[key] for key in ("cell_size", "uniformWind")} | dict(
        zip(("empty_point_x", "empty_point_y", "empty_point_z"), CONFIG["empty_point"], strict=True)
    )
    walls = [
        f"$(var pkg_dir)/scenarios/$(var scenario)/cad_models/10x6_{name}.stl" for name in ("walls", "box")
    ]
    doors = [name.replace("../../", "$(find test_env)/room/") for name in DOORS]
    listed = {"models": "$(var models)", "outlets_models": "$(var outlets)", "cell_size": "$(var cell)"}
    path = version_2(
        tmp_path, {"models": walls, "outlets": doors, "cell": 0.2}, preprocessing=config | listed
    )
    home = tmp_path / "room"
    scenario, resources = load(path)
    assert scenario.wind.occupancy == "room/simulations/sim1.yaml"
    found = gaden.read(home / "simulations/sim1.yaml").cubes
    plain = {"gaden_preprocessing": {"ros__parameters": config | {"models": walls, "outlets_models": doors}}}
    (home / "params/preproc_params.yaml").write_text(yaml.safe_dump(plain))
    np.testing.assert_array_equal(found, gaden.read(home / "params/preproc_params.yaml").cubes)
    assert (found == 2).any()
    assert {"sim1.yaml", "preproc_params.yaml", "10x6_walls.stl"} < {
        file.name for file in resources.files["wind"]
    }
    assert load(path).scenario.wind.occupancy == "room/params/preproc_params.yaml"


def test_models_of_a_variable_without_a_simulation(tmp_path):
    version_2(tmp_path, preprocessing={"models": "$(var models)", "cell_size": 0.2})
    with pytest.raises(
        gaden_models.WindFileError, match=r"models: \$\(var models\) stands for a list in simulations/"
    ):
        gaden.read(tmp_path / "room/params/preproc_params.yaml")


def test_variables():
    values = {"a": 3, "b": [1, 2], "c": "x"}
    assert substituted("$(var a)", values) == 3
    assert substituted("$(var b)", values) == [1, 2]
    assert substituted(["$(var d)/$(var c)_$(var a)", 1.5], values) == ["$(var d)/x_3", 1.5]


@pytest.mark.parametrize(
    ("number", "name", "gravity"), [(13, "smoke", 0.89), (9, "biogas", 0.8), (5, "fluorine", 1.31)]
)
def test_a_gas_without_a_molar_mass_has_that_of_its_specific_gravity(tmp_path, number, name, gravity):
    source = SIM["source"] | {"gasType": number}
    _, gas, notes = loaded(project(tmp_path, {"source": source}))
    assert (gas.species.name, gas.species.molar_mass) == (name, pytest.approx(gravity * AIR_MOLAR_MASS))
    assert f"{name} has no molar mass in GADEN" in notes
    assert gas.sources[0].position[2] == pytest.approx(0.3)  # 0.5 m above the floor of 0.2 m


def uniform_project(folder: Path, text: str, name: str = "u_0.csv") -> Path:
    config = {"uniformWind": True, "unprocessed_wind_files": "../../wind_simulations/u"}
    path = project(folder, {"windLooping": {"loop": True, "from": 1, "to": 3}}, config)
    (folder / "10x6_room/wind_simulations" / name).write_text(text)
    return path


@pytest.mark.usefixtures("taichi")
@pytest.mark.slow
@pytest.mark.parametrize("name", ["u_0.csv", "u", "u.csv"])
def test_a_uniform_wind_is_played_and_looped_from_a_later_time(tmp_path, name):
    """Five times of 0.1 to 0.5 m/s, 2 s apart: once, then the second to the fourth again and again."""
    path = uniform_project(tmp_path, "".join(f"{0.1 * n:g},0,0\n" for n in range(1, 6)), name)
    air, _, notes = loaded(path)
    assert (air.loop, air.loop_from, air.loop_to) == (True, 2.0, 6.0)
    assert "its wind is uniform" in notes
    assert "8 s from 0 s on, 2 s apart" in load(path).resources.facts["wind"].text
    wind: Any = assemble(load_scenario(path), tmp_path).wind
    upstream = []
    times = [0.0, 1.0, 3.0, 6.0, 7.0, 8.0, 11.0, 13.0, 14.0]
    for time in times:
        wind.film.show(time)
        u = wind.grid.read(wind.u[0])
        upstream.append(np.abs(u).max())
    expected = np.array([0.1, 0.15, 0.25, 0.4, 0.3, 0.2, 0.35, 0.3, 0.2])
    np.testing.assert_allclose(np.array(upstream) / upstream[0], expected / 0.1, rtol=1e-4)


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("0.1,0,0\n0.1,0\n", "line 2"),
        ("0.1,0,900\n", "no velocity below 340 m/s"),
        ("u,v,w\n0.1,0,0\n", "line 1"),
        ("", "is empty"),
    ],
)
def test_faults_of_a_uniform_wind_are_reported_in_a_line(tmp_path, text, fault):
    with pytest.raises(ScenarioError, match=fault) as caught:
        load(uniform_project(tmp_path, text))
    assert len(caught.value.faults) == 1


@pytest.mark.parametrize(
    ("keys", "fault"),
    [
        ("{loop_from: 2}", "wind.loop_from: repeats nothing without loop: true"),
        ("{loop: true, loop_to: 99}", "wind.loop_to: 99 s is outside of the files, 0 to 9 s"),
        ("{loop: true, loop_from: 4, loop_to: 5}", "wind.loop_from: no file is from 4 s to loop_to, 5 s"),
    ],
)
def test_faults_of_the_keys_of_a_loop(tmp_path, keys, fault):
    path = version_2(tmp_path, parameters={"allow_looping": False})
    path.write_text(f"{path.read_text()}wind: {keys}\n")
    with pytest.raises(ScenarioError, match=fault):
        load(path)
