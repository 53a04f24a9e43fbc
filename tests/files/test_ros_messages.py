"""Messages of ROS 2 are what others read, and bytes that are none are reported."""

from contextlib import suppress

import numpy as np
import pytest

from taichi_plume.files import ros_messages as ros

pytest.importorskip("rosbags")


def test_a_message_comes_back_as_it_was():
    one = ros.message(
        "nav_msgs/msg/Odometry",
        header=ros.header(12.345678901, "map"),
        pose={"pose": {"position": {"x": 1.5, "y": -2.0}, "orientation": ros.yawed(2.0)}},
    )
    back = ros.decode("nav_msgs/msg/Odometry", ros.encode(one))
    assert (back.header.stamp.sec, back.header.stamp.nanosec, back.header.frame_id) == (12, 345678901, "map")
    assert (back.pose.pose.position.x, back.pose.pose.position.y) == (1.5, -2.0)
    assert ros.yaw(back.pose.pose.orientation) == pytest.approx(2.0)
    assert back.pose.covariance.shape == (36,)


def test_our_own_definitions():
    one = ros.message(ros.READINGS, t=0.3, tick=3, robot=[0, 1], gas=[1.0, np.nan], lost=[0, 1])
    back = ros.decode(ros.READINGS, ros.encode(one))
    np.testing.assert_array_equal(back.gas, np.array([1.0, np.nan], np.float32))
    assert back.tick == 3
    gas = ros.message(ros.GAS_SENSOR, raw=4.5e4, raw_units=ros.UNITS["ohm"], mpn=ros.PARTS["TGS2620"])
    assert ros.decode(ros.GAS_SENSOR, ros.encode(gas)).raw == 4.5e4
    text = ros.definition(ros.GAS_SENSOR)
    assert "UNITS_PPMXM=6" in text
    assert "MSG: builtin_interfaces/Time" in text


def test_a_time_has_whole_nanoseconds():
    assert ros.time(0.1 + 0.2) == {"sec": 0, "nanosec": 300_000_000}
    assert ros.time(2.9999999999) == {"sec": 3, "nanosec": 0}


def test_what_is_no_heading():
    assert np.isnan(ros.yaw(ros.message("geometry_msgs/msg/Quaternion")))
    assert np.isnan(ros.yaw(ros.message("geometry_msgs/msg/Quaternion", w=np.inf)))


def test_bytes_that_are_none():
    rng = np.random.default_rng(1)
    good = ros.encode(ros.message(ros.COMMANDS, robot=[0, 1], speed=[0.1, 0.2]))
    for _ in range(300):
        bad = bytearray(good)
        bad[rng.integers(len(bad))] = rng.integers(256)
        for data in (bytes(bad), good[: rng.integers(len(good))], rng.bytes(int(rng.integers(200)))):
            with suppress(ros.RosError):
                assert ros.decode(ros.COMMANDS, data).speed.dtype == np.float32
    with pytest.raises(KeyError, match="no field sped"):
        ros.message(ros.COMMANDS, sped=[1.0])
