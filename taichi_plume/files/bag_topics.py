"""Topics of a ROS bag that carry gas, poses and wind: given by the user, or recognised by message type and name."""

from collections.abc import Sequence

from taichi_plume.files import ros_messages as ros
from taichi_plume.files.bags import Bag, BagError
from taichi_plume.files.tables import listed

UNSURE = ("std_msgs/msg/Float32", "std_msgs/msg/Float64")
GAS = (ros.GAS_SENSOR, ros.GAS_SENSOR_ARRAY, *UNSURE)
POSES = (
    "nav_msgs/msg/Odometry",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "geometry_msgs/msg/PoseStamped",
)
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
            return [_only(bag, topics, f"several topics that may be {what}", option)]
        if topics:
            return topics
    has = listed([f"{topic} ({kind.replace('/msg/', '/')})" for topic, kind in sorted(bag.kinds.items())])
    raise BagError(f"{bag.path}: has no topic of {what} of a type that is known; it has {has or 'none'}")


def pose_topic_of(bag: Bag, gas: str, given: str | None) -> str:
    """Return the pose topic for a gas topic: the given one, or that with the most similar name. Raises BagError."""
    if given:
        bag.require(given, POSES)
        return given
    poses = bag.of_kind(*POSES)
    poses = [topic for topic in poses if "goal" not in topic.lower()] or poses  # goals are no measured poses
    if not poses:
        raise BagError(
            f"{bag.path}: has no poses for {gas}: neither frames that lead to it nor a topic of them"
        )
    near = _nearest(gas, poses)
    best = min(POSES.index(bag.kinds[topic]) for topic in near)
    near = [topic for topic in near if bag.kinds[topic] == POSES[best]]
    return _only(bag, near, f"several topics of poses for {gas}", "--pose")


def wind_topic_of(bag: Bag, gas: str, given: str | None) -> str | None:
    """Return the wind topic for a gas topic, if any. Plain vector topics need "wind" in their name."""
    if given:
        bag.require(given, WINDS)
        return given
    winds = bag.of_kind(ros.ANEMOMETER) or [topic for topic in bag.of_kind(*WINDS) if "wind" in topic.lower()]
    return _only(bag, _nearest(gas, winds), f"several topics of wind for {gas}", "--wind") if winds else None


def _nearest(gas: str, topics: Sequence[str]) -> list[str]:
    """Return those of the topics that share most leading name parts ("/a/b") with a gas topic."""
    shared = [_shared(gas, topic) for topic in topics]
    return [topic for topic, count in zip(topics, shared, strict=True) if count == max(shared)]


def _only(bag: Bag, topics: Sequence[str], several: str, option: str) -> str:
    if len(topics) > 1:
        raise BagError(f"{bag.path}: has {several}, {listed(topics)}; choose with {option}")
    return topics[0]


def _shared(a: str, b: str) -> int:
    """Count the leading name parts, between slashes, that two topics have in common."""
    parts = list(zip(a.strip("/").split("/"), b.strip("/").split("/"), strict=False))
    return next((n for n, (mine, other) in enumerate(parts) if mine != other), len(parts))


def robot_name(topic: str) -> str:
    """Return the name of a topic's robot: the topic without its last part; "robot" if nothing is left."""
    return "/".join(topic.strip("/").split("/")[:-1]) or "robot"
