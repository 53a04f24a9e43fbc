"""What robots say of the source's place, and who judges it."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from robots import group

from taichi_plume.agents.swarm import Swarm
from taichi_plume.execution.execute import whole
from taichi_plume.grid.clearance import ClearanceMap

pytestmark = pytest.mark.usefixtures("taichi")

SOURCES = np.array([[3.0, 1.0], [1.0, 2.5]])


@pytest.fixture
def swarm():
    starts = np.full((2, 2), 0.5), np.zeros(2)
    clearance = ClearanceMap([], (4.0, 3.0), 0.2)
    groups = [group(name=name, found=name) for name in ("reached", "declared")]
    return Swarm(groups, *starts, clearance, SOURCES, 0, rivals=True)


def test_words_are_judged(swarm):
    for t, place in enumerate([(2.0, 2.0), (3.2, 1.1), (0.1, 0.1)], 1):
        swarm.declare_all(0, np.full((2, 2), place), float(t))
    swarm.declare_all(0, np.full((2, 2), np.nan), 9.0)  # nobody does
    reported = swarm.snapshot()
    assert reported["declarations"].tolist() == [3, 1]  # of the other the first word was the last
    assert reported["false_declarations"].tolist() == [2, 1]
    assert reported["declared_position"] == pytest.approx(np.array([[3.2, 1.1], [2.0, 2.0]]))
    assert reported["declared_time"].tolist() == [2.0, 1.0]
    assert reported["found"].tolist() == [False, False]
    assert not swarm.all_over()  # the first may still come to the source


def test_an_end_without_a_find_is_called_so(swarm):
    over: Any = SimpleNamespace(swarm=swarm, tick=30, last_tick=90, t=3.0)
    swarm.found.fill(1)
    assert whole(over)[:3] == ("stopped", "every robot had found a source at t = 3.0 s", 0)
    swarm.found.fill(0)
    assert whole(over)[:3] == ("stopped", "no robot searched any more at t = 3.0 s", 0)


def test_a_true_word_finds(swarm):
    swarm.declare_all(0, np.array([[1.0, 2.5], [1.0, 2.2]]), 4.0)
    reported = swarm.snapshot()
    assert reported["found"].tolist() == [False, True]
    assert reported["found_time"][1] == 4.0
    assert np.isnan(reported["reached_time"]).all()


def test_where_words_find_reaching_does_not(swarm):
    groups = [one.model for one in swarm.groups]
    swarm = Swarm(groups, SOURCES - 0.1, np.zeros(2), swarm.clearance, SOURCES, 0)
    swarm.move(1, 0.1, 0.1)
    reported = swarm.snapshot()
    assert reported["reached_time"] == pytest.approx(0.1)
    assert reported["found"].tolist() == [True, False]
    assert swarm.snapshot()["declarations"].tolist() == [0, 0]
