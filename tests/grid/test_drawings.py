"""Floor plans from CAD drawings, written by ezdxf: walls stand where their lines do, in metres."""

import numpy as np
import pytest
from ezdxf import filemanagement, units

from taichi_plume.assembly.preparation import load
from taichi_plume.grid.drawings import read_drawing
from taichi_plume.grid.map_files import OCCUPIED, MapError
from taichi_plume.scenario.loading import ScenarioError

ROOM = [(-1.0, 2.0), (3.0, 2.0), (3.0, 5.0), (-1.0, 5.0)]  # m
METRES = {units.MM: 1e-3, units.CM: 1e-2, units.M: 1.0, units.IN: 0.0254}


def drawing(path, unit=units.MM, version="R2010"):
    """A room with a partition, a round table, a hatched pillar, a block and a text, on three layers."""
    document = filemanagement.new(version)
    document.units = unit
    size = METRES.get(unit, 1.0)
    for name in ("walls", "furniture", "notes"):
        document.layers.add(name)
    space = document.modelspace()

    def at(*points):
        return [(x / size, y / size) for x, y in points]

    space.add_lwpolyline(at(*ROOM), close=True, dxfattribs={"layer": "walls"})
    space.add_line(*at((1.0, 2.0), (1.0, 4.0)), dxfattribs={"layer": "walls"})
    space.add_circle(at((2.0, 3.5))[0], 0.4 / size, dxfattribs={"layer": "furniture"})
    hatch = space.add_hatch(dxfattribs={"layer": "walls"})
    hatch.paths.add_polyline_path(at((-0.5, 2.5), (0.0, 2.5), (0.0, 3.0), (-0.5, 3.0)), is_closed=True)
    door = document.blocks.new("door")
    door.add_line((0, 0), (0.5 / size, 0), dxfattribs={"layer": "furniture"})
    space.add_blockref("door", at((1.0, 4.5))[0], dxfattribs={"rotation": 90, "layer": "furniture"})
    space.add_text("office", dxfattribs={"layer": "notes"})
    document.saveas(path)
    return path


def walls(plan):
    """Middles of the wall pixels [m]."""
    return np.array(plan.origin) + plan.resolution * (np.argwhere(plan.pixels == OCCUPIED) + 0.5)


def away(points):
    """Distance of points to the lines of the drawing by their closed forms; 0 within the pillar."""

    def line(a, b):
        a, b = np.array(a), np.array(b)
        along = np.clip(((points - a) @ (b - a)) / ((b - a) @ (b - a)), 0, 1)
        return np.linalg.norm(points - a - along[:, None] * (b - a), axis=1)

    edges = [line(a, b) for a, b in zip(ROOM, [*ROOM[1:], ROOM[0]], strict=True)]
    circle = np.abs(np.linalg.norm(points - [2.0, 3.5], axis=1) - 0.4)
    pillar = np.linalg.norm(np.maximum(np.abs(points - [-0.25, 2.75]) - 0.25, 0), axis=1)
    return np.min([*edges, line((1, 2), (1, 4)), line((1, 4.5), (1, 5.0)), circle, pillar], axis=0)


@pytest.mark.parametrize("unit", METRES)
@pytest.mark.parametrize("version", ["R2000", "R2018"])
def test_walls_stand_where_lines_do_in_every_unit(tmp_path, unit, version):
    plan = read_drawing(drawing(tmp_path / "plan.dxf", unit, version), 0.02, (), None)
    assert plan.text.startswith("drawing plan.dxf in ")
    pixels = walls(plan)
    assert away(pixels).max() < 0.02
    dense = np.stack(
        np.meshgrid(np.arange(-1.0, 3.0, 0.01), np.arange(2.0, 5.0, 0.01), indexing="ij"), -1
    ).reshape(-1, 2)
    lines = dense[away(dense) < 1e-9]
    apart = np.abs(lines[:, None] - pixels[None]).max(axis=-1).min(axis=1)
    assert apart.max() < 0.02 * 1.01
    assert any("TEXT" in remark for remark in plan.remarks)


def test_layers_are_chosen_and_hidden_ones_left_out(tmp_path):
    path = drawing(tmp_path / "plan.dxf")
    table = walls(read_drawing(path, 0.02, ("Furniture",), None))
    assert np.abs(np.linalg.norm(table[table[:, 0] > 1.2] - [2.0, 3.5], axis=1) - 0.4).max() < 0.02
    document = filemanagement.readfile(path)
    document.layers.get("furniture").off()
    document.saveas(path)
    plan = read_drawing(path, 0.02, (), None)
    assert not (np.linalg.norm(walls(plan) - [2.0, 3.5], axis=1) < 0.5).any()
    assert "layers that are off or frozen are left out: furniture" in plan.remarks
    with pytest.raises(MapError, match=r"has no layer 'wals'; it has .*walls"):
        read_drawing(path, 0.02, ("wals",), None)


def test_a_drawing_without_a_unit_needs_a_scale(tmp_path):
    path = drawing(tmp_path / "plan.dxf", unit=0)
    with pytest.raises(MapError, match=r"states no unit .*give scale"):
        read_drawing(path, 0.02, (), None)
    plan = read_drawing(path, 0.02, (), 0.5)
    np.testing.assert_allclose(walls(plan).min(axis=0), 0.5 * np.array(ROOM[0]), atol=0.011)
    (tmp_path / "bad.dxf").write_text("0\nSECTION\n2\nnothing")
    for keys in ({"file": "bad.dxf"}, {"file": "plan.dxf"}, {"file": "none.dxf"}):
        with pytest.raises(MapError, match=keys["file"]):
            read_drawing(tmp_path / keys["file"], 0.02, (), None)


def test_a_drawing_is_an_obstacle(tmp_path):
    drawing(tmp_path / "plan.dxf")
    wall = {"kind": "map", "file": "plan.dxf", "resolution": "2 cm", "origin": [-1, 2]}
    scenario = {
        "duration": 1,
        "domain": {"size": [4, 3], "spacing": 0.1},
        "obstacles": [wall],
        "wind": {"kind": "synthetic"},
        "gas": {"kind": "eulerian", "sources": [{"position": [1.2, 1.0], "rate": 1e-6}]},
    }
    _, resources = load(scenario, folder=tmp_path)
    assert resources.obstacles[0].inside(np.array([[2.0, 1.0], [0.75, 0.75], [1.5, 1.0]])).tolist() == [
        True,
        True,
        False,
    ]
    assert "x -1.01 to 3.01 m" in resources.facts["obstacles[0]"].text
    with pytest.raises(ScenarioError, match=r"obstacles\[0\]: plan.dxf: is a drawing; give resolution"):
        load(scenario | {"obstacles": [{"kind": "map", "file": "plan.dxf"}]}, folder=tmp_path)
