"""Beliefs drift as their variances say, whatever the tick; what is sensed and refereed stays true."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from arena import Run, Script
from robots import NOWHERE, Driver
from robots import group as robots

from taichi_plume.agents.members import Members
from taichi_plume.agents.parameters import Parameters
from taichi_plume.agents.potential import Potential
from taichi_plume.agents.radio import Radio
from taichi_plume.agents.sensors import Sensors
from taichi_plume.agents.swarm import Swarm
from taichi_plume.engine import ti
from taichi_plume.engine.program import compiled
from taichi_plume.files.ros_odometry import DeadReckoning
from taichi_plume.grid.clearance import ClearanceMap
from taichi_plume.scenario.algorithms import SurgeCast
from taichi_plume.scenario.localization import Odometry
from taichi_plume.scenario.robots import Communication
from taichi_plume.scenario.search_algorithm import Spiral

pytestmark = [pytest.mark.usefixtures("taichi"), pytest.mark.slow]

EXACT = dict.fromkeys(Odometry.model_fields.keys() - {"kind"}, 0.0)
MANY = 4000  # robots: a variance is estimated to sqrt(2/MANY) = 2.2 % of it
TOLERANCE = 5 * np.sqrt(2 / MANY)
SIZE = 30.0
IDEAL = {"kind": "ideal"}


def wheels(**keys):
    return Odometry(kind="odometry", **keys)


def group(localization, trials=1, count=1, name="team", **keys):
    body, sensors = {"max_speed": 1.0, "max_turn_rate_deg": 360.0}, {"gas": IDEAL, "wind": IDEAL}
    return robots(
        name=name, count=count, trials=trials, body=body, sensors=sensors, localization=localization, **keys
    )


def swarm_of(*groups, seed=3, where=(SIZE / 2, SIZE / 2), heading=0.0):
    """Every team's robots 1 m apart along y, from `where` on."""
    places = [
        (where[0], where[1] + i + n)
        for n, one in enumerate(groups)
        for _ in range(one.trials)
        for i in range(one.count)
    ]
    arena = ClearanceMap([], (SIZE, SIZE, 1.0), 1.0)
    return Swarm(groups, np.array(places), np.full(len(places), heading), arena, NOWHERE, seed)


def drive(driver, speed, turn_rate, seconds, tick):
    """Constant commands."""
    driver.command(speed, turn_rate)
    return driver.move(round(seconds / tick), tick)


def errors(driver):
    """Believed minus true position (n, 2), heading, way."""
    now = {name: value.astype(float) for name, value in driver.swarm.snapshot().items()}
    heading = now["believed_heading"] - now["heading"]
    heading -= 2 * np.pi * np.round(heading / (2 * np.pi))
    return now["believed_position"] - now["position"], heading, now["odometer"] - now["path_length"]


@pytest.fixture(scope="module")
def crowd(taichi):
    """Many trials of a robot, which the tests give errors."""
    return Driver(swarm_of(group(wheels(), MANY)))


def put(crowd, where=(SIZE / 2, SIZE / 2), heading=0.0, **errors):
    """Begin anew at a place, with these errors alone."""
    model = wheels(**EXACT | errors)
    crowd.begin([group(model, MANY)], np.tile(where, (MANY, 1)), np.full(MANY, heading), seed=3)


# ---------------------------------------------------------------- random errors


@pytest.mark.parametrize(("tick", "speed"), [(0.05, 1.0), (0.5, -1.0)])
def test_straight_ways(crowd, tick, speed):
    length, way, heading = 6.0, 0.02, np.radians(0.8)
    put(crowd, distance_noise=way, heading_noise_deg=0.8)
    drive(crowd, speed, 0.0, length, tick)
    place, turned, driven = errors(crowd)
    aside = place[:, 1]
    assert np.var(turned) == pytest.approx(heading**2 * length, rel=TOLERANCE)
    assert np.var(driven) == pytest.approx(way**2 * length, rel=TOLERANCE)
    # along a straight line the heading is a random walk and the error aside its integral
    assert np.var(aside) == pytest.approx(heading**2 * length**3 / 3, rel=TOLERANCE)
    covariance = heading**2 * length**2 / 2 * np.sign(speed)
    deviation = heading**2 * length**2 * np.sqrt((1 / 3 + 1 / 4) / MANY)
    assert np.mean(aside * turned) == pytest.approx(covariance, abs=5 * deviation)
    # E cos of the heading at s is exp(-k s/2): the believed end lies a little short
    k = heading**2
    short = (1 - np.exp(-k * length / 2)) / (k / 2) - length
    found = np.mean(place[:, 0]) * np.sign(speed)
    assert found == pytest.approx(short, abs=5 * way * np.sqrt(length / MANY))
    ratios = [turned.mean() / turned.std(), driven.mean() / driven.std()]
    assert np.abs(ratios).max() < 5 / np.sqrt(MANY)


@pytest.mark.parametrize("tick", [0.05, 0.5])
def test_turns_on_the_spot(crowd, tick):
    turns, heading, way = 1.5, np.radians(3.0), 0.02
    put(crowd, turn_noise_deg=3.0, turning_distance_noise=way)
    drive(crowd, 0.0, -np.pi, 2 * turns, tick)
    place, turned, driven = errors(crowd)
    assert np.var(turned) == pytest.approx(heading**2 * turns, rel=TOLERANCE)
    assert np.var(driven) == pytest.approx(way**2 * turns, rel=TOLERANCE)
    assert np.var(place, axis=0).sum() == pytest.approx(way**2 * turns, rel=2 * TOLERANCE)


def test_who_stands_does_not_drift(crowd):
    put(crowd, **wheels().model_dump(exclude={"kind"}))
    drive(crowd, 0.0, 0.0, 5.0, 0.5)
    assert not any(error.any() for error in errors(crowd))


# ---------------------------------------------------------------- systematic errors


def test_scale(crowd):
    put(crowd, distance_scale=0.05)
    drive(crowd, 1.0, 0.0, 3.0, 0.1)
    (first, _), turned, driven = errors(crowd)[0].T, *errors(crowd)[1:]
    scale = driven / 3.0
    assert np.std(scale) == pytest.approx(0.05, rel=TOLERANCE)
    assert abs(scale.mean()) < 5 * 0.05 / np.sqrt(MANY)
    rounding = 2 * 1e-6  # m a tick, half of the last bit of two places
    assert first == pytest.approx(3.0 * scale, abs=30 * rounding)
    assert not turned.any()
    drive(crowd, 1.0, 0.0, 4.0, 0.1)
    place, _, driven = errors(crowd)
    assert place[:, 0] == pytest.approx(7.0 * scale, abs=70 * rounding)
    assert driven == pytest.approx(7.0 * scale, abs=70 * rounding)


def test_scale_of_turns(crowd):
    put(crowd, turn_scale=0.05)
    drive(crowd, 0.0, 1.0, 2.0, 0.1)
    scale = errors(crowd)[1] / 2.0
    assert np.std(scale) == pytest.approx(0.05, rel=TOLERANCE)
    drive(crowd, 0.0, -1.0, 3.0, 0.1)
    assert errors(crowd)[1] == pytest.approx(-scale, abs=1e-5)
    assert not errors(crowd)[0].any()


def test_unequal_wheels_bend_the_way_that_is_believed(crowd):
    tick = 0.1
    put(crowd, heading=0.5, veer_deg=5.0)
    drive(crowd, 1.0, 0.0, 5.0, tick)
    place, turned, _ = errors(crowd)
    bend = turned / 5.0  # rad/m
    assert np.std(bend) == pytest.approx(np.radians(5.0), rel=TOLERANCE)
    # a circle of this curvature, whose chord points half of the angle aside
    chord, course = 2 / bend * np.sin(turned / 2), 0.5 + turned / 2
    believed = chord[:, None] * np.column_stack([np.cos(course), np.sin(course)])
    straight = 5.0 * np.array([np.cos(0.5), np.sin(0.5)])
    # with chords of `tick` metres each, (1 - (bend tick)²/24) as long
    assert place + straight == pytest.approx(believed, abs=5.0 * (np.abs(bend).max() * tick) ** 2 / 24 + 1e-4)
    drive(crowd, -1.0, 0.0, 5.0, tick)
    place, turned, _ = errors(crowd)
    assert np.abs(place).max() < 2e-4  # all the way back, but for rounding
    assert np.abs(turned).max() < 1e-5


def test_ways_along_a_wall_are_those_really_gone(crowd):
    put(crowd, where=(SIZE / 2, 0.2), heading=-0.5)
    assert drive(crowd, 0.5, 0.0, 4.0, 0.1)["blocked"].any()
    place, turned, driven = errors(crowd)
    assert np.abs(place).max() < 1e-5
    assert not turned.any()
    assert driven == pytest.approx(0, abs=1e-5)


def test_other_errors_and_seeds_compile_nothing(crowd):
    def run(seed):
        model = wheels()
        crowd.begin([group(model, MANY)], np.full((MANY, 2), 9.0), np.zeros(MANY), seed=seed)
        drive(crowd, 0.7, 0.3, 2.0, 0.1)
        return errors(crowd)[0]

    first = run(1)
    before = compiled()
    assert (run(2) != first).any(axis=1).all()
    np.testing.assert_array_equal(run(1), first)
    assert compiled() == before


# ---------------------------------------------------------------- covariances in ROS messages


def test_published_covariances_are_those_of_the_errors(crowd):
    """The squared error by the published covariance is chi-squared with three degrees of freedom, after each leg."""
    model = wheels(
        distance_scale=0.02, turn_scale=0.02, veer_deg=0.5, distance_noise=0.01,
        turning_distance_noise=0.01, heading_noise_deg=0.5, turn_noise_deg=2.0,
    )  # fmt: skip
    crowd.begin([group(model, MANY)], np.full((MANY, 2), SIZE / 2), np.full(MANY, 0.4), seed=3)
    reckoning, tick = DeadReckoning(model, MANY), 0

    def advance():
        now = crowd.swarm.snapshot()
        place = np.column_stack([now["believed_position"], np.zeros(MANY)])
        reckoning.advance(0.1 * tick, place, now["believed_heading"])

    advance()
    for speed, turn_rate, ticks in ((0.5, 0.0, 30), (0.4, 0.8, 20), (0.0, -1.5, 10), (-0.3, 0.2, 30)):
        for _ in range(ticks):
            drive(crowd, speed, turn_rate, 0.1, 0.1)
            tick += 1
            advance()
        place, turned, _ = errors(crowd)
        error = np.column_stack([place, turned])
        squared = np.einsum("ni,nij,nj->n", error, np.linalg.inv(reckoning.covariance), error)
        assert squared.mean() == pytest.approx(3, abs=5 * np.sqrt(6 / MANY))
        whitened = np.linalg.solve(np.linalg.cholesky(reckoning.covariance), error[..., None])[..., 0]
        assert np.cov(whitened.T) == pytest.approx(np.eye(3), abs=TOLERANCE)


# ---------------------------------------------------------------- none


def test_without_localization_the_belief_is_the_truth():
    swarm = swarm_of(group(None, 5))
    assert swarm.believed_position is swarm.position
    assert swarm.believed_heading is swarm.heading
    assert swarm.odometer is swarm.path_length


def test_who_has_none_beside_others_that_have():
    mixed = swarm_of(group(wheels(), 5, name="wheels"), group(None, 5, name="cameras"))
    alone = swarm_of(group(None, 5), group(None, 5, name="cameras"))
    now, before = (drive(Driver(swarm), 0.7, 0.3, 4.0, 0.1) for swarm in (mixed, alone))
    for name in ("position", "heading"):
        np.testing.assert_array_equal(now[name], before[name])
        np.testing.assert_array_equal(now[f"believed_{name}"][5:], before[name][5:])
        assert (now[f"believed_{name}"][:5] != now[name][:5]).all()
    np.testing.assert_array_equal(now["odometer"][5:], before["path_length"][5:])


# ---------------------------------------------------------------- what is sensed


class Breeze(Script):
    """Wind along (0.3, 0.1) m/s."""

    @ti.func
    def velocity(self, x, t):
        return ti.Vector([0.3, 0.1])


def mistaken(off: Any = 0.0, shift=(0.0, 0.0), **keys):
    """Robots that believe in a heading turned by `off` and a place moved by `shift`."""
    swarm = swarm_of(group(wheels(**EXACT), **keys))
    swarm.believed_heading.from_numpy(swarm.heading.to_numpy() + np.float32(off))
    swarm.believed_position.from_numpy(swarm.position.to_numpy() + np.float32(shift))
    return swarm


def test_wind_is_turned_by_the_error_of_the_heading():
    off = np.array([0.0, 0.4, -2.0])
    swarm = mistaken(off=off, count=3)
    air: Any = Breeze([1.0], 1.0)
    Sensors(swarm, 2, 0.1, air.species).measure(air, air, 1, 0.1)
    ratio = swarm.wind.to_numpy() @ [1, 1j] / (0.3 + 0.1j)
    assert np.abs(ratio) == pytest.approx(np.ones(3), rel=1e-6)
    assert np.angle(ratio) == pytest.approx(off, abs=1e-6)


def test_upwind_is_upwind_whatever_the_belief():
    model = SurgeCast(kind="surge_cast", threshold_ppm=1.0, peak_fraction=0.0, wind_memory=0.0)
    run = Run(model, Breeze([50.0], 1.0), ((20, 15),), size=(SIZE, SIZE), localization=wheels(**EXACT))
    run.swarm.believed_heading.fill(1.0)
    _, places = run.go(20)
    moved = places[-1, 0] - places[100, 0]
    assert np.arctan2(*moved[::-1]) == pytest.approx(np.arctan2(-0.1, -0.3), abs=1e-3)
    assert np.hypot(*moved) == pytest.approx(0.2 * 9.9, rel=1e-3)


class Courier:
    """A robot near a corner and a mate, on the way to a goal; returns its commands."""

    def __init__(self, off, shift):
        one = group(wheels(**EXACT), count=2)
        arena = ClearanceMap([], (SIZE, SIZE, 1.0), 0.1)
        self.swarm = Swarm((one,), np.array([[0.2, 0.25], [0.45, 0.3]]), np.full(2, 0.3), arena, NOWHERE, 3)
        turn = np.array([[np.cos(off), -np.sin(off)], [np.sin(off), np.cos(off)]])
        believed = self.swarm.position.to_numpy() + np.float32(shift)
        goal = believed[0] + turn @ np.array([0.5, 0.2])
        self.swarm.believed_heading.fill(0.3 + off)
        self.swarm.believed_position.from_numpy(believed.astype(np.float32))
        self.goal = [float(v) for v in goal]
        members = Members(self.swarm, [0])
        parameters = Parameters(members, lambda group: Potential.numbers(self.swarm, group, None, 0.3))
        self.potential = Potential(members, parameters)

    @ti.kernel
    def drive(self, x: float, y: float):
        for _ in range(1):
            self.potential.drive(0, ti.Vector([x, y]), 0.1)

    def commands(self):
        self.drive(*self.goal)
        return self.swarm.speed_command[0], self.swarm.turn_rate_command[0]


def test_walls_and_mates_are_where_they_truly_are():
    """A map that is turned and moved as a whole makes no difference to what lies around the robot."""
    wanted = Courier(0.0, (0.0, 0.0)).commands()
    assert Courier(0.8, (0.3, 2.0)).commands() == pytest.approx(wanted, abs=1e-5)


class Speaker:
    def __init__(self, swarm):
        members = Members(swarm, [0])
        parameters = Parameters(members, Radio.numbers, radio="radio")
        self.radio = Radio(members, parameters)

    @ti.kernel
    def say(self):
        for _ in range(1):
            self.radio.say(1, 5.0, ti.Vector([1.0, 2.0]))


def test_a_message_tells_where_the_sender_believes_to_be():
    swarm = mistaken(shift=(0.0, 7.0), count=2, communication=Communication(range=1.5))
    speaker = Speaker(swarm)
    speaker.say()
    speaker.radio.deliver(1, 0.1)  # 1 m apart, in truth
    assert swarm.position.to_numpy()[1] == pytest.approx([15, 16])
    assert speaker.radio.sender.to_numpy()[0, 1] == pytest.approx([15, 23])


def test_the_source_is_found_where_it_is():
    one = group(wheels(**EXACT), reach=0.25)
    arena = ClearanceMap([], (SIZE, SIZE, 1.0), 1.0)
    swarm = Swarm((one,), np.array([[5.0, 5.0]]), np.zeros(1), arena, np.array([[6.0, 5.0]]), 3)
    swarm.believed_position.fill(0.0)
    now = drive(Driver(swarm), 1.0, 0.0, 2.0, 0.1)
    assert now["found"][0] == 1
    assert now["position"][0] == pytest.approx([5.8, 5.0], abs=1e-5)
    assert now["believed_position"][0] == pytest.approx([0.8, 0.0], abs=1e-5)


# ---------------------------------------------------------------- robots that live with it


def test_turns_come_to_an_end_with_a_bad_odometer():
    """Spirals take but little longer: the robots do not dither about their courses."""
    model = Spiral(kind="spiral", arms=(0.3, 0.3, 0.3), settle=0.5, acquisition=1, minimum_ppm=100)
    rivals = [{"localization": None}, {"localization": wheels(turn_noise_deg=15.0)}]
    run = Run(
        [{"algorithm": model} | one for one in rivals], Script([0.0], 1.0), ((5, 5),), 100, (10.0, 10.0)
    )
    run.go(30)
    none, bad = run.swarm.acquisitions.to_numpy().reshape(2, 100).mean(axis=1)
    assert bad > 0.75 * none > 3  # it may need a second more of every five


def test_a_trial_alone():
    many = swarm_of(group(wheels(), 6, count=2), group(wheels(), 6, count=3, name="others"))
    alone = swarm_of(
        group(wheels(), 1, count=2, first_trial=4),
        group(wheels(), 1, count=3, first_trial=4, name="others"),
    )
    now, then = (drive(Driver(swarm), 0.7, 0.3, 4.0, 0.1) for swarm in (many, alone))
    rows = [*range(8, 10), *range(12 + 12, 12 + 15)]
    for name in ("position", "believed_position", "believed_heading", "odometer"):
        np.testing.assert_array_equal(now[name][rows], then[name], err_msg=name)
    assert len(np.unique(then["odometer"])) == 5
    assert len(np.unique(now["odometer"])) == 30


PROGRAM = """
import hashlib, sys
from taichi_plume.engine import ti
sys.path.insert(0, {folder!r})
ti.init(ti.cpu, cpu_max_num_threads=int(sys.argv[1]), log_level=ti.ERROR)
from test_odometry import Driver, drive, group, swarm_of, wheels
now = drive(Driver(swarm_of(group(wheels(), 2000))), 0.7, 0.3, 4.0, 0.1)
print(hashlib.sha256(b"".join(now[name].tobytes() for name in sorted(now))).hexdigest())
"""


def test_results_are_the_same_on_one_and_two_threads():
    program = PROGRAM.format(folder=str(Path(__file__).parent))
    one, two = (
        subprocess.run(
            [sys.executable, "-c", program, str(threads)], capture_output=True, text=True, check=True
        )
        for threads in (1, 2)
    )
    assert one.stdout == two.stdout
    assert len(one.stdout.split()[-1]) == 64
