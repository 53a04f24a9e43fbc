"""Figures drawn into a user's axes, or in a user's size, as matplotlib, pandas and xarray draw them."""

from types import SimpleNamespace
from typing import Any

import made_run
import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure

from taichi_plume.guard.input_error import InputError
from taichi_plume.report import recorded_map, theme
from taichi_plume.results.run import Run


@pytest.fixture
def run(tmp_path) -> Run:
    return Run(made_run.made(tmp_path / "run"), lenient=True)


def test_a_run_is_drawn_into_axes_of_the_user(run):
    """Beside another plot, which stays as it is; the legend names what is drawn."""
    with mpl.rc_context({"font.size": 20}):
        figure = Figure(figsize=(9, 4))
        left, right = figure.subplots(1, 2)
        right.plot([1, 2], [3, 4])
        before = [right.get_position().bounds, right.get_xlim(), len(right.lines)]
        assert run.plot(at=5, ax=left) is figure
        assert mpl.rcParams["font.size"] == 20
    assert [right.get_position().bounds, right.get_xlim(), len(right.lines)] == before
    assert np.asarray(left.images[0].get_array()).max() == pytest.approx(made_run.pixels(12).max(), abs=1)
    texts = [text.get_text() for text in left.legend().get_texts()]
    assert {"source", "pair 0", "pair 1", "wind"} <= set(texts)
    assert left.get_title(loc="left") == "t = 5.0 s"
    assert figure.axes[2].get_ylabel() == "ethanol [ppm]"


@pytest.mark.parametrize("size", [(3.5, 3.0), (12, 3), (4, 12)])
def test_figures_have_the_size_that_is_asked_for(run, size):
    model = made_run.scenario(3)
    for figure in (run.plot(figsize=size), made_run.scenario().plot(figsize=size), model.plot(figsize=size)):
        figure.canvas.draw()
        assert tuple(figure.get_size_inches()) == size
        for axes in figure.axes:
            box = axes.get_tightbbox().transformed(figure.transFigure.inverted())
            assert min(box.x0, box.y0, 1 - box.x1, 1 - box.y1) > -0.02


@pytest.mark.parametrize("size", [(1, 5), (5, 1), (0, 3), (float("nan"), 3), (3,), "ab", (4, 1e9)])
def test_a_size_that_cannot_be_is_refused_in_a_line(run, size):
    for draw in (run.plot, made_run.scenario().plot):
        with pytest.raises(InputError, match=r"figsize: got .*; allowed are ") as error:
            draw(figsize=size)
        assert len(error.value.lines) == 1
    with pytest.raises(InputError, match="ax, figsize"):
        run.plot(ax=Figure().subplots(), figsize=(4, 4))


def test_a_scene_and_a_map_are_drawn_into_axes_of_the_user():
    figure = Figure()
    scene, map_axes = figure.subplots(1, 2)
    assert made_run.scenario(3).plot(ax=scene) is figure
    assert scene.get_ylabel() == "y [m]"
    ppm, places = np.array([[3.0, 4.0, 5.0], [6.0, 7.0, 8.0]]), np.array([[0.1, 0.2]])
    gas_map: Any = SimpleNamespace(
        estimate=ppm,
        weight=ppm,
        variance=None,
        size=(1.0, 1.5),
        cell=0.5,
        readings=SimpleNamespace(place=places),
    )
    assert recorded_map.figure(gas_map, theme.Place.of(map_axes, None)) is figure
    np.testing.assert_array_equal(map_axes.images[0].get_array(), ppm.T)
    assert tuple(recorded_map.figure(gas_map, theme.Place.of(None, (8, 3))).get_size_inches()) == (8, 3)
