"""A new bag as ROS 2 makes it: a folder with an MCAP file and metadata.yaml, which `ros2 bag` plays; no ROS is needed.

rosbags writes it and not mcap-ros2-support: with the messages go how they were offered (a latched map is given to those
who come later) and the hashes of their types, and the folder has the metadata that `ros2 bag` looks for.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from taichi_plume.files import disk
from taichi_plume.files import ros_messages as ros
from taichi_plume.guard.opening import irregular, unopenable

if TYPE_CHECKING:
    from rosbags.interfaces import Connection
    from rosbags.rosbag2 import Writer

VERSION = 8  # of metadata.yaml: ROS 2 Humble to Jazzy and later read it
METADATA = "metadata.yaml"
CHECKED_EVERY = 1 << 22  # bytes, for which there has to be room on the disk


class NoBagError(Exception):
    """What is there is no bag, so that it is not replaced by one; says why."""


class BagWriter:
    """Takes messages by their topics; see `new_bag`."""

    def __init__(self, writer: "Writer", folder: Path):
        self.writer, self.folder = writer, folder
        self.connections: dict[str, Connection] = {}
        self.waiting = 0  # bytes

    def topic(self, name: str, kind: str, latched: bool = False) -> None:
        """A topic of messages of a kind. latched: its last message is given to those who come later."""
        from rosbags.interfaces import (
            Qos,
            QosDurability,
            QosHistory,
            QosLiveliness,
            QosReliability,
            QosTime,
        )

        endless = QosTime(9_223_372_036, 854_775_807)  # what ROS records
        offered = Qos(
            history=QosHistory.KEEP_LAST,
            depth=1 if latched else 10,
            reliability=QosReliability.RELIABLE,
            durability=QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE,
            deadline=endless,
            lifespan=endless,
            liveliness=QosLiveliness.AUTOMATIC,
            liveliness_lease_duration=endless,
            avoid_ros_namespace_conventions=False,
        )
        self.connections[name] = self.writer.add_connection(
            name, kind, typestore=ros.store(), offered_qos_profiles=[offered]
        )

    def write(self, topic: str, t: float, message: Any) -> None:
        """Write a message, said at time t [s], 0 or later. Raises OSError when the disk is full."""
        data = ros.encode(message)
        self.waiting += len(data)
        if self.waiting > CHECKED_EVERY:
            disk.require_room(self.folder, self.waiting)
            self.waiting = 0
        self.writer.write(self.connections[topic], round(t * 1e9), data)


@contextmanager
def new_bag(folder: Path, told: dict[str, str], force: bool = False) -> Iterator[BagWriter]:
    """Write a bag, which is there once it is whole; told: facts that metadata.yaml keeps.

    Raises NoBagError where something is there that is no bag, or is one, unless by `force`; and OSError.
    """
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

    check_new(folder, force)
    part = folder.with_name(f".{folder.name}.part")
    remove(part)
    disk.require_room(folder)
    writer = Writer(part / folder.name, version=VERSION, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    for key, value in told.items():
        writer.set_custom_data(key, value)
    try:
        with writer:
            yield BagWriter(writer, folder)
        if folder.is_dir():
            remove(folder)
        writer.path.rename(folder)
    finally:
        remove(part)


def check_new(folder: Path, force: bool) -> None:
    """Raises NoBagError where a bag may not be written."""
    if not folder.parent.is_dir():
        raise NoBagError(f"{folder}: its folder does not exist")
    if not folder.is_symlink() and not folder.exists():
        return
    if folder.is_symlink() or not folder.is_dir():
        raise NoBagError(f"{folder}: is no folder; give the name of a folder for the bag")
    if unopenable(folder / METADATA) or irregular(folder) or _strangers(folder):
        raise NoBagError(f"{folder}: is a folder, but no bag alone; choose another --out")
    if not force:
        raise NoBagError(f"{folder}: exists; choose another --out or add --force to overwrite")


def _strangers(folder: Path) -> list[str]:
    """What in a folder is nothing of a bag."""
    return [
        one.name for one in folder.iterdir() if one.name != METADATA and one.suffix not in (".mcap", ".db3")
    ]


def remove(folder: Path) -> None:
    """Remove a folder, if it is there."""
    import shutil

    shutil.rmtree(folder, ignore_errors=True)
