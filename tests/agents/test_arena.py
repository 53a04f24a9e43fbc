"""Robots may be kept to a part of the floor: there they search as in a room of that size."""

import numpy as np
import pytest
from arena import Run, Script

pytestmark = pytest.mark.usefixtures("taichi")

LOW = (1.0, 0.5)  # of the part, exact in f32
PLACES = ((0.5, 0.5), (1.5, 1.0), (2.5, 1.5))


def tracks(kind, low, seconds=60):
    places = [(x + low[0], y + low[1]) for x, y in PLACES]
    gas = Script(np.tile([0.0, 3.0, 40.0, 8.0], 20), 3.0)
    return Run({"kind": kind}, gas, places, 4, low=low).go(seconds)[1] - low


@pytest.mark.parametrize("kind", ["random_walk", "sweep", "lineup", "infotaxis", "dapso", "spiral"])
@pytest.mark.slow
def test_an_arena_is_a_room_of_its_own(kind):
    within, room = tracks(kind, LOW), tracks(kind, (0.0, 0.0))
    assert np.abs(within - room).max() < 0.02  # places are rounded elsewhere
    assert np.ptp(room, axis=0).max() > 0.5


def test_edges_of_an_arena_stop_robots():
    way = tracks("random_walk", LOW, 120)
    assert (way >= 0.085).all()
    assert (way <= np.array([3.0, 2.1]) - 0.085).all()
    assert way.min() < 0.09  # one has come there
