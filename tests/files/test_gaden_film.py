"""Results and binary winds of GADEN, written here field by field as its versions do, and those that we export."""

import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_gaden_results import film, written

from taichi_plume.assembly.assemble import assemble
from taichi_plume.assembly.preparation import load, load_scenario
from taichi_plume.files import gaden, gaden_film, gaden_winds
from taichi_plume.files.film import FilmError
from taichi_plume.files.gaden_film import GadenFilm
from taichi_plume.files.wind_points import WindFileError
from taichi_plume.scenario.domain import Domain
from taichi_plume.scenario.loading import ScenarioError
from taichi_plume.scenario.playback import GadenGas

LOW, EDGE, SHAPE = np.array([-1.0, 2.0, 0.0]), 0.25, (8, 6, 4)
HIGH = LOW + EDGE * np.array(SHAPE)
SOURCE = (-0.3, 2.7, 0.5)
MOLES, AIR = 3e-6, 4.1e-5
FILAMENTS = np.array([[-0.2, 2.6, 0.4, 12.0], [0.3, 3.1, 0.7, 20.0]])
VERSIONS: list[tuple[int, ...]] = [(1,), (2, 0), (2, 6), (3, 0), (3, 1)]


def text(value: bytes) -> bytes:
    return struct.pack("<Q", len(value)) + value


def result(
    version: tuple[int, ...], filaments: np.ndarray = FILAMENTS, gas: int = 6, kind: bytes = b"point"
) -> bytes:
    """An unpacked file with filaments, in the form of a version."""
    old = version < (2, 6)
    real = "d" if old else "f"
    if version == (1,):
        body = struct.pack("<i6d3i3d3d", 1, *LOW, *HIGH, *SHAPE, *[EDGE] * 3, *SOURCE)
    else:
        body = struct.pack("<2i3i7f", *version, *SHAPE, *LOW, *HIGH, EDGE)
        if version[0] == 3:
            body += text(kind) + bytes({b"box": 12, b"line": 12, b"sphere": 4}.get(kind, 0))
        body += struct.pack("<3f", *SOURCE)
    body += struct.pack(f"<i2{real}i", gas, MOLES, AIR, 0)
    if version == (3, 1):
        body += text(b"filaments") + struct.pack("<Q", len(filaments))
        return body + b"".join(struct.pack("<4f?3x", *one, True) for one in filaments)
    return body + b"".join(struct.pack(f"<i4{real}", n, *one) for n, one in enumerate(filaments))


def put(path: Path, body: bytes, marked: bool = False) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    head = b"GADEN_RESULT\0" + struct.pack("<Q", len(body)) if marked else b""
    path.write_bytes(head + zlib.compress(body))


def opened(folder: Path, dim: int = 3, **keys: Any) -> GadenFilm:
    size = (HIGH - LOW)[:dim].tolist()
    model = GadenGas.model_validate({"kind": "gaden", "files": "result/iteration_%d", **keys})
    return GadenFilm(folder, model, Domain(size=size, spacing=EDGE))


def centres() -> np.ndarray:
    axes = [low + EDGE * (np.arange(n) + 0.5) for low, n in zip(LOW, SHAPE, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)


def gaussians(filaments: np.ndarray = FILAMENTS) -> np.ndarray:
    """Closed form: ppm of 3-D Gaussians with MOLES each in air with AIR mol/cm³, cut at 3 sigma."""
    total = np.zeros(SHAPE)
    for x, y, z, sigma in filaments:
        distance = 100.0 * np.linalg.norm(centres() - [x, y, z], axis=-1)
        density = MOLES * np.exp(-0.5 * (distance / sigma) ** 2) / ((2 * np.pi) ** 1.5 * sigma**3)
        total += np.where(distance < 3 * sigma, 1e6 * density / AIR, 0.0)
    return total


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("marked", [False, True])
def test_filaments_of_all_versions_are_their_gaussians(tmp_path, version, marked):
    put(tmp_path / "result/iteration_0", result(version), marked)
    put(tmp_path / "result/iteration_1", result(version, FILAMENTS[:1]), marked)
    found = opened(tmp_path, interval=2.0)
    assert (found.gas, found.times.tolist()) == ("acetone", [0.0, 2.0])
    np.testing.assert_allclose(found.source, np.array(SOURCE) - LOW, atol=1e-6)
    for n, filaments in enumerate((FILAMENTS, FILAMENTS[:1])):
        values = found.frame(n, ["concentration"])["concentration"]
        np.testing.assert_allclose(values, gaussians(filaments), rtol=2e-5, atol=1e-3)
    assert "pass" in found.facts().remarks[0]


@pytest.mark.parametrize("kind", [b"point", b"box", b"line", b"sphere"])
def test_sources_of_all_types(tmp_path, kind):
    put(tmp_path / "iteration_7", result((3, 0), kind=kind))
    found = gaden_film.read(tmp_path / "iteration_7")
    np.testing.assert_allclose(found.source, SOURCE, rtol=1e-6)
    assert len(found.filaments) == 2


def test_a_wall_stops_the_gas_of_filaments(tmp_path):
    """A wall between x = 0 and x = 0.25 m, whose right side sees only the second filament."""
    put(tmp_path / "result/iteration_0", result((3, 1)))
    solid = np.zeros(SHAPE, int)
    solid[4] = 1
    layers = (
        "".join(" ".join(map(str, row)) + "\n" for row in solid[:, :, z]) + ";\n" for z in range(SHAPE[2])
    )
    head = f"#env_min(m) {LOW[0]} {LOW[1]} {LOW[2]}\n#env_max(m) {HIGH[0]} {HIGH[1]} {HIGH[2]}\n"
    (tmp_path / "grid.csv").write_text(f"{head}#num_cells 8 6 4\n#cell_size(m) {EDGE}\n{''.join(layers)}")
    found = opened(tmp_path, occupancy="grid.csv", interval=1.0)
    values = found.frame(0, ["c"])["c"]
    assert (values[4] == 0.0).all()
    np.testing.assert_allclose(values[:4], gaussians(FILAMENTS[:1])[:4], rtol=2e-5)
    np.testing.assert_allclose(values[5:], gaussians(FILAMENTS[1:])[5:], rtol=2e-5)
    assert gaussians(FILAMENTS[1:])[:4].max() > 0.05
    assert not found.facts().remarks


def test_a_section_and_coarser_cells(tmp_path):
    put(tmp_path / "result/iteration_0", result((3, 0)))
    flat = opened(tmp_path, dim=2, height=0.3)
    np.testing.assert_allclose(flat.frame(0, ["c"])["c"], gaussians()[:, :, 1], rtol=2e-5, atol=1e-3)
    model = GadenGas.model_validate({"kind": "gaden", "files": "result", "origin": [-1.0, 2.5, 0.0]})
    coarse = GadenFilm(tmp_path, model, Domain(size=(2.0, 1.0, 1.0), spacing=0.5))
    means = gaussians()[:, 2:].reshape(4, 2, 2, 2, 2, 2).mean(axis=(1, 3, 5))
    np.testing.assert_allclose(coarse.frame(0, ["c"])["c"], means, rtol=2e-5, atol=1e-3)
    with pytest.raises(FilmError, match="height 3 m is outside of z 0 to 1 m"):
        opened(tmp_path, dim=2, height=3.0)


def test_the_time_between_files(tmp_path):
    for n in range(3):
        put(tmp_path / f"sims/result/iteration_{n}", result((3, 0)))
    assert "interval" in opened(tmp_path, files="sims/result").facts().remarks[0]
    (tmp_path / "sims/sim.yaml").write_text("saveDeltaTime: 0.8\n")
    found = opened(tmp_path, files="sims/result")
    np.testing.assert_allclose(found.times, [0.0, 0.8, 1.6])
    assert "1.6 s from 0 s on, 0.8 s apart" in found.facts().text
    np.testing.assert_allclose(opened(tmp_path, files="sims/result", interval=2.0).times, [0.0, 2.0, 4.0])


ROOM = """
duration: 1
domain: {{size: {size}, spacing: 0.25}}
wind: {{kind: imported, files: run/wind/wind_iteration_%d, occupancy: run/OccupancyGrid3D.csv, interval: 0.5}}
gas: {{kind: gaden, files: run/simulations/ethanol/result}}
"""


@pytest.mark.usefixtures("taichi")
@pytest.mark.slow
@pytest.mark.parametrize("shape", [(8, 6, 4), (8, 6)])
def test_our_export_read_back_has_the_same_place_time_and_value(tmp_path, shape):
    data = film(shape, seed=4)
    (tmp_path / "run").mkdir()
    written(tmp_path / "run", data)
    size = [0.25 * n for n in shape]
    (tmp_path / "room.yaml").write_text(ROOM.format(size=size))
    scenario, resources = load(tmp_path / "room.yaml")
    source = np.array([0.3, 0.4, 0.1])[: len(shape)]
    np.testing.assert_allclose(scenario.gases[0][1].sources[0].position, source, atol=1e-6)
    assert "0.5 s from 0 s on, 0.5 s apart" in resources.facts["gas"].text
    read_back = resources.gaden_films["gas"]
    for n in (0, 1):
        values = read_back.frame(n, ["c"])["c"]
        np.testing.assert_allclose(values, data["ethanol_ppm"].values[n].T, rtol=1e-6)
    if len(shape) == 3:
        points = resources.site.read(tmp_path / "run/wind/wind_iteration_1")
        for d, name in enumerate("uvw"):
            np.testing.assert_array_equal(points.velocity[:, d], data[name].values[1].ravel())
        np.testing.assert_allclose(
            points.place[:, 0], np.tile(data.sizes["x"] and 0.25 * (np.arange(8) + 0.5), 24)
        )
    sim = assemble(load_scenario(tmp_path / "room.yaml"), tmp_path)
    gas: Any = sim.gas.gases[0]
    ppm = sim.grid.read(gas.c) * gas.species.ppm_per_density
    np.testing.assert_allclose(ppm, data["ethanol_ppm"].values[0].T, rtol=1e-5)


def test_the_gas_of_the_results_and_of_the_scenario(tmp_path):
    put(tmp_path / "result/iteration_0", result((2, 6), gas=13))
    wind = "duration: 1\ndomain: {size: [2, 1.5, 1], spacing: 0.25}\nwind: {kind: uniform, velocity: [0.1, 0, 0]}\n"
    (tmp_path / "a.yaml").write_text(wind + "gas: {kind: gaden, files: result, interval: 1}\n")
    scenario, resources = load(tmp_path / "a.yaml")
    assert scenario.gases[0][1].vapour.name == "smoke"
    assert any("smoke has no molar mass" in remark for remark in resources.warnings)
    (tmp_path / "b.yaml").write_text(
        wind + "gas: {kind: gaden, files: result, interval: 1, species: methane}\n"
    )
    scenario, resources = load(tmp_path / "b.yaml")
    assert scenario.gases[0][1].vapour.name == "methane"
    assert any("is of smoke" in remark for remark in resources.warnings)
    (tmp_path / "c.yaml").write_text(wind + "gas: {kind: gaden, files: result, origin: [9, 0, 0]}\n")
    with pytest.raises(ScenarioError, match=r"gas: no cell of .* give an origin"):
        load(tmp_path / "c.yaml")


@pytest.mark.parametrize(
    ("body", "fault"),
    [
        (b"", "cut or damaged"),
        (struct.pack("<2i", 9, 0), "no result of GADEN 1, 2 or 3"),
        (result((3, 0))[:75], "cut or damaged"),
        (result((3, 0))[:-3], "cut or damaged"),
        (result((3, 1))[:-20], "filaments are missing"),
        (result((3, 0), kind=b"disk"), "its source is none of point"),
        (result((2, 6), gas=40), "its gas has the number 40"),
        (result((2, 6), np.array([[0.0, 2.5, 0.5, 0.0]])), "is damaged"),
        (result((2, 6), np.array([[np.nan, 2.5, 0.5, 9.0]])), "is damaged"),
        (result((2, 6)).replace(struct.pack("<3i", *SHAPE), struct.pack("<3i", 8, 6, 2**30)), "is damaged"),
        (
            result((2, 6)).replace(struct.pack("<3i", *SHAPE), struct.pack("<3i", 8, 6, 9)),
            "do not fill its box",
        ),
    ],
    ids=range(11),
)
def test_faults_of_results_are_reported_in_a_line(tmp_path, body, fault):
    put(tmp_path / "result/iteration_0", body)
    with pytest.raises(FilmError, match=fault) as caught:
        opened(tmp_path)
    assert "\n" not in str(caught.value)


def test_filaments_without_bounds_take_little_time(tmp_path):
    put(tmp_path / "result/iteration_0", result((3, 0), np.tile([1e30, 2.6, 0.4, 1e12], (50, 1))))
    assert (opened(tmp_path).frame(0, ["c"])["c"] < 1e-12).all()
    many = np.tile([0.0, 2.6, 0.4, 1e4], (12_000_000, 1)).astype("<f4")
    found = gaden_film.Result(tmp_path, LOW, EDGE, SHAPE, np.zeros(3), 0, None, many, 1.0)
    with pytest.raises(FilmError, match="too many or too wide"):
        opened(tmp_path)._sum(found)


def test_damaged_results_are_reported_or_read(tmp_path):
    rng = np.random.default_rng(6)
    bodies = [result(version) for version in VERSIONS]
    reported = 0
    for n in range(300):
        damaged = bytearray(bodies[n % len(bodies)])
        for _ in range(3):
            damaged[rng.integers(len(damaged))] = rng.integers(256)
        put(tmp_path / "result/iteration_0", bytes(damaged[: rng.integers(1, len(damaged) + 1)]), n % 2 == 0)
        try:
            assert np.isfinite(opened(tmp_path).frame(0, ["c"])["c"]).all()
        except FilmError as error:
            reported += "\n" not in str(error)
    assert reported > 100


def test_what_is_no_result_or_differs(tmp_path):
    put(tmp_path / "result/iteration_0", result((3, 0)))
    (tmp_path / "result/iteration_1").write_bytes(b"plain text")
    put(tmp_path / "result/iteration_2", result((3, 0), gas=1))
    found = opened(tmp_path)
    with pytest.raises(FilmError, match="iteration_1: is no result of GADEN"):
        found.frame(1, ["c"])
    with pytest.raises(FilmError, match="iteration_2: has another grid, gas or form"):
        found.frame(2, ["c"])
    with pytest.raises(FilmError, match="no such file"):
        opened(tmp_path, files="away/iteration_%d")


# ---------------------------------------------------------------- winds


def grid_of(folder: Path) -> gaden.Occupancy:
    return gaden.Occupancy(folder, LOW, EDGE, np.zeros(SHAPE, np.int8))


def test_binary_winds_of_all_versions(tmp_path):
    """Velocities that are coordinates: each cell has its own place."""
    u = centres().transpose(2, 1, 0, 3).reshape(-1, 3)
    for version in ((2, 6), (3, 0)):
        (tmp_path / "w_0.csv_gaden").write_bytes(struct.pack("<2i", *version) + u.astype("<f4").tobytes())
        (tmp_path / "wind_iteration_0").write_bytes((tmp_path / "w_0.csv_gaden").read_bytes())
    (tmp_path / "wind_iteration_1").write_bytes(u.T.astype("<f8").tobytes())
    for d, name in enumerate("UVW"):
        (tmp_path / f"w_0.csv_{name}").write_bytes(struct.pack("<i", 999) + u[:, d].astype("<f8").tobytes())
    for name in ("w_0.csv_gaden", "wind_iteration_0", "wind_iteration_1", "w_0.csv_U"):
        assert gaden_winds.is_binary(Path(name))
        points = gaden_winds.read(tmp_path / name, grid_of(tmp_path))
        np.testing.assert_allclose(points.velocity, points.place, rtol=1e-6)
        np.testing.assert_allclose(np.array(points.box), [LOW, HIGH])
        np.testing.assert_allclose(points.place, u, atol=1e-12)
    assert not gaden_winds.is_binary(Path("w_0.csv"))


@pytest.mark.parametrize(
    ("name", "content", "fault"),
    [
        ("wind_iteration_0", b"123", "has 3 bytes; a wind on the 192 cells"),
        ("wind_iteration_0", struct.pack("<2i", 7, 0) + bytes(12 * 192), "a wind on the 192 cells"),
        ("wind_iteration_0", np.full((192, 3), np.nan).tobytes(), "must be finite"),
        ("wind_iteration_0", np.full((192, 3), 1e6).tobytes(), "below 340 m/s"),
        ("w_0.csv_U", bytes(4 + 8 * 192), "begin with the number 999"),
    ],
)
def test_faults_of_binary_winds_are_reported_in_a_line(tmp_path, name, content, fault):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(WindFileError, match=fault):
        gaden_winds.read(tmp_path / name, grid_of(tmp_path))


def test_a_binary_wind_needs_the_grid(tmp_path):
    (tmp_path / "wind_iteration_0").write_bytes(np.zeros((192, 3)).tobytes())
    room = "duration: 1\ndomain: {size: [2, 1.5, 1], spacing: 0.25}\nwind: {kind: imported, files: wind_iteration_%d}\n"
    room += "gas: {kind: eulerian, sources: [{position: [0.5, 0.6, 0.4], rate: 1 mg/s}]}\n"
    (tmp_path / "room.yaml").write_text(room)
    with pytest.raises(ScenarioError, match=r"give the grid as wind\.occupancy"):
        load(tmp_path / "room.yaml")
