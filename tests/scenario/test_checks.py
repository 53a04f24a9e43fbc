from types import SimpleNamespace

import numpy as np
import pytest
from test_meshes import box_triangles, write_stl

from taichi_plume.assembly.prepare import load_scenario
from taichi_plume.scenario import size as checks_size
from taichi_plume.scenario.loading import ScenarioError
from taichi_plume.scenario.size import estimate

ROOM = """\
duration: 10
warm_up: 5
domain: {size: [4, 3, 0.5], spacing: 0.05}
wind:
  kind: cfd
  openings:
    - {kind: fan, face: x-, center: [1.5, 0.25], diameter: 0.4, speed: 0.5}
    - {kind: outlet, face: x+}
obstacles:
  - {kind: box, center: [2, 1, 0.15], size: [0.4, 0.3, 0.3]}
  - {kind: sphere, center: [3, 2, 0.2], radius: 0.2}
gas: {kind: eulerian, sources: [{position: [1, 1.5, 0.1], rate: 1e-5}]}
robots:
  - {count: 2, start: {kind: positions, positions: [[1, 1], [1, 2]]}, algorithm: {kind: casting}}
maps: [{kind: time_series}]
"""
FLOOR = """\
duration: 10
domain: {size: [4, 3], spacing: 0.05, depth: 0.5}
wind:
  kind: cfd
  openings:
    - {kind: fan, face: x-, center: [1.5], diameter: 0.4, speed: 0.5}
    - {kind: outlet, face: x+}
obstacles: [{kind: box, center: [2, 1], size: [0.4, 0.3]}]
gas: {kind: eulerian, sources: [{position: [1, 1.5], rate: 1e-5}]}
robots: [{count: 2, start: {kind: positions, positions: [[1, 1], [1, 2]]}, algorithm: {kind: casting}}]
"""
FAN = "kind: fan, face: x+, center: [1.5, 0.25], diameter: 0.4"
WHOLE = "{kind: box, center: [3.9, 1.5, 0.25], size: [0.4, 3, 0.5]}"
ROBOTS = "algorithm: {kind: casting}"
NAMED = (
    "{{name: {}, count: 1, start: {{kind: positions, positions: [[1, {}]]}}, algorithm: {{kind: casting}}}}"
)


def screen(text):
    return f"wind.screens=[{{kind: honeycomb, {text}}}]"


def walk(path, radius=0.2):
    return f"obstacles.1={{kind: cylinder, center: [3, 2], radius: {radius}, motion: {{path: {path}}}}}"


CURVED = "kind: fan, face: x-, curve: {pressure: 25 Pa, flow: 120 m^3/h}"
WAKE = (
    "count: 1, wake: true, start: {kind: positions, positions: [[1, 1]]}, algorithm: {kind: casting}, "
    "sensors: {gas: {kind: ideal, height: 0.3}, wind: {kind: ideal, height: 0.3}}"
)
PRISM = "obstacles.1={{kind: prism, vertices: {}}}"


def scenario(tmp_path, text, *overrides):
    path = tmp_path / "s.yaml"
    path.write_text(text)
    return load_scenario(path, overrides)


def told(tmp_path, text, *overrides):
    """The faults without the file's name in front of each."""
    try:
        scenario(tmp_path, text, *overrides)
    except ScenarioError as error:
        return [line.removeprefix(f"{tmp_path / 's.yaml'}: ") for line in error.lines]
    return []


@pytest.mark.parametrize("text", [ROOM, FLOOR])
def test_good_scenarios_have_no_problems(tmp_path, text):
    assert told(tmp_path, text) == []


@pytest.mark.parametrize(
    "override",
    [
        "wind.openings.1={kind: honeycomb, face: x+}",
        f"wind.openings.1={{{FAN}, speed: -0.5}}",  # what one blows in the other draws out
        "wind.openings.0={kind: wall, face: x-, velocity: [0, 1, 0]}",
        "wind.openings=[{kind: periodic, axis: x}, {kind: slip, face: z+}]",
        "wind={kind: synthetic, shortest: 20 cm}",
        "wind.openings.1={kind: outlet, face: x-, center: [1.9, 0.25], size: [0.4, 0.4]}",  # they share a rim
        "wind.openings.1={kind: outlet, face: x-, center: [1.7, 0.44], size: [0.1, 0.1]}",  # beside the disc
        "domain.size=[4.02, 3, 0.5]",
        f"wind.openings.0={{{CURVED}}}",
        f"robots.0={{{WAKE}}}",
        screen("axis: z, at: 0.25, center: [2, 1.5], diameter: 1, cell: 8 mm"),
        walk("[[2, 3, 1], [4, 3, 2]], loop: true"),
        f"robots.0={{count: 1, start: {{kind: area, low: [1, 1], high: [1, 1]}}, {ROBOTS}}}",
        f"robots.0={{count: 25, start: {{kind: area, low: [0, 0], high: [1, 1]}}, {ROBOTS}}}",
        f"robots.0={{count: 6, trials: 1000, start: {{kind: line, begin: [3, 0.5], end: [3, 1.32]}}, {ROBOTS}}}",
        "robots.0.start.positions=[[1, 1], [1, 1.851]]",  # just out of reach of the source
        "robots.0.start={kind: area, low: [0.8, 1.3], high: [1.2, 1.7]}",  # around the source, but random
        "obstacles.1={kind: prism, vertices: [[3, 2], [3.2, 2], [3.2, 2.2], [3.4, 2.4], [3.2, 2.2], [3, 2.2], [3, 2]]}",
        f"robots=[{NAMED.format('a', 1)}, {NAMED.format('b', 2)}]",
        "robots.0.start.positions=[[0.083, 1], [1.703, 1]]",  # next to the wall and the box
        "obstacles.1={kind: cylinder, center: [1, 1], radius: 0.3, base: 0.15}",  # above the robots
        "gas.sources.0.position=[2, 1, 0.4]",  # above the box
        "wind={kind: frozen, after: 15, average: 15}",  # as long as there is
        "fields={rate: 10, start: -99}",  # one per tick, from the begin
    ],
)
def test_borderline_scenarios_have_no_problems(tmp_path, override):
    assert told(tmp_path, ROOM, override) == []


FAULTS = [
    # frozen wind, fields
    (
        "wind={kind: frozen, after: 15.1}",
        "wind.after: 15.1 s is longer than warm_up + duration = 15 s",
        "kind: cfd",
    ),
    (
        "wind={kind: frozen, after: 9, average: 10}",
        "wind.average: 10 s is longer than after: 9 s",
        "at most that",
    ),
    ("wind={kind: playback, file: no.zarr}", "wind.file: ", "no.zarr: does not exist"),
    (
        "fields.rate=11",
        "fields.rate: 11 frames per second are more than one per tick of 0.1 s",
        "use at most 10",
    ),
    ("fields.quantities=[temperature]", "fields.quantities: this run solves for no temperature", "heat"),
    ("fields.start=10.5", "fields.start: 10.5 s is after the end at 10 s", "start it earlier"),
    # sizes
    ("domain.spacing=1e-3", "domain.spacing: 6e+09 cells need 3,120 GB", "GB are free; a spacing of 0.0"),
    ("domain.spacing=1e-300", "domain.spacing: got 1e-300 m; at least 1e-06 m", ""),
    ("domain.spacing=0.4", "domain.size[2]: 0.5 m is fewer than two cells", "lower domain.spacing to 0.125"),
    ("domain.size=[4, 3, 0.07]", "domain.size[2]: 0.07 m is fewer than two cells", "make a 2-D run"),
    ("domain.size=[4, 3, 0.12]", "domain.size[2]: 0.12 m in cells of 0.05 m becomes 0.1 m", "such as 0.06 m"),
    ("maps.0.cell=1 mm", "maps[0].cell: 0.001 m makes more than", "use 0.0018 m or more"),
    ("maps=[{kind: gmrf, cell: 5 mm}]", "maps[0].cell: 0.005 m is too fine", "use 0.0075 m or more"),
    (
        "maps=[{kind: inverse_distance, window: 2e7}]",
        "maps[0]: needs 4.8 GB of memory for all trials, 3 GB are free",
        "lower the trials",
    ),
    ("robots.0.trials=1000000", "robots: 2000000 robots", "lower count or trials"),
    # obstacles and sources
    ("obstacles.0.center=[9, 1, 0.1]", "obstacles[0]: lies outside the domain: x 8.8 to 9.2 m", "x 0 to 4 m"),
    ("obstacles.0={kind: mesh, file: .}", "obstacles[0]: ", ": is a folder; give an STL, OBJ or PLY file"),
    ("obstacles.0={kind: mesh, file: no.stl}", "obstacles[0]: no.stl: no such file in ", ""),
    (
        "gas.sources.0.position=[2, 1, 0.1]",
        "gas.sources[0].position: (2, 1, 0.1) m is inside obstacles[0] (box)",
        "0.1 m",
    ),
    ("gas.sources.0.position=[1, 3.5, 0.1]", "gas.sources[0].position: y = 3.5 m is outside", "y 0 to 3 m"),
    ("wind={kind: uniform, velocity: [1, 0, 0]}", "wind.kind: a uniform wind blows through", "use kind: cfd"),
    (
        "wind={kind: synthetic, shortest: 6 cm}",
        "wind.shortest: 0.06 m is less than two cells",
        "0.2 m or more",
    ),
    ("wind={kind: synthetic, longest: 15 cm}", "wind.longest: 0.15 m is not above", "a wind.shortest below"),
    ("wind={kind: synthetic, shortest: 3 m}", "wind: shortest must be below longest", ""),
    # openings
    (
        "wind.openings.0.center=[2.9, 0.25]",
        "wind.openings[0]: reaches beyond its face x-: y 2.7 to 3.1 m",
        "y 0 to 3 m",
    ),
    (
        "wind.openings.0.diameter=0.6",
        "wind.openings[0]: reaches beyond its face x-: z -0.05 to 0.55 m",
        "z 0 to 0.5",
    ),
    (
        "wind.openings.1.face=x-",
        "wind.openings[1]: overlaps wind.openings[0] (fan) on face x-",
        "leave them apart",
    ),
    (
        "wind.openings.1={kind: slip, face: x-, center: [1.65, 0.4], size: [0.1, 0.1]}",
        "wind.openings[1]: overlaps",
        "",
    ),
    (
        "wind.openings.1={kind: fan, face: x-, center: [1.8, 0.25], diameter: 0.3, speed: 1}",
        "wind.openings[1]: overlaps",
        "",
    ),
    (
        "wind.openings.1={kind: outlet, face: x+, center: [1.5, 0.25], size: [0.01, 0.4]}",
        "wind.openings[1]: is smaller",
        "0.05",
    ),
    (
        "wind.openings.1={kind: periodic, axis: x}",
        "wind.openings[1]: axis x cannot be periodic while wind.openings[0] (fan)",
        "",
    ),
    (
        "wind.openings=[{kind: periodic, axis: x}, {kind: periodic, axis: x}]",
        "wind.openings[1]: axis x is periodic already",
        "",
    ),
    (
        "wind.openings.0={kind: wall, face: y+, velocity: [1, 2, 0]}",
        "wind.openings[0].velocity: the wall y+",
        "y component must be 0",
    ),
    (
        "wind.openings.0={kind: wall, face: y+, velocity: [1, 0, 0], schedule: [{at: 1, velocity: [0, 3, 0]}]}",
        "wind.openings[0].schedule[0].velocity: the wall y+",
        "must be 0, got 3 m/s",
    ),
    (
        "wind.openings.0={kind: wall, face: y+, velocity: [1, 0, 0], schedule: [{at: 2, velocity: [0, 0, 0]}, "
        "{at: 1, velocity: [1, 0, 0]}]}",
        "wind.openings[0]: schedule must be ordered by 'at'",
        "",
    ),
    (f"obstacles.0={WHOLE}", "wind.openings[1]: there is no air behind it", ""),
    # screens
    (screen("axis: x, at: 5"), "wind.screens[0].at: x = 5 m leaves less than a cell", "x 0.075 to 3.925 m"),
    (screen("axis: z, at: 0.45, thickness: 0.1"), "wind.screens[0].at: z = 0.45 m leaves", "z 0.1 to 0.4 m"),
    (
        screen("axis: z, at: 0.2, thickness: 0.45"),
        "wind.screens[0].thickness: 0.45 m does not fit",
        "thinner",
    ),
    (
        screen("axis: x, at: 2, center: [2.9, 0.2], diameter: 0.3"),
        "wind.screens[0]: reaches beyond the domain: y 2.75 to 3.05 m, the domain has y 0 to 3 m",
        "",
    ),
    (
        screen("axis: x, at: 2, center: [1, 0.2], size: [0.01, 0.2]"),
        "wind.screens[0]: is smaller than a cell of 0.05 m",
        "",
    ),
    (screen("axis: x, at: 2, center: [1], diameter: 0.5"), "wind.screens[0].center: has 1 number", ""),
    (
        screen("axis: x, at: 2, loss_coefficient: 1, cell: 8 mm"),
        "wind.screens[0]: takes loss_coefficient or cell, not both",
        "",
    ),
    # fans with a curve
    ("wind.openings.0={kind: fan, face: x-}", "wind.openings[0]: needs a speed or a curve", ""),
    (
        f"wind.openings.0={{{CURVED}, speed: 1, schedule: [{{at: 1, speed: 2}}]}}",
        "wind.openings[0]: takes a schedule or a curve, not both",
        "",
    ),
    (
        f"wind.openings.0={{{CURVED}, speed: -1}}",
        "wind.openings[0]: with a curve it blows into the domain",
        "",
    ),
    (
        f"wind.openings=[{{{CURVED}}}, {{kind: fan, face: x+, speed: -0.2}}]",
        "wind.openings[0].curve: needs an outlet",
        "add {kind: outlet",
    ),
    (
        "wind.openings.0={kind: fan, face: x-, curve: {pressure: 0, flow: 1}}",
        "wind.openings[0].curve.pressure: ",
        "greater than 0",
    ),
    # bodies that move
    (
        walk("[[2, 3, 1], [2, 3, 2]]"),
        "obstacles[1].motion: times must ascend from above 0",
        "path[1] has 2 s",
    ),
    (walk("[[0, 3, 1]]"), "obstacles[1].motion: times must ascend from above 0: path[0] has 0 s", ""),
    (
        walk("[[2, 3, 1], [4, 3, 3.5]]"),
        "obstacles[1].motion.path[1]: y = 3.5 m is outside the domain",
        "y 0 to 3 m",
    ),
    (
        walk("[[2, 3, 1]], loop: true"),
        "obstacles[1].motion.path[0]: a loop must end at the center (3, 2) m",
        "(3, 1)",
    ),
    (
        walk("[[0.01, 3, 1]]"),
        "obstacles[1].motion.path[0]: moves at 100 m/s from 0 to 0.01 s",
        "at most 20 m/s",
    ),
    (walk("[[2, 3, 1]]", radius=0.02), "obstacles[1]: is 0.04 m thin, less than a cell of 0.05 m", "larger"),
    (
        "obstacles.1={kind: prism, vertices: [[3, 2], [3.2, 2], [3, 2.2]], motion: {path: [[1, 1, 1]]}}",
        "obstacles[1]: unknown key 'motion'",
        "",
    ),
    (
        f"robots.0={{{WAKE}, trials: 3}}",
        "robots[0].wake: robots[0] has 3 trials in the same air",
        "trials: 1",
    ),
    (
        f"robots.0={{{WAKE}, body: {{radius: 0.02}}}}",
        "robots[0].wake: a body 0.04 m wide is smaller",
        "0.05 m",
    ),
    (
        f"robots.0={{{WAKE.replace('gas: {kind: ideal, height: 0.3}', 'gas: {kind: ideal}')}}}",
        "robots[0].sensors.gas.height: 0.1 m is inside the body",
        "above body.height = 0.15 m",
    ),
    # air that cannot get out
    (
        "wind.openings.1={kind: slip, face: x+}",
        "wind.openings: an outlet is missing: at t = -5 s a net 0.06283 m³/s",
        "outlet",
    ),
    (
        "wind.openings.1={kind: honeycomb, face: y+, speed: -1}",
        "wind.openings: an outlet is missing",
        "1.937 m³/s is drawn out",
    ),
    (
        f"wind.openings.1={{{FAN}, speed: -0.5, schedule: [{{at: 4, speed: -0.25}}], ramp: 2}}",
        "wind.openings: an outlet is missing: at t = 5 s a net 0.01571 m³/s is blown in",
        "",
    ),
    # robots
    (
        "robots.0.start.positions=[[1, 1], [1.1, 1]]",
        "robots[0].start: robot 0 and robot 1 are 0.1 m apart",
        "0.162 m",
    ),
    (
        "robots.0.start.positions=[[1, 1], [1, 1]]",
        "robots[0].start: robot 0 and robot 1 are 0 m apart",
        "0.162 m",
    ),
    (
        "robots.0.start.positions=[[1, 1]]",
        "robots[0].start.positions: 1 given for 2 robots",
        "one position per robot",
    ),
    (
        "robots.0.start.positions=[[1, 1], [3.95, 2]]",
        "robots[0].start: robot 1 at (3.95, 2) m is 0.05 m from the wall x+",
        "0.08",
    ),
    (
        "robots.0.start.positions=[[1, 1], [1, 7]]",
        "robots[0].start: robot 1 at (1, 7) m is behind the wall y+",
        "0.08",
    ),
    (
        "robots.0.start.positions=[[1, 1], [2, 1.2]]",
        "robots[0].start: robot 1 at (2, 1.2) m is 0.05 m from the surface of obstacles[0] (box)",
        "0.0961 m or more away",
    ),
    (
        "robots.0.start={kind: line, begin: [1, 1], end: [1, 1.1]}",
        "robots[0].start: robot 0 and robot 1",
        "0.1 m apart",
    ),
    (
        f"robots.0={{count: 60, start: {{kind: area, low: [0, 0], high: [1, 1]}}, {ROBOTS}}}",
        "robots[0].count: 60 robots",
        "31",
    ),
    (
        f"robots.0={{count: 2000, start: {{kind: line, begin: [1, 1], end: [1, 1]}}, {ROBOTS}}}",
        "robots[0].count: 2000",
        "596",
    ),
    (
        f"robots.0={{count: 1, start: {{kind: area, low: [1.9, 1], high: [2, 1]}}, {ROBOTS}}}",
        "robots[0].start: no robot fits",
        "",
    ),
    (
        f"robots.0={{count: 1, start: {{kind: area, low: [2, 1], high: [1, 2]}}, {ROBOTS}}}",
        "robots[0].start.high: must not",
        "",
    ),
    (
        "robots.0.body.radius=2",
        "robots[0].body.radius: a robot 4 m wide does not fit on a floor 3 m wide",
        "smaller",
    ),
    ("arena={low: [1, 1], high: [5, 2]}", "arena: along x", "got 1 and 5 m"),
    ("arena={low: [1, 2], high: [3, 1]}", "arena: along y", "got 2 and 1 m"),
    ("arena={low: [1.05, 0.5], high: [3, 2.5]}", "robots[0].start: robot 0", "the edge of the arena x-"),
    ("robots.0.body.height=0.6", "robots[0].body.height: 0.6 m is above the ceiling", "at most 0.5 m"),
    (
        "robots.0.sensors.gas={kind: ideal, height: 1}",
        "robots[0].sensors.gas.height: 1 m is above the ceiling",
        "0.5",
    ),
    ("robots.0.sensors.wind={kind: ideal, height: 1}", "robots[0].sensors.wind.height: 1 m is above", "0.5"),
    (
        f"robots=[{NAMED.format('a', 1)}, {NAMED.format('b', 2)}, {NAMED.format('a', 2.5)}]",
        "robots[2].name: 'a' is the name of robots[0] too",
        "give each group its own",
    ),
    (
        "robots.0.start.positions=[[1, 1], [1.15, 1.7]]",
        "robots[0].start: robot 1 at (1.15, 1.7) m is 0.25 m from gas.sources[0]",
        "0.35 m away",
    ),
    (
        "robots.0.start={kind: line, begin: [1, 1], end: [1, 1.2]}",
        "robots[0].start: robot 1 at (1, 1.2) m is 0.3 m from gas.sources[0]",
        "found at once",
    ),
    (
        "robots.0.start.positions=[[1, 1], [2, 1.1]]",
        "robots[0].start: robot 1 at (2, 1.1) m is inside obstacles[0] (box); its centre must be",
        "0.0961 m or more away",
    ),
    # polygons
    (
        PRISM.format("[[3, 2], [3.5, 2.5], [3.5, 2], [3, 2.5]]"),
        "obstacles[1].vertices: the edge after vertex 0 crosses the edge after vertex 2",
        "in the order",
    ),
    (
        PRISM.format("[[3, 2], [3.6, 2], [3.6, 2.4], [3.2, 1.8], [3, 2.4]]"),
        "obstacles[1].vertices: the edge after vertex 0 crosses the edge after vertex 2",
        "in the order",
    ),
    (
        PRISM.format("[[3.1, 2.1], [3.2, 2.4], [3.3, 2.7]]"),
        "obstacles[1].vertices: the polygon has no area",
        "on a line",
    ),
    # recording
    ("recording.slice_height=0.6", "recording.slice_height: 0.6 m is above the ceiling", "at most 0.5 m"),
    ("recording.range_ppm=[10, 1]", "recording.range_ppm: the first must be below the second", "10 and 1"),
]


@pytest.mark.parametrize(("override", "begins", "has"), FAULTS, ids=range(len(FAULTS)))
def test_each_fault_is_one_line_with_its_place_and_the_remedy(tmp_path, monkeypatch, override, begins, has):
    monkeypatch.setattr(checks_size.psutil, "virtual_memory", lambda: SimpleNamespace(available=3e9))
    lines = told(tmp_path, ROOM, override)
    assert len(lines) == 1, lines
    assert lines[0].startswith(begins)
    assert has in lines[0]


@pytest.mark.parametrize(
    ("override", "begins"),
    [
        ("gas.sources.0.position=[1, 1, 1]", "gas.sources[0].position: has 3 numbers, a 2-D run takes 2"),
        ("obstacles.0.center=[1, 1, 1]", "obstacles[0].center: has 3 numbers"),
        ("obstacles.0.size=[1, 1, 1]", "obstacles[0].size: has 3 numbers"),
        ("obstacles.0={kind: sphere, center: [1, 1, 1], radius: 0.1}", "obstacles[0].center: has 3 numbers"),
        ("wind.openings.0.center=[1, 1]", "wind.openings[0].center: has 2 numbers, a 2-D run takes 1"),
        ("wind.openings.0={kind: slip, face: x-, center: [1], size: [1, 1]}", "wind.openings[0].size: has 2"),
        ("wind.openings.0.swirl=0.1", "wind.openings[0].swirl: a 2-D run has no swirl"),
        ("wind.openings.0={kind: slip, face: z+}", "wind.openings[0].face: 'z+' does not exist in a 2-D run"),
        ("wind.openings.0={kind: periodic, axis: z}", "wind.openings[0].axis: 'z' does not exist"),
        ("wind.openings.0={kind: wall, face: y+, velocity: [1, 0, 0]}", "wind.openings[0].velocity: has 3"),
        ("wind={kind: uniform, velocity: [1, 0, 0]}", "wind.velocity: has 3 numbers"),
        ("wind.acceleration=[1, 0, 0]", "wind.acceleration: has 3 numbers, a 2-D run takes 2"),
        (
            "wind.openings.1={kind: slip, face: x+}",
            "wind.openings: an outlet is missing: at t = 0 s a net 0.1 m³/s",  # 0.5 m/s x 0.4 m x 0.5 m
        ),
    ],
)
def test_faults_of_2d_runs(tmp_path, override, begins):
    lines = told(tmp_path, FLOOR, override)
    assert len(lines) == 1
    assert lines[0].startswith(begins)


def test_3d_runs_want_three_numbers(tmp_path):
    lines = told(tmp_path, FLOOR, "domain.size=[4, 3, 0.5]")
    paths = ["obstacles[0].center", "obstacles[0].size", "gas.sources[0].position", "wind.openings[0].center"]
    assert [line.split(": ")[0] for line in lines] == paths


def test_an_open_mesh_is_told_with_a_place(tmp_path):
    open_box = box_triangles((1.8, 0.9, 0), (2.2, 1.1, 0.3))[:-1]
    file = write_stl(tmp_path / "open.stl", open_box)
    lines = told(tmp_path, ROOM, f"obstacles.0={{kind: mesh, file: {file}}}")
    assert len(lines) == 1
    assert lines[0].startswith("obstacles[0]: open.stl: body 0 is not watertight: 3 open")
    near = np.array(lines[0].split("near (")[1].split(")")[0].split(", "), float)
    edges = np.array([[2.0, 0.9, 0.3], [2.0, 1.1, 0.3], [1.8, 1.0, 0.3], [2.2, 1.0, 0.3], [2.0, 1.0, 0.3]])
    assert np.linalg.norm(edges - near, axis=1).min() < 1e-3  # the middle of an edge of the missing triangle


def test_overlapping_robots_of_two_groups_are_told(tmp_path):
    start = "start: {kind: positions, positions: [[1.25, 2]]}"
    second = f"{{name: big, count: 1, body: {{radius: 0.2}}, {start}, {ROBOTS}}}"
    first = f"{{count: 2, start: {{kind: positions, positions: [[1, 1], [1, 2]]}}, {ROBOTS}}}"
    assert told(tmp_path, ROOM, f"robots=[{first}, {second}]") == [
        "robots[0].start: robot 1 and robots[1] robot 0 are 0.25 m apart, too close; "
        "their centres must be 0.282 m apart or more"
    ]


def test_memory_is_checked_before_anything_is_allocated(tmp_path, monkeypatch):
    room = scenario(tmp_path, ROOM)
    monkeypatch.setattr(checks_size.psutil, "virtual_memory", lambda: SimpleNamespace(available=1e6))
    lines = told(tmp_path, ROOM)
    assert len(lines) == 1
    spacing = float(lines[0].split("a spacing of ")[1].split(" m")[0])
    assert 0.05 < spacing < 0.5
    domain = room.domain.model_copy(update={"spacing": spacing})
    coarse = room.model_copy(update={"domain": domain})
    assert estimate(coarse)["bytes"] < 1e6


def test_polygons_of_many_corners_are_checked(tmp_path):
    angle = np.linspace(0, 2 * np.pi, 300, endpoint=False)
    radius = 0.25 + 0.02 * np.cos(5 * angle)
    corners = np.stack([3 + radius * np.cos(angle), 2 + radius * np.sin(angle)], axis=1)
    assert told(tmp_path, ROOM, PRISM.format(corners.tolist())) == []
    corners[[100, 101]] = corners[[101, 100]]
    (line,) = told(tmp_path, ROOM, PRISM.format(corners.tolist()))
    assert line.startswith(
        "obstacles[1].vertices: the edge after vertex 99 crosses the edge after vertex 101"
    )


def test_only_flows_without_fast_transforms_need_memory_for_a_matrix(tmp_path):
    """In a small room a capacitance matrix, in a large one with much in it sparse factors; in 3-D multigrid."""

    def needed(text, *overrides):
        return estimate(scenario(tmp_path, text, "robots=[]", "gas.sources.0.position.0=0.2", *overrides))[
            "bytes"
        ]

    part = "wind.openings.1={kind: honeycomb, face: x+, center: [1], size: [1]}"
    uniform = "wind={kind: uniform, velocity: [1, 0]}"
    comb = [[x / 50, 2.5 if (x // 2) % 2 else 0.5] for x in range(20, 180)]
    crowded = f"obstacles=[{{kind: prism, vertices: {[*comb, [3.6, 2.8], [0.4, 2.8]]}}}]"
    empty = needed(FLOOR, "obstacles=[]")  # its fan is a wall to the pressure
    assert needed(FLOOR, "obstacles=[]", uniform) == empty
    matrix = checks_size.BYTES_OF_CHANGES * 80 * 60
    assert empty + matrix < needed(FLOOR) < empty + 1.5 * matrix
    assert empty + matrix < needed(FLOOR, "obstacles=[]", part) < empty + 1.5 * matrix
    assert needed(FLOOR, crowded) == empty + checks_size.BYTES_OF_FACTORS * 80 * 60
    bare = needed(ROOM, "obstacles=[]")
    assert needed(ROOM) > bare + 12 * 500**2  # cells beside its surfaces
    assert needed(ROOM, "obstacles=[{kind: sphere, center: [2, 1.5, 0.2], radius: 1.45}]") == bare


@pytest.mark.parametrize(
    ("algorithm", "begins"),
    [
        ("kind: infotaxis, cell: 1 mm", "robots[0].algorithm.cell: 0.001 m makes more than 250000 map cells"),
        (
            "kind: infotaxis, cell: 0.5, declare_spread: 0.2",
            "robots[0].algorithm.declare_spread: 0.2 m is never reached, as a single cell has a spread of 0.204 m",
        ),
        ("kind: infotaxis, cell: 20", "robots[0].algorithm.cell: 20 m is wider than the floor, 3 m"),
        ("kind: sweep, lane: 0.1 mm", "robots[0].algorithm.lane: 0.0001 m makes 30000 lanes"),
        (
            "kind: least_known, map: {kind: time_series, cell: 0.1 mm}",
            "robots[0].algorithm.map.cell: 0.0001 m makes",
        ),
        (
            "kind: least_known, map: {kind: time_series, cell: 9}",
            "robots[0].algorithm.map.cell: 9 m is wider than",
        ),
        (
            "kind: least_known, avoidance: 1e-6",
            "robots[0].algorithm.avoidance: radius and avoidance together",
        ),
        (
            "kind: spiral, acquisition: 1e5, sample_period: 0.1",
            "robots[0].algorithm: needs 4 GB of memory, 3 GB are free",
        ),
        (
            "kind: least_known, map: {kind: time_series, window: 2e7, beta: 1e6}",
            "robots[0].algorithm: needs 4.8 GB of memory",
        ),
    ],
)
def test_grids_and_lists_of_algorithms_have_to_fit(tmp_path, monkeypatch, algorithm, begins):
    monkeypatch.setattr(checks_size.psutil, "virtual_memory", lambda: SimpleNamespace(available=3e9))
    body = ", body: {radius: 1 mm}" if "avoidance" in algorithm else ""
    body += ", trials: 500" if "spiral" in algorithm else ""
    start = "start: {kind: positions, positions: [[1, 1], [1, 2]]}"
    lines = told(tmp_path, FLOOR, f"robots.0={{count: 2, {start}, algorithm: {{{algorithm}}}{body}}}")
    assert len(lines) == 1, lines
    assert lines[0].startswith(begins)


@pytest.mark.parametrize(
    ("override", "begins"),
    [
        ("maps=[{kind: inverse_distance, window: 1e9}]", "maps[0]: needs 240 GB of memory"),
        (
            "maps=[{kind: time_series, beta: 500}]",
            "maps[0].beta: 500 makes a neighbourhood of 1.1e+07 cells of past snaps, at most 1e+06 are looked at",
        ),
        (
            "maps=[{kind: time_series, time_scale: 1}]",
            "maps[0]: sees no past snap: (1 - alpha) time_scale window = 0.5",
        ),
        ("maps=[{kind: time_series, window: 1e-6}]", "maps[0].beta: 0.5 makes a neighbourhood of "),
        ("maps=[{kind: kernel_dmv, cell: 3.5}]", "maps[0].cell: 3.5 m is wider than the floor, 3 m"),
        (
            "gas={kind: puffs, sources: [{position: [1, 1.5], rate: 1e-5}], release_rate: 1e6, most: 1000}",
            "gas.release_rate: 1e+06 puffs per second are 1e+05 in a tick of 0.1 s",
        ),
        ("duration=1e9", "tick: 0.1 s makes 1e+10 ticks, at most 2e+09 are counted"),
    ],
)
def test_lists_of_maps_and_puffs_have_to_fit(tmp_path, override, begins):
    lines = told(tmp_path, FLOOR, override)
    assert len(lines) == 1, lines
    assert lines[0].startswith(begins)


def test_estimate(tmp_path):
    guess = estimate(scenario(tmp_path, ROOM))
    assert guess["cells"] == 80 * 60 * 10
    assert guess["bytes"] > guess["cells"] * 100
    assert guess["steps"] == 150 * 3  # 3.5 times 0.5 m/s needs three steps of 1.2 cells per tick of 0.1 s
    assert guess["wall_s"] > 0
    faster = estimate(scenario(tmp_path, ROOM, "wind.openings.0.schedule=[{at: 1, speed: -5}]"))
    assert faster["steps"] == 150 * 30
    calm = estimate(scenario(tmp_path, FLOOR, "wind={kind: uniform, velocity: [0, 0]}", "obstacles=[]"))
    assert calm["steps"] == 100


WALL = "face: z-, temperature: 300"
HEAT = "wind.buoyancy.heat"


@pytest.mark.parametrize(
    "override",
    [
        "wind.buoyancy={}",
        "wind.buoyancy={gravity: [0, 1, -9.8], heat: {reference: 21 degC}}",
        f"{HEAT}.walls=[{{{WALL}}}, {{face: x+, temperature: 25 °C, transfer: 2 W/(m^2 K)}}]",
        f"{HEAT}.walls=[{{{WALL}, center: [1, 1], size: [2, 2]}}, {{{WALL}, center: [3, 1], size: [2, 2]}}]",
        f"{HEAT}.obstacles=[{{number: 1, temperature: 60 degC}}]",
        f"{HEAT}.heaters=[{{position: [1, 1, 0.2], power: 50}}]",
    ],
)
def test_buoyant_scenarios_have_no_problems(tmp_path, override):
    assert told(tmp_path, ROOM, override) == []


@pytest.mark.parametrize(
    ("text", "override", "begins", "has"),
    [
        (FLOOR, "wind.buoyancy={}", "wind.buoyancy.gravity: ", "upright section"),
        (FLOOR, "wind.buoyancy.gravity=[0, 0, -9.81]", "wind.buoyancy.gravity: has 3 numbers", "2-D"),
        (ROOM, "wind.buoyancy.gravity=[0, -9.81]", "wind.buoyancy.gravity: has 2 numbers", "3-D"),
        (ROOM, "wind.buoyancy.gravity=[0, 0, 0]", "wind.buoyancy.gravity: is zero", "remove"),
        (ROOM, "wind.buoyancy.solutal=false", "wind.buoyancy: has no effect", ""),
        (ROOM, f"{HEAT}.reference=21", f"{HEAT}.reference: ", "'21 degC'"),
        (ROOM, f"{HEAT}.reference=700", f"{HEAT}.reference: ", "500"),
        (ROOM, f"{HEAT}.walls=[{{face: x-}}]", f"{HEAT}.walls[0]: missing key", "temperature"),
        (ROOM, f"{HEAT}.walls=[{{{WALL}, center: [1], size: [1, 1]}}]", f"{HEAT}.walls[0].center: has 1", "2"),
        (ROOM, f"{HEAT}.walls=[{{{WALL}, center: [4, 1], size: [2, 1]}}]", f"{HEAT}.walls[0]: reaches", "x 3 to 5 m"),
        (ROOM, f"{HEAT}.walls=[{{{WALL}}}, {{{WALL}}}]", f"{HEAT}.walls[1]: overlaps {HEAT}.walls[0]", "z-"),
        (
            FLOOR,
            f"wind.buoyancy={{gravity: [0, -9.81], heat: {{walls: [{{{WALL}}}]}}}}",
            f"{HEAT}.walls[0].face: 'z-' does not exist",
            "2-D",
        ),
        (ROOM, f"{HEAT}.heaters=[{{position: [1, 1], power: 1}}]", f"{HEAT}.heaters[0].position: has 2", "3"),
        (ROOM, f"{HEAT}.heaters=[{{position: [1, 1, 2], power: 1}}]", f"{HEAT}.heaters[0].position: z = 2 m", "in"),
        (
            ROOM,
            f"{HEAT}.heaters=[{{position: [2, 1, 0.15], power: 50 W}}]",
            f"{HEAT}.heaters[0].position: (2, 1, 0.15) m is inside obstacles[0]",
            "move the heater",
        ),
        (ROOM, f"{HEAT}.obstacles=[{{number: 2, temperature: 300}}]", f"{HEAT}.obstacles[0].number: ", "0 to 1"),
        (
            ROOM,
            f"{HEAT}.obstacles=[{{number: 1, temperature: 300}}, {{number: 1, temperature: 310}}]",
            f"{HEAT}.obstacles[1].number: ",
            "already",
        ),
        (ROOM, "wind.openings.1.temperature=300", "wind.openings[1].temperature: has no effect", "wind.buoyancy.heat"),
        (
            ROOM,
            f"wind={{kind: cfd, openings: [{{kind: periodic, axis: z}}], buoyancy: {{heat: {{walls: [{{{WALL}}}]}}}}}}",
            f"{HEAT}.walls[0].face: there is no wall z-",
            "periodic",
        ),
    ],
)  # fmt: skip
def test_faults_of_buoyancy(tmp_path, text, override, begins, has):
    lines = told(tmp_path, text, override)
    assert len(lines) == 1
    assert lines[0].startswith(begins)
    assert has in lines[0]
