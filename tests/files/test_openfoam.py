"""Cases of OpenFOAM, made here in its form: centres of cells against closed forms, fields against what was written."""

import gzip
import tracemalloc
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
import pytest
from foam_case import Cell, Writer, box, decomposed, prism

from taichi_plume.assembly.assemble import assemble
from taichi_plume.assembly.preparation import load_scenario
from taichi_plume.files import openfoam
from taichi_plume.files.openfoam import read
from taichi_plume.files.openfoam_case import Series, is_case, is_time, series
from taichi_plume.files.openfoam_file import open_foam
from taichi_plume.files.wind_points import WindFileError

KINDS = [{}, {"binary": True}, {"packed": True}, {"binary": True, "packed": True}]
SHEAR = np.array([[2.0, 0.4, 0.1], [0.0, 1.5, 0.3], [0.0, 0.0, 1.0]])


def graded(x: np.ndarray) -> np.ndarray:
    """Cells that widen along each axis."""
    wide = np.stack([2.0 * x[..., 0] ** 2, 1.2 * x[..., 1] ** 1.5, 0.8 * x[..., 2] ** 3], axis=-1)
    return wide - [5.0, 1.0, 0.0]


def sheared(x: np.ndarray) -> np.ndarray:
    """Parallelepipeds: hexahedra of skewed faces, whose centres are the means of their corners."""
    return x @ SHEAR.T


def centres(case: Path) -> np.ndarray:
    return openfoam._mesh(case / "constant/polyMesh")[0]


def played(path: Path) -> Series:
    found = series(path)
    assert found is not None
    return found


def times(case: Path) -> list[tuple[float, Path]]:
    return played(case).files


def small_case(folder: Path, n: tuple[int, ...] = (4, 3, 2), **keys: Any) -> None:
    """A case of a graded mesh with a time of 1 s."""
    points, cells = box(n, graded)
    writer = Writer(folder, **keys)
    writer.mesh(points, cells)
    writer.field("1", "U", speeds(means(points, cells)))


def speeds(x: np.ndarray) -> np.ndarray:
    return np.stack([0.1 + 0.2 * x[:, 1], -0.1 * x[:, 0], 0.05 * x[:, 2]], axis=-1)


def means(points: np.ndarray, cells: list[Cell]) -> np.ndarray:
    """Mean corners of cells: the centres of boxes and parallelepipeds."""
    return np.array([points[sorted({c for face in cell for c in face})].mean(axis=0) for cell in cells])


def frusta(n: int = 5, top: float = 0.4) -> tuple[np.ndarray, list[Cell], np.ndarray]:
    """A stack of two frusta of polygons of n corners, with their centres by the closed form of cones."""
    angle = 2.0 * np.pi * np.arange(n) / n
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    radii, heights = (1.0, top, 0.9), (0.0, 0.7, 1.0)
    points = np.concatenate(
        [np.column_stack([r * ring, np.full(n, z)]) for r, z in zip(radii, heights, strict=True)]
    )
    rings = [list(range(k * n, (k + 1) * n)) for k in range(3)]
    cells = [prism(rings[0], rings[1]), prism(rings[1], rings[2])]
    z = []
    for k in (0, 1):
        R, r, h = radii[k], radii[k + 1], heights[k + 1] - heights[k]
        z.append(heights[k] + h * (R * R + 2 * R * r + 3 * r * r) / (4 * (R * R + R * r + r * r)))
    return points, cells, np.array([[0.0, 0.0, z[0]], [0.0, 0.0, z[1]]])


@pytest.mark.parametrize("keys", KINDS)
@pytest.mark.parametrize("place", [graded, sheared])
def test_centres_and_fields_to_rounding(tmp_path, keys, place):
    points, cells = box((4, 3, 2), place)
    writer, x = Writer(tmp_path / "case", **keys), means(points, cells)
    writer.mesh(points, cells)
    writer.field("0", "U", np.tile([0.3, 0.0, 0.0], (24, 1)), uniform=True)
    writer.field("0.5", "U", speeds(x))
    writer.field("0.5", "nut", 1e-4 * x[:, 0] ** 2)
    writer.field("1e1", "U", -speeds(x))
    assert is_case(tmp_path / "case")
    assert [time for time, _ in times(tmp_path / "case")] == [0.0, 0.5, 10.0]
    first, second, third = (read(path) for _, path in times(tmp_path / "case"))
    np.testing.assert_allclose(second.place, x, rtol=0, atol=5e-15)
    np.testing.assert_array_equal(second.velocity, speeds(x))
    np.testing.assert_array_equal(second.eddy_viscosity, 1e-4 * x[:, 0] ** 2)
    np.testing.assert_array_equal(third.velocity, -speeds(x))
    np.testing.assert_array_equal(first.velocity, np.tile([0.3, 0.0, 0.0], (24, 1)))
    assert first.eddy_viscosity is None
    assert is_time(tmp_path / "case/0.5")


@pytest.mark.parametrize("n", [3, 4, 5, 6])
@pytest.mark.parametrize("top", [0.02, 0.4, 1.7])
def test_centres_of_polyhedra_are_those_of_their_volumes(tmp_path, n, top):
    """Wedges, hexahedra and prisms that narrow: the mean of the corners would be far off."""
    points, cells, expected = frusta(n, top)
    turn = np.linalg.qr(np.random.default_rng(n).normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    writer = Writer(tmp_path / "case", binary=n % 2 == 0)
    writer.mesh(points @ turn.T + [3.0, -2.0, 1.0], cells)
    found = centres(tmp_path / "case")
    np.testing.assert_allclose((found - [3.0, -2.0, 1.0]) @ turn, expected, rtol=0, atol=5e-15)
    if top != 1.7:
        assert np.abs(means(points, cells) - expected).max() > 0.01


def test_warped_faces_are_cut_into_triangles_as_openfoam_does(tmp_path):
    """A cube with a corner drawn out; beside it the sum over tetrahedra, one by one."""
    points, cells = box((1, 1, 1), lambda x: x)
    points[-1] += [0.4, 0.3, 0.2]
    Writer(tmp_path / "case").mesh(points, cells)
    tip = np.mean([_face_centre(points[face]) for face in cells[0]], axis=0)
    volume, moment = 0.0, np.zeros(3)
    for face in cells[0]:
        area = np.zeros(3)
        for a, b in zip(face, [*face[1:], face[0]], strict=True):
            area += 0.5 * np.cross(points[b] - points[a], points[face].mean(axis=0) - points[a])
        part = area @ (_face_centre(points[face]) - tip) / 3
        volume += part
        moment += part * (0.75 * _face_centre(points[face]) + 0.25 * tip)
    np.testing.assert_allclose(centres(tmp_path / "case")[0], moment / volume, atol=1e-14)


def _face_centre(corners: np.ndarray) -> np.ndarray:
    middle, normals, centres = corners.mean(axis=0), [], []
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        normals.append(0.5 * np.cross(b - a, middle - a))
        centres.append((a + b + middle) / 3)
    whole = np.sum(normals, axis=0)
    shares = np.array(normals) @ whole / np.linalg.norm(whole)
    return shares @ np.array(centres) / shares.sum()


@pytest.mark.parametrize("keys", KINDS[:2])
def test_a_decomposed_case_is_all_of_its_parts(tmp_path, keys):
    points, cells = box((5, 4, 2), sheared)
    x, order = means(points, cells), np.random.default_rng(2).permutation(40)
    parts = np.split(order, [13, 27])
    whole = Writer(tmp_path / "case")
    whole.mesh(points, cells)
    whole.field("0", "U", speeds(x))
    for writer, part in zip(decomposed(tmp_path / "case", points, cells, parts, **keys), parts, strict=True):
        for n, time in enumerate(("0", "0.25", "0.5")):
            writer.field(time, "U", (1 + n) * speeds(x[part]))
    found = times(tmp_path / "case")
    assert [time for time, _ in found] == [0.0, 0.25, 0.5]
    last = read(found[-1][1])
    np.testing.assert_allclose(last.place, x[order], rtol=0, atol=5e-15)
    np.testing.assert_array_equal(last.velocity, 3 * speeds(x[order]))
    whole.field("0.25", "U", speeds(x))
    whole.field("0.5", "U", 7 * speeds(x))  # reconstructed
    np.testing.assert_array_equal(read(found[-1][1]).velocity, 7 * speeds(x))
    for n in range(3):  # and gone on with in parallel, from which the case has nothing
        (tmp_path / f"case/processor{n}/0.5").rename(tmp_path / f"case/processor{n}/0.75")
    assert [time for time, _ in times(tmp_path / "case")] == [0.0, 0.25, 0.75]
    np.testing.assert_array_equal(read(tmp_path / "case/0.75").velocity, 3 * speeds(x[order]))
    np.testing.assert_array_equal(read(tmp_path / "case/0.5").velocity, 7 * speeds(x))


@pytest.mark.parametrize("name", ["points", "points.gz"])
def test_a_mesh_that_moves_is_refused(tmp_path, name):
    small_case(tmp_path)
    (tmp_path / "1/polyMesh").mkdir()
    (tmp_path / "1/polyMesh" / name).write_bytes(b"")
    for path in (tmp_path, tmp_path / "1"):
        with pytest.raises(WindFileError, match=r"1/polyMesh: .*the mesh moves"):
            times(path)


@pytest.mark.parametrize("keys", KINDS[:2])
def test_what_the_tests_make_is_a_case_for_another_reader(tmp_path, keys):
    import pyvista

    small_case(tmp_path, **keys)
    control = b"startTime 0; endTime 1; deltaT 1; writeInterval 1;"
    Writer(tmp_path).write("system/controlDict", "dictionary", control)
    (tmp_path / "case.foam").touch()
    reader = pyvista.OpenFOAMReader(str(tmp_path / "case.foam"))
    reader.set_active_time_value(1.0)
    grid = reader.read()["internalMesh"]
    ours = read(tmp_path / "1")
    np.testing.assert_allclose(grid.cell_centers().points, ours.place, atol=1e-6)  # it has single precision
    np.testing.assert_allclose(grid.cell_data["U"], ours.velocity, atol=1e-7)


@pytest.mark.parametrize(
    ("file", "old", "new", "reported"),
    [
        ("constant/polyMesh/points", b"FoamFile", b"Foam", "is no file of OpenFOAM"),
        ("constant/polyMesh/points", b"60\n(", b"61\n(", "its list has 60 of 61 entries; is it whole"),
        ("constant/polyMesh/points", b"(-5.0 ", b"(x ", "holds what is no number"),
        ("constant/polyMesh/points", b"(-5.0 ", b"(nan ", "not all of its values are finite"),
        ("constant/polyMesh/faces", b"4(", b"5(", "truncated or damaged"),
        ("constant/polyMesh/faces", b"\n(", b"\n{", "has no list"),
        ("constant/polyMesh/owner", b"0\n", b"-7\n", "do not belong together"),
        ("constant/polyMesh/owner", b"0\n", b"999999\n", "do not belong together|faces"),
        ("1/U", b"internalField", b"inner", "has no internalField"),
        ("1/U", b"24\n(", b"23\n(", "has 23 values, but the mesh has 24 cells"),
        ("constant/polyMesh/owner", b"0\n", b"inf\n", "no label of a mesh"),
        ("constant/polyMesh/faces", b"4(", b"inf(", "no label of a mesh"),
        ("constant/polyMesh/faces", b"4(", b"nan(", "no label of a mesh"),
        ("1/U", b"List<vector> \n24", b"List<vector> \n99999999999999999999", "has no list"),
    ],
)
def test_faults_are_reported_in_a_line(tmp_path, file, old, new, reported):
    small_case(tmp_path)
    content = (tmp_path / file).read_bytes()
    assert old in content
    (tmp_path / file).write_bytes(content.replace(old, new, 1))
    openfoam._mesh_of.cache_clear()
    with pytest.raises(WindFileError, match=reported) as caught:
        read(tmp_path / "1")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("keys", KINDS)
def test_damaged_files_are_reported_or_read(tmp_path, keys):
    small_case(tmp_path, (3, 2, 2), **keys)
    rng = np.random.default_rng(3)
    names = [*(f"constant/polyMesh/{name}" for name in openfoam.PARTS), "1/U"]
    reported = 0
    for name in names:
        file = tmp_path / (f"{name}.gz" if keys.get("packed") else name)
        good = file.read_bytes()
        for _ in range(40):
            damaged = bytearray(good)
            if rng.random() < 0.3:
                del damaged[rng.integers(len(damaged)) :]
            for _ in range(3):
                if damaged:
                    damaged[rng.integers(len(damaged))] = rng.integers(256)
            file.write_bytes(damaged)
            openfoam._mesh_of.cache_clear()
            try:
                found = read(tmp_path / "1")
                assert np.isfinite(found.place).all()
            except WindFileError as error:
                reported += "\n" not in str(error)
        file.write_bytes(good)
    assert reported > 60
    assert not is_case(tmp_path / "1")
    assert not is_case(tmp_path / ("a" * 5000))
    assert not is_time(tmp_path / ("a" * 5000) / "1")
    assert series(tmp_path / "constant") is None
    with pytest.raises(WindFileError, match="is no time of a case"):
        read(tmp_path / "constant")


TEXT, BINARY = b"FoamFile { format ascii; }\n", b"FoamFile { format binary; }\n"
U = b"internalField nonuniform "


@pytest.mark.parametrize(
    "content",
    [
        b"/* " * 66_000,
        TEXT + b"/* " * 66_000,
        BINARY + b"/* " * 66_000,
        TEXT + b"// " * 66_000,
        BINARY + b"/**/" * 50_000,
        b"FoamFile { " + b"a " * 95_000 + b"}",
        b"FoamFile { a b" + b'"x' * 95_000 + b"}",
        b"FoamFile { a" + b" " * 190_000 + b"}",
        TEXT + b"internalField uniform " + b" " * 190_000,
        TEXT + U + b"10((" + b"1 " * 50_000 + b"1" * 50_000 + b"))",
    ],
)
def test_small_files_take_little_time(tmp_path, content):
    """A reader that is quadratic takes seconds to minutes for 200 kB."""
    file = tmp_path / "U"
    for packed in (content, gzip.compress(content)):
        file.write_bytes(packed)
        start = process_time()
        with pytest.raises(WindFileError):
            open_foam(file).field(3, 10)
        assert process_time() - start < 2.0


@pytest.mark.parametrize("content", [U + b"9999999999{", U + b"40000000{", b"40000000{", b"3000000000("])
def test_small_files_take_little_memory(tmp_path, content):
    """A list may claim any length."""
    (tmp_path / "U").write_bytes(BINARY + content + bytes(200))
    tracemalloc.start()
    try:
        for read_it in (lambda file: file.field(3, 10), lambda file: file.numbers(3)):
            with pytest.raises(WindFileError):
                read_it(open_foam(tmp_path / "U"))
        assert tracemalloc.get_traced_memory()[1] < 5_000_000
    finally:
        tracemalloc.stop()


def test_comments_and_quotes_in_a_header(tmp_path):
    header = b'/* FoamFile { } */ FoamFile\n{ // note;\nformat ascii; note "a; b"; arch "LSB;label=32;scalar=64"; }\n'
    body = b"// * //\ninternalField /* here */ uniform (1 2 3); boundaryField { }"
    (tmp_path / "U").write_bytes(header + body)
    np.testing.assert_array_equal(open_foam(tmp_path / "U").field(3, 2), [[1, 2, 3], [1, 2, 3]])


ROOM = """
duration: 0.2
domain: {size: [2.0, 1.2], spacing: 0.1}
wind: {kind: imported, files: case, start: 1.0}
gas: {kind: eulerian, sources: [{position: [0.5, 0.6], rate: 1 mg/s}]}
"""


@pytest.mark.usefixtures("taichi")
@pytest.mark.slow
def test_a_case_of_one_layer_is_the_wind_of_a_2_d_run(tmp_path):
    """A stream of uniform shear, which is free of divergence and linear: it comes through unchanged."""
    points, cells = box((16, 10, 1), lambda x: x * [2.0, 1.2, 0.1] + [4.0, 0.0, 0.0])
    writer, x = Writer(tmp_path / "case"), means(points, cells)
    writer.mesh(points, cells)
    for time, factor in (("0", 0.0), ("2", 2.0)):
        u = np.zeros((160, 3))
        u[:, 0] = factor * (0.2 + 0.1 * x[:, 1])
        writer.field(time, "U", u)
    (tmp_path / "room.yaml").write_text(ROOM)
    sim = assemble(load_scenario(tmp_path / "room.yaml"), tmp_path)
    u = sim.grid.read(sim.wind.u[0])[1:]
    expected = 0.2 + 0.1 * sim.grid.centers()[1:, :, 1]
    np.testing.assert_allclose(u, expected, atol=1e-5)
    last = assemble(load_scenario(tmp_path / "room.yaml", ["wind.files=case/2", "wind.start=0"]), tmp_path)
    np.testing.assert_allclose(last.grid.read(last.wind.u[0])[1:], 2 * expected, atol=1e-5)
