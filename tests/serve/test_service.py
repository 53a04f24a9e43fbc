"""The clock of a served run, with robots that answer in the same thread and a clock that a test turns."""

from math import inf

import numpy as np
import pytest

from taichi_plume.assembly.assemble import assemble
from taichi_plume.execution.signals import SignalRequests
from taichi_plume.files import ros_messages as ros
from taichi_plume.files.ros_messages import points_of
from taichi_plume.grid.fields import ppm_at
from taichi_plume.scenario.loading import scenario_from
from taichi_plume.scenario.localization import Odometry
from taichi_plume.serve.service import Pace, Service

pytest.importorskip("rosbags")
pytestmark = [pytest.mark.usefixtures("taichi"), pytest.mark.slow]

LASER = {"kind": "tdlas", "species": "ethanol", "left": 0.05, "bearing_deg": 90, "noise_ppm_m": 0}
SCENARIO = {
    "duration": 3.0,
    "domain": {"size": [4, 3], "spacing": 0.1},
    "wind": {"kind": "uniform", "velocity": [0.5, 0]},
    "gas": {
        "kind": "gaussian_plume",
        "diffusivity": 0.002,
        "sources": [{"position": [0.5, 1.5], "rate": "10 mg/s"}],
    },
    "robots": [
        {
            "name": "my team",
            "count": 2,
            "start": {"kind": "positions", "positions": [[3, 1], [3, 2]], "heading_deg": 180},
            "algorithm": {"kind": "external", "timeout": 0.5},
            "sensors": {"gas": [{"kind": "mox"}, LASER]},
        }
    ],
}


class Clock:
    """tick_s: what the computer takes for a tick, as the clock sees it."""

    def __init__(self, tick_s: float = 0.01):
        self.now, self.tick_s = 1000.0, tick_s

    def __call__(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        assert seconds > 0
        self.now += seconds


class Robots:
    """Robots at the other end of a link: `answer` is called with the readings of each tick."""

    def __init__(self, clock: Clock, answer):
        self.clock, self.answer = clock, answer
        self.incoming, self.seen, self.messages = {}, [], []
        self.names, self.unwanted = {}, ()

    def listen(self, incoming, stray):
        self.incoming = incoming

    def wants(self, topic: str, name: str) -> bool:
        self.names[topic] = name
        return topic not in self.unwanted

    def publish(self, topic: str, data: bytes) -> None:
        now = ros.decode(self.names[topic], data)
        self.messages.append((topic, now))
        if self.names[topic] == ros.READINGS and not now.ended:
            if self.seen:
                self.clock.now += self.clock.tick_s
            self.seen.append((self.clock.now, now))
            self.answer(self, now)

    def drive(self, now, speed=0.1, number=None, tick=None, robot=(0, 1)) -> None:
        one = ros.message(
            ros.COMMANDS,
            number=len(self.seen) if number is None else number,
            tick=now.tick if tick is None else tick,
            robot=robot,
            speed=[speed] * len(robot),
            turn_rate=[0.0] * len(robot),
        )
        self.incoming["my_team/commands"](ros.encode(one))

    def announce_time(self, t: float) -> None:
        self.now = t

    def close(self) -> None:
        self.incoming = {}


@pytest.fixture(scope="module")
def made(taichi):
    return assemble(scenario_from(SCENARIO), driven=True)


@pytest.fixture
def served(made):
    def run(answer, pace=None, tick_s=0.01, unwanted=(), warm=True, timeouts=False, sim=made):
        clock = Clock(tick_s)
        robots = Robots(clock, answer)
        robots.unwanted = unwanted
        service = Service(pace or Pace(), [robots], not timeouts, clock, clock.sleep)
        if warm:
            service.warm(sim)
        else:
            sim.reset()
        service.attach(sim, SignalRequests())
        for group in service.groups if timeouts else ():
            group.inbox.clock = clock
        sim.run()
        service.close()
        return robots, service

    return run


def test_a_run_takes_its_time(served):
    robots, service = served(Robots.drive)
    times = np.array([when for when, _ in robots.seen])
    ticks = [now.tick for _, now in robots.seen]
    assert ticks == list(range(31))
    np.testing.assert_allclose(np.diff(times)[1:], 0.1, atol=1e-6)
    assert (service.ticks, service.missed) == (30, 0)
    last = robots.seen[-1][1]
    np.testing.assert_allclose(last.x, 3 - 0.1 * 3.0, atol=1e-3)
    assert last.t == pytest.approx(3.0)
    assert np.isfinite(last.resistance[::2]).all(), "of the first of two sensors"


def test_ten_times_as_fast(served):
    robots, _ = served(Robots.drive, Pace(speed=10.0), tick_s=0.001)
    assert np.diff([when for when, _ in robots.seen])[1:] == pytest.approx(0.01, abs=1e-6)


@pytest.mark.parametrize(("late", "missed", "behind"), [(0.35, 3, 0.0), (5.0, 1, 4.9)])
def test_ticks_that_take_too_long_are_caught_up_unless_the_clock_is_far_behind(served, late, missed, behind):
    def answer(robots, now):
        robots.drive(now)
        if now.tick == 10:
            robots.clock.now += late

    robots, service = served(answer)
    times = np.array([when for when, _ in robots.seen])
    assert service.missed == missed
    assert times[-1] - times[1] == pytest.approx(2.9 + behind, abs=0.02 if behind else 1e-6)


def test_it_begins_when_all_robots_are_there(served):
    def answer(robots, now):
        if len(robots.seen) > 4:
            robots.drive(now)
        elif len(robots.seen) > 2:
            robots.drive(now, robot=(1,))

    robots, _ = served(answer)
    assert [now.tick for _, now in robots.seen][:6] == [0, 0, 0, 0, 0, 1]


def test_or_at_once(served):
    robots, service = served(lambda robots, now: None, Pace(at_once=True))
    assert [now.tick for _, now in robots.seen] == list(range(31))
    assert robots.seen[-1][1].x.tolist() == [3.0, 3.0]
    assert service.summary()["messages"]["my_team"]["never_heard"] == 2


def test_waiting_for_answers_nothing_depends_on_the_clock(served):
    """Robots that are slow, and of which one answers a tick behind, which is waited for."""

    def answer(robots, now):
        robots.clock.now += 0.3
        robots.drive(now, speed=0.1 + 0.01 * (now.tick % 3))

    def tracks(pace, tick_s):
        robots, _ = served(answer, pace, tick_s)
        return np.array([now.x for _, now in robots.seen])

    np.testing.assert_array_equal(tracks(Pace(inf, wait=True), 0.01), tracks(Pace(inf, wait=True), 7.0))


def test_messages_of_each_robot(served):
    robots, _ = served(Robots.drive)
    decoded = dict(robots.messages)
    assert robots.messages[-1][1].ended
    assert sorted(decoded) == [
        "clock", "map", "my_team/readings",
        *(f"my_team_{n}/{what}" for n in (0, 1) for what in ("gas", "gas_1", "gas_raw", "odom", "wind")),
        "plume/ethanol", "tf", "tf_static",
    ]  # fmt: skip
    now = robots.seen[-1][1]
    assert decoded["clock"].clock.sec == 3
    odometry = decoded["my_team_1/odom"]
    assert odometry.pose.pose.position.x == pytest.approx(now.x[1])
    assert abs(ros.yaw(odometry.pose.pose.orientation)) == pytest.approx(np.pi, abs=1e-5)
    gas, resistance = now.gas.reshape(2, now.noses), now.resistance.reshape(2, now.noses)
    assert now.noses == 2
    assert decoded["my_team_1/gas"].raw == pytest.approx(gas[1, 0])
    assert decoded["my_team_1/gas_raw"].raw == pytest.approx(resistance[1, 0])
    assert decoded["my_team_1/gas_raw"].raw_units == ros.UNITS["ohm"]
    laser = decoded["my_team_1/gas_1"]
    assert laser.raw == pytest.approx(gas[1, 1])
    assert laser.raw > 1.0
    assert np.isnan(resistance[:, 1]).all()
    assert laser.technology == ros.TECHNOLOGIES["tdlas"]
    assert laser.raw_units == ros.UNITS["ppm m"]
    assert laser.header.frame_id == "my_team_1/gas_sensor_1"
    (looks,) = (
        one.transform
        for one in decoded["tf_static"].transforms
        if one.child_frame_id == laser.header.frame_id
    )
    assert looks.translation.y == pytest.approx(0.05)
    assert ros.yaw(looks.rotation) == pytest.approx(np.pi / 2)
    wind = decoded["my_team_0/wind"]
    assert wind.wind_speed == pytest.approx(np.hypot(now.wind_x[0], now.wind_y[0]))
    # it drives against the wind, so in its frame the air comes from ahead
    assert abs(wind.wind_direction) == pytest.approx(np.pi, abs=0.2)
    assert [(one.header.frame_id, one.child_frame_id) for one in decoded["tf"].transforms] == [
        link
        for n in (0, 1)
        for link in (("map", f"my_team_{n}/odom"), (f"my_team_{n}/odom", f"my_team_{n}/base_link"))
    ]
    assert odometry.header.frame_id == "my_team_1/odom"
    assert odometry.twist.twist.linear.x == pytest.approx(0.1, abs=1e-4)
    assert not odometry.pose.covariance.any(), "these robots know their poses"


def test_tf_leads_to_the_true_pose_by_the_believed_one(served, made):
    """Robots with odometry errors: the correction is an ideal localiser's, and the covariance grows."""
    changed = (
        scenario_from(SCENARIO)
        .robots[0]
        .model_copy(update={"localization": Odometry(kind="odometry", veer_deg=10)})
    )
    erring = assemble(made.scenario.model_copy(update={"robots": [changed]}), driven=True)
    robots, _ = served(Robots.drive, sim=erring)
    now = erring.swarm.snapshot()
    variances = []
    for n in (0, 1):
        correction, moved = dict(robots.messages)["tf"].transforms[2 * n : 2 * n + 2]
        at, shift = moved.transform.translation, correction.transform.translation
        off = ros.yaw(correction.transform.rotation)
        assert abs(off) > 1e-3
        assert [at.x, at.y] == pytest.approx(now["believed_position"][n].tolist(), abs=1e-6)
        there = (at.x + 1j * at.y) * np.exp(1j * off) + shift.x + 1j * shift.y
        assert [there.real, there.imag] == pytest.approx(now["position"][n].tolist(), abs=1e-5)
        heading = off + ros.yaw(moved.transform.rotation) - float(now["heading"][n])
        assert np.exp(1j * heading) == pytest.approx(1, abs=1e-5)
        odometry = [one for topic, one in robots.messages if topic == f"my_team_{n}/odom"]
        variances.append([one.pose.covariance[35] for one in odometry])
        path = now["odometer"][n]
        _, k2, _, _ = Odometry(kind="odometry").variances
        assert variances[-1][-1] == pytest.approx(k2 * path + np.radians(10) ** 2 * path**2, rel=0.02)
    assert (np.diff(variances, axis=1)[:, 2:] > 0).all()


def test_what_nobody_wants_is_not_made(served, monkeypatch):
    unwanted = ("map", "plume/ethanol", "tf")
    for what in ("topics.ros.grid", "topics.ros.cloud", "topics._transforms"):
        monkeypatch.setattr(f"taichi_plume.serve.{what}", lambda *_: pytest.fail("is made"))
    robots, _ = served(Robots.drive, unwanted=unwanted, warm=False)
    assert not {topic for topic, _ in robots.messages} & set(unwanted)


def test_what_there_is_to_see(served, made):
    """The floor, and the gas as the sensors would read it without a lag."""
    robots, _ = served(Robots.drive)
    seen = dict(robots.messages)
    assert sum(topic == "map" for topic, _ in robots.messages) == 4  # once a second
    info = seen["map"].info
    taken = seen["map"].data.reshape(info.height, info.width)
    assert taken.shape == (32, 42)
    assert (taken[1:-1, 1:-1] == 0).all()
    assert taken.sum() == 100 * (taken.size - 30 * 40)
    points = points_of(seen["plume/ethanol"])
    assert points["ppm"].min() >= 0.1
    n = points["ppm"].argmax()
    assert np.hypot(points["x"][n] - 0.5, points["y"][n] - 1.5) < 0.15  # at the source
    inside = [(dx, dy) for dx in (-0.025, 0.025) for dy in (-0.025, 0.025)]
    there = np.column_stack([points["x"], points["y"]]) + np.array(inside, np.float32)[:, None]
    largest = ppm_at(made.gas, there, made.t)[..., 0].max(axis=0)
    np.testing.assert_allclose(largest, points["ppm"], rtol=1e-4)


def test_lost_and_back(served, capsys):
    """A robot is silent for some ticks: it stands still, is reported as lost, and goes on."""

    def answer(robots, now):
        robots.drive(now, robot=(0,))
        if not 10 <= now.tick < 20:
            robots.drive(now, number=len(robots.seen) + 1000, robot=(1,))

    robots, service = served(answer, timeouts=True)
    x = np.array([now.x for _, now in robots.seen])[:, 1]
    moving = np.diff(x) < -1e-4
    assert moving[:14].all()
    assert not moving[16:20].any()
    assert moving[22:].all()
    reported = capsys.readouterr().err
    assert "my_team_1 lost: no command received, standing still" in reported
    assert "my_team_1 back" in reported
    assert service.summary()["messages"]["my_team"]["times_lost"] == 1
