"""Air flow from elsewhere: on our grid, free of divergence, around the obstacles, in time; what is refused."""

import json
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from rooms import blocks, divergence, through_faces

from taichi_plume.assembly.assemble import assemble
from taichi_plume.assembly.preparation import load_scenario
from taichi_plume.cli import run
from taichi_plume.files.wind_site import Site
from taichi_plume.grid.cut_cells import air_of
from taichi_plume.grid.fields import velocity_at
from taichi_plume.grid.grid import Grid
from taichi_plume.scenario.imported_wind import ImportedWind
from taichi_plume.scenario.loading import ScenarioError
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.solvers.imported_flow import ImportedFilm, ImportedFlow
from taichi_plume.time_loop import TimeLoop

pytestmark = [pytest.mark.usefixtures("taichi"), pytest.mark.slow]

SIZE = (1.6, 1.2, 0.4)
LOW = (-5.0, 2.0, 0.5)  # the room's corner in the files
ROOM = """
duration: 3
domain: {size: [1.6, 1.2, 0.4], spacing: 0.1}
wind: {kind: imported, files: wind_%d.csv}
gas: {kind: eulerian, sources: [{position: [0.3, 0.6, 0.2], rate: 10 mg/s}]}
"""
TABLE = """#env_min(m) -5 2 0.5
#env_max(m) -3.4 3.2 0.9
#num_cells 8 6 2
#cell_size(m) 0.2
"""
CLOSED = "wind.walls=[x-, x+, y-, y+, z-, z+]"
FLAT = ["domain.size=[1.2, 1.0]", "gas.sources.0.position=[0.3, 0.6]", "wind.origin=[-4.8, 2.1]"]
BLOCK = (slice(3, 5), slice(1, 4), slice(0, 1))  # cubes of the table's obstacle


def swirl(x: np.ndarray) -> np.ndarray:
    """A flow in the closed room without divergence, at points from its corner on [m]."""
    turned = np.pi * x / SIZE
    s, c = np.sin(turned), np.cos(turned)
    u = np.stack([0.4 * s[:, 0] * c[:, 1], -0.3 * c[:, 0] * s[:, 1], 0 * x[:, 0]], axis=1)
    return u * (1 + x[:, 2:])


def stream(x: np.ndarray) -> np.ndarray:
    """Faster in the middle, along x, and one third more comes out than in."""
    u = 0.3 * np.sin(np.pi * x[:, 1] / SIZE[1]) * (1 + x[:, 0] / SIZE[0] / 3)
    return np.stack([u, 0 * u, 0 * u], axis=1)


def write(path: Path, flow, cells=(16, 12, 4), extra=None, scale=1.0) -> None:
    """Points at the centres of a mesh that fills the room, in no order."""
    axes = [(np.arange(n) + 0.5) * size / n for n, size in zip(cells, SIZE, strict=True)]
    x = np.random.default_rng(5).permutation(np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 3))
    columns, header = [scale * flow(x), x + LOW], '"U:0","U:1","U:2","Points:0","Points:1","Points:2"'
    if extra is not None:
        columns.append(extra(x)[:, None])
        header += ',"nut"'
    np.savetxt(path, np.hstack(columns), fmt="%.7g", delimiter=",", header=header, comments="")


def write_cubes(path: Path, cubes: np.ndarray, header: str = TABLE) -> None:
    layers = ("\n".join(" ".join(map(str, row)) for row in cubes[:, :, z]) for z in range(cubes.shape[2]))
    path.write_text(header + "".join(f"{layer}\n;\n" for layer in layers))


def write_block(path: Path) -> None:
    write_cubes(path, 1 * blocks((8, 6, 2), BLOCK))


def scenario_in(folder: Path, *overrides: str) -> Scenario:
    (folder / "room.yaml").write_text(ROOM)
    return load_scenario(folder / "room.yaml", overrides)


def simulation(folder: Path, *overrides: str) -> TimeLoop:
    return assemble(scenario_in(folder, *overrides), folder)


def imported(folder: Path, *overrides: str) -> SimpleNamespace:
    """The air of such a simulation, without its gas."""
    scenario = scenario_in(folder, *overrides)
    assert isinstance(scenario.wind, ImportedWind)
    grid, site = Grid.of(scenario.domain), Site(scenario.wind, scenario.domain.extent, folder)
    air = air_of([], grid, left=site.cubes.shares(grid) if site.cubes else None)
    wind = ImportedFlow(scenario.wind, ImportedFilm(site, grid, air), grid)
    return SimpleNamespace(model=scenario.wind, grid=grid, air=air, wind=wind)


def test_well_mixed_gas_stays_well_mixed(tmp_path):
    write(tmp_path / "wind_0.csv", swirl)
    write(tmp_path / "wind_1.csv", swirl, scale=-0.5)
    sim = simulation(
        tmp_path,
        CLOSED,
        "gas.sources.0.rate=0",
        "obstacles=[{kind: sphere, center: [0.9, 0.5, 0.2], radius: 0.22}]",
    )
    gas = sim.gas.gases[0]
    gas.start_from(lambda x: np.ones(x.shape[:-1]))
    sim.run()
    assert divergence(sim.wind) < 1e-5
    c = sim.grid.read(gas.c)[~sim.air.solid]
    np.testing.assert_allclose(c, 1.0, rtol=1e-5)
    assert sim.wind.diagnostics()["max_speed"] > 0.2
    assert 0.01 < sim.wind.diagnostics()["correction"] < 0.5


def test_files_follow_one_another(tmp_path):
    for n, scale in enumerate([1.0, 2.0, 0.5]):
        write(tmp_path / f"wind_{n + 4}.csv", swirl, scale=scale)
    sim = imported(tmp_path, "wind.interval=0.5", CLOSED)
    x = np.array([[0.45, 0.33, 0.2], [0.7, 0.9, 0.1]])
    once = velocity_at(sim.wind, x, 0.0)
    np.testing.assert_allclose(once, swirl(x), atol=0.02)
    for t, scale in ((0.25, 1.5), (0.5, 2.0), (0.9, 0.8), (2.0, 0.5)):
        sim.wind.advance(t - 0.05, 0.05)
        np.testing.assert_allclose(velocity_at(sim.wind, x, t), scale * once, atol=2e-6)


def test_the_largest_speed_is_of_all_frames(tmp_path):
    """Of five, of which the second, which is neither first nor last nor in the middle, is four times as fast."""
    for n, scale in enumerate((1.0, 4.0, 1.0, 1.0, 1.0)):
        write(tmp_path / f"wind_{n}.csv", swirl, scale=scale)
    fast = imported(tmp_path, CLOSED).wind.diagnostics()["max_speed"]
    write(tmp_path / "wind_1.csv", swirl)
    assert fast == pytest.approx(4 * imported(tmp_path, CLOSED).wind.diagnostics()["max_speed"], rel=1e-4)


def test_occupied_cubes_are_in_the_way(tmp_path):
    write(tmp_path / "wind_0.csv", stream, (23, 17, 5))
    write_block(tmp_path / "o.csv")
    sim = imported(tmp_path, "wind.occupancy=o.csv", "wind.walls=[z-, z+]")
    cells = tuple(slice(2 * s.start, 2 * s.stop) for s in BLOCK)
    assert sim.air.solid[cells].all()
    assert sim.air.solid.sum() == 8 * np.prod([s.stop - s.start for s in BLOCK])
    u = through_faces(sim.wind)
    for d, v in enumerate(u):
        around = tuple(slice(s.start, s.stop + (a == d)) for a, s in enumerate(cells))
        assert np.abs(v[around]).max() == 0.0
    through = u[0].sum(axis=(1, 2))
    np.testing.assert_allclose(through, through[0], rtol=1e-6)
    # the mean of what came in and what went out
    y = (np.arange(12) + 0.5) / 12
    assert through[0] == pytest.approx(0.3 * 7 / 6 * 4 * np.sin(np.pi * y).sum(), rel=0.01)
    assert divergence(sim.wind) < 1e-5
    assert np.abs(u[1]).max() > 0.02, "around the block"
    assert np.abs(u[2][:, :, [0, -1]]).max() == 0.0


def test_a_section_of_three_dimensions(tmp_path):
    write(tmp_path / "wind_0.csv", swirl, (32, 24, 4))
    x = np.random.default_rng(6).uniform(0.0, 1.0, (50, 2))
    for height, z in ((0.75, 0.25), (0.88, 0.38), ("null", 0.2)):  # unless a height is given, the middle
        sim = imported(tmp_path, *FLAT, f"wind.height={height}")
        wanted = swirl(np.column_stack([x + np.array([0.2, 0.1]), np.full(50, z)]))
        np.testing.assert_allclose(velocity_at(sim.wind, x, 0.0), wanted[:, :2], atol=0.01)  # dx²/8 |u''|
        assert divergence(sim.wind) < 1e-5


def test_a_section_meets_the_cubes_at_its_height(tmp_path):
    write(tmp_path / "wind_0.csv", stream)
    write_block(tmp_path / "o.csv")
    for height, met in ((0.6, True), (0.8, False)):
        sim = imported(tmp_path, *FLAT, "wind.occupancy=o.csv", f"wind.height={height}")
        x = sim.grid.centers() + np.array([0.2, 0.1])
        block = (np.abs(x - [0.8, 0.5]) < [0.2, 0.3]).all(axis=-1)
        np.testing.assert_array_equal(sim.air.solid, block & met)


def test_eddies_spread_the_gas(tmp_path):
    write(tmp_path / "wind_0.csv", swirl, extra=lambda x: 1e-3 * (1 + x[:, 0]))
    sim = imported(tmp_path)
    nu = sim.grid.read(sim.wind.nu)
    np.testing.assert_allclose(nu, 1.56e-5 + 1e-3 * (1 + sim.grid.centers()[..., 0]), rtol=1e-5)
    sim = imported(tmp_path, "wind.eddy_viscosity=5e-4")
    np.testing.assert_allclose(sim.grid.read(sim.wind.nu), 5.156e-4, rtol=1e-6)
    assert sim.wind.max_viscosity == pytest.approx(5.156e-4)


def test_air_goes_on_through_outlets_in_the_walls(tmp_path):
    """Walls one cube thick around the points, with an opening at either end."""
    write(tmp_path / "wind_0.csv", lambda x: np.tile([0.3, 0.0, 0.0], (len(x), 1)))
    cubes = np.ones((10, 8, 2), int)
    cubes[1:-1, 1:-1] = 0
    cubes[[0, -1], 2:4] = 2
    header = "#env_min(m) -5.2 1.8 0.5\n#env_max(m) -3.2 3.4 0.9\n#num_cells 10 8 2\n#cell_size(m) 0.2\n"
    write_cubes(tmp_path / "o.csv", cubes, header)
    sim = imported(tmp_path, "wind.occupancy=o.csv", "domain.size=[2.0, 1.6, 0.4]", "wind.walls=[z-, z+]")
    u = through_faces(sim.wind)
    np.testing.assert_allclose(u[0].sum(axis=(1, 2)), 0.3 * 4 * 4, rtol=1e-6)
    for end in (0, -1):
        np.testing.assert_allclose(u[0][end, 4:8], 0.3, rtol=1e-6)


@pytest.fixture
def case(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    for n in range(3):
        write(tmp_path / f"wind_{n}.csv", stream)
    write_block(tmp_path / "o.csv")
    (tmp_path / "room.yaml").write_text(ROOM)
    return tmp_path


BLOCKED = "wind.occupancy=o.csv"
ROBOT = "robots=[{{count: 1, start: {{kind: positions, positions: [{}]}}, algorithm: {{kind: casting}}}}]"


@pytest.mark.parametrize(
    ("overrides", "fault"),
    [
        (["wind.files=no_%d.csv"], r"wind\.files: .*no_%d\.csv: there is no such file"),
        (["domain.size=[1.7, 1.2, 0.4]"], r"domain\.size\[0\]: .*-5 to -3\.3 m.*wind_0\.csv.*-5 to -3\.4 m.* 1\.6 m"),
        (["wind.origin=[-5, 2.1, 0.5]"], r"domain\.size\[1\]: .*2\.1 to 3\.3 m.* 2 to 3\.2 m"),
        (["wind.origin=[-5, 2]"], r"wind\.origin: .*2 numbers.* 3 "),
        (["wind.height=0.6"], r"wind\.height: .*2-D"),
        (["wind.start=3"], r"wind\.start: 3 s .*wind_2\.csv.* 2 s"),
        (["wind.walls=[z-]", *FLAT[:2]], r"wind\.walls\[0\]: 'z-' .*2-D"),
        (["wind.walls=[up]"], r"wind\.walls\[0\]: got 'up'"),
        (["wind.occupancy=none.csv"], r"wind\.files: .*none\.csv: cannot be read: No such file"),
        (["wind.occupancy=small.csv"], r"domain\.size\[0\]: .*small\.csv.* -5 to -4\.6 m"),
        ([BLOCKED, "gas.sources.0.position=[0.7, 0.5, 0.1]"], r"gas\.sources\[0\]\.position: .*o\.csv"),
        ([BLOCKED, ROBOT.format([0.55, 0.5])], r"robots\[0\]\.start\.positions\[0\]: .*o\.csv"),
        ([BLOCKED, ROBOT.format([0.55, 0.5]).replace("count: 1", "count: 2").replace(
            "kind: positions, positions: [[0.55, 0.5]]", "kind: line, begin: [0.2, 0.5], end: [0.55, 0.5]")],
         r"robots\[0\]\.start: robot 1 .*o\.csv"),
        (["wind.occupancy=floor.csv", ROBOT.format([0.2, 0.2])], r"wind\.origin: .*floor\.csv.* 0\.2 m.* 0\.7 "),
        (["wind.files=flat.csv"], r"flat\.csv: .* z and w"),
        (["wind.files=level.csv"], r"level\.csv: .*z = 0\.5 m"),
        (["wind.files=mixed_%d.csv"], r"mixed_1\.csv: .*columns.*mixed_0\.csv"),
        ([*FLAT, "wind.height=3"], r"wind\.height: 3 m .*wind_0\.csv.* 0\.5 to 0\.9 m"),
        ([*FLAT, "wind.occupancy=low.csv"], r"low\.csv: .*z = 0\.7 m.* 0\.1 to 0\.5 m"),
        (["wind.file=wind_0.csv"], r"'file'.* 'files'"),
    ],
)  # fmt: skip
def test_faults_name_the_key_the_value_and_the_limit(case, overrides, fault):
    (case / "flat.csv").write_text("x,y,u,v\n" + "".join(f"{n % 3},{n // 3},0,0\n" for n in range(9)))
    (case / "level.csv").write_text(
        "x,y,z,u,v,w\n" + "".join(f"{n % 3},{n // 3},0.5,0,0,0\n" for n in range(9))
    )
    write(case / "mixed_0.csv", stream)
    write(case / "mixed_1.csv", stream, extra=lambda x: x[:, 0])
    (case / "low.csv").write_text((case / "o.csv").read_text().replace("0.5", "0.1").replace("0.9", "0.5"))
    write_cubes(case / "floor.csv", 1 * blocks((8, 6, 2), np.s_[:, :, 0]))
    (case / "small.csv").write_text("#env_min(m) -5 2 0.5\n#env_max(m) -4.6 2.2 0.7\n#num_cells 2 1 1\n"
                                    "#cell_size(m) 0.2\n0\n0\n;\n")  # fmt: skip
    with pytest.raises(ScenarioError, match=fault) as raised:
        load_scenario(case / "room.yaml", overrides)
    assert not any("\n" in line for line in raised.value.lines)


def test_a_broken_file_in_the_middle_ends_the_run_before_it_begins(case, capsys):
    lines = (case / "wind_1.csv").read_text().splitlines()
    for text, fault in (
        (lines[:-5], r"has 763 points.* 768"),
        ([*lines[:7], lines[7].rsplit(",", 4)[0], *lines[8:]], r"line 8: .*2 columns.* 6"),
    ):
        (case / "wind_1.csv").write_text("\n".join(text))
        assert run.main(["room.yaml", "--no-recording", "--quiet"]) == 2
        reported = capsys.readouterr().err
        assert re.match(r"wind\.files: .*wind_1\.csv: " + fault, reported)
        assert reported.count("\n") == 1
        assert not any(Path("runs").glob("*/result.json"))


def test_a_run_from_the_command_line(case):
    robots = ROBOT.format("[1.3, 0.3]")
    sets = [BLOCKED, "wind.loop=true", robots, "duration=2"]
    options = [word for override in sets for word in ("--set", override)]
    assert run.main(["room.yaml", "--quiet", "--out", "out/first", *options]) == 0
    result = json.loads(Path("out/first/result.json").read_text())
    assert result["status"] == "completed"
    assert result["flow"]["max_divergence"] < 1e-5
    assert 0.0 < result["flow"]["correction"] < 0.5
    assert abs(result["gas"]["relative_error"]) < 1e-5
    assert (Path("out/first") / "recording.rrd").exists()
    assert run.main(["out/first/scenario.yaml", "--check", "--allow-outside"]) == 0


def test_films_of_imported_air_can_be_played(case):
    first = ["room.yaml", "--quiet", "--no-recording", "--out", "first", "--set", "fields={rate: 10}"]
    assert run.main([*first, "--set", "duration=0.5"]) == 0
    wind = "wind={kind: playback, file: first/fields.zarr}"
    scenario = load_scenario("room.yaml", [wind])
    sim = assemble(scenario, case)
    assert divergence(sim.wind) < 1e-5
    site = Site(ImportedWind(kind="imported", files="wind_0.csv"), sim.grid.extent, case)
    film = ImportedFilm(site, sim.grid, sim.air)
    np.testing.assert_array_equal(sim.grid.read(sim.wind.u[0], 1)[1:], film.frame(0, ["u_face"])["u_face"])
