import io
from pathlib import Path

import made_run
import numpy as np
import pytest
from matplotlib.colors import to_rgb
from PIL import Image

from taichi_plume.assembly.preparation import checked
from taichi_plume.report import scene, theme

SPHERE = {"kind": "sphere", "center": [1.0, 0.5, 0.7], "radius": 0.2}


def seen(axes, x: float, y: float) -> np.ndarray:
    """Colour (3,) 0 to 1 of the drawing at a place."""
    picture = np.asarray(Image.open(io.BytesIO(theme.png(axes.figure))).convert("RGB"), float) / 255
    column, row = axes.transData.transform((x, y))
    return picture[round(len(picture) - 1 - row), round(column)]


def drawn(model, plane=theme.ABOVE, shapes=None, **how):
    axes = theme.figure(8, 6).add_subplot()
    scene.draw(axes, model, shapes, plane=plane, **how)
    axes.figure.canvas.draw()
    return axes


def is_solid(color) -> bool:
    return np.allclose(color, to_rgb(theme.SOLID), atol=0.02)


def test_obstacles_are_where_they_are():
    axes = drawn(made_run.scenario(), sizes=False)
    assert [is_solid(seen(axes, 3.2 + x, 2.4)) for x in (0.0, 0.17, 0.23)] == [True, True, False]


def test_from_the_side_heights_count():
    box = {"kind": "box", "center": [3, 2, 0.2], "size": [1, 1, 0.4]}
    model = made_run.scenario(3, obstacles=[SPHERE, box])
    axes = drawn(model, theme.SIDE, sizes=False)
    assert [is_solid(seen(axes, 1.0, z)) for z in (0.7, 0.3)] == [True, False]
    assert [is_solid(seen(axes, 2.6, z)) for z in (0.3, 0.5)] == [True, False]
    axes = drawn(model, theme.FRONT, sizes=False)
    assert is_solid(seen(axes, 0.5, 0.7))


def tetrahedron(path: Path) -> Path:
    """Corners at the origin and 1 m along each axis."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    faces = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
    lines = [f"v {x} {y} {z}" for x, y, z in corners] + [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces]
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize("dim", [2, 3])
def test_a_mesh_is_drawn_by_its_outline(tmp_path, dim):
    tetrahedron(tmp_path / "t.obj")
    mesh = {"kind": "mesh", "file": "t.obj", "translate": [1.5, 0.5, 0.0], "section": 0.5}
    prepared = checked(made_run.scenario(dim, obstacles=[mesh]), tmp_path)
    axes = drawn(prepared.scenario, shapes=scene.all_shapes(prepared), sizes=False)
    assert is_solid(seen(axes, 1.65, 0.65))
    assert is_solid(seen(axes, 2.0, 0.8)) == (dim == 3)  # the section half way up is half as large
    assert not is_solid(seen(axes, 2.2, 1.2))


CFD = {
    "kind": "cfd",
    "openings": [
        {"kind": "fan", "face": "x-", "center": [1.0], "diameter": 0.5, "speed": 1.0},
        {"kind": "outlet", "face": "x+"},
        {"kind": "wall", "face": "y+", "velocity": [0.5, 0]},
    ],
    "screens": [{"kind": "honeycomb", "axis": "x", "at": 0.8}],
}


def test_names_and_sizes_are_written_and_are_no_mathematics():
    model = made_run.scenario(wind=CFD)
    group = model.robots[0].model_copy(update={"name": r"$\frac{1}{0}$ <b>"})
    axes = drawn(model.model_copy(update={"robots": (group,)}))
    reported = " ".join(text.get_text() for text in axes.texts)
    expected = (
        "cylinder ⌀ 0.4 m",
        "source, 1 mg/s",
        "fan 1 m/s",
        "outlet",
        "honeycomb",
        r"$\frac{1}{0}$ <b>",
    )
    assert not [words for words in expected if words not in reported]
    assert not [text for text in drawn(model, sizes=False).texts if text.get_text()]


def test_arrows_point_where_air_goes():
    """Air comes in from the left by the fan, and leaves to the right."""
    axes = drawn(made_run.scenario(wind=CFD))
    arrows = [one for one in axes.patches if type(one).__name__ == "FancyArrowPatch"]
    ways = [np.subtract(*one._posA_posB[::-1]) for one in arrows]
    assert len(ways) > 3
    assert all(way[0] > 0 and way[1] == 0 for way in ways)


@pytest.mark.parametrize("dim", [2, 3])
def test_the_check_writes_a_picture(tmp_path, dim):
    prepared = checked(made_run.scenario(dim), tmp_path)
    scene.save_check(prepared, tmp_path / "scene.png")
    width, height = Image.open(tmp_path / "scene.png").size
    assert 800 < width < 2000
    assert 500 < height < 2500


def test_starts_that_are_drawn_by_lot_and_thousands_of_robots():
    area = {"kind": "area", "low": [2, 0.3], "high": [3.8, 2.7]}
    many = {"name": "many", "count": 3000, "algorithm": {"kind": "casting"}, "start": area}
    many |= {"body": {"radius": 0.01}}
    axes = drawn(made_run.scenario(robots=[many]))
    assert len(axes.patches) < 50
    assert "3000 × many" in " ".join(text.get_text() for text in axes.texts)
