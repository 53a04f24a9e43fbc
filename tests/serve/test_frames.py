"""Frames of published positions: those of an imported map of ROS, both out and in."""

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from taichi_plume.assembly.preparation import load
from taichi_plume.files import ros_messages as ros
from taichi_plume.files.ros_odometry import DeadReckoning
from taichi_plume.files.ros_robots import MapFrame
from taichi_plume.serve import topics
from taichi_plume.serve.inbox import Inbox

pytest.importorskip("rosbags")
ROOM = """
duration: 2
domain: {size: [6, 3], spacing: 0.1}
obstacles: [{kind: map, file: plan.yaml}]
wind: {kind: synthetic, speed: 5 cm/s}
gas: {kind: eulerian, sources: [{position: [1, 1.5], rate: 1 mg/s}]}
"""


@pytest.fixture
def room(tmp_path):
    Image.fromarray(np.full((60, 120), 254, np.uint8)).save(tmp_path / "plan.pgm")
    (tmp_path / "plan.yaml").write_text(
        "image: plan.pgm\nresolution: 0.05\norigin: [-2.0, -1.0, 0.0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    (tmp_path / "s.yaml").write_text(ROOM)
    return tmp_path / "s.yaml"


def parts_of(link):
    """Return translation and rotation of a ROS Transform."""
    at, turn = link.translation, link.rotation
    return np.array([at.x, at.y, at.z]), Rotation.from_quat([turn.x, turn.y, turn.z, turn.w])


def frame_of(room, *overrides) -> MapFrame:
    scenario, resources = load(room, overrides)
    return MapFrame.of(scenario, resources.obstacles)


def test_the_frame_is_that_of_the_imported_map(room):
    assert frame_of(room) == ("map", (-2.0, -1.0))
    assert frame_of(room, "obstacles.0.origin=[-1.5, -1]") == ("map", (-1.5, -1.0))
    assert frame_of(room, "obstacles=[]") == ("map", (0.0, 0.0))
    assert MapFrame.of(load(room).scenario, []) == ("domain", (0.0, 0.0)), "of a map that cannot be read"


def test_a_robot_is_published_where_it_is_in_the_map(room):
    """A robot at (3, 1.5) of the map is at (5, 2.5) in the domain, and believes to be elsewhere in both."""
    frame = frame_of(room)
    place, heading, z = np.array([[5.0, 2.5]]), np.array([0.5]), np.array([0.2])
    believed, course = np.array([[4.7, 2.9]]), np.array([-2.9])
    now = {
        "position": place, "heading": heading, "altitude": z,
        "believed_position": believed, "believed_heading": course,
    }  # fmt: skip
    correction, moved = topics.poses(1.0, ["r_0"], now, frame).make().transforms
    assert (correction.header.frame_id, correction.child_frame_id) == ("map", "r_0/odom")
    assert (moved.header.frame_id, moved.child_frame_id) == ("r_0/odom", "r_0/base_link")
    (shift, turn), (at, yaw) = (parts_of(link.transform) for link in (correction, moved))
    assert at == pytest.approx([2.7, 1.9, 0.2])
    assert yaw.as_rotvec() == pytest.approx([0, 0, -2.9])
    assert turn.apply(at) + shift == pytest.approx([3.0, 1.5, 0.2])
    assert (turn * yaw).as_rotvec() == pytest.approx([0, 0, 0.5])
    known = now | {"believed_position": place, "believed_heading": heading}
    shift, turn = parts_of(topics.poses(1.0, ["r_0"], known, frame).make().transforms[0].transform)
    assert not shift.any()
    assert not turn.as_rotvec().any(), "the odometry does not err"
    values = {"wind": np.zeros((1, 2)), "resistance": np.full((1, 0), np.nan), "reading": np.zeros((1, 0))}
    reckoning = DeadReckoning(None, 1)
    reckoning.advance(1.0, np.column_stack([believed, z]), course)
    odom = next(topics.of_each("r", 1.0, values, [], reckoning, frame)).make()
    assert (odom.header.frame_id, odom.child_frame_id) == ("r_0/odom", "r_0/base_link")
    assert [odom.pose.pose.position.x, odom.pose.pose.position.y] == pytest.approx(at[:2])
    grid = frame.grid(np.zeros((2, 3)), 0.1, -0.1, 0.0)
    assert (grid.info.origin.position.x, grid.info.origin.position.y) == pytest.approx((-2.1, -1.1))
    points = ros.points_of(frame.cloud({"x": place[:, 0], "y": place[:, 1], "z": z, "ppm": z}, 0.0))
    assert (points["x"][0], points["y"][0], points["z"][0]) == pytest.approx((3.0, 1.5, 0.2))


@pytest.mark.parametrize(
    ("frame_id", "taken"), [("map", 1), ("/map", 1), ("", 1), ("odom", 0), ("domain", 0)]
)
def test_poses_are_taken_in_the_frame_of_the_map_alone(room, frame_id, taken):
    lines: list[str] = []
    inbox = Inbox("real", 1, True, ((0, 0), (6, 3)), 1.0, lines.append, frame=frame_of(room))
    pose = {"position": {"x": 3.0, "y": 1.5}, "orientation": ros.yawed(0.0)}
    header = ros.header(0.0, frame_id)
    inbox.hear_pose(0, ros.encode(ros.message("geometry_msgs/msg/PoseStamped", header=header, pose=pose)))
    assert inbox.counts["taken"] == taken
    if taken:
        np.testing.assert_allclose(inbox.orders().position, [[5.0, 2.5]])
        pose["position"] = {"x": 5.0, "y": -1.5}
        inbox.hear_pose(0, ros.encode(ros.message("geometry_msgs/msg/PoseStamped", header=header, pose=pose)))
        expected = "(7, -0.5) m is not on the floor, x 0 to 6 m, y 0 to 3 m of the domain; sent as (5, -1.5) m of frame"
        assert expected in lines[0]
    else:
        assert f"frame '{frame_id}'; allowed: map" in lines[0]
