"""Way points among walls, boxes and team mates: the balance of pull and push, gaps, and ways out of local minima."""

import numpy as np
import pytest
from robots import NOWHERE, group

from taichi_plume.agents.members import Members
from taichi_plume.agents.parameters import Parameters
from taichi_plume.agents.potential import NEAR, Potential
from taichi_plume.agents.swarm import Swarm
from taichi_plume.engine import ti
from taichi_plume.grid.clearance import ClearanceMap
from taichi_plume.grid.shapes import UprightBox
from taichi_plume.scenario.obstacles import Box

pytestmark = pytest.mark.usefixtures("taichi")

TICK = 0.1
RADIUS, SPEED, AVOIDANCE = 0.05, 0.2, 0.2


SMALL = Box(kind="box", center=(2, 1.5), size=(0.4, 0.4))
WIDTHS = (0.3, 1.0)
OFFSETS = (0.0, 0.01, 0.1)
RING = 1.1 * np.stack([np.cos(np.arange(8) * np.pi / 4), np.sin(np.arange(8) * np.pi / 4)], axis=1)
MIDDLE = np.array([2, 1.5])


class Couriers:
    """Teams of robots that drive from starts to goals; they neither see nor touch each other.

    teams: (starts, goals, heading [rad], trials) of each; several trials do the same.
    """

    def __init__(self, teams, size=(4.0, 3.0), boxes=()):
        groups = tuple(
            group(count=len(starts), trials=trials, body={"radius": RADIUS, "max_speed": SPEED})
            for starts, _, _, trials in teams
        )
        arena = ClearanceMap([UprightBox(box, 2) for box in boxes], (*size, 1.0), 0.1)
        where = np.concatenate([np.tile(starts, (trials, 1)) for starts, _, _, trials in teams])
        headings = np.concatenate(
            [np.full(len(starts) * trials, angle) for starts, _, angle, trials in teams]
        )
        self.swarm = Swarm(groups, where, headings, arena, NOWHERE, 1, rivals=True)
        members = Members(self.swarm, range(len(groups)))
        parameters = Parameters(members, lambda group: Potential.numbers(self.swarm, group, None, AVOIDANCE))
        self.potential = Potential(members, parameters)
        goals = [np.tile(np.asarray(goals, float), (trials, 1)) for _, goals, _, trials in teams]
        self.goals = ti.filled_vectors(np.concatenate(goals))

    @ti.kernel
    def act(self):
        for n in range(self.goals.shape[0]):
            self.potential.drive(n, self.goals[n], TICK)

    @ti.kernel
    def clear(self):
        for n in range(self.goals.shape[0]):
            self.goals[n] = self.potential.clear(n, self.goals[n])

    def go(self, seconds):
        """Positions (ticks, robots, 2), by team."""
        tracks = []
        for tick in range(1, round(seconds / TICK) + 1):
            self.act()
            self.swarm.move(tick, tick * TICK, TICK)
            tracks.append(self.swarm.position.to_numpy())
        return [np.array(tracks)[:, group.slice] for group in self.swarm.groups]


@pytest.fixture(scope="module")
def tracks(taichi):
    """In an empty room, by team: alone, towards the wall, two that meet (for each of OFFSETS), and across the ring."""
    meetings = [([(1, 1.5), (3, 1.5 + offset)], [(3, 1.5 + offset), (1, 1.5)], 0.0, 1) for offset in OFFSETS]
    teams = [
        ([(1, 1)], [(3, 2)], np.arctan2(1, 2), 1),
        ([(1, 1.5)], [(0, 1.5)], np.pi, 1),
        *meetings,
        (MIDDLE + RING, MIDDLE - RING, 0.0, 2),
    ]
    return Couriers(teams).go(90)


def arrived(tracks, goals):
    return np.linalg.norm(tracks - np.asarray(goals), axis=-1).min(axis=0) < NEAR


def least_gap(tracks, one, other):
    return np.linalg.norm(tracks[:, one] - tracks[:, other], axis=-1).min() - 2 * RADIUS


def test_the_way_is_straight_where_nothing_stands(tracks):
    track = tracks[0][: round((np.sqrt(5) / SPEED + 3) / TICK)]
    assert arrived(track, (3, 2)).all()
    along, across = np.array([2, 1]) / np.sqrt(5), np.array([-1, 2]) / np.sqrt(5)
    assert np.abs((track[:, 0] - [1, 1]) @ across).max() < 1e-3
    assert np.diff(track[:100, 0] @ along) == pytest.approx(SPEED * TICK, rel=1e-3)


def test_pull_and_push_are_equal_at_half_the_avoidance(tracks):
    """A way point on the wall: the robot stops in front of it."""
    track = tracks[1][: round(7.5 / TICK)]  # before it takes its place for a local minimum
    assert track[-1, 0, 0] - RADIUS == pytest.approx(AVOIDANCE / 2, abs=3e-3)


@pytest.mark.parametrize("offset", OFFSETS)
def test_two_that_meet_pass_at_a_distance(tracks, offset):
    track = tracks[2 + OFFSETS.index(offset)][: round(40 / TICK)]
    assert arrived(track, [(3, 1.5 + offset), (1, 1.5)]).all()
    assert least_gap(track, 0, 1) > AVOIDANCE / 3


def test_eight_that_change_places_across_a_circle_keep_their_gaps(tracks):
    track = tracks[-1]
    assert arrived(track, np.tile(MIDDLE - RING, (2, 1))).all()
    assert min(least_gap(track, i, j) for i in range(8) for j in range(i)) > AVOIDANCE / 4
    assert (track[:, :8] == track[:, 8:]).all()  # the two trials do not see each other


@pytest.fixture(scope="module")
def among_boxes(taichi):
    """A room with a small box and one of each of WIDTHS, 3 m apart; goals of the first team need to be cleared."""
    boxes = [Box(kind="box", center=(2, 4.5 + 3 * n), size=(0.3, width)) for n, width in enumerate(WIDTHS)]
    goals = [(0, 0), (9, 1), (2.1, 1.5), (1, 2)]
    teams = [([(1, 1)] * 4, goals, 0.0, 1)]
    teams += [([(1, box.center[1])], [(3, box.center[1])], 0.0, 1) for box in boxes]
    return Couriers(teams, (4.0, 9.0), [SMALL, *boxes])


@pytest.fixture(scope="module")
def around(among_boxes):
    """Tracks there."""
    return among_boxes.go(60)


@pytest.mark.parametrize("width", WIDTHS)
def test_a_box_square_in_the_way_is_gone_around(around, width):
    n = WIDTHS.index(width)
    track, y = around[1 + n], 4.5 + 3 * n
    assert arrived(track, (3, y)).all()
    beyond = np.abs(track[:, 0] - [2, y]) - np.array([0.15, width / 2])
    assert np.maximum(beyond, 0).max(axis=-1).min() > RADIUS  # never in the box


def test_way_points_are_put_where_a_robot_can_be(around, among_boxes):
    room = RADIUS + AVOIDANCE
    among_boxes.clear()
    goals = among_boxes.goals.to_numpy()[:4]
    assert goals[:2] == pytest.approx(np.array([(room, room), (4 - room, 1)]))
    assert goals[3].tolist() == [1, 2]
    assert goals[2] == pytest.approx((2.2 + room, 1.5), abs=0.02)
