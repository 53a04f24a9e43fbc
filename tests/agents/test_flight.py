"""Drones fly as given within their limits, and touch nothing in all three directions."""

from pathlib import Path

import numpy as np
import pytest
from robots import NOWHERE, Driver, group

from taichi_plume.agents.collisions import SKIN
from taichi_plume.agents.swarm import Swarm
from taichi_plume.grid.clearance import ClearanceMap
from taichi_plume.grid.layers import MOST_LAYERS, Layers, levels
from taichi_plume.scenario.domain import Domain
from taichi_plume.scenario.obstacles import Box, Cylinder, Sphere
from taichi_plume.scenario.shapes import shape

pytestmark = [pytest.mark.usefixtures("taichi"), pytest.mark.slow]

ROOM = Domain(size=(4.0, 3.0, 2.4), spacing=0.1)
LOW_BOX = Box(kind="box", center=(2.0, 1.5, 0.4), size=(0.6, 0.6, 0.8))
LAMP = Cylinder(kind="cylinder", center=(3.2, 2.4), radius=0.3, base=1.8, height=0.6)
BALL = Sphere(kind="sphere", center=(0.8, 2.3, 1.2), radius=0.3)
SHAPES = [shape(one, ROOM, Path()) for one in (LOW_BOX, LAMP, BALL)]
R, H, TICK = 0.1, 0.1, 0.1
AWAY = np.array([[0.2, 0.2, 0.1], [-9, -9, 0]])
NAN = np.nan


def drone(altitude=1.0, kind="drone", **body):
    if kind == "drone":
        body |= {"radius": R, "height": H, "rotor_radius": 0.03, "arm": 0.05}
    start = {"kind": "positions", "positions": [(1, 1)], "altitude": altitude if kind == "drone" else None}
    return group(start=start, body={"kind": kind, **body}, reach=0.3)


class Flight(Driver):
    """Three drones and a robot of the floor in a room with a box, a lamp under the ceiling and a ball."""

    def __init__(self):
        clearance = ClearanceMap(SHAPES, ROOM.extent, H)
        clearance.layers = Layers(SHAPES, clearance, ROOM.extent[2], H)
        groups = [drone(), drone(), drone(), drone(kind="free")]
        super().__init__(Swarm(groups, np.zeros((4, 2)), np.zeros(4), clearance, AWAY, 0))

    def put(self, *places, heading=0.0, sources=AWAY, floor=(3.8, 0.2), **body):
        """Drones at (x, y, z), the rest out of the way."""
        spare = [(0.2 + 0.5 * n, 0.2, 0.0) for n in range(3 - len(places))]
        all_of_them = [*places, *spare]
        groups = [*(drone(z, **body) for _, _, z in all_of_them), drone(kind="free")]
        positions = np.array([*((x, y) for x, y, _ in all_of_them), floor])
        clearance = self.swarm.clearance
        self.swarm = Swarm(groups, positions, np.full(4, heading), clearance, np.array(sources), 0)
        self.tick = 0
        self.fly()

    def fly(self, speed=0.0, turn=0.0, left=0.0, climb=0.0, goal=(NAN, NAN, NAN), heading=NAN):
        """Command the first drone; the others hover."""
        first = np.array([1.0, 0.0, 0.0, 0.0])
        goals = np.full((4, 3), NAN)
        goals[0] = goal
        headings = np.full(4, NAN)
        headings[0] = heading
        self.command_all(speed * first, turn * first, left * first, climb * first, goals, headings)

    def command_all(self, speed, turn, left, climb, goals, headings):
        """Command each drone, and the robot of the floor."""
        swarm = self.swarm
        swarm.speed_command.from_numpy(speed)
        swarm.turn_rate_command.from_numpy(turn)
        swarm.left_command.from_numpy(left)
        swarm.climb_command.from_numpy(climb)
        swarm.goal.from_numpy(goals)
        swarm.goal_heading.from_numpy(headings)

    def at(self, n=0):
        now = self.swarm.snapshot()
        return np.append(now["position"][n], now["altitude"][n])


@pytest.fixture(scope="module")
def flight(taichi):
    return Flight()


def test_a_velocity_is_reached_as_fast_as_the_drone_can_and_kept(flight):
    """Forward, left and up at once: the change of the vector is limited, each part of it by its own speed."""
    flight.put((1.0, 1.0, 0.5), heading=0.3, max_speed=0.5, max_climb=0.2, max_acceleration=1.0)
    flight.fly(speed=0.3, left=0.4, climb=0.15)
    c, s = np.cos(0.3), np.sin(0.3)
    wanted = np.array([0.3 * c - 0.4 * s, 0.3 * s + 0.4 * c, 0.15])
    steps = np.minimum(np.arange(1, 21) * 1.0 * TICK / np.linalg.norm(wanted), 1.0)
    flight.move(20)
    np.testing.assert_allclose(flight.at(), [1.0, 1.0, 0.5] + wanted * TICK * steps.sum(), atol=1e-5)
    now = flight.swarm.snapshot()
    assert now["climb_rate"][0] == pytest.approx(0.15, abs=1e-6)
    assert now["path_length"][0] == pytest.approx(np.linalg.norm(wanted) * TICK * steps.sum(), rel=1e-5)
    flight.fly(speed=3.0, left=-4.0, climb=9.0)
    flight.move(20)
    before = flight.at()
    flight.move()
    velocity = (flight.at() - before) / TICK
    along = 0.5 * np.array([0.6 * c + 0.8 * s, 0.6 * s - 0.8 * c])  # as given, and no faster than it can
    np.testing.assert_allclose(velocity, [*along, 0.2], atol=1e-5)


def test_it_descends_no_faster_than_it_can(flight):
    flight.put((1.0, 1.0, 2.0), max_descent=0.3, max_acceleration=100.0)
    flight.fly(climb=-5.0)
    flight.move(20)
    assert flight.at()[2] == pytest.approx(2.0 - 0.3 * 2.0, abs=1e-5)


@pytest.mark.parametrize("most", [0.5, 3.0, 1000.0])
def test_it_flies_straight_to_a_place_and_stops_there(flight, most):
    begin, goal = np.array([0.5, 0.6, 0.5]), np.array([1.4, 0.9, 1.7])
    flight.put(tuple(begin), max_speed=1.0, max_climb=0.6, max_acceleration=most)
    flight.fly(goal=goal, heading=2.0)
    e = (goal - begin) / np.linalg.norm(goal - begin)
    way = []
    for _ in range(80):
        flight.move()
        apart = flight.at() - begin
        way.append(apart @ e)
        assert np.linalg.norm(apart - way[-1] * e) < 2e-4  # on the line
    speeds = np.diff([0.0, *way]) / TICK
    assert way[-1] == pytest.approx(np.linalg.norm(goal - begin), abs=1e-3)
    assert max(way) < np.linalg.norm(goal - begin) + 1e-3  # not beyond
    assert abs(speeds[-1]) < 1e-3
    assert max(speeds) <= 0.6 / e[2] + 1e-4
    assert np.abs(np.diff([0.0, *speeds])).max() < most * TICK + 1e-3
    assert flight.swarm.snapshot()["heading"][0] == pytest.approx(2.0, abs=1e-4)


def test_it_reaches_a_place_from_any_motion(flight):
    """With a velocity across the line it comes back to it and does not circle."""
    flight.put((1.0, 1.0, 1.0), max_speed=1.0, max_acceleration=0.5)
    flight.fly(left=1.0)
    flight.move(10)
    flight.fly(goal=(1.6, 0.6, 1.4))
    flight.move(120)
    np.testing.assert_allclose(flight.at(), [1.6, 0.6, 1.4], atol=2e-3)


def test_it_stops_at_floor_and_ceiling_and_feels_them(flight):
    flight.put((1.0, 1.0, 1.0))
    flight.fly(climb=1.0)
    now = flight.move(30)
    assert flight.at()[2] == pytest.approx(2.4 - H, abs=1e-5)
    assert now["blocked"][0]
    flight.fly(climb=-1.0)
    now = flight.move(60)
    assert flight.at()[2] == pytest.approx(0.0, abs=1e-6)
    assert now["blocked"][0]
    assert now["bumps"][0] == 2
    flight.fly(climb=0.5)
    now = flight.move(10)
    assert flight.at()[2] > 0.2
    assert not now["blocked"][0]


def test_it_passes_above_a_low_box_and_under_a_lamp_and_slides_along_them(flight):
    flight.put((1.0, 1.5, 0.82))
    flight.fly(speed=1.0)
    assert not flight.move(20)["blocked"][0]
    assert flight.at()[0] > 2.7
    flight.put((1.0, 1.5, 0.78))
    flight.fly(speed=1.0)
    assert flight.move(20)["blocked"][0]
    assert flight.at()[0] == pytest.approx(1.7 - R, abs=0.03)  # the map gives a little away
    assert flight.at()[0] < 1.7 - R
    flight.fly(speed=1.0, climb=0.2)  # pressed to its side it rises, and goes on above it
    flight.move(30)
    assert flight.at()[0] > 2.3
    flight.put((3.2, 1.5, 1.8 - H - 0.01), heading=np.pi / 2)
    flight.fly(speed=0.5)
    assert not flight.move(20)["blocked"][0]
    assert flight.at()[1] > 2.3
    flight.put((3.2, 1.5, 1.8 - H + 0.01), heading=np.pi / 2)
    flight.fly(speed=0.5)
    assert flight.move(30)["blocked"][0]
    assert flight.at()[1] < 2.1 - R


def test_it_lands_on_a_box_and_rises_to_a_lamp(flight):
    flight.put((2.0, 1.5, 1.5))
    flight.fly(climb=-0.5)
    assert flight.move(30)["blocked"][0]
    assert flight.at()[2] == pytest.approx(0.8 + SKIN, abs=1e-4)
    flight.put((3.2, 2.4, 1.0))
    flight.fly(climb=0.5)
    assert flight.move(30)["blocked"][0]
    assert flight.at()[2] == pytest.approx(1.8 - H - SKIN, abs=1e-4)


def test_drones_meet_as_upright_cylinders(flight):
    flight.put((1.0, 0.6, 1.0), (2.0, 0.6, 1.05), (3.0, 0.6, 1.2))
    flight.fly(speed=1.0)
    flight.move(30)
    assert flight.at()[0] == pytest.approx(2.0 - 2 * R - SKIN, abs=1e-3)
    flight.put((1.0, 0.6, 1.0), (2.0, 0.6, 1.0 + H + 0.01), (3.0, 0.6, 0.8))
    flight.fly(speed=1.0)
    flight.move(30)
    assert flight.at()[0] > 3.5  # below the one and above the other
    flight.put((1.0, 0.6, 1.0), (1.1, 0.6, 1.5), (1.0, 0.5, 0.5))
    flight.fly(climb=0.5)
    flight.move(20)
    assert flight.at()[2] == pytest.approx(1.5 - H - SKIN, abs=1e-4)
    flight.fly(climb=-0.5)
    flight.move(40)
    assert flight.at()[2] == pytest.approx(0.5 + H + SKIN, abs=1e-4)


def test_a_robot_of_the_floor_drives_below_a_drone_and_stops_at_one_that_landed(flight):
    for altitude, blocked in ((0.2, False), (0.0, True)):
        flight.put((2.8, 0.2, altitude), heading=np.pi, floor=(3.8, 0.2))
        speeds = np.array([0.0, 0.0, 0.0, 0.2])
        flight.command_all(speeds, 0 * speeds, 0 * speeds, 0 * speeds, np.full((4, 3), NAN), np.full(4, NAN))
        now = flight.move(60)
        assert bool(now["blocked"][3]) == blocked
        assert now["altitude"][3] == 0.0
        assert (now["position"][3, 0] < 2.8) != blocked


def test_nothing_overlaps_in_a_blind_flight(flight):
    """Three drones thrown about for 40 s: none comes into another or an obstacle, in all three directions."""
    rng = np.random.default_rng(3)
    flight.put((1.0, 1.0, 0.5), (2.5, 0.7, 1.0), (3.2, 1.5, 1.5), max_acceleration=5.0, max_climb=1.0)
    bumps = 0
    for _ in range(400):
        if flight.tick % 8 == 0:
            speed, left, climb = rng.uniform(-1, 1, (3, 4)) * [[1.5], [1.5], [1.0]]
            flight.command_all(speed, 0 * speed, left, climb, np.full((4, 3), NAN), np.full(4, NAN))
        now = flight.move()
        bumps += int(now["blocked"].sum())
        p, z = now["position"].astype(float), now["altitude"].astype(float)
        assert (z >= 0).all()
        assert (z[:3] <= 2.4 - H + 1e-6).all()
        assert (np.minimum(p, [4.0, 3.0] - p).min(axis=1)[:3] > R).all()
        for n in range(3):
            for one in SHAPES:
                assert one.horizontal_distance(p[n], z[n], z[n] + H) > R
        for a in range(4):
            for b in range(a):
                radius, height = (R, 0.08)[a == 3], (H, 0.15)[a == 3]
                beside = z[a] < z[b] + H and z[b] < z[a] + height
                assert not beside or np.hypot(*(p[a] - p[b])) > R + radius
    assert bumps > 30


def test_layers_begin_where_upright_shapes_do(flight):
    found = levels(SHAPES[:2], 2.4, H)
    np.testing.assert_allclose(found, [0.0, 0.8, 1.7])
    assert 3 < len(levels(SHAPES, 2.4, H)) < MOST_LAYERS
    stacked = [
        shape(Box(kind="box", center=(1, 1, z), size=(0.1, 0.1, 0.01)), ROOM, Path())
        for z in np.linspace(0.1, 2.3, 50)
    ]
    assert len(levels(stacked, 2.4, H)) == MOST_LAYERS


def test_a_source_is_found_in_space(flight):
    """0.3 m from the middle of the body; a robot of the floor counts the way over it alone."""
    flight.put((1.0, 0.6, 1.0), floor=(2.0, 0.5), sources=[[2.0, 0.6, 1.5], [-9, -9, 0]])
    flight.fly(speed=1.0)
    now = flight.move(20)
    assert not now["found"][0]
    assert now["found"][3]
    flight.put((1.0, 0.6, 1.2), floor=(3.8, 0.2), sources=[[2.0, 0.6, 1.5], [-9, -9, 0]])
    flight.fly(speed=1.0)
    now = flight.move(30)
    assert now["found"][0]
    middle = np.append(now["position"][0], now["altitude"][0] + H / 2)
    assert 0.2 < np.linalg.norm(middle - [2.0, 0.6, 1.5]) <= 0.3 + 1e-4
    assert not now["found"][3]


def test_a_swarm_of_the_floor_has_no_columns_of_flight():
    names = {column.name for column in Swarm([], NOWHERE, np.empty(0), None, NOWHERE, 0).columns}
    assert not names & {"altitude", "flight", "climb_rate", "goal"}
