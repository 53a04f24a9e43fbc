"""Which topics of a bag are gas, where its robot is, and wind: those that are told, or that fit by type and name."""

from collections.abc import Sequence

from taichi_plume.files import ros_messages as ros
from taichi_plume.files.bags import Bag, BagError
from taichi_plume.files.tables import listed

FLOATS = ("std_msgs/msg/Float32", "std_msgs/msg/Float64")
GAS = (ros.GAS_SENSOR, ros.GAS_SENSOR_ARRAY, *FLOATS)
UNSURE = FLOATS
POSES = (
    "nav_msgs/msg/Odometry",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "geometry_msgs/msg/PoseStamped",
)
WINDS = (ros.ANEMOMETER, "geometry_msgs/msg/Vector3Stamped", "geometry_msgs/msg/TwistStamped")
"""Types that are taken, the best first."""


def chosen(bag: Bag, given: tuple[str, ...], kinds: Sequence[str], what: str, option: str) -> list[str]:
    """The topics that are given or, of the first type that there is any of, all. Raises BagError."""
    for topic in given:
        bag.require(topic, kinds)
    if given:
        return list(given)
    for kind in kinds:
        found = bag.of_kind(kind)
        if found and kind in UNSURE and len(found) > 1:
            raise BagError(
                f"{bag.path}: has several topics that may be {what}, {listed(found)}; choose with {option}"
            )
        if found:
            return found
    has = listed([f"{topic} ({kind.replace('/msg/', '/')})" for topic, kind in sorted(bag.kinds.items())])
    raise BagError(f"{bag.path}: has no topic of {what} of a type that is known; it has {has or 'none'}")


def beside(bag: Bag, gas: str, given: str | None, kinds: Sequence[str], what: str, option: str) -> str:
    """The topic that is given, or the one of the first type that shares most of its name with a topic of gas."""
    if given:
        bag.require(given, kinds)
        return given
    found = bag.of_kind(*kinds)
    found = [one for one in found if "goal" not in one.lower()] or found  # where it ought to go
    if not found:
        raise BagError(
            f"{bag.path}: has no {what} for {gas}: neither frames that lead to it nor a topic of them"
        )
    most = max(_shared(gas, one) for one in found)
    near = [one for one in found if _shared(gas, one) == most]
    first = min(kinds.index(bag.kinds[one]) for one in near)
    near = [one for one in near if kinds.index(bag.kinds[one]) == first]
    if len(near) > 1:
        raise BagError(
            f"{bag.path}: has several topics of {what} for {gas}, {listed(near)}; choose with {option}"
        )
    return near[0]


def wind_topic_of(bag: Bag, gas: str, given: str | None) -> str | None:
    """The topic of wind that belongs to one of gas, if there is any: vectors are wind only if their name says so."""
    if given:
        bag.require(given, WINDS)
        return given
    sure = bag.of_kind(ros.ANEMOMETER) or [one for one in bag.of_kind(*WINDS) if "wind" in one.lower()]
    if not sure:
        return None
    most = max(_shared(gas, one) for one in sure)
    near = [one for one in sure if _shared(gas, one) == most]
    if len(near) > 1:
        raise BagError(
            f"{bag.path}: has several topics of wind for {gas}, {listed(near)}; choose with --wind"
        )
    return near[0]


def _shared(a: str, b: str) -> int:
    """How many parts two topics begin with alike."""
    parts = list(zip(a.strip("/").split("/"), b.strip("/").split("/"), strict=False))
    return next((n for n, (one, other) in enumerate(parts) if one != other), len(parts))


def robot_name(topic: str) -> str:
    """Of the robot that a topic is of."""
    return "/".join(topic.strip("/").split("/")[:-1]) or "robot"
