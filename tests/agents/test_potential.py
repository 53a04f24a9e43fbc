"""Way points among walls, boxes and team mates: the balance of pull and push, gaps, and ways out of local minima."""

import numpy as np
import pytest
import taichi as ti

from taichi_plume.agents.members import Members
from taichi_plume.agents.parameters import Parameters
from taichi_plume.agents.potential import NEAR, Potential
from taichi_plume.agents.swarm import Swarm
from taichi_plume.grid.clearance import ClearanceMap
from taichi_plume.grid.shapes import UprightBox
from taichi_plume.scenario.algorithms import RandomWalk
from taichi_plume.scenario.obstacles import Box
from taichi_plume.scenario.robots import Body, Group
from taichi_plume.scenario.starts import StartAt

pytestmark = pytest.mark.usefixtures("taichi")

TICK = 0.1
RADIUS, SPEED, AVOIDANCE = 0.05, 0.2, 0.2


@ti.data_oriented
class Couriers:
    """Robots that drive from `starts` to `goals`; several trials do the same."""

    def __init__(self, starts, goals, headings=0.0, size=(4.0, 3.0), boxes=(), trials=1):
        self.count = len(starts)
        group = Group(
            count=self.count,
            trials=trials,
            start=StartAt(kind="positions", positions=tuple(starts)),
            algorithm=RandomWalk(kind="random_walk"),
            body=Body(radius=RADIUS, max_speed=SPEED),
        )
        arena = ClearanceMap([UprightBox(box, 2) for box in boxes], (*size, 1.0), 0.1)
        n = self.count * trials
        self.swarm = Swarm(
            (group,), np.tile(starts, (trials, 1)), np.full(n, headings), arena, np.empty((0, 2)), 1
        )
        members = Members(self.swarm, [0])
        parameters = Parameters(members, lambda group: Potential.numbers(self.swarm, group, None, AVOIDANCE))
        parameters.begin()
        self.potential = Potential(members, parameters)
        self.potential.mark.fill(np.inf)
        self.goals = ti.Vector.field(2, ti.f32, n)
        self.goals.from_numpy(np.tile(np.asarray(goals, np.float32), (trials, 1)))

    @ti.kernel
    def act(self):
        for n in self.goals:
            self.potential.drive(n, self.goals[n], TICK)

    @ti.kernel
    def clear(self):
        for n in self.goals:
            self.goals[n] = self.potential.clear(n, self.goals[n])

    def go(self, seconds):
        """Positions (ticks, robots, 2)."""
        tracks = []
        for tick in range(1, round(seconds / TICK) + 1):
            self.act()
            self.swarm.move(tick, tick * TICK, TICK)
            tracks.append(self.swarm.position.to_numpy())
        return np.array(tracks)


def arrived(couriers, tracks):
    return np.linalg.norm(tracks - couriers.goals.to_numpy(), axis=-1).min(axis=0) < NEAR


def least_gap(tracks, one, other):
    return np.linalg.norm(tracks[:, one] - tracks[:, other], axis=-1).min() - 2 * RADIUS


def test_the_way_is_straight_where_nothing_stands():
    couriers = Couriers([(1, 1)], [(3, 2)], headings=np.arctan2(1, 2))
    tracks = couriers.go(np.sqrt(5) / SPEED + 3)
    assert arrived(couriers, tracks).all()
    along, across = np.array([2, 1]) / np.sqrt(5), np.array([-1, 2]) / np.sqrt(5)
    assert np.abs((tracks[:, 0] - [1, 1]) @ across).max() < 1e-3
    assert np.diff(tracks[:100, 0] @ along) == pytest.approx(SPEED * TICK, rel=1e-3)


def test_pull_and_push_are_equal_at_half_the_avoidance():
    """A way point on the wall: the robot stops in front of it."""
    couriers = Couriers([(1, 1.5)], [(0, 1.5)], headings=np.pi)
    tracks = couriers.go(7.5)  # before it takes its place for a local minimum
    assert tracks[-1, 0, 0] - RADIUS == pytest.approx(AVOIDANCE / 2, abs=3e-3)


@pytest.mark.parametrize("offset", [0.0, 0.01, 0.1])
def test_two_that_meet_pass_at_a_distance(offset):
    couriers = Couriers([(1, 1.5), (3, 1.5 + offset)], [(3, 1.5 + offset), (1, 1.5)])
    tracks = couriers.go(40)
    assert arrived(couriers, tracks).all()
    assert least_gap(tracks, 0, 1) > AVOIDANCE / 3


def test_eight_that_change_places_across_a_circle_keep_their_gaps():
    angles = np.arange(8) * np.pi / 4
    ring = 1.1 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    middle = np.array([2, 1.5])
    couriers = Couriers(middle + ring, middle - ring, trials=2)
    tracks = couriers.go(90)
    assert arrived(couriers, tracks).all()
    assert min(least_gap(tracks, i, j) for i in range(8) for j in range(i)) > AVOIDANCE / 4
    assert (tracks[:, :8] == tracks[:, 8:]).all()  # the two trials do not see each other


@pytest.mark.parametrize("width", [0.3, 1.0])
def test_a_box_square_in_the_way_is_gone_around(width):
    box = Box(kind="box", center=(2, 1.5), size=(0.3, width))
    couriers = Couriers([(1, 1.5)], [(3, 1.5)], boxes=[box])
    tracks = couriers.go(60)
    assert arrived(couriers, tracks).all()
    beyond = np.abs(tracks[:, 0] - [2, 1.5]) - np.array([0.15, width / 2])
    assert np.maximum(beyond, 0).max(axis=-1).min() > RADIUS  # never in the box


def test_way_points_are_put_where_a_robot_can_be():
    room = RADIUS + AVOIDANCE
    box = Box(kind="box", center=(2, 1.5), size=(0.4, 0.4))
    couriers = Couriers([(1, 1)] * 4, [(0, 0), (9, 1), (2.1, 1.5), (1, 2)], boxes=[box])
    couriers.clear()
    goals = couriers.goals.to_numpy()
    assert goals[:2] == pytest.approx(np.array([(room, room), (4 - room, 1)]))
    assert goals[3].tolist() == [1, 2]
    assert goals[2] == pytest.approx((2.2 + room, 1.5), abs=0.02)
