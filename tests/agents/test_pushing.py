"""No obstacle that moves runs over a robot: it pushes the robot aside, or the robot counts as pinned."""

from pathlib import Path

import numpy as np
import pytest
from robots import NOWHERE, Driver
from robots import group as robots

from taichi_plume.agents.swarm import Swarm
from taichi_plume.grid.clearance import ClearanceMap
from taichi_plume.grid.layers import Layers
from taichi_plume.grid.state import State
from taichi_plume.scenario.domain import Domain
from taichi_plume.scenario.obstacles import Box, Cylinder
from taichi_plume.scenario.shapes import shape

pytestmark = pytest.mark.usefixtures("taichi")

ROOM = Domain(size=(4.0, 3.0), spacing=0.1)
HALL = Domain(size=(4.0, 3.0, 2.4), spacing=0.1)
R, WALKER, TICK = 0.1, 0.3, 0.1
# a dead end of 0.22 m: a robot in it can go neither aside nor back
ALLEY = [
    Box(kind="box", center=(3.8, 1.19), size=(0.4, 0.4)),
    Box(kind="box", center=(3.8, 1.81), size=(0.4, 0.4)),
]


def walker(center, *path, radius=WALKER, loop=False, **keys):
    motion = {"path": path, "loop": loop}
    return Cylinder.model_validate(
        {"kind": "cylinder", "center": center, "radius": radius, "motion": motion, **keys}
    )


IDLE = walker((0.4, 2.6), (999.0, 0.4, 2.6))


def group(count, trials, kind="free", altitude=None, **body):
    start = {"kind": "positions", "positions": [(1, 1)], "altitude": altitude}
    body = {"kind": kind, "radius": R, "max_speed": 0.05, **body}
    return robots(count=count, trials=trials, start=start, body=body, reach=0.3)


class Pushed(Driver):
    """Two robots per trial and two walkers among the walls of the room and of the alley."""

    def __init__(self):
        self.clearance = ClearanceMap([shape(one, ROOM, Path()) for one in ALLEY], ROOM.extent, 0.1)
        self.team = group(2, 4)
        places = np.zeros((8, 2))
        super().__init__(Swarm([self.team], places, np.zeros(8), self.clearance, NOWHERE, 0, [IDLE, IDLE]))

    def put(self, walkers, *pairs):
        spare = [((3.0, 0.2), (3.5, 0.2))] * (4 - len(pairs))
        places = np.array([*pairs, *spare]).reshape(-1, 2)
        self.begin([self.team], places, np.zeros(8), walkers=walkers)
        self.walkers, self.gap = walkers, np.full(8, np.inf)

    def go(self, ticks, speed=0.0, dt=TICK):
        """The robots after so many ticks; `gap`: the least air between each and a walker at the end of a tick."""
        self.command(speed, 0.0)
        for _ in range(ticks):
            now = self.move(dt=dt)
            at = np.array([one.motion.place(one.center, self.tick * dt) for one in self.walkers])
            apart = np.linalg.norm(now["position"][:, None].astype(float) - at, axis=-1)
            self.gap = np.minimum(self.gap, (apart - R - [one.radius for one in self.walkers]).min(axis=1))
        between = np.linalg.norm(np.diff(now["position"].reshape(4, 2, 2), axis=1)[:, 0], axis=-1)
        assert between.min() > 2 * R
        assert self.clearance.distance_at(now["position"].astype(float)).min() > R - 1e-4
        return now


@pytest.fixture(scope="module")
def pushed(taichi):
    return Pushed()


def test_a_robot_in_the_way_is_pushed_and_counts_it(pushed):
    """Standing, standing beside the track, a row of two, and one that drives against the walker."""
    along = walker((0.5, 1.5), (5.0, 3.0, 1.5))
    pushed.put(
        [along, IDLE],
        ((1.5, 1.5), (3.0, 2.5)), ((1.5, 1.6), (3.0, 2.5)), ((1.5, 1.5), (1.75, 1.5)), ((3.0, 2.5), (1.5, 0.5)),
    )  # fmt: skip
    now = pushed.go(50)
    assert pushed.gap.min() > 0.0
    assert now["pushes"].tolist() == [1, 0, 1, 0, 1, 1, 0, 0]
    assert now["pinned_s"].max() == 0.0
    # dead ahead: along with the walker; beside the track: only out of it
    assert now["position"][0] == pytest.approx([3.0 + R + WALKER, 1.5], abs=0.01)
    assert now["position"][2, 0] < 2.5
    assert now["position"][2, 1] > 1.85
    assert now["path_length"].max() == 0.0, "pushed, not driven"
    assert pushed.swarm.velocity.to_numpy()[0] == pytest.approx([0.5, 0.0], abs=0.02)
    assert now["blocked"][:4].tolist() == [True, False, False, False]
    assert now["bumps"][0] == 1


def test_a_second_encounter_counts_again(pushed):
    to_and_fro = walker((0.5, 1.5), (2.0, 1.5, 1.5), (4.0, 0.5, 1.5), loop=True)
    pushed.put([to_and_fro, IDLE], ((1.0, 1.5), (3.0, 2.5)))
    assert pushed.go(40)["pushes"][0] == 1
    assert pushed.go(1)["pushes"][0] == 1
    pushed.command(np.where(np.arange(8) == 0, -0.05, 0.0), 0.0)  # comes back into the way
    for _ in range(25):
        now = pushed.move()
    assert now["pushes"][0] == 2


@pytest.mark.parametrize("speed", [0.004, 0.5, 8.0, 20.0])
def test_how_fast_the_walker_is_does_not_matter(pushed, speed):
    """A slow one pushes once, one that passes a robot in a single tick does not miss it."""
    seconds = 2.0 / speed
    pushed.put([walker((0.8, 1.5), (seconds, 2.8, 1.5)), IDLE], ((1.25, 1.45), (3.0, 2.5)))
    now = pushed.go(min(round(seconds / TICK) + 1, 400))
    assert pushed.gap.min() > 0.0
    assert now["pushes"][0] == 1
    assert now["pinned_s"][0] == 0.0
    assert now["position"][0, 1] < 1.45
    assert now["position"][0, 0] > 1.25


def test_a_wall_lets_it_slip_aside_and_a_dead_end_pins_it(pushed):
    pushed.put(
        [walker((2.0, 1.5), (2.0, 2.0, 0.31)), walker((2.9, 1.5), (2.0, 3.5, 1.5))],
        ((2.0, 0.5), (0.5, 0.5)), ((0.5, 0.5), (3.85, 1.5)),
    )  # fmt: skip
    now = pushed.go(40)
    assert pushed.gap[0] > 0.0
    assert abs(now["position"][0, 0] - 2.0) > 0.15
    assert now["pinned_s"][0] == 0.0
    assert now["position"][3] == pytest.approx([3.88, 1.5], abs=0.03)
    # the walker's edge is 0.2 m before the wall from 2 s on; the robot needs 0.2 m and the skin
    assert pushed.gap[3] < 0.0
    assert now["pushes"][3] == 1
    assert now["pinned_s"][3] == pytest.approx(2.0, abs=0.3)


def test_robots_between_two_walkers_leave_the_gap(pushed):
    pushed.put(
        [walker((1.0, 1.5), (2.0, 1.69, 1.5)), walker((3.0, 1.5), (2.0, 2.31, 1.5))],
        ((2.0, 1.5), (0.5, 0.5)), ((1.9, 1.5), (2.12, 1.5)),
    )  # fmt: skip
    now = pushed.go(40)
    assert pushed.gap.min() > 0.0
    assert (np.abs(now["position"][[0, 2, 3], 1] - 1.5) > 0.2).all()


def test_pushes_are_the_same_to_the_bit_after_a_restart(pushed):
    pushed.put([walker((0.5, 1.5), (3.0, 3.0, 1.4)), IDLE], ((1.5, 1.47), (1.5, 1.0)))
    pushed.go(10, speed=0.05)
    saved, state = State(pushed.swarm).save(), pushed.tick
    whole = pushed.go(15, speed=0.05)
    pushed.put([walker((0.5, 1.5), (3.0, 3.0, 1.4)), IDLE], ((1.0, 2.0), (2.5, 0.5)))
    State(pushed.swarm).restore(saved)
    pushed.tick = state
    for key, values in pushed.go(15, speed=0.05).items():
        if key != "start":
            np.testing.assert_array_equal(values, whole[key])


def test_robots_put_from_outside_stay_and_count_the_time_inside(pushed):
    pushed.put([walker((0.5, 1.5), (3.0, 3.5, 1.5)), IDLE], ((1.5, 1.5), (3.0, 2.5)))
    places = np.array([*((1.5, 1.5), (3.0, 2.5)), *[(3.0, 0.2), (3.5, 0.2)] * 3], np.float32)
    pushed.swarm.placed.fill(1.0)
    pushed.swarm.ordered_position.from_numpy(places)
    pushed.swarm.ordered_heading.fill(0.0)
    now = pushed.move(40)
    assert now["position"][0].tolist() == [1.5, 1.5]
    assert now["pushes"].tolist() == [1, *[0] * 7]
    assert now["pinned_s"][0] == pytest.approx(2 * (R + WALKER) / 1.0, abs=0.2)


@pytest.mark.slow
def test_drones_are_pushed_by_walkers_at_their_height_and_rise_out_of_a_dead_end(taichi):
    shapes = [
        shape(Box(kind="box", center=(3.8, y, 1.2), size=(0.4, 0.4, 2.4)), HALL, Path()) for y in (1.19, 1.81)
    ]
    clearance = ClearanceMap(shapes, HALL.extent, 0.1)
    clearance.layers = Layers(shapes, clearance, HALL.extent[2], 0.1)
    drones = group(1, 3, "drone", 1.0, height=0.1, rotor_radius=0.03, arm=0.05)
    low = walker((0.5, 1.5), (6.0, 3.5, 1.5), base=0.0, height=1.6)
    places = np.array([[1.5, 1.52], [3.85, 1.5], [1.5, 1.5]])
    driver = Driver(Swarm([drones], places, np.zeros(3), clearance, np.empty((0, 3)), 0, [low]))
    driver.swarm.altitude.from_numpy([1.0, 1.0, 1.7])
    now = driver.move(70)
    assert np.hypot(*(now["position"][0].astype(float) - (3.5, 1.5))) > R + WALKER
    assert now["altitude"][0] == pytest.approx(1.0)
    assert now["altitude"][1] > 1.6, "out upward"
    assert now["position"][2].tolist() == [1.5, 1.5], "below it"
    assert now["pushes"].tolist() == [1, 1, 0]
    assert now["pinned_s"].max() == 0.0


def test_swarms_without_walkers_have_no_columns_of_pushing(taichi):
    swarm = Swarm([group(1, 1)], np.ones((1, 2)), np.zeros(1), ClearanceMap([], (4, 3), 0.1), NOWHERE, 0)
    assert not {"pushes", "pinned_time", "touched"} & set(swarm.STATE)
