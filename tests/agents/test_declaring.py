"""What robots say of the source's place, and who judges it."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import taichi as ti

from taichi_plume.agents.swarm import Swarm
from taichi_plume.grid.clearance import ClearanceMap
from taichi_plume.running.job import whole
from taichi_plume.scenario.algorithms import Casting
from taichi_plume.scenario.robots import Group
from taichi_plume.scenario.starts import StartAt

pytestmark = pytest.mark.usefixtures("taichi")

SOURCES = np.array([[3.0, 1.0], [1.0, 2.5]])


def group(name, found):
    at = StartAt(kind="positions", positions=((0.5, 0.5),), heading_deg=0.0)
    return Group(name=name, count=1, start=at, algorithm=Casting(kind="casting"), found=found)


@ti.data_oriented
class Says:
    """Lets each robot declare a place."""

    def __init__(self, swarm):
        self.swarm = swarm

    @ti.kernel
    def at(self, t: float, places: ti.types.ndarray(dtype=ti.f32, ndim=2)):
        for i in range(places.shape[0]):
            self.swarm.declare(i, ti.Vector([places[i, 0], places[i, 1]]), t)


@pytest.fixture
def swarm():
    starts = np.full((2, 2), 0.5), np.zeros(2)
    clearance = ClearanceMap([], (4.0, 3.0), 0.2)
    groups = [group("free", "reached"), group("ends", "declared")]
    return Swarm(groups, *starts, clearance, SOURCES, 0, rivals=True)


def test_words_are_judged(swarm):
    say = Says(swarm).at
    for t, place in enumerate([(2.0, 2.0), (3.2, 1.1), (0.1, 0.1)], 1):
        say(float(t), np.full((2, 2), place, np.float32))
    told = swarm.snapshot()
    assert told["declarations"].tolist() == [3, 1]  # of the other the first word was the last
    assert told["false_declarations"].tolist() == [2, 1]
    assert told["declared_position"] == pytest.approx(np.array([[3.2, 1.1], [2.0, 2.0]]))
    assert told["declared_time"].tolist() == [2.0, 1.0]
    assert told["found"].tolist() == [False, False]
    assert not swarm.all_over()  # the first may still come to the source


def test_an_end_without_a_find_is_called_so(swarm):
    over: Any = SimpleNamespace(swarm=swarm, tick=30, last_tick=90, t=3.0)
    swarm.found.fill(1)
    assert whole(over) == ("stopped", "every robot had found a source at t = 3.0 s", 0)
    swarm.found.fill(0)
    assert whole(over) == ("stopped", "no robot searched any more at t = 3.0 s", 0)


def test_a_true_word_finds(swarm):
    Says(swarm).at(4.0, np.array([[1.0, 2.5], [1.0, 2.2]], np.float32))
    told = swarm.snapshot()
    assert told["found"].tolist() == [False, True]
    assert told["found_time"][1] == 4.0
    assert np.isnan(told["reached_time"]).all()


def test_where_words_find_reaching_does_not(swarm):
    swarm.begin([one.model for one in swarm.groups], SOURCES - 0.1, np.zeros(2), SOURCES, 0)
    swarm.move(1, 0.1, 0.1)
    told = swarm.snapshot()
    assert told["reached_time"] == pytest.approx(0.1)
    assert told["found"].tolist() == [True, False]
    assert swarm.snapshot()["declarations"].tolist() == [0, 0]
