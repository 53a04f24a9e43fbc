"""Numbers in messages of a ROS bag, named by topic, fields and indices, such as /enose.data[0] or /air.gas[2].ppm.

Messages may be of any type whose definition the bag holds, or of ROS itself.
"""

import re
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from typing import NamedTuple

import numpy as np

from taichi_plume.files import ros_messages as ros
from taichi_plume.files.bags import Bag, BagError, Sample, stamp_of
from taichi_plume.files.tables import listed

PATH = re.compile(r"[^.\[\]\s]+((?:\.\w+|\[\d{1,8}\])+)")
STEP = re.compile(r"\.(\w+)|\[(\d+)\]")
EXAMPLE = "/enose.data[0]"
MOST_LISTED = 4  # numbers of a bag that a message suggests
ASIDE = ("header", "layout", "covariance")  # fields that hold no readings
NO_GAS = ("tf", "tf2_msgs", "rosgraph_msgs", "rcl_interfaces", "rosgraph", "nav_msgs", "geometry_msgs",
          "visualization_msgs")  # fmt: skip
"""Packages whose messages hold no readings."""


class Field(NamedTuple):
    """Number in the messages of a topic; steps: names of fields and indices of entries that lead to the number."""

    text: str
    topic: str
    steps: tuple[str | int, ...]


def field_of(bag: Bag, text: str) -> Field:
    """Return the field that a text names; the bag has the topic. Raises BagError."""
    match = PATH.fullmatch(text.strip())
    topic = re.split(r"[.\[]", text.strip())[0]
    if topic not in bag.kinds:
        names = listed(sorted(bag.kinds)) or "none"
        raise BagError(f"{bag.path}: --reading {text}: has no topic '{topic}'; it has {names}")
    if not match:
        numbers = list(_numbers(bag, topic))
        hint = (
            f"name a number in its messages, such as {numbers[0]}"
            if numbers
            else "its messages have no number"
        )
        raise BagError(f"{bag.path}: --reading {text}: is no field such as {EXAMPLE}; {hint}")
    steps = tuple(name or int(index) for name, index in STEP.findall(match[1]))
    return Field(match[0], topic, steps)


def number_of(bag: Bag, field: Field, message: ros.Message) -> Sample:
    """Return stamp, frame and the number of a field in a message of a bag. Raises BagError.

    An entry beyond the end of a list is NaN. Stamp and frame are those of the innermost header on the way.
    """
    where = f"{bag.path}: --reading {field.text}"
    stamp, frame, part, name = 0.0, "", message, field.topic
    for step in field.steps:
        header = getattr(part, "header", None)
        if header is not None and hasattr(header, "frame_id"):
            stamp, frame = stamp_of(header) or stamp, header.frame_id or frame
        if isinstance(step, int):
            if isinstance(part, str) or not hasattr(part, "__len__"):
                raise BagError(f"{where}: {name} is no list; remove [{step}]")
            if step >= len(part):
                return Sample(stamp, frame, [np.nan])
            part, name = part[step], f"{name}[{step}]"
        else:
            known = _fields(part)
            if step not in known:
                raise BagError(f"{where}: {name} has no field '{step}'; it has {listed(known) or 'none'}")
            part, name = getattr(part, step), f"{name}.{step}"
    if isinstance(part, bool | np.bool_ | str) or not isinstance(part, int | float | np.number):
        hint = next(_inside(name, part), "")
        raise BagError(f"{where}: {name} is no number{hint and f'; name one in it, such as {hint}'}")
    return Sample(stamp, frame, [float(part)])


def suggestions(bag: Bag) -> str:
    """Return numbers of a bag's messages that may be readings, as a text; "" if there are none."""
    found = []
    for topic, kind in sorted(bag.kinds.items()):
        if kind.split("/")[0] not in NO_GAS:
            found += list(_numbers(bag, topic))[:1]
    return ", ".join(found[:MOST_LISTED])


def _numbers(bag: Bag, topic: str) -> Iterator[str]:
    """Yield the numbers in the first message of a topic, in the notation of --reading; none if it is unreadable."""
    try:
        yield from _inside(topic, bag.first(topic))
    except Exception:  # rosbags raises errors of many kinds; these numbers are only a hint
        return


def _inside(name: str, part: object, depth: int = 0) -> Iterator[str]:
    if isinstance(part, bool | np.bool_ | str | bytes) or depth > 5:
        return
    if isinstance(part, int | float | np.number):
        yield name
    elif isinstance(part, list | np.ndarray):
        if len(part):
            yield from _inside(f"{name}[0]", part[0], depth + 1)
    else:
        for field in _fields(part):
            if field not in ASIDE:
                yield from _inside(f"{name}.{field}", getattr(part, field), depth + 1)


def _fields(part: object) -> list[str]:
    """Return the names of a message's fields, without constants; none for numbers, texts and lists."""
    if not is_dataclass(part):
        return []
    return [field.name for field in fields(part) if not field.name.startswith("__")]
