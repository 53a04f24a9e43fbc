"""Occupancy maps of ROS: reading, position in the domain, air fractions, and walls that do not leak."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from PIL import Image
from scipy import ndimage

from taichi_plume.assembly.assemble import assemble
from taichi_plume.assembly.preparation import load, load_scenario
from taichi_plume.grid import floor_plans
from taichi_plume.grid.cut_cells import Air, air_of, sealed
from taichi_plume.grid.floor_plans import FloorPlan
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.level_set import signed_distance
from taichi_plume.grid.map_files import FREE, OCCUPIED, UNKNOWN, MapError, image_of, read_map
from taichi_plume.scenario.input_files import files_of
from taichi_plume.scenario.loading import ScenarioError

YAML = "image: plan.pgm\nresolution: {}\norigin: [{}, {}, {}]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"


def write(folder: Path, walls: np.ndarray, size: float = 0.05, origin=(0.0, 0.0, 0.0)) -> Path:
    """Write a map; walls: bool, axes (x, y)."""
    Image.fromarray(np.where(walls, 0, 254).astype(np.uint8).T[::-1]).save(folder / "plan.pgm")
    (folder / "plan.yaml").write_text(YAML.format(size, *origin))
    return folder / "plan.yaml"


def plan(folder: Path, walls: np.ndarray, extent, size=0.05, at=(0.0, 0.0, 0.0), **keys: Any) -> FloorPlan:
    """Return the shape of a map; the lower corner of the domain is the origin of the map's frame."""
    write(folder, walls, size, at)
    given = {
        "file": "plan.yaml",
        "resolution": None,
        "layers": (),
        "scale": None,
        "unknown": "wall",
        "origin": (0.0, 0.0),
        "base": 0.0,
        "height": None,
    }
    return FloorPlan(SimpleNamespace(**{**given, "motion": None, **keys}), extent, folder)


def rooms(obstacles: list, size=(1.0, 1.0)) -> dict[str, Any]:
    """Return a scenario whose only robot and source have room in any map."""
    return {
        "duration": 1.0,
        "domain": {"size": list(size), "spacing": 0.025},
        "wind": {"kind": "synthetic", "speed": 0.1},
        "obstacles": obstacles,
        "gas": {"kind": "eulerian", "sources": [{"position": [0.45, 0.05], "rate": 1e-6}]},
    }


def turn(yaw: float) -> np.ndarray:
    return np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])


# ---------------------------------------------------------------- files


@pytest.mark.parametrize(
    ("mode", "negate", "meant"),
    [
        ("trinary", 0, [OCCUPIED, OCCUPIED, UNKNOWN, UNKNOWN, UNKNOWN, FREE]),
        ("trinary", 1, [FREE, UNKNOWN, UNKNOWN, UNKNOWN, OCCUPIED, OCCUPIED]),
        ("scale", 0, [OCCUPIED, OCCUPIED, OCCUPIED, FREE, FREE, FREE]),
        ("raw", 0, [FREE, OCCUPIED, UNKNOWN, UNKNOWN, UNKNOWN, UNKNOWN]),
    ],
)
@pytest.mark.parametrize("kind", ["pgm", "png", "RGB", "16 bit"])
def test_shades_are_free_occupied_or_unknown(tmp_path, mode, negate, meant, kind):
    shades = np.array([[0, 77, 128, 150, 205, 254]], np.uint8)
    picture = Image.fromarray(shades.astype(np.uint16) * 257 if kind == "16 bit" else shades)
    picture = picture.convert("RGB") if kind == "RGB" else picture
    name = "plan.pgm" if kind == "pgm" else "plan.png"
    picture.save(tmp_path / name)
    text = YAML.format(0.1, -1, 2, 0.5).replace("plan.pgm", name).replace("negate: 0", f"negate: {negate}")
    (tmp_path / "plan.yaml").write_text(f"{text}mode: {mode}\n")
    found = read_map(tmp_path / "plan.yaml")
    assert list(found.pixels[:, 0]) == meant
    assert (found.resolution, found.origin, found.yaw) == (0.1, (-1.0, 2.0), 0.5)


def test_the_first_row_is_the_upper_edge_and_what_is_transparent_is_unknown(tmp_path):
    pixels = np.zeros((2, 3, 4), np.uint8)
    pixels[0] = 255
    pixels[0, 0, 3] = 100
    pixels[1, :, 3] = 255
    Image.fromarray(pixels).save(tmp_path / "plan.png")
    text = YAML.format(0.1, 0, 0, 0).replace("plan.pgm", "plan.png")
    (tmp_path / "plan.yaml").write_text(f"{text}mode: scale\n")
    found = read_map(tmp_path / "plan.yaml")
    np.testing.assert_array_equal(found.pixels, [[OCCUPIED, UNKNOWN], [OCCUPIED, FREE], [OCCUPIED, FREE]])


@pytest.mark.parametrize(
    ("old", "new", "reported"),
    [
        ("resolution: 0.05", "", "resolution: is missing; a number from 0.0001 to 1000"),
        ("resolution: 0.05", "resolution: -1", "resolution: got -1"),
        ("resolution: 0.05", "resolution: .nan", "resolution: got nan"),
        ("origin: [0.0, 0.0, 0.0]", "origin: 3", r"origin: must be \[x, y, yaw\], got 3"),
        ("origin: [0.0, 0.0, 0.0]", "origin: [a, 0]", r"origin\[0\]: got 'a'"),
        ("occupied_thresh: 0.65", "occupied_thresh: 0.1", "free_thresh: must be less than occupied_thresh"),
        ("origin: [0.0, 0.0, 0.0]", "origin: [0, 0, 90]", r"origin\[2\]: .*radians, got 90; .* 1\.5708"),
        ("origin: [0.0, 0.0, 0.0]", "origin: [0, 0, -45.0]", r"radians, got -45; .* -0\.785"),
        ("negate: 0", "negate: 0\nmode: best", "mode: got 'best'; allowed: trinary, scale, raw"),
        ("image: plan.pgm", "image: ../other.pgm", r"image: '\.\./other\.pgm' lies outside its folder"),
        ("image: plan.pgm", "image: /etc/passwd", "lies outside its folder"),
        ("image: plan.pgm", "image: [1]", "must be the name of a picture"),
        ("image: plan.pgm", "image: none.pgm", "none.pgm: no such file"),
        ("image: plan.pgm", 'image: "a\\0b"', r"has the character \\x00"),
        ("image: plan.pgm", "image: plan.yaml", "PGM, PNG or BMP picture"),
        ("image: plan.pgm", "image: .", "Is a directory"),
        ("image: plan.pgm", "[" * 9000, "is nested too deeply"),
        ("image: plan.pgm", "a: 1", "has no key image"),
    ],
)
def test_faults_are_reported_in_a_line(tmp_path, old, new, reported):
    path = write(tmp_path, np.zeros((4, 4), bool))
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    with pytest.raises(MapError, match=reported) as caught:
        read_map(path)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith("plan.yaml: ")


@pytest.mark.parametrize(
    "name", ["/home/me/maps/plan.pgm", "../rooms/plan.pgm", "C:\\maps\\plan.pgm", "maps/plan.pgm"]
)
def test_a_picture_beside_the_yaml_file_is_taken_for_one_of_another_computer(tmp_path, name):
    path = write(tmp_path, np.eye(4, dtype=bool))
    here = read_map(path)
    assert here.remarks == ()
    path.write_text(path.read_text().replace("image: plan.pgm", f"image: {name}"))
    found = read_map(path)
    np.testing.assert_array_equal(found.pixels, here.pixels)
    (remark,) = found.remarks
    assert "plan.pgm beside" in remark
    assert image_of(path) == tmp_path / "plan.pgm"


def test_a_picture_at_the_stated_place_is_taken_before_one_beside(tmp_path):
    path = write(tmp_path, np.zeros((4, 4), bool))
    (tmp_path / "maps").mkdir()
    Image.fromarray(np.zeros((2, 3), np.uint8)).save(tmp_path / "maps" / "plan.pgm")
    path.write_text(path.read_text().replace("image: plan.pgm", "image: maps/plan.pgm"))
    assert read_map(path).pixels.shape == (3, 2)
    assert read_map(path).remarks == ()


def test_a_link_beside_that_leads_elsewhere_is_refused(tmp_path):
    (tmp_path / "a").mkdir()
    path = write(tmp_path / "a", np.zeros((4, 4), bool))
    (tmp_path / "a" / "plan.pgm").rename(tmp_path / "plan.pgm")
    (tmp_path / "a" / "plan.pgm").symlink_to(tmp_path / "plan.pgm")
    path.write_text(path.read_text().replace("image: plan.pgm", "image: /maps/plan.pgm"))
    with pytest.raises(MapError, match="lies outside its folder"):
        read_map(path)


def saved_by_map_saver(folder: Path, thresholds: str, kind: str = "pgm") -> Path:
    """Write a map of 7 unknown, 3 occupied and 10 free pixels, as map_saver does; return its YAML file."""
    shades = np.array([205] * 7 + [0] * 3 + [254] * 10, np.uint8).reshape(4, 5)
    picture = Image.fromarray(shades.astype(np.uint16) * 257 if kind == "16 bit" else shades)
    name = "plan.pgm" if kind == "pgm" else "plan.png"
    (picture.convert("RGB") if kind == "RGB" else picture).save(folder / name)
    (folder / "m.yaml").write_text(
        f"image: {name}\nresolution: 0.1\norigin: [0, 0, 0]\nnegate: 0\n{thresholds}"
    )
    return folder / "m.yaml"


@pytest.mark.parametrize("kind", ["L", "RGB"])
def test_the_grey_for_unknown_is_negated_with_the_map(tmp_path, kind):
    path = saved_by_map_saver(tmp_path, "occupied_thresh: 0.65\nfree_thresh: 0.25\n", "png")
    shades = 255 - np.asarray(Image.open(tmp_path / "plan.png"))
    Image.fromarray(shades).convert(kind).save(tmp_path / "plan.png")
    path.write_text(path.read_text().replace("negate: 0", "negate: 1"))
    plan = read_map(path)
    assert [plan.walls(unknown).sum() for unknown in (None, "free", "wall")] == [3, 3, 10]
    (remark,) = plan.remarks_on(None)
    assert "7 pixels of grey 50" in remark


@pytest.mark.parametrize("unknown", ["wall", "free"])
@pytest.mark.parametrize(
    ("shade", "thresholds"),
    [
        (127, "occupied_thresh: 0.65\nfree_thresh: 0.55\n"),
        (204, "occupied_thresh: 0.65\nfree_thresh: 0.25\n"),
        (205, "occupied_thresh: 0.65\nfree_thresh: 0.25\nmode: scale\n"),
        (90, "occupied_thresh: 0.65\nfree_thresh: 0.25\nmode: raw\n"),
    ],
)
def test_unknown_without_an_unknown_pixel_is_reported(tmp_path, shade, thresholds, unknown):
    path = saved_by_map_saver(tmp_path, thresholds)
    shades = np.array([shade] * 7 + [0] * 13, np.uint8).reshape(4, 5)
    Image.fromarray(shades).save(tmp_path / "plan.pgm")
    plan = read_map(path)
    (remark,) = plan.remarks_on(unknown)
    assert f"unknown: {unknown} has no effect" in remark
    assert plan.remarks_on(None) == ()
    saved_by_map_saver(tmp_path, "occupied_thresh: 0.65\nfree_thresh: 0.196\n")
    assert read_map(path).remarks_on(unknown) == ()


def test_pictures_in_other_formats_are_no_damaged_ones(tmp_path):
    path = saved_by_map_saver(tmp_path, "")
    Image.open(tmp_path / "plan.pgm").save(tmp_path / "plan.jpg")
    with pytest.raises(MapError, match="PGM, PPM, PNG and BMP"):
        read_map(tmp_path / "plan.jpg", 0.1)
    path.write_text(path.read_text().replace("plan.pgm", "plan.jpg"))
    with pytest.raises(MapError, match=r"PGM, PNG or BMP picture .*another format"):
        read_map(path)


@pytest.mark.parametrize("kind", ["pgm", "png", "RGB", "16 bit"])
@pytest.mark.parametrize(
    ("thresholds", "unknown", "walls", "words"),
    [
        (
            "occupied_thresh: 0.65\nfree_thresh: 0.25\n",
            None,
            3,
            ("7 pixels of grey 205", "free_thresh", "unknown: wall"),
        ),
        ("occupied_thresh: 0.65\nfree_thresh: 0.25\n", "wall", 10, ("7 pixels of grey 205", "unknown: wall")),
        ("occupied_thresh: 0.65\nfree_thresh: 0.25\n", "free", 3, ()),
        ("occupied_thresh: 0.65\nfree_thresh: 0.196\n", None, 10, ()),
        ("occupied_thresh: 0.65\nfree_thresh: 0.196\n", "free", 3, ()),
        (
            "occupied_thresh: 0.15\nfree_thresh: 0.1\n",
            None,
            10,
            ("7 pixels", "occupied_thresh", "unknown: free"),
        ),
        ("occupied_thresh: 0.15\nfree_thresh: 0.1\n", "free", 3, ("7 pixels", "unknown: free")),
        ("occupied_thresh: 0.65\nfree_thresh: 0.25\nmode: scale\n", None, 3, ()),
        ("occupied_thresh: 0.65\n", "wall", 10, ("free_thresh is missing", "0.25", "7 pixels")),
        (
            "occupied_thresh: 0.65\nfree_threshold: 0.25\n",
            "wall",
            10,
            ("not read: free_threshold", "0.25 is assumed", "7 pixels"),
        ),
    ],
)
def test_map_savers_grey_for_unknown_is_never_air_in_silence(
    tmp_path, kind, thresholds, unknown, walls, words
):
    saved_by_map_saver(tmp_path, thresholds, kind)
    keys = {} if unknown is None else {"unknown": unknown}
    room = rooms(obstacles=[{"kind": "map", "file": "m.yaml", **keys}], size=(0.5, 0.4))
    _, resources = load(room, folder=tmp_path)
    shape = resources.shapes["obstacles[0]"]
    assert isinstance(shape, FloorPlan)
    assert shape.solid.sum() == walls
    facts = resources.facts["obstacles[0]"]
    for text in ("5 x 4 pixels of 0.1 m", "x 0 to 0.5 m", "y 0 to 0.4 m", f"{walls} wall pixels"):
        assert text in facts.text
    said = " ".join(line for line in resources.warnings if line.startswith("obstacles[0]"))
    for word in words:
        assert word in said
    assert ("grey" in said) == any("pixels" in word for word in words)


@pytest.mark.parametrize("name", ["plan.png", "plan.PGM", "plan.bmp"])
def test_a_picture_with_a_resolution_is_a_map(tmp_path, name):
    walls = np.random.default_rng(2).random((10, 8)) < 0.4
    Image.fromarray(np.where(walls, 20, 250).astype(np.uint8).T[::-1]).save(tmp_path / name)
    one = {"kind": "map", "file": name, "resolution": "5 cm"}
    _, resources = load(rooms([one], (0.5, 0.4)), folder=tmp_path)
    found = resources.shapes["obstacles[0]"]
    assert isinstance(found, FloorPlan)
    np.testing.assert_array_equal(found.solid, walls)
    assert found.size == pytest.approx(0.05)
    assert "10 x 8 pixels of 0.05 m, " in resources.facts["obstacles[0]"].text
    assert "(0, 0)" in resources.facts["obstacles[0]"].remarks[0]
    _, resources = load(rooms([one | {"origin": [0.1, 0.0]}], (0.5, 0.4)), folder=tmp_path)
    moved, shift = resources.shapes["obstacles[0]"], np.array([0.1, 0.0])
    at = np.array([[0.025, 0.025], [0.125, 0.225]])
    np.testing.assert_array_equal(moved.inside(at), found.inside(at + shift))
    with pytest.raises(ScenarioError, match=r"obstacles\[0\]: plan.*resolution"):
        load(rooms([{"kind": "map", "file": name}]), folder=tmp_path)
    write(tmp_path, walls)
    with pytest.raises(ScenarioError, match=r"obstacles\[0\]: plan\.yaml: .*resolution"):
        load(rooms([one | {"file": "plan.yaml"}]), folder=tmp_path)


def test_all_keys_of_a_scenario_with_a_map_keep_its_walls(tmp_path):
    """`unknown` has an effect of its own if given: a default that is written out must not be one of its values."""
    saved_by_map_saver(tmp_path, "occupied_thresh: 0.65\nfree_thresh: 0.25\n")
    room = rooms(obstacles=[{"kind": "map", "file": "m.yaml"}], size=(0.5, 0.4))
    scenario = load_scenario(room, folder=tmp_path)
    scenario.to_yaml(tmp_path / "s.yaml", defaults=True)
    shape = load(tmp_path / "s.yaml").resources.shapes["obstacles[0]"]
    assert isinstance(shape, FloorPlan)
    assert shape.solid.sum() == 3


@pytest.mark.parametrize("size", [(10_000, 10_000), (100_000, 100_000)])
@pytest.mark.filterwarnings("error")
def test_large_pictures_are_refused_unread(tmp_path, size):
    """Pillow warns of the first, and raises an error of its own for the second."""
    path = write(tmp_path, np.zeros((4, 4), bool))
    (tmp_path / "plan.pgm").write_bytes(b"P5 %d %d 255\n" % size)
    with pytest.raises(MapError, match=r"pixels.* 50,000,000"):
        read_map(path)


def test_a_turned_map_has_few_edges_of_walls(tmp_path, monkeypatch):
    """Lines are drawn from each of them: of a checkerboard that took minutes and gigabytes."""
    walls = np.indices((40, 40)).sum(axis=0) % 2 == 0
    monkeypatch.setattr(floor_plans, "MOST_RIM", 1000)
    assert plan(tmp_path, walls[:20], (1.0, 2.0), at=(0.0, 0.0, 0.3)).solid.any()
    plan(tmp_path, np.ones((40, 40), bool), (2.0, 2.0), at=(0.0, 0.0, 0.3))
    monkeypatch.setattr(floor_plans, "MOST_RIM", 700)
    with pytest.raises(MapError, match="turned, and has more than 700 pixels at edges of walls"):
        plan(tmp_path, walls, (2.0, 2.0), at=(0.0, 0.0, 0.3))
    assert plan(tmp_path, walls, (2.0, 2.0)).solid.any()


def test_cut_pictures_are_reported(tmp_path):
    """Pictures with other damage are in tests/fuzz."""
    path = write(tmp_path, np.random.default_rng(0).random((40, 30)) < 0.2)
    good = (tmp_path / "plan.pgm").read_bytes()
    Image.open(tmp_path / "plan.pgm").save(tmp_path / "plan.png")
    png = (tmp_path / "plan.png").read_bytes()
    for content in [b"", b"P5 900000 900000 255\n", *(one[:n] for one in (good, png) for n in (5, 30, 200))]:
        (tmp_path / "plan.pgm").write_bytes(content)
        with pytest.raises(MapError):
            read_map(path)


@pytest.mark.parametrize(
    "picture", [b"P5\n" + b"#\n" * 600_000, b"P2 2 2 255\n" + b"#\n" * 2000 + b"0 0 0 0"]
)
def test_comments_of_pictures_are_bounded(tmp_path, picture):
    """Pillow reads comments byte by byte, and in the pixels of a text in quadratic time."""
    path = write(tmp_path, np.zeros((4, 4), bool))
    (tmp_path / "plan.pgm").write_bytes(picture)
    with pytest.raises(MapError, match=r"comments|damaged"):
        read_map(path)
    (tmp_path / "plan.pgm").write_bytes(b"P2 # text\n2 2 #\n255\n0 255 #\n\n255 255")
    assert (read_map(path).pixels == OCCUPIED).sum() == 1


def test_the_picture_is_one_of_the_files_of_a_scenario(tmp_path):
    write(tmp_path, np.zeros((4, 4), bool))
    assert files_of(tmp_path, "plan.yaml") == [tmp_path / "plan.yaml", tmp_path / "plan.pgm"]
    assert image_of(tmp_path / "none.yaml") is None


# ---------------------------------------------------------------- position


@pytest.mark.parametrize("quarters", [0, 1, 2, 3, -1])
def test_a_map_lies_as_its_origin_says(tmp_path, quarters):
    """Turned by a quarter it is exact; points of the domain are taken to pixels by hand."""
    walls = np.random.default_rng(9).random((9, 7)) < 0.3
    at = (0.33, 0.41, quarters * np.pi / 2)
    found = plan(tmp_path, walls, (1.2, 1.1), 0.1, at)
    places = np.random.default_rng(1).random((500, 2)) * [1.2, 1.1]
    there = (places - at[:2]) @ turn(at[2]) / 0.1
    pixel = np.floor(there).astype(int)
    known = ((pixel >= 0) & (pixel < walls.shape)).all(axis=1)
    wall = np.zeros(len(places), bool)
    wall[known] = walls[tuple(pixel[known].T)]
    np.testing.assert_array_equal(found.inside(places), wall)


def test_unless_reported_its_lower_corner_is_the_domain_s(tmp_path):
    walls = np.zeros((20, 10), bool)
    walls[0] = True
    found = plan(tmp_path, walls, (1.0, 0.5), 0.05, (-7.0, 3.0, 0.0), origin=None)
    assert found.inside(np.array([[0.02, 0.3], [0.06, 0.3]])).tolist() == [True, False]
    np.testing.assert_allclose(found.reach, [[-7.0, 3.0], [-6.0, 3.5]])


@pytest.mark.parametrize("yaw", [0.0, 0.4])
def test_distances_are_those_to_the_nearest_pixel(tmp_path, yaw):
    walls = np.random.default_rng(3).random((30, 24)) < 0.05
    found = plan(tmp_path, walls, (2.0, 1.8), 0.05, (0.3, 0.2, yaw))
    places = np.random.default_rng(4).random((400, 2)) * [2.0, 1.8]
    solid = found.solid
    assert abs(solid.sum() * found.size**2 / (walls.sum() * 0.05**2) - 1.0) < (1e-9 if yaw == 0.0 else 0.35)

    def to(kind: np.ndarray) -> np.ndarray:
        middle = found.corner + found.size * (np.argwhere(kind) + 0.5)
        beyond = np.maximum(np.abs(places[:, None] - middle) - found.size / 2, 0.0)
        return np.linalg.norm(beyond, axis=-1).min(axis=1)

    expected = np.where(to(solid) > 0.0, to(solid), -to(~solid))
    margin = places - found.corner, found.corner + found.size * np.array(solid.shape) - places
    within = np.minimum(*margin).min(axis=1) > -found.size / 2
    assert 100 < within.sum() < 400
    for got in (found.signed_distance(places), found.horizontal_distance(places, 0.0, 0.3)):
        air = within & (expected > 0.0)
        np.testing.assert_allclose(got[air], expected[air], atol=1e-9)
        np.testing.assert_allclose(got[within & ~air], expected[within & ~air], atol=0.4 * found.size)
        assert (got <= expected + 1e-9)[expected > 0.0].all()  # beyond the map never more than the truth
        assert (got[~within] > 0.5 * expected[~within]).all()


# ---------------------------------------------------------------- cells


def test_thick_walls_cut_cells_exactly(tmp_path):
    walls = np.zeros((40, 20), bool)
    walls[13:31, 5:11] = True  # x 0.325 to 0.775, y 0.125 to 0.275
    volume, (along_x, along_y) = plan(tmp_path, walls, (1.0, 0.5), 0.025).shares((10, 5), 0.1)
    assert (1.0 - volume).sum() * 0.01 == pytest.approx(0.45 * 0.15)
    np.testing.assert_allclose(volume[3], [1.0, 1 - 0.75 * 0.75, 1 - 0.75 * 0.75, 1.0, 1.0])
    np.testing.assert_allclose(along_x[5], [1.0, 0.25, 0.25, 1.0, 1.0])
    np.testing.assert_allclose(along_y[:, 2], [1, 1, 1, 0.25, 0, 0, 0, 0.25, 1, 1])


def test_in_3_d_walls_are_drawn_out(tmp_path):
    walls = np.zeros((20, 12), bool)
    walls[10:12] = True  # x 0.5 to 0.6
    found = plan(tmp_path, walls, (1.0, 0.6, 0.5), height=0.25)
    volume, area = found.shares((10, 6, 5), 0.1)
    np.testing.assert_allclose(volume[5, 3], [0.0, 0.0, 0.5, 1.0, 1.0], atol=1e-9)
    np.testing.assert_allclose(area[0][5, 3], [0.0, 0.0, 0.5, 1.0, 1.0], atol=1e-9)
    np.testing.assert_allclose(area[2][5, 3], [1.0, 0.0, 0.0, 1.0, 1.0, 1.0])
    low = found.horizontal_distance(np.array([[0.2, 0.3]]), 0.0, 0.3)
    assert low[0] == pytest.approx(0.3)
    assert found.horizontal_distance(np.array([[0.2, 0.3]]), 0.25, 0.3)[0] == np.inf
    nodes = np.stack(np.meshgrid(*[np.arange(0.0, n, 0.05) for n in (1.0, 0.6, 0.5)], indexing="ij"), axis=-1)
    each = np.array([found.signed_distance(nodes[:, :, k].reshape(-1, 3)) for k in range(nodes.shape[2])])
    np.testing.assert_allclose(found.signed_distance(nodes).reshape(-1, nodes.shape[2]).T, each)


def thin_walls(rng: np.random.Generator, shape: tuple[int, int]) -> np.ndarray:
    """Ways of one pixel through a map, which may go over corners."""
    walls = np.zeros(shape, bool)
    for _ in range(12):
        place, way = rng.random(2) * shape, rng.normal(size=2)
        for _ in range(400):
            way += 0.1 * rng.normal(size=2)
            place = place + 0.9 * way / np.abs(way).max()
            if not ((place >= 0) & (place < shape)).all():
                break
            walls[tuple(place.astype(int))] = True
    return walls


@pytest.mark.parametrize("seed", range(8))
def test_what_cells_exchange_has_a_way_between_the_pixels(tmp_path, seed):
    """Cells several pixels wide; beside it the parts into which the pixels' own neighbours fall."""
    rng = np.random.default_rng(seed)
    walls = thin_walls(rng, (90, 70))
    at = (*rng.uniform(-0.3, 0.0, 2), 0.0)
    extent, dx = (3.0, 2.4), (0.1, 0.12, 0.2, 0.075)[seed % 4]
    grid = Grid((round(extent[0] / dx), round(extent[1] / dx)), dx)
    found = plan(tmp_path, walls, grid.extent, 0.04, at)
    air = air_of([found], grid)
    regions = air.regions()
    free = np.pad(~found.solid, 1, constant_values=True)
    label = np.kron(ndimage.label(free)[0], np.ones((8, 8), int))  # type: ignore[index]
    places = (np.argwhere(label >= 0) + 0.5) * found.size / 8 + found.corner - found.size
    cell = np.floor(places / dx).astype(int)
    inside = ((places >= 0) & (places < grid.extent)).all(axis=1)
    label = label.ravel()
    touched: dict[int, set[int]] = {}
    for region in range(1, regions.max() + 1):
        here = inside & (label > 0)
        here[here] = regions[tuple(cell[here].T)] == region
        whole, parts = cell[here][:, 0] * grid.shape[1] + cell[here][:, 1], label[here]
        only = [set(parts[whole == one]) for one in np.unique(whole)]
        touched[region] = {
            part for one in only if len(one) == 1 for part in one
        }  # cells that touch one part alone
    assert all(len(parts) <= 1 for parts in touched.values()), touched
    assert sum(map(bool, touched.values())) > 1


def are_parted(part: np.ndarray, side: np.ndarray, margin: float) -> bool:
    """Return whether no part lies on both sides of a wall; side: distance from the wall."""
    left, right = (set(part[side * sign > margin]) - {0} for sign in (-1, 1))
    return bool(left) and bool(right) and not left & right


@pytest.mark.parametrize("yaw", [0.0, 0.1, 0.7, -1.2, np.pi / 4])
@pytest.mark.parametrize("dx", [0.05, 0.1, 0.23])
def test_a_wall_one_pixel_thick_parts_the_air(tmp_path, yaw, dx):
    """The wall has any direction, and its level set has no gap for puffs either."""
    walls = np.zeros((200, 200), bool)
    walls[100] = True  # 2.5 cm
    grid = Grid((round(2.0 / dx), round(1.6 / dx)), dx)
    middle = np.array(grid.extent) / 2 + [0.013, 0.021]
    at = (*(middle - turn(yaw) @ [2.5125, 2.5]), yaw)
    found = plan(tmp_path, walls, grid.extent, 0.025, at)
    air = air_of([found], grid)
    assert are_parted(air.regions(), (grid.centers() - middle) @ turn(yaw)[:, 0], dx)
    of_film = sealed(replace(air, sealed=()), [found], grid)
    np.testing.assert_array_equal(signed_distance(of_film, grid), signed_distance(air, grid))
    free = signed_distance(air, grid) > 0.0
    part = ndimage.label(free, np.ones((3, 3)))[0]  # type: ignore[index]
    nodes = np.stack(np.meshgrid(*[np.arange(n) * dx / 2 for n in free.shape], indexing="ij"), axis=-1)
    assert are_parted(part, (nodes - middle) @ turn(yaw)[:, 0], 1.5 * dx)


def test_a_wall_on_a_face_of_the_domain_shuts_it(tmp_path):
    walls = np.zeros((40, 24), bool)
    walls[0, :12] = True
    air = air_of([plan(tmp_path, walls, (1.0, 0.6), 0.025)], Grid((10, 6), 0.1))
    np.testing.assert_array_equal(air.area[0][0], [0, 0, 0, 1, 1, 1])
    assert (air.volume[0, :3] > 0.0).all()


def test_the_walls_in_rectangles_are_all_of_them(tmp_path):
    walls = np.random.default_rng(7).random((50, 40)) < 0.4
    found = plan(tmp_path, walls, (2.5, 2.0))
    boxes = found.rectangles(10**6)
    area = (boxes[:, 2:] - boxes[:, :2]).prod(axis=1).sum()
    assert area == pytest.approx(walls.sum() * 0.0025)
    places = np.random.default_rng(8).random((500, 2)) * [2.5, 2.0]
    inside = ((places[:, None] > boxes[:, :2]) & (places[:, None] < boxes[:, 2:])).all(axis=-1)
    np.testing.assert_array_equal(np.any(inside, axis=1), found.inside(places))
    assert len(found.rectangles(20)) <= 20


# ---------------------------------------------------------------- a run

ROOM = """
duration: 20
tick: 0.5
domain: {size: [2.0, 1.2], spacing: 0.1}
wind:
  kind: cfd
  openings: [{kind: inlet, face: y-, center: [0.4], size: [0.4], speed: 0.2}, {kind: outlet, face: y+}]
obstacles: [{kind: map, file: plan.yaml}]
gas: {kind: mixture, parts: [
  {kind: eulerian, species: ethanol, sources: [{position: [0.4, 0.6], rate: 1 mg/s}]},
  {kind: puffs, species: acetone, handover: false, fluctuation: 0.2, sources: [{position: [0.6, 0.6], rate: 1 mg/s}]}]}
robots: [{count: 1, start: {kind: positions, positions: [[0.15, 0.15]]}, algorithm: {kind: random_walk}}]
"""


def slanted(folder: Path, gap: int = 0) -> None:
    """A wall of one pixel, 2.5 cm, from the lower to the upper edge of the room; of it so many pixels are missing."""
    walls = np.zeros((80, 48), bool)
    x, y = np.linspace(33, 47, 400), np.linspace(0, 47.99, 400)
    walls[x.astype(int), y.astype(int)] = True
    walls[:, 20 : 20 + gap] = False
    write(folder, walls, 0.025, (-3.0, 5.0, 0.0))
    (folder / "room.yaml").write_text(ROOM)


@pytest.mark.usefixtures("taichi")
@pytest.mark.slow
def test_neither_air_nor_gas_nor_robots_go_through_a_thin_wall(tmp_path):
    slanted(tmp_path)
    sim = assemble(load_scenario(tmp_path / "room.yaml"), tmp_path)
    sim.run()
    assert isinstance(sim.air, Air)
    right = sim.grid.centers()[..., 0] > 1.35
    speed = [sim.grid.read(u)[right] for u in sim.wind.u]
    assert sim.wind.diagnostics()["max_speed"] > 0.2
    assert max(np.abs(u).max() for u in speed) < 1e-5
    ethanol, acetone = sim.gas.gases
    grid_gas = sim.grid.read(ethanol.c)
    assert grid_gas[right].max() == 0.0
    assert grid_gas[~right].max() > 0.0
    puffs = acetone.puffs.rows()
    assert len(puffs) > 50
    assert puffs[:, 0].max() < 1.2
    start = np.array([[0.84, 0.05], [0.95, 0.3]])
    assert (sim.swarm.clearance.distance_at(start) < np.array([0.02, 0.1])).all()


def test_checks_of_a_map(tmp_path):
    slanted(tmp_path)
    assert not load(tmp_path / "room.yaml").resources.warnings
    cases = {
        "obstacles.0.origin=[5, 5]": r"obstacles\[0\]\.origin: the map lies outside the domain: it has x -3 to -1 m",
        "obstacles.0.file=none.yaml": r"obstacles\[0\]: none\.yaml: no such file",
        "robots.0.start.positions=[[1.05, 0.6]]": r"robots\[0\]\.start.* (obstacle|touches)",
        "gas.parts.0.sources.0.position=[1.01, 0.61]": r"gas\.parts\[0\]\.sources\[0\]\.position: ",
    }
    for override, reported in cases.items():
        with pytest.raises(ScenarioError, match=reported):
            load(tmp_path / "room.yaml", [override])
    remarks = load(tmp_path / "room.yaml", ["domain.size=[3, 2]"]).resources.warnings
    assert any("domain.size of 2 x 1.2 m with an origin of [-3, 5]" in remark for remark in remarks)
