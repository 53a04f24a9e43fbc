"""Writer of ROS 2 bags: a folder with an MCAP file and metadata.yaml, which `ros2 bag` plays; ROS is not needed.

rosbags is used instead of mcap-ros2-support: it stores the quality of service (so that late subscribers get a latched
map), the hashes of the message types, and the metadata that `ros2 bag` needs.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from taichi_plume.files import disk
from taichi_plume.files import ros_messages as ros
from taichi_plume.guard.safe_open import irregular, unopenable

if TYPE_CHECKING:
    from rosbags.interfaces import Connection
    from rosbags.rosbag2 import Writer

VERSION = 8  # of metadata.yaml: ROS 2 Humble to Jazzy and later read it
METADATA = "metadata.yaml"
CHECKED_EVERY = 1 << 22  # bytes, for which there has to be room on the disk


class NoBagError(Exception):
    """Error: a bag may not be written to a folder; the message is one line and begins with the path."""


class BagWriter:
    """Writer of ROS messages by topic into an open bag; see `new_bag`."""

    def __init__(self, writer: "Writer", folder: Path):
        self.writer, self.folder = writer, folder
        self.connections: dict[str, Connection] = {}
        self.waiting = 0  # bytes

    def topic(self, name: str, kind: str, latched: bool = False) -> None:
        """Declare a topic and its message type `kind`. latched: late subscribers get the last message."""
        from rosbags import interfaces as ros2

        endless = ros2.QosTime(9_223_372_036, 854_775_807)  # as ROS records
        quality = ros2.Qos(
            history=ros2.QosHistory.KEEP_LAST,
            depth=1 if latched else 10,
            reliability=ros2.QosReliability.RELIABLE,
            durability=ros2.QosDurability.TRANSIENT_LOCAL if latched else ros2.QosDurability.VOLATILE,
            deadline=endless,
            lifespan=endless,
            liveliness=ros2.QosLiveliness.AUTOMATIC,
            liveliness_lease_duration=endless,
            avoid_ros_namespace_conventions=False,
        )
        self.connections[name] = self.writer.add_connection(
            name, kind, typestore=ros.store(), offered_qos_profiles=[quality]
        )

    def write(self, topic: str, t: float, message: ros.Message) -> None:
        """Write a message to a topic at time t >= 0 [s]. Raises OSError if the disk is full."""
        data = ros.encode(message)
        self.waiting += len(data)
        if self.waiting > CHECKED_EVERY:
            disk.require_room(self.folder, self.waiting)
            self.waiting = 0
        self.writer.write(self.connections[topic], round(t * 1e9), data)


@contextmanager
def new_bag(folder: Path, facts: Mapping[str, str], force: bool = False) -> Iterator[BagWriter]:
    """Context that yields the writer of a new bag; the folder appears once the bag is complete.

    facts: stored in metadata.yaml. force: replace an existing bag. Raises NoBagError if that is forbidden, and OSError.
    """
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

    _require_free(folder, force)
    disk.require_room(folder)
    part = disk.new_folder_beside(folder)
    try:
        writer = Writer(part / folder.name, version=VERSION, storage_plugin=StoragePlugin.MCAP)
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        for key, value in facts.items():
            writer.set_custom_data(key, value)
        with writer:
            yield BagWriter(writer, folder)
        disk.discard(folder)
        writer.path.rename(folder)
    finally:
        disk.discard(part)


def _require_free(folder: Path, force: bool) -> None:
    """Raise NoBagError if a folder exists already or cannot be a bag; with `force`, an existing bag is accepted."""
    if not folder.parent.is_dir():
        raise NoBagError(f"{folder}: its folder does not exist")
    if not folder.is_symlink() and not folder.exists():
        return
    if folder.is_symlink() or not folder.is_dir():
        raise NoBagError(f"{folder}: is no folder; give the name of a folder for the bag")
    others = [
        file for file in folder.iterdir() if file.name != METADATA and file.suffix not in (".mcap", ".db3")
    ]
    if unopenable(folder / METADATA) or irregular(folder) or others:
        raise NoBagError(f"{folder}: is a folder, but no bag alone; choose another --out")
    if not force:
        raise NoBagError(f"{folder}: exists; choose another --out or add --force to overwrite")
