"""Commands to robots, whatever comes: each is taken, or counted and reported in a line."""

from contextlib import suppress

import numpy as np
import pytest

from taichi_plume import client
from taichi_plume.agents.external import AWAITED, DRIVEN, LOST
from taichi_plume.files import ros_messages as ros
from taichi_plume.serve.inbox import Inbox

pytest.importorskip("rosbags")
FLOOR = ((0.0, 0.0), (4.0, 3.0))


class Clock:
    now = 100.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def lines():
    return []


@pytest.fixture
def velocities(clock, lines):
    return Inbox("team", 3, False, FLOOR, 1.0, lines.append, clock)


@pytest.fixture
def poses(clock, lines):
    return Inbox("real", 2, True, FLOOR, 1.0, lines.append, clock)


def commands(number=1, tick=0, robot=(0,), **fields) -> bytes:
    return ros.encode(ros.message(ros.COMMANDS, number=number, tick=tick, robot=robot, **fields))


def drive(number=1, tick=0, robot=(0,), speed=0.1, turn_rate=0.2) -> bytes:
    count = len(robot)
    return commands(number, tick, robot, speed=[speed] * count, turn_rate=[turn_rate] * count)


def test_a_robot_carries_out_its_last_command(velocities):
    assert (velocities.orders().state == AWAITED).all()
    velocities.hear_commands(drive(1, robot=(0, 2)))
    velocities.hear_commands(drive(2, speed=0.3))
    orders = velocities.orders()
    assert orders.state.tolist() == [DRIVEN, AWAITED, DRIVEN]
    np.testing.assert_allclose(orders.speed, [0.3, 0.0, 0.1], rtol=1e-6)
    np.testing.assert_allclose(orders.turn_rate, [0.2, 0.0, 0.2], rtol=1e-6)
    assert velocities.counts == {"taken": 2}


def test_one_that_is_silent_is_lost_and_may_come_back(velocities, clock):
    velocities.hear_commands(drive(5, robot=(0, 1, 2)))
    clock.now += 0.9
    velocities.hear_commands(drive(6, robot=(1,)))
    clock.now += 0.2
    orders = velocities.orders()
    assert orders.state.tolist() == [LOST, DRIVEN, LOST]
    assert orders.speed[0] == 0.0
    velocities.hear_commands(drive(1))  # another program, which counts anew
    assert velocities.orders().state.tolist() == [DRIVEN, DRIVEN, LOST]
    assert velocities.counts["late"] == 0
    velocities.hear_commands(drive((1 << 64) - 1))
    velocities.hear_commands(drive(2))
    assert velocities.counts["late"] == 1


def test_what_comes_late(velocities, lines):
    velocities.published(50, 40)
    velocities.hear_commands(drive(5, 45))
    velocities.hear_commands(drive(5, 45, speed=0.5))  # the same again
    velocities.hear_commands(drive(4, 45, speed=0.5))  # sent before
    velocities.hear_commands(drive(6, 39, speed=0.5))  # answers readings of long ago
    assert velocities.orders().speed[0] == pytest.approx(0.1)
    assert velocities.counts == {"taken": 1, "late": 3}
    assert [line.split(";")[0] for line in lines] == [
        "team: late messages: 1, the last one: number 5 came after 5",
        "team: late messages: 2, the last one: number 4 came after 5",
    ]
    velocities.hear_commands(drive(6, 39))
    assert "readings of tick 39, ticks before 40 are too old" in lines[-1]


class Session:
    """Of zenoh, in place of a network: what is put reaches an inbox at once."""

    def __init__(self, inbox):
        self.put = inbox.hear_commands

    def declare_subscriber(self, *_):
        return None

    def declare_publisher(self, *_):
        return self


def test_the_client_that_was_started_last_drives(velocities, monkeypatch):
    """However many commands the older one has sent before."""
    monkeypatch.setattr(client, "_connected", lambda *_: Session(velocities))
    older = client.Team(robots=[0])
    for _ in range(500):
        older.drive(0.1)
    newer = client.Team(robots=[0])
    number = newer.drive(0.2)
    older.drive(0.1)
    assert velocities.orders().speed[0] == pytest.approx(0.2)
    assert velocities.counts == {"taken": 501, "late": 1}
    assert velocities.number[0] == number
    reported = ros.decode(ros.READINGS, ros.encode(ros.message(ros.READINGS, answered=velocities.number)))
    assert reported.answered[0] == number


def test_what_tells_no_tick_answers_the_newest_readings(velocities):
    velocities.published(50, 40)
    velocities.hear_twist(1, ros.encode(ros.message("geometry_msgs/msg/Twist", linear={"x": 0.2})))
    velocities.hear_commands(drive(1, 45, robot=(2,)))
    assert velocities.answers.tolist() == [-1, 50, 45]


def test_who_has_waited_for_others_is_not_lost_at_the_begin(velocities, clock):
    velocities.hear_commands(drive(1, robot=(0, 1)))
    clock.now += 5
    assert velocities.lost().tolist() == [True, True, False]
    velocities.begin()
    assert velocities.orders().state.tolist() == [DRIVEN, DRIVEN, AWAITED]


def test_texts_in_json(velocities, lines):
    velocities.hear_twist(0, b'{"linear": {"x": 0.3}}', True)
    assert velocities.orders().speed[0] == pytest.approx(0.3)
    for text in (b'{"linear": {"x": "a"}}', b'{"no": 1}', b"[1]", b"{", b"\xff", b'{"linear": {"x": NaN}}'):
        velocities.hear_twist(0, text, True)
    velocities.hear_twist(0, b" " * 40_000, True)
    assert velocities.counts == {"taken": 1, "malformed": 6, "oversized": 1}
    assert all("\n" not in line for line in lines)


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (b"hello", "is no taichi_plume_msgs"),
        (commands(), "speed has 0 entries, robot has 1"),
        (commands(robot=()), "'robot' is empty"),
        (drive(robot=(3,)), "robot 3 does not exist; allowed: 0 to 2"),
        (drive(robot=(2**32 - 1,)), "robot 4294967295 does not exist; allowed: 0 to 2"),
        (drive(speed=np.nan), "speed of robot 0 is no number"),
        (drive(turn_rate=-np.inf), "turn_rate of robot 0 is no number"),
        (commands(x=[1.0], y=[1.0], heading=[0.0]), "poses, but the group takes velocities"),
        (drive(tick=7), "answers readings of tick 7, the newest are of 0"),
        (commands(speed=[0.1], turn_rate=[0.1], declared_x=[1.0]), "declared_y has 0 entries, robot has 1"),
    ],
)
def test_what_is_malformed(velocities, lines, data, why):
    velocities.hear_commands(data)
    assert velocities.counts == {"malformed": 1}
    assert why in lines[0]
    assert (velocities.orders().state == AWAITED).all()


def test_poses(poses, lines):
    poses.hear_commands(commands(robot=(0, 1), x=[1.0, 3.5], y=[2.0, 0.5], heading=[0.1, 9.0]))
    orders = poses.orders()
    np.testing.assert_allclose(orders.position, [[1.0, 2.0], [3.5, 0.5]])
    np.testing.assert_allclose(orders.heading, [0.1, 9.0], rtol=1e-6)
    poses.hear_commands(commands(2, robot=(0, 1), x=[1.0, 4.5], y=[2.0, 0.5], heading=[0.1, 0.2]))
    assert "(4.5, 0.5) m is not on the floor" in lines[-1]
    np.testing.assert_allclose(poses.orders().position, [[1.0, 2.0], [3.5, 0.5]])


def test_drones(clock, lines):
    drones = Inbox("drones", 1, False, FLOOR, 1.0, lines.append, clock, ceiling=2.0)
    drones.hear_commands(commands(speed=[0.1], turn_rate=[0.0], left=[0.2], climb=[-0.3]))
    orders = drones.orders()
    assert (orders.left[0], orders.climb[0]) == pytest.approx((0.2, -0.3))
    twist = ros.message("geometry_msgs/msg/Twist", linear={"x": 0.2, "y": 0.4, "z": 0.5})
    drones.hear_twist(0, ros.encode(twist))
    assert (drones.orders().left[0], drones.orders().climb[0]) == (0.4, 0.5)
    clock.now += 5
    assert drones.orders().climb[0] == 0.0
    real = Inbox("real", 1, True, FLOOR, 1.0, lines.append, clock, ceiling=2.0)
    real.hear_commands(commands(x=[1.0], y=[1.0], z=[1.5], heading=[0.0]))
    assert real.orders().altitude[0] == 1.5
    real.hear_commands(commands(2, x=[1.0], y=[1.0], z=[2.5], heading=[0.0]))
    assert "z is not between the floor and the ceiling, 2 m" in lines[-1]
    walker = Inbox("walker", 1, False, FLOOR, 1.0, lines.append, clock)
    walker.hear_twist(0, ros.encode(twist))
    assert "the group's robots do not fly" in lines[-1]


def test_a_lost_robot_stays_where_it_was_seen_last(poses, clock):
    poses.hear_commands(commands(x=[1.0], y=[2.0], heading=[0.1]))
    clock.now += 5
    orders = poses.orders()
    assert orders.state.tolist() == [LOST, AWAITED]
    assert orders.position[0].tolist() == [1.0, 2.0]


def test_messages_of_ros(velocities, poses, lines):
    twist = ros.message("geometry_msgs/msg/Twist", linear={"x": 0.2}, angular={"z": -0.4})
    velocities.hear_twist(1, ros.encode(twist))
    assert velocities.orders().speed.tolist() == [0.0, 0.2, 0.0]
    assert velocities.orders().turn_rate.tolist() == [0.0, -0.4, 0.0]
    pose = {"position": {"x": 1.0, "y": 2.0}, "orientation": ros.yawed(0.7)}
    poses.hear_pose(1, ros.encode(ros.message("geometry_msgs/msg/PoseStamped", pose=pose)))
    assert poses.orders().heading[1] == pytest.approx(0.7)
    poses.hear_pose(1, ros.encode(ros.message("geometry_msgs/msg/PoseStamped")))  # its quaternion is none
    poses.hear_twist(1, ros.encode(twist))
    velocities.hear_pose(1, ros.encode(ros.message("geometry_msgs/msg/PoseStamped", pose=pose)))
    for line, fault in zip(lines, ("heading", "group takes poses", "group takes velocities"), strict=True):
        assert fault in line


def test_what_is_oversized_is_not_read(velocities, lines):
    velocities.hear_commands(bytes(velocities.longest + 1))
    assert velocities.counts == {"oversized": 1}
    assert "4,289 bytes, more than the 4,288" in lines[0]


def test_a_declaration_is_said_once(velocities):
    velocities.hear_commands(
        commands(robot=(0, 1), speed=[0, 0], turn_rate=[0, 0], declared_x=[np.nan, 1], declared_y=[np.nan, 2])
    )
    np.testing.assert_array_equal(velocities.orders().declared, [[np.nan] * 2, [1, 2], [np.nan] * 2])
    assert np.isnan(velocities.orders().declared).all()


def test_ten_thousand_that_are_malformed_change_nothing(velocities, lines):
    """Bytes of a good message with some changed, cut off, put together, or at random."""
    rng = np.random.default_rng(3)
    velocities.hear_commands(drive(2**31, robot=(0, 1, 2), speed=0.1))
    good, taken = drive(1, robot=(0, 1, 2)), velocities.counts["taken"]
    for k in range(10_000):
        bad = bytearray(good if k % 2 else rng.bytes(int(rng.integers(200))))
        for _ in range(rng.integers(4)):
            if bad:
                bad[rng.integers(len(bad))] = rng.integers(256)
        with suppress(IndexError):
            del bad[rng.integers(4, 400) :]
        velocities.hear_commands(bytes(bad))
    counts = velocities.counts
    assert sum(counts.values()) == 10_001
    assert counts["malformed"] > 5000
    assert len(lines) < 60  # the first, and fewer and fewer
    orders = velocities.orders()
    assert np.isfinite(orders.speed).all()
    if counts["taken"] == taken:
        np.testing.assert_allclose(orders.speed, 0.1, rtol=1e-6)
