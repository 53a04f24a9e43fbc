"""Bags of others: what is read of them, where the robots are by frames or poses, and what is wrong with some."""

import shutil
import sqlite3
from contextlib import closing
from dataclasses import replace
from math import cos, pi, sin
from typing import Any

import numpy as np
import pytest
from recorded_bag import ODOMETRY, POSE, TF, gas, pose, transforms, wind, write
from refusals import refused

from taichi_plume.files import bag_readings, bag_topics, bags
from taichi_plume.files import ros_messages as ros
from taichi_plume.files.bag_readings import BagOptions
from taichi_plume.files.bags import BagError
from taichi_plume.files.readings import ReadingsError, read

AT = np.arange(0.5, 5.0, 0.25)
"""Times of readings [s]."""


def poses(topic="/odom", kind=ODOMETRY, begin=0.0, rate=2.0, y=1.0):
    """A robot that drives along x with 0.2 m/s and turns left by 0.4 rad/s, from time `begin` on."""
    times = begin + np.arange(0.0, 6.0, 1.0 / rate)
    return [(t, topic, pose(t, 0.2 * (t - begin), y, 0.4 * (t - begin), kind)) for t in times]


def readings(topic="/gas", **more):
    return [(t, topic, gas(t, 10.0 * t, **more)) for t in AT]


# ---------------------------------------------------------------- what is read


@pytest.mark.parametrize(("storage", "version"), [("sqlite3", 8), ("sqlite3", 9), ("mcap", 8), ("mcap", 9)])
def test_poses_are_interpolated_to_the_times_of_readings(storage, version, tmp_path):
    winds = [(t, "/wind", wind(t, 0.5, 1.0 - 0.4 * t, "anemometer")) for t in np.arange(0.0, 6.0, 0.01)]
    folder = write(tmp_path / "a", [*poses(), *readings(), *winds], storage, version)
    (file,) = [one for one in folder.iterdir() if one.suffix in bags.FILES]
    for path in (folder, file):
        (one,) = bag_readings.read(path)
        assert (one.name, one.frame) == ("robot", "odom")
        assert one.topics == "gas of /gas in ppm, positions of /odom in frame odom, wind of /wind"
        np.testing.assert_allclose(one.read_at, AT)
        np.testing.assert_allclose(one.ppm, 10.0 * AT)
        np.testing.assert_allclose(one.at, np.stack([0.2 * AT, np.ones_like(AT)], axis=-1))
        np.testing.assert_allclose(one.heading, 0.4 * one.t)
        np.testing.assert_allclose(one.wind, np.tile([0.5 * cos(1), 0.5 * sin(1)], (len(AT), 1)), atol=2e-3)
        found = read(path)
        np.testing.assert_allclose(found.place, one.at)
        np.testing.assert_allclose(found.wind, one.wind)


def test_frames_lead_to_the_sensor(tmp_path):
    """The map, a drifting frame of odometry, the body, and a nose 0.3 m to its left."""
    times = np.arange(0.0, 6.0, 0.125)
    moving = []
    for t in times:
        odometry = ("map", "odom", 1.0 + 0.1 * t, 0.5, pi / 2)
        moving.append((t + 9, "/tf", transforms(t, odometry, ("/odom", "r/base", 0.4 * t, 0.0, 0.3 * t))))
    still = (0.0, "/tf_static", transforms(0.0, ("r/base", "r/nose", 0.0, 0.3, pi)))
    messages = [
        still,
        *moving,
        *readings("/r/gas", frame="r/nose"),
        *poses("/r/odom"),
        *[(t, "/r/wind", wind(t, 1.0, 0.0, "r/nose")) for t in times],
    ]
    (one,) = bag_readings.read(write(tmp_path / "a", messages))
    assert one.name == "r"
    turn = pi / 2 + 0.3 * AT
    wanted = np.stack([1.0 + 0.1 * AT - 0.3 * np.sin(turn), 0.5 + 0.4 * AT + 0.3 * np.cos(turn)], axis=-1)
    np.testing.assert_allclose(one.at, wanted, atol=1e-3)
    np.testing.assert_allclose(one.wind, np.stack([np.cos(turn + pi), np.sin(turn + pi)], axis=-1), atol=2e-3)
    way = np.stack([1.0 + 0.1 * one.t, 0.5 + 0.4 * one.t, 0 * one.t], axis=-1)
    np.testing.assert_allclose(one.place, way, atol=1e-6)
    np.testing.assert_allclose(np.unwrap(one.heading), pi / 2 + 0.3 * one.t, atol=1e-6)
    (other,) = bag_readings.read(tmp_path / "a", BagOptions(frame="odom"))
    np.testing.assert_allclose(other.place, np.outer(other.t, [0.4, 0.0, 0.0]), atol=1e-6)
    (by_topic,) = bag_readings.read(tmp_path / "a", BagOptions(gas=("/r/gas",), pose=("/r/odom",)))
    np.testing.assert_allclose(by_topic.at[:, 0], 1.0 + 0.1 * AT - 1.0, atol=1e-6)
    np.testing.assert_allclose(by_topic.at[:, 1], 0.5 + 0.2 * AT, atol=1e-6)


LAW: dict[str, Any] = {"raw_air": 5e4, "calib_a": 3.0, "calib_b": -0.7}


def test_resistances_become_ppm(tmp_path):
    ppm = 10.0 * AT
    raw = 5e4 * (1 + ppm * 3.0 ** (-1 / 0.7)) ** -0.7
    reported = [(t, "/gas", gas(t, r, "ohm", **LAW)) for t, r in zip(AT, raw, strict=True)]
    (one,) = bag_readings.read(write(tmp_path / "expected", [*poses(), *reported]))
    np.testing.assert_allclose(one.ppm, ppm, rtol=1e-6)
    raw = 30e3 * (1 + ppm / 4.32) ** -0.7155
    bare = [(t, "/gas", gas(t, r, "ohm")) for t, r in zip(AT, raw, strict=True)]
    bag = write(tmp_path / "bare", [*poses(), *bare])
    (one,) = bag_readings.read(bag, BagOptions(model="tgs2620", air=30e3))
    np.testing.assert_allclose(one.ppm, ppm, rtol=1e-6)
    for raw, value in ((6e4, 0.0), (0.0, np.nan), (np.nan, np.nan)):
        bag = write(tmp_path / str(raw), [*poses(), (1.0, "/gas", gas(1.0, raw, "ohm", **LAW))])
        (one,) = bag_readings.read(bag)
        np.testing.assert_array_equal(one.ppm, [value])
    (one,) = bag_readings.read(write(tmp_path / "b", [*poses(), *readings(units="ppb")]))
    np.testing.assert_allclose(one.ppm, 10e-3 * AT)


def test_plain_numbers_are_of_the_time_of_recording(tmp_path):
    """They have no stamp, so the poses' stamps, of another clock, do not count."""
    numbers = [(t, "/nose", ros.message("std_msgs/msg/Float32", data=10.0 * t)) for t in AT]
    off = [(t, topic, pose(t + 1e6, m.pose.position.x, 1.0, 0.0, POSE)) for t, topic, m in poses("/at", POSE)]
    (one,) = bag_readings.read(write(tmp_path / "a", [*off, *numbers]))
    np.testing.assert_allclose(one.read_at, AT)
    np.testing.assert_allclose(one.at[:, 0], 0.2 * AT)
    np.testing.assert_allclose(one.ppm, 10.0 * AT)


def test_one_of_an_array(tmp_path):
    def both(t):
        sensors = [{"raw": 1.0, "raw_units": 3}, {"raw": 10.0 * t, "raw_units": 3}]
        return ros.message(ros.GAS_SENSOR_ARRAY, header=ros.header(t, ""), sensors=sensors)

    bag = write(tmp_path / "a", [*poses(), *[(t, "/noses", both(t)) for t in AT]])
    (one,) = bag_readings.read(bag, BagOptions(sensor=1))
    np.testing.assert_allclose(one.ppm, 10.0 * AT)
    np.testing.assert_allclose(one.read_at, AT)
    with pytest.raises(BagError, match="/noses has 2 sensors in a message; choose with --sensor"):
        bag_readings.read(bag)
    with pytest.raises(BagError, match="and none of number 2"):
        bag_readings.read(bag, BagOptions(sensor=2))


def test_several_robots_are_groups(tmp_path):
    messages = [
        *poses("/r1/odom"), *poses("/fleet/r2/odom", y=2.0), *poses("/fleet/r2/amcl", POSE, y=3.0),
        *readings("/r1/gas"), *readings("/fleet/r2/gas"),
        *[(t, "/fleet/r2/wind", wind(t, 0.3, pi)) for t in (0.0, 6.0)],
    ]  # fmt: skip
    bag = write(tmp_path / "a", messages)
    both = read(bag)
    assert len(both.t) == 2 * len(AT)
    assert [line.split(":")[0] for line in both.topics] == ["fleet/r2", "r1"]
    assert [line.split(":")[0] for line in both.facts.remarks] == ["fleet/r2, r1"] * 2
    assert "in frame odom" in both.facts.remarks[0]
    assert "name no frame" in both.facts.remarks[1]
    second = read(bag, group="fleet/r2")
    np.testing.assert_allclose(second.place[:, 1], 2.0)
    np.testing.assert_allclose(second.wind, np.tile([-0.3, 0.0], (len(AT), 1)), atol=1e-6)
    other = read(bag, options=BagOptions(gas=("/fleet/r2/gas",), pose=("/fleet/r2/amcl",), upwind=True))
    np.testing.assert_allclose(other.place[:, 1], 3.0)
    np.testing.assert_allclose(other.wind[:, 0], 0.3)
    assert len(read(bag, group="fleet").t) == len(AT), "all whose name begins so"
    with pytest.raises(ReadingsError, match=r"has no group 'r3'; it has fleet/r2, r1$"):
        read(bag, group="r3")


def test_a_bag_by_another_library(tmp_path):
    """Of mcap-ros2-support: a file alone, whose schemas have comments, as those of packages do."""
    from mcap_ros2.writer import Writer

    def plain(message):
        if not hasattr(message, "__dataclass_fields__"):
            return message.tolist() if isinstance(message, np.ndarray) else message
        names = [name for name in message.__dataclass_fields__ if name[0] != "_"]
        return {name: plain(getattr(message, name)) for name in names}

    path = tmp_path / "lab.mcap"
    with path.open("wb") as file, Writer(file) as writer:
        kinds = {"/odom": ODOMETRY, "/gas": ros.GAS_SENSOR}
        schemas = {}
        for topic, kind in kinds.items():
            schemas[topic] = writer.register_msgdef(kind, "# of a package\n" + ros.definition(kind))
        for t, topic, message in [*poses(), *readings()]:
            writer.write_message(topic, schemas[topic], plain(message), round(t * 1e9))
    (one,) = bag_readings.read(path)
    np.testing.assert_allclose(one.ppm, 10.0 * AT)
    np.testing.assert_allclose(one.at[:, 0], 0.2 * AT)


def test_a_robot_of_several_noses(tmp_path):
    """Such as one that tells ppm and, apart, ohm."""
    both = [*readings("/r1/gas"), *readings("/r1/gas_raw", units="ppb")]
    bag = write(tmp_path / "a", [*poses("/r1/odom"), *both])
    assert len(read(bag).t) == 2 * len(AT)
    np.testing.assert_allclose(read(bag, group="r1/gas_raw").reading, 0.01 * AT)
    assert read(bag, options=BagOptions(gas=("/r1/gas",))).topics[0].startswith("r1: gas of /r1/gas in ppm, ")


def test_a_bag_of_ros_1(tmp_path):
    """Its messages have other names and, of a sensor, capitals."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    fields = ("uint8 technology", "float64 raw", "uint8 raw_units", "float64 raw_air")
    sensor = "\n".join(("Header header", *fields, "float64 calib_A", "float64 calib_B", ""))
    store.register(get_types_from_msg(sensor, "olfaction_msgs/msg/gas_sensor"))
    header, time = store.types["std_msgs/msg/Header"], store.types["builtin_interfaces/msg/Time"]
    pose_at, point, turn = (
        store.types[f"geometry_msgs/msg/{name}"] for name in ("Pose", "Point", "Quaternion")
    )
    with Writer(tmp_path / "a.bag") as writer:
        topics = {
            name: writer.add_connection(name, kind, typestore=store)
            for name, kind in (("/gas", "olfaction_msgs/msg/gas_sensor"), ("/pose", POSE))
        }
        for n, t in enumerate(AT):
            whole = header(seq=n, stamp=time(sec=int(t), nanosec=round(t % 1 * 1e9)), frame_id="/nose")
            reported = store.types["olfaction_msgs/msg/gas_sensor"](
                whole, 1, 5e4 * (1 + t) ** -0.7, 5, 5e4, 1.0, -0.7
            )
            there = store.types[POSE](whole, pose_at(point(0.2 * t, 1.0, 0.0), turn(0.0, 0.0, 0.0, 1.0)))
            for name, message in (("/gas", reported), ("/pose", there)):
                writer.write(
                    topics[name], round((t + 50) * 1e9), store.serialize_ros1(message, message.__msgtype__)
                )
    (one,) = bag_readings.read(tmp_path / "a.bag")
    np.testing.assert_allclose(one.read_at, AT)
    np.testing.assert_allclose(one.ppm, AT, rtol=1e-6)
    np.testing.assert_allclose(one.at[:, 0], 0.2 * AT)


def test_readings_without_poses_around_them_are_left_out(tmp_path):
    late = [one for one in poses() if 1.0 <= one[0] <= 3.0]
    found = read(write(tmp_path / "a", [*late, *readings()]))
    np.testing.assert_allclose(found.t, AT[(AT >= 1) & (AT <= 3)])
    assert any("9 of 18 readings of /gas have no pose" in remark for remark in found.facts.remarks)


def test_robots_with_frames_of_their_own(tmp_path):
    """Equal names in /r1/tf and /r2/tf, as many robots have them."""
    messages = []
    for name, y in (("r1", 1.0), ("r2", 2.0)):
        messages += [(t, f"/{name}/tf", transforms(t, ("map", "base", 0.2 * t, y, 0.0))) for t in (0.0, 6.0)]
        messages += readings(f"/{name}/gas", frame="base")
    first, second = bag_readings.read(write(tmp_path / "a", messages))
    np.testing.assert_allclose(first.at, np.column_stack([0.2 * AT, np.full(len(AT), 1.0)]), atol=1e-9)
    np.testing.assert_allclose(second.at[:, 1], 2.0)


def test_a_sensor_that_stands_has_no_robot(tmp_path):
    """Frames tell where it is, not odometry; of others that were moved from one to another nothing is wanted."""
    still = (0.0, "/tf_static", transforms(0.0, ("map", "post", 3.0, 2.0, 0.0)))
    cup = [(t, "/tf", transforms(t, (hand, "cup", 0, 0, 0))) for t, hand in ((1.0, "a"), (2.0, "b"))]
    messages = [still, *cup, *poses(), *readings("/s/gas", frame="post")]
    (one,) = bag_readings.read(write(tmp_path / "a", messages))
    np.testing.assert_allclose(one.at, np.tile([3.0, 2.0], (len(AT), 1)))
    (same,) = bag_readings.read(tmp_path / "a", BagOptions(frame="/map"))
    np.testing.assert_allclose(same.at, one.at)
    with pytest.raises(BagError, match="has no frame 'world'; it has a, cup, map, odom, post"):
        bag_readings.read(tmp_path / "a", BagOptions(frame="world"))


def test_where_it_ought_to_go_is_not_where_it_is(tmp_path):
    bag = write(tmp_path / "a", [*poses(), *poses("/r/goal_pose", POSE, y=9.0), *readings("/r/gas")])
    (one,) = bag_readings.read(bag)
    np.testing.assert_allclose(one.at[:, 1], 1.0)


def test_a_robot_with_several_sensors_goes_one_way(tmp_path):
    """Of its readings the first sensor's count, unless others are asked for."""
    names = [f"/r{n}/gas{k}" for n in (2, 10) for k in ("", "_1")]
    messages = [one for n in (2, 10) for one in poses(f"/r{n}/odom", y=float(n))]
    bag = write(tmp_path / "a", [*messages, *(one for name in names for one in readings(name))])
    assert [one.name for one in bag_readings.read(bag, BagOptions(lenient=True))] == ["r2", "r10"]
    assert [one.name for one in bag_readings.read(bag)] == ["r2/gas", "r2/gas_1", "r10/gas", "r10/gas_1"]
    assert len(read(bag, group="r2").t) == 2 * len(AT)


# ---------------------------------------------------------------- frames


def in_map(topic, kind, frame="map", y=2.5):
    """Poses in the frame of the map of the robot of `poses`: 1 m ahead, along x."""
    return [(t, topic, pose(t, 1.0 + 0.2 * t, y, 0.0, kind, frame)) for t in np.arange(0.0, 6.0, 1.0)]


CORRECTION = [(t, "/tf", transforms(t, ("map", "odom", 4.0, -1.0, pi / 2))) for t in (0.0, 9.0)]
LOCALISED = "geometry_msgs/msg/PoseWithCovarianceStamped"


@pytest.mark.parametrize("frame", ["map", "/map"])
@pytest.mark.parametrize(
    ("topic", "gas_topic"), [("/amcl_pose", "/gas"), ("/amcl_pose", "/r/gas"), ("/r/slam", "/r/gas")]
)
def test_the_frame_of_poses_decides_before_their_type(topic, gas_topic, frame, tmp_path):
    odometry = gas_topic.replace("gas", "odom")
    set_by_hand = (0.5, "/initialpose", pose(0.5, 9.0, 9.0, 0.0, LOCALISED, "map"))
    messages = [*poses(odometry), *in_map(topic, LOCALISED, frame), set_by_hand, *readings(gas_topic)]
    bag = write(tmp_path / "a", messages)
    (one,) = bag_readings.read(bag)
    assert (one.frame, one.remarks) == ("map", ())
    np.testing.assert_allclose(one.at, np.column_stack([1.0 + 0.2 * AT, np.full(len(AT), 2.5)]))
    (other,) = bag_readings.read(bag, BagOptions(frame="odom"))
    assert (other.frame, other.remarks) == ("odom", ())
    np.testing.assert_allclose(other.at, np.column_stack([0.2 * AT, np.ones(len(AT))]))
    (given,) = bag_readings.read(bag, BagOptions(pose=(odometry,)))
    assert given.frame == "odom"
    assert "positions are in frame odom" in given.remarks[0]
    with refused(BagError, bag, f"no pose leads from {gas_topic} to frame 'map'; it has map, odom"):
        bag_readings.read(bag, BagOptions(pose=(odometry,), frame="map"))
    with refused(BagError, bag, "has no frame 'earth'; it has map, odom"):
        bag_readings.read(bag, BagOptions(frame="earth"))


def test_transforms_correct_poses_of_odometry(tmp_path):
    """x of odom is y of the map."""
    bag = write(tmp_path / "a", [*CORRECTION, *poses(), *readings()])
    (one,) = bag_readings.read(bag)
    assert (one.frame, one.remarks) == ("map", ())
    np.testing.assert_allclose(one.at, np.column_stack([np.full(len(AT), 3.0), -1.0 + 0.2 * AT]), atol=1e-9)
    np.testing.assert_allclose(np.unwrap(one.heading), pi / 2 + 0.4 * one.t)
    (same,) = bag_readings.read(bag, BagOptions(lenient=True))
    np.testing.assert_allclose(same.place, one.place)


@pytest.mark.parametrize(("localised", "frame"), [(True, "map"), (False, "odom")])
def test_poses_without_gas_are_in_the_frame_of_the_map_too(localised, frame, tmp_path):
    messages = [*poses(), *(in_map("/amcl_pose", LOCALISED) if localised else ())]
    (one,) = bag_readings.read(write(tmp_path / "a", messages), BagOptions(lenient=True))
    assert one.frame == frame
    assert len(one.remarks) == (not localised)
    assert one.place[0, 1] == (2.5 if localised else 1.0)


def test_the_frames_of_a_bag_without_map_lead_to_their_root(tmp_path):
    moving = [(t, "/tf", transforms(t, ("world", "base", 0.3 * t, 1.5, 0.0))) for t in np.arange(0.0, 6.0)]
    (one,) = bag_readings.read(write(tmp_path / "a", [*moving, *readings(frame="base")]))
    assert one.frame == "world"
    assert "positions are in frame world" in one.remarks[0]
    np.testing.assert_allclose(one.at, np.column_stack([0.3 * AT, np.full(len(AT), 1.5)]))


@pytest.mark.parametrize("topic", ["/gas", "/odom"])
def test_a_topic_in_several_frames_is_refused(topic, tmp_path):
    """Where its values are is then unknown."""
    messages = [*poses(), *readings(frame="a")]
    other = gas(5.5, 1.0, frame="b") if topic == "/gas" else pose(5.7, 1.0, 1.0, 0.0, frame="map")
    bag = write(tmp_path / "a", [*messages, (5.9, topic, other)])
    with refused(
        BagError, bag, f"{topic} is in several frames, {'a, b' if topic == '/gas' else 'odom, map'}"
    ):
        bag_readings.read(bag)


def test_a_robot_does_not_take_the_poses_of_another(tmp_path):
    """Even if those are in the frame of the map."""
    messages = [
        *poses("/r1/odom"),
        *in_map("/r1/amcl", LOCALISED),
        *poses("/r2/odom"),
        *in_map("/amcl", LOCALISED),
    ]
    bag = write(tmp_path / "a", [*messages, *readings("/r1/gas"), *readings("/r2/gas")])
    assert [one.frame for one in bag_readings.read(bag)] == ["map", "odom"]


def stamped(kind, t, frame, **fields):
    return ros.message(f"geometry_msgs/msg/{kind}", header=ros.header(t, frame), **fields)


@pytest.mark.parametrize("every", [4.0, 100.0])
def test_the_source_with_poses_around_most_readings_counts(every, tmp_path):
    """AMCL publishes when the robot has moved; its poses in between lie on no straight line."""
    sparse = [
        (t, "/amcl_pose", pose(t, 3.0, -1.0 + 0.2 * t, 0.0, LOCALISED, "map"))
        for t in np.arange(0.5, 6, every)
    ]
    bag = write(tmp_path / "a", [*sparse, *CORRECTION, *poses(), *readings()])
    (one,) = bag_readings.read(bag)
    assert (one.topics.split(", ")[1], one.remarks) == ("positions of /odom in frame odom", ())
    np.testing.assert_allclose(one.at, np.column_stack([np.full(len(AT), 3.0), -1.0 + 0.2 * AT]), atol=1e-9)
    if every < 6.0:  # without /tf there is nothing better
        (one,) = bag_readings.read(write(tmp_path / "b", [*sparse, *poses(), *readings()]))
        assert one.frame == "map"
        (far, dropped) = sorted(one.remarks, key=lambda remark: "apart" not in remark)
        assert "16 of 18 readings of /gas lie between poses" in far or "15 of 18" in far
        assert "up to 4 s apart" in far
        assert "1 of 18" in dropped


def test_the_body_of_the_frames_counts_before_sparse_poses(tmp_path):
    """Even if no topic of odometry was recorded; frames of nobody's are no reason to refuse."""
    sparse = [(t, "/amcl_pose", pose(t, 3.0, 0.2 * t, 0.0, LOCALISED, "map")) for t in (0.0, 5.5)]
    cup = [
        (t, "/tf", transforms(t, (hand, "cup", 0, 0, 0), ("cup", "tea", t, 0, 0)))
        for t, hand in ((1, "a"), (2, "b"))
    ]
    links = [(t, "/tf", transforms(t, ("odom", "base_link", t * t, 0, 0))) for t in np.arange(0.0, 6.0, 0.25)]
    bag = write(tmp_path / "a", [*sparse, *cup, *CORRECTION, *links, *floats("/gas")])
    (one,) = bag_readings.read(bag)
    np.testing.assert_allclose(one.at, np.column_stack([np.full(len(AT), 4.0), -1.0 + AT**2]), atol=1e-9)
    with refused(BagError, bag, "has no frame 'earth'; it has a, base_link, cup, map, odom, tea"):
        bag_readings.read(bag, BagOptions(frame="earth"))
    (given,) = bag_readings.read(bag, BagOptions(frame="odom"))
    np.testing.assert_allclose(given.at[:, 0], AT**2, atol=1e-9)


@pytest.mark.parametrize("moving", [False, True])
def test_frames_beside_the_target_lead_to_it(moving, tmp_path):
    """As tf2 looks up: from the frame of the poses up to the common ancestor, and down; here world, and map in it."""
    ends = (0.0, 9.0)
    to_map = [
        (t, "/tf" if moving else "/tf_static", transforms(t, ("world", "map", 5.0, 2.0, pi / 2)))
        for t in ends
    ]
    lab = (0.0, "/tf_static", transforms(0.0, ("world", "lab", 1.0, 0.0, 0.0)))
    seen = [(t, "/vicon/pose", pose(t, 6.0, 0.2 * t, 0.0, POSE, "lab")) for t in np.arange(0.0, 6.0)]
    (one,) = bag_readings.read(write(tmp_path / "a", [*to_map, lab, *seen, *readings()]))
    assert (one.frame, one.remarks) == ("map", ())
    matrix = np.array([[0.0, -1.0, 5.0], [1.0, 0.0, 2.0], [0.0, 0.0, 1.0]])  # of map in world
    there = np.column_stack([np.full(len(AT), 7.0), 0.2 * AT, np.ones(len(AT))])
    np.testing.assert_allclose(one.at, np.linalg.solve(matrix, there.T).T[:, :2], atol=1e-9)
    np.testing.assert_allclose(one.heading, -pi / 2)


def test_frames_that_do_not_drift_are_preferred(tmp_path):
    """And other poses are named."""
    seen = [(t, "/vicon/pose", pose(t, 7.0, 0.2 * t, 0.0, POSE, "/world")) for t in np.arange(0.0, 6.0)]
    bag = write(tmp_path / "a", [*poses(), *seen, *readings()])
    (one,) = bag_readings.read(bag)
    assert one.frame == "world"
    np.testing.assert_allclose(one.at, np.column_stack([np.full(len(AT), 7.0), 0.2 * AT]))
    (remark,) = one.remarks
    assert "nothing leads from there to frame map" in remark
    assert "/odom in odom" in remark
    (other,) = bag_readings.read(bag, BagOptions(pose=("/odom",)))
    assert "/vicon/pose in world" in other.remarks[0]


def test_without_pose_topics_the_body_of_the_frames_is_the_robot(tmp_path):
    """Here with wheels, which move too; --pose names another frame."""
    links = [
        (
            t,
            "/tf",
            transforms(
                t,
                ("map", "odom", 1.0, 0, 0),
                ("odom", "base_link", 0.2 * t, 2, 0),
                ("base_link", "wheel", 0, 0.1, t),
            ),
        )
        for t in np.arange(0.0, 6.0)
    ]
    bag = write(tmp_path / "a", [*links, *floats("/gas")])
    (one,) = bag_readings.read(bag)
    np.testing.assert_allclose(one.at, np.column_stack([1.0 + 0.2 * AT, np.full(len(AT), 2.0)]))
    assert any("frame base_link (--pose" in remark for remark in one.remarks)
    (wheel,) = bag_readings.read(bag, BagOptions(pose=("/wheel",)))
    np.testing.assert_allclose(wheel.at[:, 1], 2.1)
    (replayed,) = bag_readings.read(write(tmp_path / "b", links), BagOptions(lenient=True))
    np.testing.assert_allclose(replayed.place[:, 0], 1.0 + 0.2 * replayed.t)
    two = [(t, "/tf", transforms(t, ("map", "a", t, 0, 0), ("map", "b", 0, t, 0))) for t in (0.0, 6.0)]
    bag = write(tmp_path / "c", [*two, *floats("/gas")])
    with refused(BagError, bag, "several frames that may carry /gas, a, b; choose with --pose"):
        bag_readings.read(bag)
    (second,) = bag_readings.read(bag, BagOptions(pose=("b",)))
    np.testing.assert_allclose(second.at[:, 1], AT)


def test_positions_of_other_types_are_read(tmp_path):
    """Of a motion capture, of beacons without heading, and in the plane without a frame."""
    of_body = {
        "child_frame_id": "vicon/robot",
        "transform": {"translation": {"x": 1.0}, "rotation": ros.yawed(0.5)},
    }
    for name, frame, assumed, heading, get in (
        ("seen", "world", "frame world", 0.5, lambda t: stamped("TransformStamped", t, "world", **of_body)),
        (
            "heard",
            "map",
            "no heading",
            pi / 2,
            lambda t: stamped("PointStamped", t, "map", point={"x": 1.0, "y": t}),
        ),
        ("flat", "map", "no frame", 0.3, lambda t: ros.message("geometry_msgs/msg/Pose2D", x=1.0, theta=0.3)),
    ):
        clicked = (0.5, "/clicked_point", stamped("PointStamped", 0.5, "map", point={"x": 9.0}))
        places = [(t, f"/{name}", get(t)) for t in np.arange(0.0, 6.0)]
        (one,) = bag_readings.read(write(tmp_path / name, [*places, clicked, *floats("/gas")]))
        assert one.frame == frame
        assert any(assumed in remark for remark in one.remarks)
        np.testing.assert_allclose(one.at[:, 0], 1.0)
        np.testing.assert_allclose(one.heading, heading, atol=1e-9)


@pytest.mark.parametrize("frame", ["base_link", "r1/base_footprint", "own_body"])
def test_the_body_of_the_robot_is_at_its_pose(frame, tmp_path):
    odometry = [(t, topic, replace(m, child_frame_id="own_body")) for t, topic, m in poses()]
    bag = write(tmp_path / "a", [*CORRECTION, *odometry, *readings(frame=frame)])
    (one,) = bag_readings.read(bag)
    assert one.remarks == ()


# ---------------------------------------------------------------- numbers of any message


def enose(t, *values):
    return ros.message("std_msgs/msg/Float64MultiArray", data=np.array(values))


def test_a_number_in_a_list_is_named(tmp_path):
    """Of several numbers each is a robot; a list that is empty at the start has no readings there."""
    numbers = [(0.25, "/r/enose", enose(0.25)), *[(t, "/r/enose", enose(t, 5.0, 4.0 * t)) for t in AT]]
    bag = write(tmp_path / "a", [*numbers, *in_map("/r/pose", POSE)])
    (one,) = bag_readings.read(bag, BagOptions(reading=("/r/enose.data[1]",)))
    np.testing.assert_allclose(one.ppm, [np.nan, *(4.0 * AT)])
    np.testing.assert_allclose(one.read_at[1:], AT)
    assert (one.name, one.topics.split(",")[0]) == ("r", "gas of /r/enose.data[1] in ppm")
    for part in (
        "is assumed to be ppm",
        "1 of 19 values",
        "times of /r/enose.data[1] are those of recording",
    ):
        assert any(part in remark for remark in one.remarks)
    both = bag_readings.read(bag, BagOptions(reading=("/r/enose.data[0]", "/r/enose.data[1]"), units="ppb"))
    assert [robot.name for robot in both] == ["r/enose.data[0]", "r/enose.data[1]"]
    np.testing.assert_allclose(both[0].ppm[1:], 0.005)
    assert not any("assumed" in remark for robot in both for remark in robot.remarks)
    raw = BagOptions(reading=("/r/enose.data[0]",), units="ohm", model="tgs2620", air=10.0)
    np.testing.assert_allclose(
        bag_readings.read(bag, raw)[0].ppm[1:], 4.32 * (2 ** (1 / 0.7155) - 1), rtol=1e-6
    )


@pytest.mark.parametrize(
    ("text", "reported"),
    [
        (
            "/enose",
            "--reading /enose: is no field such as /enose.data[0]; name a number in its messages, such as /enose.da",
        ),
        ("/nose.data[0]", "has no topic '/nose'; it has /enose, /odom"),
        ("/enose.values[0]", "/enose has no field 'values'; it has layout, data"),
        ("/enose.data", "/enose.data is no number; name one in it, such as /enose.data[0]"),
        ("/enose.data[2]", "no message has this number"),
        ("/enose.data[0].ppm", "/enose.data[0] has no field 'ppm'; it has none"),
        ("/enose.layout", "is no number; name one in it, such as /enose.layout.data_offset"),
        ("/odom.child_frame_id", "/odom.child_frame_id is no number"),
        ("/odom.child_frame_id[0]", "/odom.child_frame_id is no list"),
        ("/enose.data[-1]", "is no field such as /enose.data[0]"),
        ("/enose data", "has no topic '/enose data'"),
    ],
)
def test_what_names_no_number_is_refused(text, reported, tmp_path):
    bag = write(tmp_path / "a", [*poses(), *[(t, "/enose", enose(t, 1.0, 2.0)) for t in AT]])
    with refused(BagError, bag, reported):
        bag_readings.read(bag, BagOptions(reading=(text,)))
    with refused(
        BagError,
        bag,
        "(std_msgs/Float64MultiArray), /odom (nav_msgs/Odometry); name a number by --reading, such as /enose.data[0]",
    ):
        bag_readings.read(bag)


CUSTOM = "std_msgs/Header header\nlab_msgs/Channel[] channels\nbool valid\n"
CHANNEL = "string gas\nfloat32 ppb\nfloat64[2] at\n"


def custom_bag(path, storage, ros1=False):
    """A bag with messages of types that no library knows: in MCAP and in ROS 1 with their definitions."""
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_JAZZY)
    whole = CUSTOM.replace("std_msgs/Header", "Header") if ros1 else CUSTOM
    store.register(get_types_from_msg(CHANNEL, "lab_msgs/msg/Channel"))
    store.register(get_types_from_msg(whole, "lab_msgs/msg/Air"))
    of = {name.rpartition("/")[2]: kind for name, kind in store.types.items() if name != "std_msgs/msg/Time"}
    writer = Writer1(path) if ros1 else Writer2(path, version=8, storage_plugin=StoragePlugin[storage])
    pack = store.serialize_ros1 if ros1 else store.serialize_cdr
    with writer:
        topics = {
            name: writer.add_connection(name, kind, typestore=store)
            for name, kind in (("/air", "lab_msgs/msg/Air"), ("/pose", POSE))
        }
        for n, t in enumerate(np.arange(0.0, 6.0, 0.25)):
            stamp = of["Time"](sec=int(t) + 100, nanosec=round(t % 1 * 1e9))
            head, there = (of["Header"](*((n,) if ros1 else ()), stamp, frame) for frame in ("nose", "map"))
            channels: Any = [
                of["Channel"](gas, 1e3 * k * (1 + t), np.array([t, k])) for k, gas in enumerate("ab")
            ]
            at = of["Pose"](of["Point"](0.2 * t, 1.0, 0.0), of["Quaternion"](0.0, 0.0, 0.0, 1.0))
            for name, message in (
                ("/air", of["Air"](head, channels, True)),
                ("/pose", of["PoseStamped"](there, at)),
            ):
                writer.write(topics[name], round(t * 1e9), bytes(pack(message, message.__msgtype__)))
    return path


@pytest.mark.parametrize(("storage", "ros1"), [("MCAP", False), ("SQLITE3", False), ("", True)])
def test_a_number_in_a_message_defined_in_the_bag(storage, ros1, tmp_path):
    bag = custom_bag(tmp_path / ("a.bag" if ros1 else "a"), storage, ros1)
    if storage == "SQLITE3":  # as ROS recorded before Iron
        (file,) = bag.glob("*.db3")
        with closing(sqlite3.connect(file)) as base, base:
            base.execute("DELETE FROM message_definitions")
        for options in (BagOptions(), BagOptions(reading=("/air.channels[1].ppb",))):
            with refused(
                BagError,
                bag,
                "/air is of type lab_msgs/msg/Air, whose definition the bag does not hold|no topic of gas",
            ):
                bag_readings.read(bag, options)
        return
    (one,) = bag_readings.read(bag, BagOptions(reading=("/air.channels[1].ppb",)))
    assert one.topics.startswith("gas of /air.channels[1].ppb in ppb")
    assert not any("assumed to be ppm" in remark for remark in one.remarks)
    np.testing.assert_allclose(one.ppm, 1.0 + one.read_at - 100.0, rtol=1e-6)
    np.testing.assert_allclose(one.at[:, 0], 0.2 * (one.read_at - 100.0), atol=1e-9)
    assert len(one.ppm) == 24
    (second,) = bag_readings.read(bag, BagOptions(reading=("/air.channels[1].at[1]",)))
    assert (second.ppm == 1.0).all()
    for text, reported in (
        ("/air.valid", "is no number"),
        ("/air.channels[0]", "/air.channels[0].ppb"),
    ):
        with refused(BagError, bag, reported):
            bag_readings.read(bag, BagOptions(reading=(text,)))
    with refused(BagError, bag, "name a number by --reading, such as /air.channels[0].ppb"):
        bag_readings.read(bag)


@pytest.mark.parametrize(
    ("topic", "factor"),
    [
        ("/h2s_ppb", 1e-3), ("/pid/PPM", 1.0), ("/ppb_sensor", None), ("/ppb", 1e-3), ("/ch4_raw_percent", 1e4),
        ("/voc_ppt", 1e-6), ("/gas/min", None),
    ],
)  # fmt: skip
def test_the_name_of_a_topic_may_state_the_unit(topic, factor, tmp_path):
    numbers = [(t, topic, ros.message("std_msgs/msg/Float64", data=7.0 * t)) for t in AT]
    (one,) = bag_readings.read(write(tmp_path / "a", [*in_map("/pose", POSE), *numbers]))
    np.testing.assert_allclose(one.ppm, 7.0 * AT * (factor or 1.0))
    assert any("assumed to be ppm" in remark for remark in one.remarks) is (factor is None)


@pytest.mark.parametrize(
    ("topic", "kind", "reading"),
    [
        ("/gas_mV", "mv", ()), ("/voc_mg_m3", "mg/m3", ()), ("/pid_adc", "adc", ()), ("/gas_v", "v", ("/gas_v.data",)),
        ("/ch4_percent_lel", "lel", ()),
    ],
)  # fmt: skip
def test_names_of_units_that_are_no_share_are_refused(topic, kind, reading, tmp_path):
    numbers = [(t, topic, ros.message("std_msgs/msg/Float64", data=7.0 * t)) for t in AT]
    bag = write(tmp_path / "a", [*in_map("/pose", POSE), *numbers])
    with refused(BagError, bag, f"the unit of gas is {kind}, not ppm"):
        bag_readings.read(bag, BagOptions(reading=reading))
    (one,) = bag_readings.read(bag, BagOptions(units="ppb"))
    np.testing.assert_allclose(one.ppm, 7e-3 * AT)


def test_the_name_of_a_topic_may_state_kiloohms(tmp_path):
    numbers = [(t, "/mox_kohm", ros.message("std_msgs/msg/Float64", data=20.0)) for t in AT]
    bag = write(tmp_path / "a", [*in_map("/pose", POSE), *numbers])
    (one,) = bag_readings.read(bag, BagOptions(model="tgs2620", air=40e3))
    np.testing.assert_allclose(one.ppm, 4.32 * (2 ** (1 / 0.7155) - 1), rtol=1e-6)


def test_a_sensor_is_mounted_on_the_body_whose_poses_are_recorded(tmp_path):
    """0.3 m to the left of a robot that turns; /tf_static alone says so."""
    still = (
        0.0,
        "/tf_static",
        transforms(0.0, ("base", "arm", 0.0, 0.1, pi / 2), ("arm", "nose", 0.2, 0.0, 0.0)),
    )
    (one,) = bag_readings.read(
        write(tmp_path / "a", [still, *poses(), *readings(frame="nose")]), BagOptions(frame="odom")
    )
    turn = 0.4 * AT
    np.testing.assert_allclose(
        one.at, np.column_stack([0.2 * AT - 0.3 * np.sin(turn), 1 + 0.3 * np.cos(turn)]), atol=1e-9
    )
    (remark,) = one.remarks
    assert "assumed to be those of base, on which nose is mounted" in remark


def test_values_that_mean_none_are_left_out(tmp_path):
    """In the unit of the message, before it is converted."""
    raw = np.where(np.arange(len(AT)) % 3 == 1, -9999.0, 2000.0 * AT)
    raw[5] = np.nan
    messages = [(t, "/gas", gas(t, value, "ppb")) for t, value in zip(AT, raw, strict=True)]
    (one,) = bag_readings.read(write(tmp_path / "a", [*in_map("/pose", POSE), *messages]))
    np.testing.assert_allclose(one.ppm, np.where(np.isnan(raw) | (raw < 0), np.nan, 2.0 * AT))
    (remark,) = one.remarks
    assert "7 of 18 values of /gas mean none (-9999, nan)" in remark


def test_stamps_of_zero_are_none(tmp_path):
    """If some messages have none, all times are those of recording."""
    mixed = [(t, "/gas", gas(t + 1e6 if n % 2 else 0.0, t)) for n, t in enumerate(AT)]
    (one,) = bag_readings.read(write(tmp_path / "a", [*in_map("/pose", POSE), *mixed]))
    np.testing.assert_allclose(one.read_at, AT)
    assert "9 of 18 messages have one" in one.remarks[0]


# ---------------------------------------------------------------- what is wrong


def vectors(topic):
    kind = "geometry_msgs/msg/Vector3Stamped"
    return [(t, topic, ros.message(kind, header=ros.header(t, ""), vector={"x": 1.0})) for t in AT]


def floats(topic):
    return [(t, topic, ros.message("std_msgs/msg/Float64", data=t)) for t in AT]


LOOP = [(t, "/tf", transforms(t, ("b", "a", 1, 0, 0), ("a", "b", 1, 0, 0))) for t in (0.0, 9.0)]


@pytest.mark.parametrize(
    ("messages", "wanted", "reported"),
    [
        (poses(), {}, "has no topic of gas of a type that is known; it has /odom (nav_msgs/Odometry)"),
        (readings(), {}, "has no poses for /gas: neither frames that lead to it nor a topic of them"),
        ([*readings(frame="a"), *LOOP], {}, "has no poses for /gas"),
        ([*readings(), *poses()], {"gas": ("/odor",)}, "has no topic '/odor'; it has /gas, /odom"),
        ([*readings(), *poses()], {"gas": ("/odom",)}, "'/odom' is of type nav_msgs/msg/Odometry; olfaction_msgs/GasS"),
        ([*readings(), *poses()], {"pose": ("/gas",)}, "'/gas' is of type olfaction_msgs/msg/GasSensor; nav_msgs/Odom"),
        ([*readings(), *poses()], {"pose": ("/odom", "/odom")}, "--pose is given 2 times for 1 topics of gas, /gas"),
        ([*readings(), *poses(), *poses("/other")], {}, "several topics of poses for /gas, /odom, /other; choose"),
        ([*floats("/a"), *floats("/b"), *poses()], {}, "several topics that may be gas, /a, /b; choose with --topic"),
        ([*readings(), *poses(), *vectors("/wind1"), *vectors("/wind2")], {}, "several topics of wind for /gas"),
        ([*readings(), *poses(begin=100.0)], {}, "(0.5 to 4.75 s) has a pose of /odom in frame odom (100 to 105.5 s)"),
        ([*readings(units="volt"), *poses()], {}, "the unit of gas is volt, not ppm, ppb or ohm; give --units"),
        ([*readings(units="ohm"), *poses()], {}, "has resistances without calib_a and calib_b; give --model"),
        ([*readings(units="ohm"), *poses()], {"model": "tgs2600"}, "without raw_air, the resistance in clean air"),
        ([*readings(frame="nose"), (1.0, "/tf", transforms(1.0, ("a", "nose", 0, 0, 0), ("b", "nose", 0, 0, 0)))], {},
         "frame 'nose' is in 'a' and in 'b'"),
        ([], {}, "has no topic of gas of a type that is known; it has none"),
    ],
)  # fmt: skip
def test_what_is_not_there_is_reported_in_a_line(messages, wanted, reported, tmp_path):
    bag = write(tmp_path / "a", messages)
    with refused(BagError, bag, reported):
        bag_readings.read(bag, BagOptions(**wanted))


def test_vectors_are_wind_only_where_they_say_so(tmp_path):
    assert not read(write(tmp_path / "a", [*readings(), *poses(), *vectors("/force")])).wind.any()
    write(tmp_path / "b", [*readings(), *poses(), *vectors("/wind")])
    for name, wanted in (("b", None), ("a", BagOptions(wind=("/force",)))):
        np.testing.assert_allclose(read(tmp_path / name, options=wanted).wind[:, 0], 1.0)


def test_what_is_no_bag_is_reported_in_a_line(tmp_path):
    bag = write(tmp_path / "a", [*poses(), *readings()])
    (tmp_path / "folder").mkdir()
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "robots.parquet").touch()
    (tmp_path / "text.mcap").write_text("no bag")
    (tmp_path / "empty.db3").touch()
    linked = shutil.copytree(bag, tmp_path / "linked")
    (linked / "a.mcap").unlink()
    (linked / "a.mcap").symlink_to(bag / "a.mcap")
    away = shutil.copytree(bag, tmp_path / "away")
    (away / "a.mcap").rename(tmp_path / "elsewhere.mcap")
    text = (away / "metadata.yaml").read_text()
    (away / "metadata.yaml").write_text(text.replace("- a.mcap", "- ../elsewhere.mcap"))
    (tmp_path / "a.csv").write_text("t,x,y,reading\n1,0,0,2\n")
    with pytest.raises(ReadingsError, match="is no bag, so it has no topics"):
        read(tmp_path / "a.csv", options=BagOptions(frame="odom"))
    for name, reported in (
        ("missing.mcap", "does not exist"),
        ("folder", "is a folder without metadata.yaml, and so no bag"),
        ("run", "name a file in it, such as robots.parquet"),
        ("text.mcap", "cannot be read"),
        ("empty.db3", "cannot be read"),
        ("linked", "holds a.mcap, which is no plain file"),
        ("away", "cannot be read: Some database files are missing"),
    ):
        with refused(ReadingsError, tmp_path / name, reported):
            read(tmp_path / name)


def test_all_types_that_are_reported_are_there():
    for kind in (*bag_topics.GAS, *bag_topics.POSES, *bag_topics.WINDS, TF):
        assert ros.definition(kind)
