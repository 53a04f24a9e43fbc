"""Topics of a ROS bag that carry gas, poses and wind: given by the user, or recognised by message type and name."""

from collections.abc import Sequence

from taichi_plume.files import ros_messages as ros
from taichi_plume.files.bag_fields import suggestions
from taichi_plume.files.bags import Bag, BagError
from taichi_plume.files.tables import listed

UNSURE = ("std_msgs/msg/Float32", "std_msgs/msg/Float64")
GAS = (ros.GAS_SENSOR, ros.GAS_SENSOR_ARRAY, *UNSURE)
POSES = (
    "nav_msgs/msg/Odometry",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/TransformStamped",
    *(POINTS := ("geometry_msgs/msg/PointStamped", "geometry_msgs/msg/Pose2D")),
)
"""Accepted types of poses, preferred types first; POINTS count if a bag has no others."""
NO_POSE = (
    "goal",
    "initialpose",
    "initial_pose",
    "clicked",
)  # names of topics with poses that are set, not measured
WINDS = (ros.ANEMOMETER, "geometry_msgs/msg/Vector3Stamped", "geometry_msgs/msg/TwistStamped")
"""Accepted types, preferred types first."""


def chosen(bag: Bag, given: Sequence[str], kinds: Sequence[str], what: str, option: str) -> list[str]:
    """Return the topics the user gave, or all topics of the first message type in `kinds` present. Raises BagError."""
    for topic in given:
        bag.require(topic, kinds)
    if given:
        return list(given)
    for kind in kinds:
        topics = bag.of_kind(kind)
        if topics and kind in UNSURE:
            return [only(bag, topics, f"several topics that may be {what}", option)]
        if topics:
            return topics
    numbers = suggestions(bag) if kinds == GAS else ""
    hint = f"; name a number by --reading, such as {numbers}" if numbers else ""
    raise BagError(f"{bag.path}: has no topic of {what} of a type that is known; it has {bag.contents}{hint}")


def measured_poses(bag: Bag) -> list[str]:
    """Return the pose topics of a bag, preferred types first, and none that are set, if there are others."""
    poses = bag.of_kind(*POSES[: -len(POINTS)]) or bag.of_kind(*POINTS)
    poses = [topic for topic in poses if not any(word in topic.lower() for word in NO_POSE)] or poses
    return sorted(poses, key=lambda topic: POSES.index(bag.kinds[topic]))


def pose_topics(bag: Bag, gas: str, alone: bool) -> list[str]:
    """Return the pose topics that may be of the robot of a gas topic: those whose names share most with its name.

    alone: whether the bag has one robot, to which topics of enclosing namespaces, such as /amcl_pose, belong too.
    """
    poses = measured_poses(bag)
    around = [topic for topic in poses if alone and shared_parts(gas, topic) == topic.strip("/").count("/")]
    return list(dict.fromkeys([*_nearest(gas, poses), *around]))


def wind_topic_of(bag: Bag, gas: str, given: str | None) -> str | None:
    """Return the wind topic for a gas topic, if any. Plain vector topics need "wind" in their name."""
    if given:
        bag.require(given, WINDS)
        return given
    winds = bag.of_kind(ros.ANEMOMETER) or [topic for topic in bag.of_kind(*WINDS) if "wind" in topic.lower()]
    return only(bag, _nearest(gas, winds), f"several topics of wind for {gas}", "--wind") if winds else None


def _nearest(gas: str, topics: Sequence[str]) -> list[str]:
    """Return those of the topics that share most leading name parts ("/a/b") with a gas topic."""
    shared = [shared_parts(gas, topic) for topic in topics]
    return [topic for topic, count in zip(topics, shared, strict=True) if count == max(shared, default=0)]


def only(bag: Bag, topics: Sequence[str], several: str, option: str) -> str:
    """Return the only topic in a list. Raises BagError if there are several, which `several` describes."""
    if len(topics) > 1:
        raise BagError(f"{bag.path}: has {several}, {listed(topics)}; choose with {option}")
    return topics[0]


def shared_parts(a: str, b: str) -> int:
    """Count the leading name parts, between slashes, that two topics have in common."""
    parts = list(zip(a.strip("/").split("/"), b.strip("/").split("/"), strict=False))
    return next((n for n, (mine, other) in enumerate(parts) if mine != other), len(parts))


def robot_name(topic: str) -> str:
    """Return the name of a topic's robot: the topic without its last part; "robot" if nothing is left."""
    return "/".join(topic.strip("/").split("/")[:-1]) or "robot"
