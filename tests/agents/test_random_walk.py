"""The random walk: straight legs, uniform turns, and another direction at a bump."""

import numpy as np
import pytest
from arena import TICK, Run, Script

from taichi_plume.agents.random_walk import BUMP, WALK
from taichi_plume.scenario.algorithms import RandomWalk

pytestmark = pytest.mark.usefixtures("taichi")

AIR = [0.0]
MODEL = RandomWalk(kind="random_walk")


@pytest.fixture(scope="module")
def outside(taichi):
    """Tracks of 60 robots, and of 20 that turn by at most 30°, far from any wall; and the states of all."""
    rivals = [
        {"algorithm": MODEL, "trials": 60},
        {"algorithm": RandomWalk(kind="random_walk", turn_angle_deg=30), "trials": 20},
    ]
    run = Run(rivals, Script(AIR, 1.0), ((25, 25),), size=(50.0, 50.0))
    states, tracks = run.go(60)
    return tracks[:, run.of(0)], tracks[:, run.of(1)], states


@pytest.fixture(scope="module")
def inside(taichi):
    """20 robots in a narrow room of 1.5 m."""
    return Run(MODEL, Script(AIR, 1.0), ((0.75, 0.75),), 20, (1.5, 1.5))


def legs(track):
    """The straight parts of a track (ticks, 2), end minus begin."""
    moving = np.linalg.norm(np.diff(track, axis=0), axis=1) > 1e-4
    edges = np.flatnonzero(np.diff(np.concatenate([[0], moving, [0]])))
    return np.array([track[end] - track[begin] for begin, end in edges.reshape(-1, 2)])


def test_legs_have_their_length_and_any_direction(outside):
    tracks, _, states = outside
    ways = [legs(tracks[:, n])[:-1] for n in range(60)]  # the last is not complete
    lengths = np.concatenate([np.linalg.norm(way, axis=1) for way in ways])
    assert len(lengths) > 300
    assert lengths.min() > 0.5 - 1e-3
    assert lengths.max() < 1.5 + 1e-3
    assert lengths[: 60 * 4].mean() == pytest.approx(1.0, abs=0.08)
    courses = np.concatenate([np.arctan2(way[:, 1], way[:, 0]) for way in ways])
    for harmonic in (1, 2):
        assert np.abs(np.exp(1j * harmonic * courses).mean()) < 3.5 / np.sqrt(len(courses))
    assert (states[-1] == WALK).all()


def test_turns_can_be_small(outside):
    _, tracks, _ = outside
    for n in range(20):
        way = legs(tracks[:, n])
        course = np.unwrap(np.arctan2(way[:, 1], way[:, 0]))
        assert np.abs(np.diff(course)).max() < np.radians(30) + 1e-3


def test_walls_are_left_again(inside):
    """They bump a lot, and still visit all of the room."""
    inside.begin(MODEL)
    states, tracks = inside.go(300)
    assert (states == BUMP).any(axis=0).all()
    assert inside.swarm.bumps.to_numpy().min() > 10
    counts, *_ = np.histogram2d(*tracks.reshape(-1, 2).T, bins=5, range=[[0.085, 1.415]] * 2)
    assert counts.min() > 0.2 * counts.mean()
    still = np.linalg.norm(np.diff(tracks, axis=0), axis=-1) < 1e-4
    assert np.lib.stride_tricks.sliding_window_view(still, round(30 / TICK), axis=0).all(axis=-1).sum() == 0
