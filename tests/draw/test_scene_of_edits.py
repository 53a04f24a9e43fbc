"""A scene that takes over what an edit left alone is that of the text, whatever the edits were."""

import random
import re

import numpy as np
import pytest

pytest.importorskip("bokeh", reason="the extra draw is not installed")

from test_document import ROOT

from taichi_plume.draw import edits
from taichi_plume.draw.document import EditError, delete, duplicate, set_value
from taichi_plume.draw.objects import scene
from taichi_plume.draw.workplace import Workplace
from taichi_plume.guard.yaml_text import LineError
from taichi_plume.report.theme import ABOVE

CONFIGS = (
    "casting_room",
    "arena_3d",
    "heated_room",
    "moving_obstacle",
    "sensor_network",
    "spiral_room",
    "whiffs",
)
MESH = "solid s\n facet normal 0 0 1\n outer loop\n {}\n endloop\n endfacet\nendsolid s\n"


def seen(of):
    """All that a scene shows."""

    def plain(part):
        if part is None:
            return None
        drawn = [part.drawn(plane) for plane in of.planes]
        return (
            part.model,
            part.within,
            repr([([(p.tolist(), c) for p, c in lines], at) for lines, at in drawn]),
        )

    return of.text, of.data, of.room, [(t.path, t.name, t.color, t.mark, plain(t.part)) for t in of.things]


def edited(rng, text, of):
    """Text after a random edit: by the pointer, of a number or a word of the text, or half typed."""
    placed = [thing for thing in of.things if thing.part is not None]
    thing = rng.choice(placed) if placed else None
    kind = rng.randrange(7)
    if kind == 0 and thing is not None and thing.handles(ABOVE):
        to = (rng.uniform(0, 3), rng.uniform(0, 3))
        return edits.move_handle(text, of, thing.path, rng.choice(sorted(thing.handles(ABOVE))), ABOVE, to)
    if kind == 1 and thing is not None and thing.path.endswith("]"):
        return rng.choice((delete, duplicate))(text, thing.path)
    if kind == 2:
        return set_value(text, f"domain.size[{rng.randrange(2)}]", rng.choice(("4 m", 5, 3.5, "wide")))
    if kind == 3:
        return set_value(
            text, rng.choice(("wind.kind", "gas.kind")), rng.choice(("cfd", "uniform", "eulerian", "x"))
        )
    spots = list(re.finditer(r"\d+(\.\d+)?" if kind < 6 else r"[\w.]+", text))
    spot = rng.choice(spots)
    new = (
        rng.choice(("0.4", "1", "2.25", "-3")) if kind < 6 else rng.choice(("box", "[", "", "x: {", "center"))
    )
    return text[: spot.start()] + new + text[spot.end() :]


@pytest.mark.parametrize("name", CONFIGS)
def test_a_scene_of_random_edits_is_that_of_the_text(tmp_path, name):
    (tmp_path / "s.yaml").write_text((ROOT / f"configs/{name}.yaml").read_text())
    place, rng, shared = Workplace(tmp_path, tmp_path / "s.yaml"), random.Random(name), 0
    for _ in range(60):
        before = {id(thing.part) for thing in place.scene.things if thing.part is not None}
        try:
            place.put(edited(rng, place.text, place.scene))
        except (EditError, LineError):
            continue
        fresh = scene(place.text, tmp_path)
        if fresh.room is None or rng.randrange(4) == 0:  # the plan of a text that is no YAML stays
            if fresh.data:
                assert seen(place.scene) == seen(fresh)
            place.undo()
            fresh = scene(place.text, tmp_path)
        assert seen(place.scene) == seen(fresh)
        shared += any(id(thing.part) in before for thing in place.scene.things)
    assert shared > 10, "parts are taken over"


def test_a_file_of_an_obstacle_is_read_again_once_it_is_there(tmp_path):
    (tmp_path / "s.yaml").write_text(
        "domain: {size: [4, 3], spacing: 0.1}\nobstacles: [{kind: mesh, file: m.stl, translate: [1, 1, 0]}]\n"
    )
    place = Workplace(tmp_path, tmp_path / "s.yaml")
    assert place.scene.things[-1].part is None
    cells = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], float)
    faces = [cells[[a, b, c]] for a, b, c in ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2))]
    facets = (
        MESH.format("\n ".join("vertex " + " ".join(map(str, corner)) for corner in face)) for face in faces
    )
    whole = "".join(facets).replace("endsolid s\nsolid s\n", "")
    (tmp_path / "m.stl").write_text(whole)
    place.put(place.text + "# the file has come\n")
    points = place.scene.things[-1].outlines(ABOVE)[0].points
    assert (np.nanmin(points), np.nanmax(points)) == pytest.approx((1.0, 2.0), abs=0.01)
