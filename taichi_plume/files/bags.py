"""Reader of foreign ROS bags, by rosbags: MCAP and SQLite of ROS 2, as a file or folder, and .bag of ROS 1."""

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from taichi_plume.files import ros_messages as ros
from taichi_plume.files.tables import LONGEST_TEXT, listed, plain
from taichi_plume.guard.safe_open import irregular, unopenable

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader

FILES = (".mcap", ".db3", ".bag")
FAULTS = (Exception,)  # rosbags raises errors of many kinds, such as of SQLite, decompression and YAML
OLD_NAMES = {  # of ROS 1, and of older packages
    "olfaction_msgs/msg/gas_sensor": ros.GAS_SENSOR,
    "olfaction_msgs/msg/gas_sensor_array": ros.GAS_SENSOR_ARRAY,
    "olfaction_msgs/msg/anemometer": ros.ANEMOMETER,
    "tf/msg/tfMessage": "tf2_msgs/msg/TFMessage",
}


class BagError(ValueError):
    """Error: a ROS bag cannot be read or lacks a topic; the message is one line and begins with the path."""


class Sample(NamedTuple):
    """Data of a ROS message: header stamp [s], 0 if missing; frame of the values, "" if missing; the values."""

    stamp: float
    frame: str
    values: Sequence[float]


@dataclass(frozen=True)
class Series:
    """Values of all messages of a ROS topic, in the order of the bag.

    stamp: header times, 0 if missing; logged: times of recording, both (n,) [s]; values (n, k); frames: names in the
    headers, each once, without a leading slash.
    """

    topic: str
    stamp: np.ndarray
    logged: np.ndarray
    frames: tuple[str, ...]
    values: np.ndarray

    @property
    def frame(self) -> str:
        """First frame that a header names, "" if none does."""
        return next(iter(self.frames), "")

    @property
    def is_stamped(self) -> bool:
        """Whether all messages of the topic, except perhaps the first, have a header stamp."""
        return bool((self.stamp > 0.0).all() or (len(self.stamp) > 1 and (self.stamp[1:] > 0.0).all()))

    def times(self, stamped: bool) -> np.ndarray:
        """Return the times of the messages (n,) [s]: header stamps if `stamped`, otherwise times of recording."""
        return self.stamp if stamped else self.logged


class Bag:
    """An open ROS bag; see `opened`. kinds: message type of each topic that has messages."""

    def __init__(self, path: Path, reader: "AnyReader"):
        self.path, self.reader = path, reader
        used = [connection for connection in reader.connections if connection.msgcount]
        self.kinds = {topic.topic: OLD_NAMES.get(topic.msgtype, topic.msgtype) for topic in used}

    @property
    def contents(self) -> str:
        """Topics and their message types, as a text."""
        return listed([f"{topic} ({short([kind])})" for topic, kind in sorted(self.kinds.items())]) or "none"

    def of_kind(self, *kinds: str) -> list[str]:
        """Return the topics of these message types, in natural order (r2 before r10)."""
        topics = [topic for topic, kind in self.kinds.items() if kind in kinds]
        return sorted(topics, key=_counted)

    def messages(self, *topics: str) -> Iterator[tuple[str, float, ros.Message]]:
        """Yield (topic, time of recording [s], message) for all messages of these topics. Raises BagError."""
        chosen = [c for c in self.reader.connections if c.topic in topics and c.msgcount]
        for connection, t, data in self.reader.messages(chosen) if chosen else ():
            if connection.msgtype not in self.reader.typestore.fielddefs:
                raise BagError(
                    f"{self.path}: {connection.topic} is of type {connection.msgtype}, whose definition the bag does "
                    "not hold; record or convert it to MCAP (ros2 bag convert), which stores definitions"
                )
            yield connection.topic, 1e-9 * t, self.reader.deserialize(data, connection.msgtype)

    def first(self, topic: str) -> ros.Message:
        """Return the first message of a topic. Raises BagError."""
        for _, _, message in self.messages(topic):
            return message
        raise BagError(f"{self.path}: {topic} has no messages")

    def series(self, topic: str, get: Callable[[ros.Message], Sample]) -> Series:
        """Return the values of all messages of a topic; get: extracts them from a message. Raises BagError."""
        rows = [(logged, *get(message)) for _, logged, message in self.messages(topic)]
        if not rows:
            raise BagError(f"{self.path}: {topic} has no messages")
        logged, stamp, frames, values = zip(*rows, strict=True)
        table = np.array(values, float).reshape(len(rows), -1)
        names = tuple(dict.fromkeys(filter(None, map(ros.plain_name, frames))))
        return Series(topic, np.array(stamp, float), np.array(logged, float), names, table)

    def require_one_frame(self, series: Series, hint: str = "") -> None:
        """Raise BagError if the headers of a topic name several frames."""
        if len(series.frames) > 1:
            raise BagError(f"{self.path}: {series.topic} is in several frames, {listed(series.frames)}{hint}")

    def require(self, topic: str, kinds: Iterable[str]) -> None:
        """Raise BagError unless the bag has this topic with one of these message types."""
        if topic not in self.kinds:
            raise BagError(
                f"{self.path}: has no topic '{topic}'; it has {listed(sorted(self.kinds)) or 'none'}"
            )
        if self.kinds[topic] not in kinds:
            raise BagError(
                f"{self.path}: '{topic}' is of type {self.kinds[topic]}; {short(kinds)} can be used"
            )


def is_bag(path: Path) -> bool:
    """Return whether a path may be a ROS bag: a folder, or a file with the suffix of a bag."""
    return path.suffix.lower() in FILES or path.is_dir()


@contextmanager
def opened(path: Path) -> Iterator[Bag]:
    """Context that opens a bag. Raises BagError, also for errors while the bag is read."""
    check(path)
    try:
        from rosbags.highlevel import AnyReader
    except ImportError:
        raise BagError(f'{path}: bags are read by rosbags: pip install "taichi_plume[ros]"') from None
    try:
        with AnyReader([path], default_typestore=ros.store()) as reader:
            yield Bag(path, reader)
    except (BagError, KeyboardInterrupt):
        raise
    except MemoryError:
        raise BagError(f"{path}: cannot be read: too much memory for its size; is it damaged?") from None
    except FAULTS as error:
        raise BagError(f"{path}: cannot be read: {plain(str(error)) or type(error).__name__}") from None


def check(path: Path) -> None:
    """Raise BagError if no ROS bag exists at this path."""
    reason = irregular(path) if path.is_dir() else unopenable(path)
    if reason:
        raise BagError(f"{path}: {reason}")
    if not path.is_dir():
        return
    metadata = path / "metadata.yaml"
    if not metadata.is_file():
        files = sorted(file.name for file in path.iterdir() if file.suffix in (*FILES, ".parquet"))
        hint = f"; name a file in it, such as {files[0][:LONGEST_TEXT]}" if files else ""
        raise BagError(f"{path}: is a folder without metadata.yaml, and so no bag{hint}")


def short(kinds: Iterable[str]) -> str:
    """Return message types as a text, as ROS 1 names them."""
    return ", ".join(kind.replace("/msg/", "/") for kind in kinds)


def stamp_of(header: ros.Message) -> float:
    """Return the time of a ROS 1 or ROS 2 message header [s]."""
    return float(header.stamp.sec) + 1e-9 * float(header.stamp.nanosec)


def _counted(topic: str) -> list[tuple[int, str]]:
    """Return a sort key for the natural order of topic names (digits compared as numbers)."""
    parts = re.split(r"([0-9]+)", topic)
    return [(len(part) if n % 2 else 0, part) for n, part in enumerate(parts)]
