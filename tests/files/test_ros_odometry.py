"""Covariances and velocities of Odometry messages, against closed forms of straight paths and of turns on the spot."""

import numpy as np
import pytest

from taichi_plume.files import ros_messages as ros
from taichi_plume.files.ros_odometry import ODOMETRY, DeadReckoning
from taichi_plume.files.ros_robots import MapFrame
from taichi_plume.scenario.localization import Camera, Localization, Odometry

MODEL = Odometry(kind="odometry")
K1, K2, K3, K4 = MODEL.variances
A, B, C = np.square(MODEL.deviations)
COURSE, LENGTH, STEPS, DT = 0.7, 5.0, 400, 0.1


def along(s, turn=0.0, model: Localization | None = MODEL) -> DeadReckoning:
    """Return the state at the end of a straight path of s [m] in direction COURSE, or of a turn on the spot [rad]."""
    reckoning = DeadReckoning(model, 1)
    for n in range(STEPS + 1):
        part = n / STEPS
        place = np.array([[2.0 + part * s * np.cos(COURSE), 1.0 + part * s * np.sin(COURSE), 0.0]])
        reckoning.advance(DT * n, place, np.array([COURSE + part * turn]))
    return reckoning


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_variances_of_a_straight_path(direction):
    """In axes along and across the path, forwards and backwards."""
    (found,) = along(direction * LENGTH).covariance
    turn = np.eye(3)
    turn[:2, :2] = [[np.cos(COURSE), np.sin(COURSE)], [-np.sin(COURSE), np.cos(COURSE)]]
    found = turn @ found @ turn.T
    wanted = np.zeros((3, 3))
    wanted[0, 0] = K3 * LENGTH + A * LENGTH**2
    wanted[1, 1] = K2 * LENGTH**3 / 3 + C * LENGTH**4 / 4
    wanted[1, 2] = wanted[2, 1] = direction * (K2 * LENGTH**2 / 2 + C * LENGTH**3 / 2)
    wanted[2, 2] = K2 * LENGTH + C * LENGTH**2
    assert found == pytest.approx(wanted, rel=1e-4, abs=1e-12)


def test_variances_of_a_turn_on_the_spot():
    """Two turns: errors of the distance, in all directions alike, and of the heading."""
    turn = 4 * np.pi
    (found,) = along(0.0, turn).covariance
    assert np.diag(found) == pytest.approx([K4 * turn / 2, K4 * turn / 2, K1 * turn + B * turn**2], rel=1e-3)
    assert found[2, :2] == pytest.approx([0, 0], abs=1e-9)


def test_velocities_have_the_variances_of_a_step():
    ahead, turning = along(-LENGTH), along(0.0, -3.0)
    speed, rate = -LENGTH / STEPS / DT, -3.0 / STEPS / DT
    assert ahead.velocity[0] == pytest.approx([speed, 0, 0], abs=1e-12)
    assert turning.turn_rate[0] == pytest.approx(rate)
    wanted = [K3 * abs(speed) / DT + A * speed**2, 0, K2 * abs(speed) / DT + C * speed**2]
    assert ahead.of_velocity[0] == pytest.approx(np.diag(wanted), rel=1e-9)
    wanted = [K4 * abs(rate) / DT, 0, K1 * abs(rate) / DT + B * rate**2]
    assert turning.of_velocity[0] == pytest.approx(np.diag(wanted), rel=1e-9)


def test_poses_that_are_known_have_no_variance():
    known, still = along(LENGTH, model=None), along(0.0)
    for one in (known, still):
        assert not one.covariance.any()
        assert not one.of_velocity.any()
    assert known.velocity[0, 0] == pytest.approx(LENGTH / STEPS / DT)


def test_poses_of_a_camera_have_the_variances_of_a_frame():
    """And a velocity is the difference of two frames."""
    seen = along(LENGTH, model=Camera(kind="camera", position_noise=0.01, heading_noise_deg=3.0))
    wanted = np.diag([1e-4, 1e-4, np.radians(3.0) ** 2])
    assert seen.covariance[0] == pytest.approx(wanted, rel=1e-12)
    assert seen.of_velocity[0] == pytest.approx(200 * wanted, rel=1e-9)


def test_readings_that_are_repeated_add_nothing():
    once, again = along(LENGTH), along(LENGTH)
    again.advance(STEPS * DT, again.place, again.heading)
    np.testing.assert_array_equal(again.covariance, once.covariance)
    np.testing.assert_array_equal(again.velocity, once.velocity)


def test_the_message_has_them_by_rows_of_x_y_z_roll_pitch_yaw():
    pytest.importorskip("rosbags")
    reckoning = along(LENGTH)
    one = ros.message(ODOMETRY, **reckoning.fields(0, "r_0", MapFrame(corner=(-2.0, -1.0))))
    assert (one.header.frame_id, one.child_frame_id) == ("r_0/odom", "r_0/base_link")
    assert one.header.stamp.sec == STEPS * DT
    end = [one.pose.pose.position.x, one.pose.pose.position.y]
    assert end == pytest.approx([LENGTH * np.cos(COURSE), LENGTH * np.sin(COURSE)])
    for part, planar in ((one.pose, reckoning.covariance[0]), (one.twist, reckoning.of_velocity[0])):
        whole = part.covariance.reshape(6, 6)
        for row, i in enumerate((0, 1, 5)):
            np.testing.assert_array_equal(whole[i, [0, 1, 5]], planar[row])
        assert not whole[2:5].any()
        assert not whole[:, 2:5].any()
