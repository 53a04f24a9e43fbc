"""The random walk: straight legs, uniform turns, and another direction at a bump."""

import numpy as np
import pytest
from arena import TICK, Run, Script

from taichi_plume.agents.random_walk import BUMP, WALK
from taichi_plume.scenario.algorithms import RandomWalk

pytestmark = pytest.mark.usefixtures("taichi")

AIR = [0.0]


def legs(track):
    """The straight parts of a track (ticks, 2), end minus begin."""
    moving = np.linalg.norm(np.diff(track, axis=0), axis=1) > 1e-4
    edges = np.flatnonzero(np.diff(np.concatenate([[0], moving, [0]])))
    return np.array([track[end] - track[begin] for begin, end in edges.reshape(-1, 2)])


def test_legs_have_their_length_and_any_direction():
    run = Run(RandomWalk(kind="random_walk"), Script(AIR, 1.0), ((25, 25),), 60, (50.0, 50.0))
    _, tracks = run.go(60)
    ways = [legs(tracks[:, n])[:-1] for n in range(60)]  # the last is not complete
    lengths = np.concatenate([np.linalg.norm(way, axis=1) for way in ways])
    assert len(lengths) > 300
    assert lengths.min() > 0.5 - 1e-3
    assert lengths.max() < 1.5 + 1e-3
    assert lengths[: 60 * 4].mean() == pytest.approx(1.0, abs=0.08)
    courses = np.concatenate([np.arctan2(way[:, 1], way[:, 0]) for way in ways])
    for harmonic in (1, 2):
        assert np.abs(np.exp(1j * harmonic * courses).mean()) < 3.5 / np.sqrt(len(courses))
    assert (run.swarm.state.to_numpy() == WALK).all()


def test_turns_can_be_small():
    run = Run(
        RandomWalk(kind="random_walk", turn_angle_deg=30), Script(AIR, 1.0), ((25, 25),), 20, (50.0, 50.0)
    )
    _, tracks = run.go(60)
    for n in range(20):
        way = legs(tracks[:, n])
        course = np.unwrap(np.arctan2(way[:, 1], way[:, 0]))
        assert np.abs(np.diff(course)).max() < np.radians(30) + 1e-3


def test_walls_are_left_again():
    """In a narrow room of 1.5 m they bump a lot, and still visit all of it."""
    run = Run(RandomWalk(kind="random_walk"), Script(AIR, 1.0), ((0.75, 0.75),), 20, (1.5, 1.5))
    states, tracks = run.go(300)
    assert (states == BUMP).any(axis=0).all()
    assert run.swarm.bumps.to_numpy().min() > 10
    counts, *_ = np.histogram2d(*tracks.reshape(-1, 2).T, bins=5, range=[[0.085, 1.415]] * 2)
    assert counts.min() > 0.2 * counts.mean()
    still = np.linalg.norm(np.diff(tracks, axis=0), axis=-1) < 1e-4
    assert np.lib.stride_tricks.sliding_window_view(still, round(30 / TICK), axis=0).all(axis=-1).sum() == 0


def test_a_trial_alone_is_the_same_as_among_many():
    _, among = Run(RandomWalk(kind="random_walk"), Script(AIR, 1.0), trials=6).go(40)
    _, alone = Run(RandomWalk(kind="random_walk"), Script(AIR, 1.0), trials=1, first_trial=4).go(40)
    assert (alone[:, 0] == among[:, 4]).all()
    assert (among[:, 0] != among[:, 1]).any()
