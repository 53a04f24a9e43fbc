"""Meshes are read as they are, or refused in one line: never in part, and no file ends the process."""

import os
import struct
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_meshes import box_triangles, stl_bytes, torus, write_obj

from taichi_plume.grid import polygons
from taichi_plume.grid.mesh_files import MeshError, read_mesh
from taichi_plume.grid.meshes import Solid
from taichi_plume.grid.polygons import triangulated
from taichi_plume.scenario.obstacles import Mesh

BOX = box_triangles((1, 1, 0), (2, 2, 0.5))
PLACES, CORNERS = np.unique(BOX.reshape(-1, 3), axis=0, return_inverse=True)
FACES = CORNERS.reshape(-1, 3)
QUADS = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])


def stl_text(triangles=BOX) -> bytes:
    facets = "".join(
        "facet normal 0 0 1\n outer loop\n"
        + "".join(f"  vertex {x} {y} {z}\n" for x, y, z in triangle)
        + " endloop\nendfacet\n"
        for triangle in triangles
    )
    return f"solid box of mine\n{facets}endsolid\n".encode()


def ply(order: str, faces: Any = FACES, vertices=PLACES) -> bytes:
    """With a colour beside each face and an element of no interest between the two."""
    kind = {"": "ascii", "<": "binary_little_endian", ">": "binary_big_endian"}[order]
    header = (
        f"ply\nformat {kind} 1.0\ncomment of \xff mine\nelement vertex {len(vertices)}\n"
        "property float x\nproperty double y\nproperty float32 z\n"
        "element other 2\nproperty list uchar short a\n"
        f"element face {len(faces)}\nproperty uchar red\nproperty list uchar int vertex_indices\nend_header\n"
    ).encode("latin-1")
    if not order:
        rows = [*(f"{x} {y} {z}" for x, y, z in vertices), "1 5", "2 5 6"]
        rows += [f"7 {len(one)} {' '.join(map(str, one))}" for one in faces]
        return header + "\n".join(rows).encode() + b"\n"
    body = b"".join(struct.pack(f"{order}fdf", *one) for one in vertices)
    body += struct.pack(f"{order}BhBhh", 1, 5, 2, 5, 6)
    body += b"".join(struct.pack(f"{order}BB{len(one)}i", 7, len(one), *one) for one in faces)
    return header + body


def obj() -> bytes:
    lines = ["# mine", "mtllib nowhere.mtl", "o box", *(f"v {x} {y} {z} 1.0" for x, y, z in PLACES), "vt 0 0"]
    first = [f"f {a + 1}/1 {b + 1}/1 {c + 1}/1" for a, b, c in FACES[:6]]
    last = [f"f {a - 8} {b - 8} {c - 8}" for a, b, c in FACES[6:]]
    return "\n".join([*lines, *first, *last, ""]).encode()


MIXED = [*QUADS[:5].tolist(), [1, 5, 7], [1, 7, 3]]
CONTENTS = {
    "binary.stl": stl_bytes(BOX),
    "text.stl": stl_text(),
    "a.obj": obj(),
    "text.ply": ply(""),
    "little.ply": ply("<"),
    "big.ply": ply(">"),
    "quads.ply": ply("<", QUADS),
    "mixed.ply": ply(">", MIXED),
    "mixed_text.ply": ply("", MIXED),
}
"""A box in every format."""


def solid(path: Path, content: bytes | str) -> Solid:
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return Solid(Mesh(kind="mesh", file=path.name), 3, path.parent)


def doubled_areas(corners: np.ndarray) -> np.ndarray:
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


@pytest.mark.parametrize("name", CONTENTS)
def test_every_format_is_read_as_it_is_and_every_cut_is_reported(tmp_path, name):
    """A cut OBJ, which has no counts, is an open body."""
    content = CONTENTS[name]
    assert solid(tmp_path / name, content).triangles.shape == (12, 3)
    mesh = read_mesh(tmp_path / name)
    assert mesh.triangles.shape == (12, 3)
    assert mesh.remarks == ()
    assert np.linalg.norm(doubled_areas(mesh.vertices[mesh.triangles]), axis=1).sum() / 2 == pytest.approx(
        4.0
    )
    for end in {*range(0, len(content) - 2, 7), len(content) - 2}:
        with pytest.raises(MeshError) as caught:
            solid(tmp_path / name, content[:end])
        assert str(caught.value).isprintable()


@pytest.mark.parametrize("name", ["text.stl", "a.obj", "text.ply", "little.ply", "mixed_text.ply"])
def test_byte_order_marks_are_skipped(tmp_path, name):
    assert solid(tmp_path / name, b"\xef\xbb\xbf" + CONTENTS[name]).triangles.shape == (12, 3)
    if name.endswith((".obj", "t.stl")):
        for order in ("utf-16-le", "utf-16-be"):
            wide = ("\ufeff" + CONTENTS[name].decode()).encode(order)
            assert solid(tmp_path / name, wide).triangles.shape == (12, 3)


@pytest.mark.parametrize("name", CONTENTS)
@pytest.mark.parametrize("padding", [b"\0", b"\n", b"\r\n \t\n", b"\x1a", b"\0" * 600, b" " * 51])
def test_padding_at_the_end_is_skipped_with_a_remark(tmp_path, name, padding):
    found = solid(tmp_path / name, CONTENTS[name] + padding)
    assert found.triangles.shape == (12, 3)
    np.testing.assert_array_equal([found.low, found.high], [[1, 1, 0], [2, 2, 0.5]])
    binary = name in ("binary.stl", "little.ply", "big.ply", "quads.ply", "mixed.ply")
    assert [f"{len(padding)} bytes after" in remark for remark in found.remarks] == [True] * binary


def test_what_follows_the_announced_triangles_is_reported(tmp_path):
    """It is read as triangles if it may be some: then the count is damaged."""
    for more in (51, 120, 4321):
        found = solid(tmp_path / "a.stl", CONTENTS["binary.stl"] + b"\7" * more)
        assert found.triangles.shape == (12, 3)
        assert f"{more} bytes" in found.remarks[0]
    marked = solid(tmp_path / "a.stl", b"\xef\xbb\xbf" + CONTENTS["binary.stl"])
    assert marked.triangles.shape == (12, 3)
    with pytest.raises(MeshError, match="damaged"):
        solid(tmp_path / "a.stl", CONTENTS["binary.stl"] + b"\7" * 150)


def test_a_part_of_a_row_at_the_end_is_padding_but_a_row_is_not(tmp_path):
    for name, row in (("binary.stl", 50), ("little.ply", 14)):
        assert solid(tmp_path / name, CONTENTS[name] + b"\1" * (row - 1)).remarks
        with pytest.raises(MeshError, match="damaged"):
            solid(tmp_path / name, CONTENTS[name] + b"\1" * row)


@pytest.mark.parametrize(
    ("name", "content", "factor"),
    [
        ("a.obj", b"# Units: millimeters\n" + obj(), 0.001),
        ("a.obj", b"# made by me\n#unit cm\n" + obj(), 0.01),
        ("a.obj", b"# all lengths; unit is inch\n" + obj(), 0.0254),
        ("a.ply", ply("<").replace(b"comment of \xff mine", b"comment unit mm"), 0.001),
        ("a.ply", ply("").replace(b"comment of \xff mine", b"comment units=feet"), 0.3048),
        ("a.stl", stl_text().replace(b"box of mine", b"box units=mm", 1), 0.001),
        ("a.stl", b"UNITS=mm".ljust(80, b"\0") + stl_bytes(BOX)[80:], 0.001),
        ("a.obj", b"# a unit cube of ten units by hand\n# units: parsec\n" + obj(), None),
        ("a.obj", b"# unit: m\n" + obj(), 1.0),
        ("a.obj", b"# exported in MM by hand\n" + obj(), 0.001),
        ("a.obj", b"# drawn in Spain, in inches\n" + obj(), 0.0254),
        ("a.obj", b"# 1 unit = 1 cm\n" + obj(), 0.01),
        ("a.obj", b"# 1 unit = 2.5 mm\n" + obj(), 0.0025),
        ("a.stl", stl_text().replace(b"box of mine", b"bench (mm)", 1), 0.001),
        ("a.stl", stl_text().replace(b"box of mine", b"bench (copy)", 1), None),
        ("a.obj", b"# made in 2 days, in counts (px)\n" + obj(), None),
        ("a.obj", obj(), None),
    ],
)
def test_a_unit_in_a_comment_is_reported_unless_the_scale_is_its(tmp_path, name, content, factor):
    (tmp_path / name).write_bytes(content)
    unit = read_mesh(tmp_path / name).unit
    assert (unit and unit[0]) == factor
    remarks = Solid(Mesh(kind="mesh", file=name), 3, tmp_path).remarks
    assert [f"scale: {factor}" in remark for remark in remarks] == [True] * (factor not in (None, 1.0))
    if factor is not None:
        assert Solid(Mesh(kind="mesh", file=name, scale=factor), 3, tmp_path).remarks == ()


@pytest.mark.parametrize(
    ("name", "content", "reported"),
    [
        ("a.ply", ply("<", [[0, 1, 99999999]]), "none of the 8 vertices"),
        ("a.ply", ply("", [[0, 1, 99999999], [1, 2, 3, 4]]), "none of the 8 vertices"),
        ("a.ply", ply(">", [[0, 1, -1]]), "none of the 8 vertices"),
        ("a.ply", ply("<", [[0, 1]]), "fewer than three corners"),
        ("a.ply", ply("<").replace(b"vertex 8", b"vertex 4000000000"), "4000000000 rows of vertex"),
        ("a.ply", ply("").replace(b"vertex 8", b"vertex 4000000000"), "4000000000 rows of vertex"),
        ("a.ply", ply("<").replace(b"face 12", b"face 13"), "13 rows of face, fewer follow"),
        ("a.ply", ply("<").replace(b"face 12", b"face 11"), "holds 14 bytes more"),
        ("a.ply", ply("").replace(b"face 12", b"face 11"), "holds 5 numbers more"),
        ("a.ply", ply("").replace(b"7 3", b"7 x", 1), "is damaged: could not convert"),
        ("a.ply", ply("").replace(b"7 3", b"7 2.5", 1), "is damaged: "),
        ("a.ply", ply("").replace(b"float x", b"float \x1b[31m"), "no x, y, z"),
        ("a.ply", ply("").replace(b"float x", b"flaot \x1b[31m"), r"'property flaot \\x1b\[31m'"),
        ("a.ply", ply("").replace(b"float x", b"float y"), "two properties of vertex"),
        ("a.ply", b"ply\nformat ascii 1.0\n" + b"comment\n" * 20_000, "has no header"),
        ("a.ply", b"ply\nformat ascii 1.0\nend_header\n", "no x, y, z"),
        ("a.stl", b"\0" * 34, "is cut"),
        ("a.stl", b"\0" * 80 + b"\xff\xff\xff\xff", "4294967295 triangles, it holds 0"),
        ("a.stl", stl_text().replace(b"endloop", b"endpool", 1), "after 0 facets comes 'facet normal"),
        ("a.stl", stl_text().replace(b"vertex 1.0", b"vertex 1,0", 1), "could not convert"),
        ("a.stl", stl_text() + b"facet", "after 12 facets comes 'facet'"),
        ("a.stl", b"solid a\nendsolid a\n", "no triangles in it"),
        ("a.stl", stl_text(np.where(BOX == 2, np.inf, BOX)), "not finite"),
        ("a.stl", stl_text(np.where(BOX == 2, 1e30, BOX)), "beyond 1e\\+09"),
        ("a.stl", stl_text(np.array([BOX[0], BOX[0][::-1]])), "body 0 is flat"),
        ("a.obj", obj().replace(b"f 1/", b"f 9/", 1), "a face has vertex 9 of 8"),
        ("a.obj", obj().replace(b"f 1/", b"f 0/", 1), "counted from 1"),
        ("a.obj", obj().replace(b"f 1/", b"f " + b"9" * 5000 + b"/", 1), "is no corner of a face"),
        ("a.obj", obj().replace(b"f -", b"f -9", 1), "counted from 1"),
        ("a.obj", obj().replace(b"vt 0", b"\x1b 0"), r"line \d+: '\\x1b' is no key"),
        ("a.obj", b"v 1 2\n", "line 1: a vertex has three"),
        ("a.off", b"", r"must end in \.stl, \.obj or \.ply"),
    ],
)
def test_damage_is_reported(tmp_path, name, content, reported):
    with pytest.raises(MeshError, match=reported) as caught:
        solid(tmp_path / name, content)
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 400


def test_what_is_no_file_is_reported_at_once(tmp_path):
    os.mkfifo(tmp_path / "pipe.stl")
    (tmp_path / "folder.ply").mkdir()
    names = {
        "pipe.stl": "is a pipe",
        "folder.ply": "Is a directory",
        f"{'a' * 5000}.obj": "File name too long",
    }
    for name, reported in names.items():
        with pytest.raises(MeshError, match=reported):
            read_mesh(tmp_path / name)


def test_a_fine_mesh_is_the_same_in_text_and_binary(tmp_path):
    vertices, quads = torus()
    write_obj(tmp_path / "a.obj", vertices, quads)
    (tmp_path / "a.ply").write_bytes(ply("<", quads.tolist(), vertices))
    text, binary = read_mesh(tmp_path / "a.obj"), read_mesh(tmp_path / "a.ply")
    (ours, first), (theirs, second) = ((mesh.vertices, mesh.triangles) for mesh in (text, binary))
    np.testing.assert_allclose(ours, theirs, atol=1e-6)
    assert len(first) == len(second) == 2 * len(quads)


@pytest.mark.parametrize("axes", [(0, 1, 2), (1, 2, 0), (2, 0, 1), (1, 0, 2)])
@pytest.mark.parametrize(
    ("outline", "area"),
    [
        ([(0, 0), (4, 0), (4, 3), (0, 3)], 12.0),
        ([(0, 0), (4, 0), (4, 4), (3, 4), (3, 1), (1, 1), (1, 4), (0, 4)], 10.0),  # a U
        ([(0, 0), (2, 1), (4, 0), (3, 2), (4, 4), (2, 3), (0, 4), (1, 2)], 8.0),  # a star
    ],
)
def test_polygons_become_triangles_that_do_not_overlap(axes, outline, area):
    places = np.column_stack([outline, 0.5 * np.array(outline) @ [1, 1]])[:, axes]
    corners = places[triangulated(places, [list(range(len(outline)))])]
    assert len(corners) == len(outline) - 2
    cross = doubled_areas(corners)
    tilt = np.sqrt(1 + 2 * 0.25)  # of the plane z = (x + y)/2
    assert np.linalg.norm(cross, axis=1).sum() / 2 == pytest.approx(area * tilt)
    assert np.linalg.norm(cross.sum(axis=0)) / 2 == pytest.approx(area * tilt)


PLANE = "".join(f"v {x:.3g} {y:.3g} 0\n" for x, y in np.random.default_rng(2).uniform(size=(1990, 2)))
CROSSED = "f " + " ".join(str(n + 1) for n in np.random.default_rng(3).permutation(1990)) + "\n"


@pytest.mark.parametrize(
    ("name", "content", "reported"),
    [
        ("a.ply", b"ply" + b"\n" * 200_000, "has no header"),
        ("a.ply", b"ply\n" + b"\n" * 200_000 + b"end_header\n", "has no header"),
        ("a.ply", b"ply" + b" \n" * 100_000, "has no header"),
        ("a.ply", b"ply\n" + b"\nend_header x" * 20_000, "has no header"),
        ("a.obj", (PLANE + CROSSED * 40).encode(), "faces of many corners that are not convex"),
        ("a.obj", b"v 0 0 0\nv 1e300 0 0\nv 1e300 1e300 0\nv 0 1e300 1e300\nf 1 2 3 4\n", "beyond 1e"),
        # open3d would compare each triangle at an edge with each
        ("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\n" + b"f 1 2 3\n" * 25_000, "25000 triangles share the edge"),
    ],
    ids=range(7),
)
@pytest.mark.filterwarnings("error")
def test_small_files_take_little_time(tmp_path, name, content, reported, monkeypatch):
    monkeypatch.setattr(polygons, "MOST_WORK", 2_000_000)
    begin = time.process_time()
    with pytest.raises(MeshError, match=reported):
        solid(tmp_path / name, content)
    assert time.process_time() - begin < 5.0


def test_bodies_are_counted(tmp_path):
    """Over a thousand scenes open3d ends the process."""
    text = "".join(
        f"v {n} 0 0\nv {n}.5 0 0\nv {n} 1 0\nv {n} 0 1\nf -4 -2 -3\nf -4 -3 -1\nf -4 -1 -2\nf -3 -2 -1\n"
        for n in range(1100)
    )
    with pytest.raises(MeshError, match=r"a\.obj: has 1100 bodies.* more than 800"):
        solid(tmp_path / "a.obj", text)
    some = "".join(text.splitlines(keepends=True)[: 8 * 450])
    kept = solid(tmp_path / "a.obj", some)
    with pytest.raises(MeshError, match=r"a\.obj: has 450 bodies"):
        solid(tmp_path / "a.obj", some)
    del kept  # bodies that are gone do not count
    solid(tmp_path / "a.obj", some)
