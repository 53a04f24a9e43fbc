"""Openings that obstacles cover, on the grid of the run: refused where nearly all is covered, else their open share."""

import numpy as np
import pytest
import yaml
from PIL import Image

from taichi_plume.assembly.assemble import _box
from taichi_plume.assembly.preparation import load
from taichi_plume.scenario.loading import ScenarioError
from taichi_plume.solvers.openings import patch_of

MAP = "image: plan.pgm\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
KINDS = {
    "inlet": {"kind": "inlet", "speed": 0.3},
    "outlet": {"kind": "outlet"},
    "fan": {"kind": "fan", "speed": 0.3},
    "honeycomb": {"kind": "honeycomb", "speed": 0.3},
}


def prepared(folder, obstacle, spacing=0.1, kind="inlet", size=(2.0, 1.0), **opening):
    scenario = {
        "duration": 60,
        "domain": {"size": list(size), "spacing": spacing},
        "wind": {
            "kind": "cfd",
            "openings": [KINDS[kind] | {"face": "x-"} | opening, {"kind": "outlet", "face": "x+"}],
        },
        "gas": {"kind": "eulerian", "sources": [{"position": [s / 2 for s in size], "rate": 1e-6}]},
        "obstacles": [obstacle],
    }
    if kind == "outlet":
        scenario["wind"]["openings"][1] = {"kind": "inlet", "face": "x+", "speed": 0.3}
    (folder / "room.yaml").write_text(yaml.safe_dump(scenario))
    return load(folder / "room.yaml")


def plan(folder, door=slice(0, 0)):
    """A map of a room of 2 x 1 m with walls of one pixel, 5 cm; in those of both ends a door."""
    walls = np.zeros((40, 20), bool)
    walls[[0, -1]] = True
    walls[[0, -1], door] = False
    Image.fromarray(np.where(walls, 0, 254).astype(np.uint8).T[::-1]).save(folder / "plan.pgm")
    (folder / "plan.yaml").write_text(MAP)
    return {"kind": "map", "file": "plan.yaml"}


def warnings(prepared):
    return [one for one in prepared.resources.warnings if "openings[0]" in one and "open" in one]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("spacing", [0.1, 0.05, 0.2])
def test_walls_of_a_map_seal_an_opening_on_any_grid(tmp_path, kind, spacing):
    with pytest.raises(
        ScenarioError, match=r"wind.openings\[0\]: obstacles cover it.* 0 of 0?\.?\d* m² are open"
    ):
        prepared(tmp_path, plan(tmp_path), spacing, kind)


@pytest.mark.parametrize("spacing", [0.1, 0.05])
def test_a_door_is_the_open_share_of_the_face(tmp_path, spacing):
    (note,) = warnings(prepared(tmp_path, plan(tmp_path, slice(4, 12)), spacing))
    assert "40 %" in note
    assert "2.5 times as fast" in note


@pytest.mark.parametrize(
    ("obstacle", "size", "share"),
    [
        ({"kind": "box", "center": [0.1, 0.25], "size": [0.2, 0.5]}, (2.0, 1.0), 50),
        ({"kind": "box", "center": [0.01, 0.25], "size": [0.02, 0.5]}, (2.0, 1.0), None),
        ({"kind": "cylinder", "center": [0.0, 0.5], "radius": 0.3}, (2.0, 1.0), 40),
        ({"kind": "box", "center": [0.1, 0.5, 0.2], "size": [0.2, 1.0, 0.4]}, (2.0, 1.0, 0.8), 50),
        ({"kind": "cylinder", "center": [1.5, 0.5], "radius": 0.3}, (2.0, 1.0), None),
        ({"kind": "cylinder", "center": [0.4, 0.5], "radius": 0.3}, (2.0, 1.0), None),
    ],
)
def test_a_part_that_is_covered_is_noted(tmp_path, obstacle, size, share):
    notes = warnings(prepared(tmp_path, obstacle, size=size))
    assert len(notes) == (share is not None)
    assert all(f"{share} %" in one for one in notes)


@pytest.mark.parametrize(
    ("door", "obstacle"),
    [
        (slice(4, 11), None),
        (slice(4, 12), None),
        (None, [0.06, 0.7]),
        (None, [0.02, 0.4]),
        (None, [0.2, 0.36]),
        (None, [0.08, 0.33]),
    ],
)
def test_the_share_is_that_of_the_faces_through_which_the_run_blows(tmp_path, door, obstacle):
    size = obstacle or [0.0, 0.0]
    box = {"kind": "box", "center": [size[0] / 2, size[1] / 2], "size": size}
    case = prepared(tmp_path, box if obstacle else plan(tmp_path, door))
    (grid, air), opening = _box(case.scenario, case.resources), case.scenario.wind.openings[0]
    open_share = patch_of(opening, grid, air.area).covered.mean()
    notes = warnings(case)
    assert len(notes) == (open_share < 0.9)
    assert all(f"{100 * open_share:.0f} %" in one for one in notes)


@pytest.mark.parametrize("thickness", [0.02, 0.2])
def test_a_box_over_all_of_an_opening_is_refused(tmp_path, thickness):
    box = {"kind": "box", "center": [thickness / 2, 0.5], "size": [thickness, 1.0]}
    with pytest.raises(ScenarioError, match=r"wind.openings\[0\]: obstacles cover it"):
        prepared(tmp_path, box)
