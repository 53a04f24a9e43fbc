"""Sizes of runs, bodies of many corners and of files, and beliefs: checks that are more than a message."""

from types import SimpleNamespace

import numpy as np
import pytest
from test_loading import load as scenario
from test_meshes import box_triangles, write_stl
from test_messages import FLOOR, ROOM, said

from taichi_plume.files.run_folder import to_yaml
from taichi_plume.scenario import size as checks_size
from taichi_plume.scenario.size import estimate


def test_an_open_mesh_is_reported_with_a_place(tmp_path):
    open_box = box_triangles((1.8, 0.9, 0), (2.2, 1.1, 0.3))[:-2]  # without its lid
    file = write_stl(tmp_path / "open.stl", open_box)
    lines = said(tmp_path, ROOM, f"obstacles.0={{kind: mesh, file: {file}}}")
    assert len(lines) == 1
    assert lines[0].startswith("obstacles[0]: open.stl: body 0 is not watertight: 4 open")
    near = np.array(lines[0].split("near (")[1].split(")")[0].split(", "), float)
    edges = np.array([[2.0, 0.9, 0.3], [2.0, 1.1, 0.3], [1.8, 1.0, 0.3], [2.2, 1.0, 0.3]])
    assert np.linalg.norm(edges - near, axis=1).min() < 1e-3  # the middle of an edge of the lid


def test_memory_is_checked_before_anything_is_allocated(tmp_path, monkeypatch):
    room = scenario(tmp_path, ROOM)
    monkeypatch.setattr(checks_size.psutil, "virtual_memory", lambda: SimpleNamespace(available=1e6))
    lines = said(tmp_path, ROOM)
    assert len(lines) == 1
    spacing = float(lines[0].split("a spacing of ")[1].split(" m")[0])
    assert 0.05 < spacing < 0.5
    domain = room.domain.model_copy(update={"spacing": spacing})
    coarse = room.model_copy(update={"domain": domain})
    assert estimate(coarse)["bytes"] < 1e6


def test_polygons_of_many_corners_are_checked(tmp_path):
    def prism(corners):
        return f"obstacles.1={{kind: prism, vertices: {corners.tolist()}}}"

    angle = np.linspace(0, 2 * np.pi, 300, endpoint=False)
    radius = 0.25 + 0.02 * np.cos(5 * angle)
    corners = np.stack([3 + radius * np.cos(angle), 2 + radius * np.sin(angle)], axis=1)
    assert said(tmp_path, ROOM, prism(corners)) == []
    corners[[100, 101]] = corners[[101, 100]]
    (line,) = said(tmp_path, ROOM, prism(corners))
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


@pytest.mark.parametrize("kind", ["infotaxis", "space_aware_infotaxis", "hit_map"])
def test_beliefs_that_never_get_sure_cannot_declare(tmp_path, kind):
    found = scenario(tmp_path, FLOOR, f"robots.0.algorithm={{kind: {kind}, cell: 0.6}}")
    assert not found.robots[0].algorithm.may_declare
    assert scenario(tmp_path, to_yaml(found)) == found, "written out, nothing more is asked for"
