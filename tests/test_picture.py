import io
from pathlib import Path
from typing import Any

import made_run
import numpy as np
import pytest
from PIL import Image
from refusals import unfinished

from taichi_plume.__main__ import main
from taichi_plume.files import manifest
from taichi_plume.report import films, plume, theme
from taichi_plume.results.pictures import wind
from taichi_plume.results.run import Run


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return made_run.made(tmp_path_factory.mktemp("picture") / "run")


@pytest.fixture(scope="module")
def tall(tmp_path_factory) -> Path:
    return made_run.made(tmp_path_factory.mktemp("picture") / "tall", made_run.scenario(3))


@pytest.fixture
def reported(capsys):
    """Exit code, and what was printed."""

    def call(*args: object) -> tuple[int, str]:
        code = main(["picture", *map(str, args)])
        return code, "".join(capsys.readouterr())

    return call


def test_colours_are_those_of_the_scale_where_the_gas_is(folder):
    """The peak's pixel has its colour; where there is none, the floor shows."""
    run = Run(folder, lenient=True)
    one = run.pictures.gas_slice
    figure, view = plume.figure_of(run, one, [], 8, 100, wind=False)
    view.show(6.0, one.values[14])
    image: Any = np.asarray(Image.open(io.BytesIO(theme.png(figure))).convert("RGB"), float)

    def at(x: float, y: float) -> np.ndarray:
        column, row = view.axes.transData.transform((x, y))
        return image[round(len(image) - 1 - row), round(column)]

    level = made_run.pixels(14)[made_run.PEAK] / 255
    np.testing.assert_allclose(at(2.35, 1.15), 255 * np.array(theme.GAS(level)[:3]), atol=8)
    np.testing.assert_allclose(at(0.5, 2.5), 255 * np.array(theme.GAS(0.0)[:3]), atol=2)


def test_a_moment_shows_its_own_frame_robots_and_wind(folder):
    run = Run(folder, lenient=True)
    one = run.pictures.gas_slice
    _, view = plume.figure_of(run, one, run.tracks, 8, 100)
    view.show(4.0, one.values[10], plume.Arrows.of(wind(run, "slice")))
    bodies = [np.asarray(path.vertices).mean(axis=0) for path in view.bodies.get_paths()]
    np.testing.assert_allclose(bodies, [[2.5, 0.5], [2.5, 1.5]], atol=0.05)
    assert [len(np.asarray(path.vertices)) for path in view.trails.get_paths()] == [9, 9]
    assert len(view.arrows.get_paths()) == 8 * 6
    ends = np.asarray(
        view.arrows.get_paths()[0].vertices
    )  # 1.2 times as long as their distance, about its middle
    assert (ends[:, 0].min(), ends[:, 0].max()) == pytest.approx((-0.05, 0.55))
    assert not view.rims.get_paths()
    view.show(8.0, one.values[18])
    (rim,) = view.rims.get_paths()  # the first has found it
    first, _ = view.bodies.get_paths()
    np.testing.assert_array_equal(rim.vertices, first.vertices)


def test_a_picture_is_as_wide_as_asked_for(folder, tmp_path, reported):
    code, said = reported(folder, "--at", 3.2, "--out", tmp_path / "x.png", "--width", 500)
    assert code == 0
    assert "t = 3 s" in said  # the last frame that is not later
    assert Image.open(tmp_path / "x.png").size[0] == 500


def test_by_default_the_end_from_above_here(folder, tmp_path, reported, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert reported(folder)[0] == 0
    assert [file.name for file in tmp_path.iterdir()] == ["run-above-10s.png"]


VIEWS = [("column", "column"), ("side", "section"), ("above", "slice"), (None, "column")]


@pytest.mark.parametrize(("view", "name"), VIEWS)
def test_views_of_a_room(tall, tmp_path, reported, view, name):
    options = ["--view", view] if view else []
    code, said = reported(tall, *options, "--out", tmp_path / "x.png", "--width", 400)
    assert (code, f"gas {name}" in said) == (0, True)


def test_a_film_has_its_frames_and_moves(folder, tmp_path, reported):
    code, said = reported(folder, "--film", tmp_path / "x.gif", "--frames", 5, "--width", 300, "--fps", 10)
    assert code == 0
    assert "5 frames, t = 0 to 10 s" in said
    film = Image.open(tmp_path / "x.gif")
    assert film.n_frames == 5
    assert film.info["duration"] == 100
    frames = []
    for n in range(5):
        film.seek(n)
        frames.append(np.asarray(film.convert("RGB"), int))
    away = [np.abs(frame - frames[0]).max(axis=-1) for frame in frames[1:]]
    assert all((one > 60).sum() > 50 for one in away)
    still = np.abs(frames[4] - frames[0])[-25:]  # the letters below the axis
    assert still.max() < 40


def test_a_frame_of_a_film_is_the_picture_of_that_moment(folder, tmp_path):
    """What is drawn on what stood still is what would have been drawn at once."""
    run = Run(folder, lenient=True)
    one = run.pictures.gas_slice

    def drawn(times: list[int], still: bool) -> np.ndarray:
        figure, view = plume.figure_of(run, one, run.tracks, 6, 80)
        canvas = films.Still(figure, view.moving) if still else figure.canvas
        for n in times:
            view.show(float(one.time[n]), one.values[n], plume.Arrows.of(wind(run, "slice")))
            canvas.draw()
        return np.asarray(canvas.buffer_rgba()).astype(int)

    away = np.abs(drawn([3, 9, 15], True) - drawn([15], False))
    assert (away.max(axis=-1) > 8).mean() < 2e-3


def test_mp4_without_ffmpeg_is_one_line(folder, tmp_path, reported, monkeypatch):
    monkeypatch.setattr(films.animation.FFMpegWriter, "isAvailable", classmethod(lambda cls: False))
    code, said = reported(folder, "--film", tmp_path / "x.mp4")
    assert (code, said.startswith(str(tmp_path / "x.mp4")), said.count("\n")) == (2, True, 1)


def bad_folders(tmp_path: Path) -> dict[str, Path]:
    """Folders of which no picture can be made, with what is reported."""
    bare = made_run.made(tmp_path / "bare", recording=False)
    cut, other, torn = (made_run.made(tmp_path / name) for name in ("cut", "other", "torn"))
    (cut / "pictures.zarr" / "gas_slice" / "c" / "0" / "0" / "0").unlink()
    made_run.reworded(other, frobnicate=3)
    (torn / "robots.parquet").write_bytes(b"PAR1 nothing")
    damage = "robots.parquet: is damaged"
    return {"neither": bare, "gas_slice has 0 of 1": cut, "frobnicate": other, damage: torn}


def test_bad_folders_are_one_line_each(tmp_path, reported):
    for words, bad in bad_folders(tmp_path).items():
        code, said = reported(bad, "--out", tmp_path / "x.png")
        assert (code, said.startswith(str(bad)), words in said, said.count("\n")) == (2, True, True, 1), said
    assert not (tmp_path / "x.png").exists()


@pytest.mark.parametrize(
    ("option", "value", "words"),
    [("--at", -5, "from -1 to 10 s"), ("--at", 20, "from -1 to 10 s"), ("--view", "section", "gas_slice")],
)
def test_a_time_or_view_outside_the_run_is_one_line(folder, reported, option, value, words):
    code, said = reported(folder, option, value)
    assert (code, words in said, said.count("\n")) == (2, True, 1)


def test_a_run_that_goes_on_is_shown_as_far_as_it_is(tmp_path, reported):
    """The rows of robots are in a stream, and result.json says little."""
    folder = made_run.made(tmp_path / "run", content={"name": "made", "status": "running", "seed": 0})
    unfinished(folder / "robots.parquet")
    assert len(Run(folder, lenient=True).tracks) == 2
    code, said = reported(folder, "--out", tmp_path / "x.png", "--width", 300)
    assert code == 0
    assert "t = 10 s" in said


STL = "solid a\n{}endsolid a\n".format(
    "".join(
        "facet normal 0 0 0\nouter loop\n" + "".join(f"vertex {x} {y} {z}\n" for x, y, z in corners)
        + "endloop\nendfacet\n"
        for corners in (((0, 0, 0), (0, 1, 0), (1, 0, 0)), ((0, 0, 0), (1, 0, 0), (0, 0, 1)),
                        ((0, 0, 0), (0, 0, 1), (0, 1, 0)), ((1, 0, 0), (0, 1, 0), (0, 0, 1)))
    )
)  # fmt: skip


@pytest.mark.parametrize("kind", ["map", "mesh"])
def test_walls_of_files_beside_the_scenario_are_drawn_while_they_are_those_of_the_run(
    tmp_path, reported, kind, monkeypatch
):
    """The manifest tells which files the run read; a changed one, or one that it does not name, is not opened."""
    case = tmp_path / "case"
    case.mkdir()
    wall = np.where(np.arange(40) // 3 == 6, 0, 255).astype("u1")[None].repeat(30, 0)
    Image.fromarray(wall).save(case / "wall.png")
    (case / "wall.yaml").write_text("image: wall.png\nresolution: 0.1\norigin: [0, 0, 0]\n")
    (case / "wall.stl").write_text(STL)
    files = [case / "wall.yaml", case / "wall.png"] if kind == "map" else [case / "wall.stl"]
    scenario = made_run.scenario(3, obstacles=[{"kind": kind, "file": f"../case/{files[0].name}"}])
    folder = made_run.made(tmp_path / "run", scenario)
    monkeypatch.chdir(case)
    assert not Run(folder, lenient=True).shapes, "the manifest names no input"
    manifest.write(folder, manifest.digests(folder, files), [])
    run = Run(folder, lenient=True)
    assert (len(run.shapes), run.lacks) == (1, [])
    for changed in files:
        before = changed.read_bytes()
        changed.write_bytes(before[:-1] + b"!")
        code, said = reported(folder, "--at", 5, "--out", tmp_path / "a.png")
        assert (code, "--allow-outside" in said) == (0, True)
        assert not Run(folder, lenient=True).shapes
        changed.write_bytes(before)
    assert len(Run(folder, lenient=True).shapes) == 1


@pytest.mark.parametrize("option", ["--out", "--film"])
def test_a_link_to_a_file_of_the_users_is_replaced_and_not_followed(folder, reported, tmp_path, option):
    mine, out = tmp_path / "mine", tmp_path / ("a.png" if option == "--out" else "a.gif")
    mine.write_text("mine")
    out.symlink_to(mine)
    code, _ = reported(folder, *(["--at", 5] if option == "--out" else ["--frames", 2]), option, out)
    assert (code, out.is_symlink(), mine.read_text()) == (0, False, "mine")
    with Image.open(out) as image:
        assert image.format == out.suffix[1:].upper()
