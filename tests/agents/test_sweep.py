"""Lanes: they cover the floor, each robot has its share, and robots follow them."""

from itertools import pairwise

import numpy as np
import pytest
from arena import Run, Script
from scipy.spatial import cKDTree

from taichi_plume.agents.potential import NEAR
from taichi_plume.agents.sweep import DONE, SWEEP, TRANSIT, lanes
from taichi_plume.scenario.algorithms import Sweep

pytestmark = pytest.mark.usefixtures("taichi")

ROOM = 0.085 + 0.05


def along_way(way, step=0.01):
    """Points every `step` along way points (k, 2)."""
    parts = []
    for begin, end in pairwise(way):
        count = 2 + int(np.linalg.norm(end - begin) / step)
        parts.append(begin + np.linspace(0, 1, count)[:, None] * (end - begin))
    return np.concatenate(parts)


def farthest(points, size, room, axis):
    """Largest distance from the floor to the points; at the lanes' ends only as far as a robot can get."""
    low, high = np.zeros(2), np.array(size)
    low[axis], high[axis] = room, size[axis] - room
    grid = np.stack(np.meshgrid(*(np.linspace(low[d], high[d], 150) for d in range(2))), axis=-1)
    return cKDTree(points).query(grid.reshape(-1, 2))[0].max()


@pytest.mark.parametrize("size", [(4.0, 3.0), (3.0, 4.0), (6.1, 1.3)])
@pytest.mark.parametrize("count", [1, 2, 5])
@pytest.mark.parametrize("along", [None, "x", "y"])
def test_lanes_cover_the_floor(size, count, along):
    team = np.random.default_rng(count).uniform(0.3, 1.0, (count, 2))
    axis, number = Sweep(kind="sweep", lane=0.4, along=along).lanes(size, count)
    assert axis == {"x": 0, "y": 1, None: int(np.argmax(size))}[along]
    ways = lanes(team, size, axis, number, 0.1)
    points = np.concatenate([along_way(way) for way in ways])
    assert farthest(points, size, 0.1, axis) < 0.2 + 1e-3
    used = np.concatenate([way[::2, 1 - axis] for way in ways])
    gaps = np.diff(np.sort(used))
    assert len(np.unique(used)) == len(used)  # no lane twice
    assert gaps == pytest.approx(np.full(len(gaps), size[1 - axis] / len(used)))
    assert np.ptp([len(way) // 2 for way in ways]) <= 1  # fair shares
    for way in ways:
        assert way[::2, 1 - axis] == pytest.approx(way[1::2, 1 - axis])  # along the axis
        assert np.abs(np.diff(way[:, 1 - axis])).max() < 0.4 + 1e-9  # to the next lane


def test_blocks_and_first_corners_are_near():
    team = np.array([[3.8, 2.8], [0.2, 0.2], [3.8, 1.4]])
    ways = lanes(team, np.array([4.0, 3.0]), 0, 12, 0.1)
    assert ways[0][0] == pytest.approx((3.9, 2.875))
    assert ways[1][0] == pytest.approx((0.1, 0.125))
    assert ways[2][0, 0] == pytest.approx(3.9)


def test_robots_cover_the_floor():
    """Those of one trial, and those of three."""
    size, teams = (3.0, 2.1), 4
    model = Sweep(kind="sweep", lane=0.3, repeat=False)
    rivals = [{"algorithm": model, "trials": trials} for trials in (1, 3)]
    run = Run(rivals, Script([0.0], 1.0), ((0.3, 0.3), (0.3, 0.6), (0.6, 0.3)), size=size)
    states, tracks = run.go(90)
    assert (states[0] == TRANSIT).all()
    assert (states == SWEEP).any(axis=0).all()
    assert (states[-1] == DONE).all()
    assert np.abs(tracks[-1] - tracks[-5]).max() == 0
    for k in range(teams):
        points = tracks[:, 3 * k : 3 * k + 3].reshape(-1, 2)
        assert farthest(points, size, ROOM + NEAR, 0) < 0.15 + 0.02
        team = tracks[:, 3 * k : 3 * k + 3]
        apart = np.linalg.norm(team[:, :, None] - team[:, None], axis=-1) + 9 * np.eye(3)
        assert apart.min() > 2 * 0.085
    # 7 lanes of 2.73 m for three: three of them and a step of 0.3 m between at 0.2 m/s
    longest = 3 * (3.0 - 2 * ROOM) + 2 * 0.3
    assert longest / 0.2 < (states == SWEEP).sum(axis=0).max() * 0.1 < longest / 0.2 + 6 * 3


def test_a_repeated_sweep_goes_back_and_forth():
    model = Sweep(kind="sweep", lane=0.5)
    _, tracks = Run(model, Script([0.0], 1.0), ((0.2, 0.2),), size=(1.5, 1.2)).go(150)
    at_last = np.linalg.norm(tracks[:, 0] - [1.5 - ROOM, 1.0], axis=-1) < 0.1
    at_first = np.linalg.norm(tracks[:, 0] - [ROOM, 0.2], axis=-1) < 0.1
    order = [visit for visit in np.where(at_last, 1, np.where(at_first, -1, 0)) if visit]
    assert np.count_nonzero(np.diff(order)) >= 3
