"""Ways by a map: to what it knows least, or where a measurement gains most over the cost."""

import numpy as np
import pytest
from arena import TICK, Run, Script
from numpy.testing import assert_array_equal
from saved import assert_plain
from scipy.sparse.csgraph import dijkstra

from taichi_plume.agents.least_known import _ways
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


# ---------------------------------------------------------------- criteria of the gain

FIELD = {"kind": "gmrf", "cell": 0.25, "memory": None}


def wall_run(criterion, field=FIELD):
    """Two robots left of a wall that is open at the top, after the first readings of their map."""
    wall = Box(kind="box", center=(2.0, 1.2), size=(0.1, 2.4))
    standing = shape(wall, Domain(size=SIZE, spacing=0.05), None)  # type: ignore[arg-type]
    model = LeastKnown.model_validate(
        {"kind": "least_known", "criterion": criterion, "map": field, "avoidance": 0.05}
    )
    run = Run(model, Script([1.0], 1.0), ((0.4, 0.4), (0.9, 0.4)), 1, SIZE, obstacles=(standing,))
    run.go(3)
    return run


def chosen(algorithm, gain, place=(1.6, 0.4)):
    goal = np.array([[3.9, 2.9], [0.1, 0.1]])
    algorithm._choose_gain(0, 0, gain, np.array(place), goal)
    return goal[0]


@pytest.fixture(scope="module")
def walled(taichi):
    return wall_run("variance").algorithm


def test_the_gain_counts_over_the_way_around_obstacles(walled):
    """The same gain on both sides of the wall: the far side is 0.8 m away, but the way there is longer than 4 m."""
    gain = np.zeros(len(walled.places))
    behind, beside = (np.linalg.norm(walled.places - at, axis=1).argmin() for at in ((2.4, 0.4), (0.4, 2.4)))
    gain[[behind, beside]] = 1.0
    np.testing.assert_array_equal(chosen(walled, gain), walled.places[beside])
    gain[behind] = 2.0
    np.testing.assert_array_equal(chosen(walled, gain), walled.places[behind])


def test_lengths_are_those_of_the_eight_neighbours():
    """On a free floor: the shorter difference along diagonals, the rest straight."""
    ways = dijkstra(_ways(np.ones((6, 9), bool), 0.5), indices=2 * 9 + 3).reshape(6, 9)
    i, j = np.abs(np.indices((6, 9)) - np.array([2, 3])[:, None, None])
    np.testing.assert_allclose(ways, 0.5 * (np.maximum(i, j) + (np.sqrt(2.0) - 1.0) * np.minimum(i, j)))


def test_gains_of_the_criteria(walled, monkeypatch):
    mean, variance = np.full((1, *walled.map.shape), 3.0), np.full((1, *walled.map.shape), 4.0)
    variance[0, 0, 0], mean[0, 1, 1] = np.nan, -9.0
    monkeypatch.setattr(walled.map, "estimate", lambda: mean)
    monkeypatch.setattr(walled.map, "variance", lambda: variance)
    monkeypatch.setattr(walled, "free", np.ones(walled.map.shape, bool))
    for criterion, expected in (("variance", 4.0), ("upper_bound", 3.0 + 2.0 * 2.0)):
        monkeypatch.setitem(vars(walled.model), "criterion", criterion)
        gain = walled._gain(slice(0, 1)).reshape(walled.map.shape)
        assert gain[0, 0] == np.inf
        assert gain[5, 5] == expected
        assert gain[1, 1] == (4.0 if criterion == "variance" else 0.0)


def test_information_is_the_drop_of_the_summed_variance_after_a_reading():
    """Against the map itself, which is given a reading at each of some cells in turn."""
    algorithm = wall_run("information").algorithm
    field = algorithm.map
    cells = np.flatnonzero(algorithm.free)[::25]
    gain = algorithm._information(0, cells)
    before = np.nansum(field.variance())
    past = list(field.past)
    for cell, expected in zip(cells, gain, strict=True):
        field.past = [*past, [field.ended * 1.0, np.array([cell]), np.ones(1), np.ones(1)]]
        field._solved = None
        np.testing.assert_allclose(before - np.nansum(field.variance()), expected, rtol=1e-6)


@pytest.mark.parametrize("field", [FIELD, {"kind": "kernel_dmv", "cell": 0.25}], ids=["gmrf", "kernel_dmv"])
@pytest.mark.slow
def test_robots_go_behind_the_wall_to_measure(field):
    run = wall_run("variance", field)
    tracks = run.go(60)[1]
    assert tracks[..., 0].max() > 2.2
