"""What can be run but is probably not meant is told, in a line each, and kept in the result."""

import numpy as np
import pytest
from test_checks import FLOOR, ROOM, told
from test_meshes import box_triangles, write_stl

from taichi_plume.assembly.prepare import load
from taichi_plume.cli import run


def remarks(tmp_path, text, *overrides):
    path = tmp_path / "s.yaml"
    path.write_text(text)
    return load(path, overrides).resources.remarks


def of_obstacles(tmp_path, text, *overrides):
    """Remarks on obstacles; those on openings that obstacles cover are left out."""
    return [line for line in remarks(tmp_path, text, *overrides) if line.startswith("obstacles")]


def table(path, scale=1.0, slab=0.2):
    """A table of 1.6 x 0.8 m on legs of 8 cm, under a slab of that thickness [m]."""
    legs = [box_triangles((x, y, 0), (x + 0.08, y + 0.08, 0.7)) for x in (0, 1.52) for y in (0, 0.72)]
    slab = box_triangles((0, 0, 0.7), (1.6, 0.8, 0.7 + slab))
    return write_stl(path, scale * np.concatenate([slab, *legs]))


HALL = (
    "domain={size: [6, 4, 2], spacing: 0.2}",
    "obstacles=[{kind: mesh, file: table.stl, translate: [2.21, 1.61, 0]}]",
    "robots=[]",
    "gas.sources.0.position=[1, 1.5, 0.1]",
)


@pytest.mark.parametrize("text", [ROOM, FLOOR])
def test_of_sound_scenarios_nothing_is_remarked(tmp_path, text):
    assert remarks(tmp_path, text) == []


@pytest.mark.parametrize(
    ("override", "begins", "has"),
    [
        (
            "obstacles.0={kind: box, center: [2, 1.0125], size: [1, 0.01]}",
            "obstacles[0]: the air does not see it, about (",
            "a domain.spacing of 0.02 m or less",
        ),
        (
            "obstacles.0={kind: cylinder, center: [2.0125, 1.0125], radius: 0.01}",
            "obstacles[0]: the air does not see it",
            "0.04 m or less",
        ),
        (
            "obstacles.0={kind: prism, vertices: [[1.5, 2.305], [3, 2.305], [3, 2.32], [2, 2.322], [1.5, 2.32]]}",
            "obstacles[0]: the air does not see ",
            "lower domain.spacing",
        ),
        (
            "obstacles.0={kind: box, center: [4.5, 1], size: [2, 0.5]}",
            "obstacles[0]: only 25 % of it are in the domain",
            "x 3.5 to 5.5 m",
        ),
    ],
)
def test_bodies_that_the_grid_does_not_see_are_told(tmp_path, override, begins, has):
    (line,) = of_obstacles(tmp_path, FLOOR, override)
    assert line.startswith(begins)
    assert has in line


@pytest.mark.parametrize(
    "override",
    [
        "obstacles.0={kind: box, center: [2, 1], size: [1, 0.01]}",  # over nodes of the grid, which see it
        "obstacles.0={kind: box, center: [4, 1], size: [0.2, 0.5]}",  # astride of the wall
        "obstacles.0={kind: prism, vertices: [[1.5, 1.5], [3, 1.5], [2, 2.5]]}",
        "obstacles.0={kind: box, center: [2, 1], size: [0.3, 0.4], yaw_deg: 25}",
    ],
)
def test_bodies_that_the_grid_sees_are_not(tmp_path, override):
    assert of_obstacles(tmp_path, FLOOR, override) == []


def test_thin_legs_of_a_table_are_told_and_where(tmp_path):
    table(tmp_path / "table.stl")
    (line,) = of_obstacles(tmp_path, ROOM, *HALL)
    assert line.startswith("obstacles[0]: the air does not see ")
    assert " % of it, about (" in line
    place = np.array(line.split("about (")[1].split(")")[0].split(", "), float)
    assert 0 < place[2] < 0.7
    assert remarks(tmp_path, ROOM, *HALL, "domain.spacing=0.05") == []


def test_a_mesh_in_millimetres_is_told_with_the_scale(tmp_path):
    table(tmp_path / "table.stl", scale=1000.0)
    (line,) = told(tmp_path, ROOM, *HALL)
    assert line == (
        "obstacles[0]: reaches over x 2.21 to 1602 m, far more than the domain, x 0 to 6 m; if table.stl is in "
        "millimetres, give scale: 0.001; otherwise make it smaller"
    )
    assert not told(tmp_path, ROOM, *HALL, "domain.spacing=0.05", "obstacles.0.scale=0.001")


def test_a_mesh_that_became_too_small_is_told_with_the_scale(tmp_path):
    table(tmp_path / "table.stl")
    line, *_ = remarks(
        tmp_path, ROOM, *HALL, "obstacles.0.scale=0.001", "obstacles.0.translate=[2.22, 1.66, 0.01]"
    )
    assert "the air does not see it" in line
    assert "if table.stl is in metres, not millimetres, give scale: 1; otherwise lower domain.spacing" in line


def test_a_check_prints_remarks(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "s.yaml").write_text(FLOOR)
    assert run.main([str(tmp_path / "s.yaml"), "--set", "robots.0.reach=0", "--check"]) == 0
    line, *rest = capsys.readouterr().err.splitlines()
    assert line.startswith("note: robots[0].reach: 0 m")
    assert all(one.startswith("note: runs") for one in rest)  # of a picture that could not be drawn


@pytest.mark.parametrize(
    ("override", "begins"),
    [
        ("robots.0.reach=0", "robots[0].reach: 0 m: its robots do not search"),
        ("robots.0.algorithm.speed=1", "robots[0].algorithm.speed: 1 m/s is more than body.max_speed"),
        ("gas.sources.0.start=10", "gas.sources[0].start: 10 s is not before the end at 10 s"),
        ("gas.sources.0.stop=-1", "gas.sources[0].stop: -1 s is before the begin at 0 s"),
        ("gas.sources.0.rate=0", "gas.sources[0].rate: 0 kg/s: it emits nothing"),
        (
            "wind.openings.0.schedule=[{at: 12, speed: 1}]",
            "wind.openings[0].schedule[0].at: 12 s is not before",
        ),
        (
            "wind.openings.0={kind: inlet, face: x-, speed: -0.5}",
            "wind.openings[0].speed: -0.5 m/s draws air out",
        ),
        (
            "wind.openings.0={kind: inlet, face: x-, speed: 1, turbulence_intensity: 0.1, turbulence_length: 1 cm}",
            "wind.openings[0].turbulence_length: 0.01 m is too short for cells of",
        ),
        ("maps=[{kind: inverse_distance, window: 11}]", "maps[0].window: 11 s is longer than duration: 10 s"),
        (
            "robots.0.sensors={gas: {kind: mox, sensitivity: {aceton: 1}}}",
            "robots[0].sensors.gas.sensitivity: 'aceton' is not in the air",
        ),
    ],
)
def test_what_has_no_effect_is_told(tmp_path, override, begins):
    (line,) = remarks(tmp_path, FLOOR, override)
    assert line.startswith(begins)


@pytest.mark.parametrize(
    "override", ["robots.0.algorithm.speed=0", "maps=[{kind: inverse_distance, window: 1}]"]
)
def test_robots_that_measure_or_map_need_no_reach(tmp_path, override):
    assert remarks(tmp_path, FLOOR, "robots.0.reach=0", override) == []


def test_bodies_that_walk_in_a_wind_that_cannot_feel_them_are_told(tmp_path):
    walker = "obstacles.0={kind: cylinder, center: [2, 1], radius: 0.2, motion: {path: [[5, 3, 1]]}}"
    assert remarks(tmp_path, FLOOR, walker) == []
    (line,) = remarks(tmp_path, FLOOR, walker, "wind={kind: synthetic}")
    assert line == "obstacles[0].motion: robots meet it, but a wind of kind synthetic does not feel it"


ALONE = "count: 1, start: {kind: positions, positions: [[1, 1]]}, algorithm: {kind: casting}"


@pytest.mark.parametrize(
    ("overrides", "begins"),
    [
        (
            ["robots.0.sensors={gas: {kind: pid, calibrated_for: xenon}}"],
            "robots[0].sensors.gas.calibrated_for: there is no correction for 'xenon'; add one, or use isobutylene",
        ),
        (
            ["wind={kind: synthetic}", f"robots.0={{{ALONE}, wake: true}}"],
            "robots[0].wake: a wind of kind synthetic is not disturbed; use wind.kind: cfd",
        ),
        (
            ["wind={kind: uniform, velocity: [0.5, 0]}", "obstacles=[]", f"robots.0={{{ALONE}, wake: true}}"],
            "robots[0].wake: a wind of kind uniform is not disturbed; use wind.kind: cfd",
        ),
        (
            ["robots.0.start={kind: area, low: [3, 1], high: [4.2, 2]}"],
            "robots[0].start.high: x = 4.2 m is not on the floor of the robots, x 0 to 4 m; move it in",
        ),
        (
            ["wind.openings.0.turbulence_length=5"],
            "wind.openings[0].turbulence_length: 5 m is more than the room is long; use at most 4 m",
        ),
        (["gas.sources.0.radius=5"], "gas.sources[0].radius: 5 m is larger than the domain, 4 m"),
        (
            ["robots.0.sensors={gas: {kind: ideal, ahead: 5}}"],
            "robots[0].sensors.gas.ahead: 5 m is more than the room is long; use at most 4 m",
        ),
        (  # of a box that walks, robots feel the disc around it
            [
                "obstacles.0={kind: box, center: [2, 1], size: [1.6, 0.2], motion: {path: [[5, 3, 1]]}}",
                "robots.0.start.positions=[[1, 2.5], [2, 1.7]]",
            ],
            "robots[0].start: robot 1 at (2, 1.7) m is inside obstacles[0] (box); its centre must be 0.082 m",
        ),
    ],
)
def test_what_could_not_be_assembled_is_refused_before(tmp_path, overrides, begins):
    (line,) = told(tmp_path, FLOOR, *overrides)
    assert line.startswith(begins)


def test_robots_that_never_declare_find_nothing_by_declaring(tmp_path):
    found = "robots.0.found=declared"
    (line,) = remarks(tmp_path, FLOOR, found)
    assert line.startswith(
        "robots[0].found: declared, but casting never says where a source is: none will count"
    )
    (tmp_path / "own.py").write_text("class Own:\n    def act(self, robots):\n        pass\n")
    assert remarks(tmp_path, FLOOR, found, "robots.0.algorithm={kind: own, file: own.py}") == []
