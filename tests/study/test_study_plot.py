"""Figures of a study from Python: over an axis, into a user's axes, in a user's size."""

import made_study
import numpy as np
import pytest
from matplotlib.figure import Figure

from taichi_plume.guard.input_error import InputError
from taichi_plume.scenario import palette


@pytest.fixture
def results(tmp_path):
    plan = made_study.plan(airs=4)
    make = made_study.searches(0, lambda values, _: 0.9 if values["speed"] < 0.6 else 0.1, 4)
    return made_study.published(tmp_path, plan, made_study.records(plan, make))


def test_a_study_is_drawn_over_an_axis(results):
    """The line goes through the means of the table of points."""
    axes = Figure().subplots()
    results.plot("speed", ax=axes)
    line = axes.lines[0]
    trials = results.trials()
    searched = trials[trials.searched]
    means = searched.groupby("speed").success.mean()
    np.testing.assert_allclose(np.asarray(line.get_xdata(), float), means.index, atol=1e-9)
    np.testing.assert_allclose(np.asarray(line.get_ydata(), float), 100 * means.to_numpy(float), rtol=1e-9)
    assert line.get_color() == palette.ROBOTS[0]
    by = Figure().subplots()
    results.plot("speed", "time_s", "algorithm of all", ax=by)
    assert [text.get_text() for text in by.get_legend().get_texts()] == ["casting", "spiral/50 %"]
    assert tuple(results.plot(figsize=(4, 3)).get_size_inches()) == (4, 3)
    bars = Figure().subplots()
    results.plot("algorithm of all", ax=bars)
    assert [text.get_text() for text in bars.get_yticklabels()] == ["casting", "spiral/50 %"]


@pytest.mark.parametrize(
    ("given", "key"),
    [({"x": "sped"}, "x"), ({"quantity": "succes"}, "quantity"), ({"x": "speed", "by": "speed"}, "by")],
)
def test_an_unknown_axis_is_refused_with_those_there_are(results, given, key):
    with pytest.raises(InputError, match=f"{key}: got .*; allowed are .*") as error:
        results.plot(**given)
    assert len(error.value.lines) == 1
