"""Ways by the weights of a map: to what it knows least."""

import numpy as np
import pytest
from arena import TICK, Run, Script
from numpy.testing import assert_array_equal
from saved import assert_plain

from taichi_plume.grid.state import State
from taichi_plume.scenario.algorithms import LeastKnown, RandomWalk
from taichi_plume.scenario.domain import Domain
from taichi_plume.scenario.obstacles import Box
from taichi_plume.scenario.shapes import shape

pytestmark = pytest.mark.usefixtures("taichi")

AIR = [0.0]
CORNER = ((3.4, 0.4), (3.7, 0.4), (3.4, 0.8), (3.7, 0.8))
SIZE = (4.0, 3.0)


@pytest.mark.slow
def test_the_floor_is_covered_better_than_by_a_random_walk():
    """Share of the squares of 0.5 m in which a robot has been, in each of 4 trials, and their ages at the end [s]."""
    rivals = [{"algorithm": LeastKnown(kind="least_known")}, {"algorithm": RandomWalk(kind="random_walk")}]
    run = Run(rivals, Script(AIR, 1.0), CORNER, 4, SIZE)
    tracks = run.go(120)[1]
    i, j = np.moveaxis((tracks / 0.5).astype(int), -1, 0)
    last = np.zeros((8, 8, 6))
    for tick in range(len(tracks)):
        last[np.repeat(np.arange(8), 4), i[tick], j[tick]] = (tick + 1) * TICK
    (shares, walked), (ages, walked_ages) = np.split((last > 0).mean(axis=(1, 2)), 2), np.split(120 - last, 2)
    assert shares.min() > walked.max()
    assert shares.min() > 0.9
    assert ages.mean() < 0.8 * walked_ages.mean()


MODEL = LeastKnown(kind="least_known", apart=0.6)
OPTIONS = {"size": SIZE, "heading_deg": None}


@pytest.fixture(scope="module")
def begun(taichi):
    """Three teams after 30 s; they differ in the robots' headings at the start."""
    run = Run(MODEL, Script(AIR, 1.0), CORNER, 3, **OPTIONS)
    run.go(30)
    return run


def test_team_mates_go_to_different_places(begun):
    run = begun
    for _ in range(8):
        run.go(5)
        goal = run.algorithm.goal.to_numpy().reshape(3, 4, 2)
        apart = np.linalg.norm(goal[:, :, None] - goal[:, None], axis=-1) + 9.0 * np.eye(4)
        assert apart.min() >= 0.6 - 1e-5


def test_the_next_way_point_is_of_the_least_known(begun, monkeypatch):
    algorithm = begun.algorithm
    monkeypatch.setattr(algorithm, "share", 0.2)
    weight = np.arange(len(algorithm.places), dtype=float)
    goal = np.zeros((1, 2))
    algorithm._choose(weight, np.array([[1.0, 1.0]]), goal, np.ones(1), algorithm.home[0])
    chosen = np.flatnonzero((algorithm.places == goal[0]).all(axis=1))
    assert chosen[0] <= 0.2 * len(weight)


def test_it_goes_on_from_the_middle_of_a_snap(begun):
    """Its map too; in between it drives elsewhere, through other snaps."""
    run = begun
    run.go(2.3)
    restore = run.saved()
    assert_plain(State(run).save())
    _, rest = run.go(16)
    run.go(21)
    restore()
    assert_array_equal(run.go(16)[1], rest)


@pytest.mark.slow
def test_what_cannot_be_reached_is_left_alone():
    """A wall from end to end: the floor behind it is known least, and nobody goes there."""
    wall = Box(kind="box", center=(2.5, 1.5), size=(0.1, 3.0))
    standing = shape(wall, Domain(size=SIZE, spacing=0.05), None)  # type: ignore[arg-type]
    places = ((0.4, 0.4), (0.9, 0.4), (0.4, 0.9))
    run = Run(LeastKnown(kind="least_known"), Script(AIR, 1.0), places, 2, SIZE, obstacles=(standing,))
    for _ in range(10):
        run.go(4)
        goal = run.algorithm.goal.to_numpy()
        assert goal[:, 0].max() < 2.4


def test_each_trial_goes_by_its_own_map(begun, monkeypatch):
    """Among rivals a group's trials have other rows of the map than their numbers."""
    run = begun
    algorithm = run.algorithm
    weights = np.ones((4, *algorithm.map.shape))
    weights[1, :4], weights[2, 12:] = 0.0, 0.0  # each knows one end of the floor less
    monkeypatch.setattr(algorithm, "row", 1)
    monkeypatch.setattr(algorithm.map, "weight", lambda: weights)
    monkeypatch.setattr(algorithm, "apart", 0.5)
    start = np.tile(CORNER, (3, 1))
    for field in (run.swarm.position, algorithm.goal):
        field.from_numpy(start)  # all of them are there, and ask
    run.go(TICK)
    goal = algorithm.goal.to_numpy().reshape(3, 4, 2)
    assert (goal[0, :, 0] < 1.0).all()
    assert (goal[1, :, 0] > 3.0).all()
