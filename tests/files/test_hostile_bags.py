"""Bags are read in a process with limits: a small one cannot fill the memory or the disk, nor take for ever."""

import sqlite3
import struct
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import zstandard
from recorded_bag import gas, pose, write
from refusals import refused

from taichi_plume.files import bag_readings, bags
from taichi_plume.files.bags import BagError

pytestmark = pytest.mark.slow

BOMB = 1 << 30  # bytes


def packed(size: int = BOMB) -> bytes:
    """Zeros, compressed by zstd."""
    made = zstandard.ZstdCompressor(level=3).compressobj()
    block = bytes(1 << 24)
    return b"".join([*(made.compress(block) for _ in range(size >> 24)), made.flush()])


def good(folder: Path, storage: str = "mcap") -> Path:
    """A bag of a robot that reads gas."""
    messages = [(t / 4, "/odom", pose(t / 4, 0.1 * t, 1.0, 0.0)) for t in range(20)]
    return write(folder, [*messages, (2.0, "/gas", gas(2.0, 5.0))], storage)


def compressed_file(folder: Path) -> Path:
    """A bag whose file is a compressed one, of zeros."""
    (file,) = good(folder, "sqlite3").glob("*.db3")
    file.unlink()
    (folder / f"{file.name}.zstd").write_bytes(packed())
    metadata = folder / "metadata.yaml"
    text = metadata.read_text().replace(file.name, f"{file.name}.zstd")
    text = text.replace("compression_format: ''", "compression_format: zstd")
    metadata.write_text(text.replace("compression_mode: ''", "compression_mode: FILE"))
    return folder


def compressed_chunk(folder: Path) -> Path:
    """An MCAP file of one chunk of zeros, which its index tells of."""
    compression, content = b"zstd", packed()
    header = struct.pack("<QQQI", 0, 1, BOMB, 0) + _text(compression) + struct.pack("<Q", len(content))
    chunk = _record(6, header + content)
    start = b"\x89MCAP0\r\n" + _record(1, _text(b"ros2") + _text(b""))
    text = b"float32 data"
    schema = _record(
        3, struct.pack("<H", 1) + _text(b"std_msgs/msg/Float32") + _text(b"ros2msg") + _text(text)
    )
    channel = _record(4, struct.pack("<HH", 1, 1) + _text(b"/gas") + _text(b"cdr") + _text(b""))
    index = struct.pack("<QQQQ", 0, 1, len(start), len(chunk)) + _text(
        struct.pack("<HQ", 1, len(start) + len(chunk))
    )
    index += struct.pack("<Q", 31) + _text(compression) + struct.pack("<QQ", len(content), BOMB)
    counted = struct.pack("<QHIIIIQQ", 1, 1, 1, 0, 0, 1, 0, 1) + _text(struct.pack("<HQ", 1, 1))
    summary = schema + channel + _record(8, index) + _record(11, counted)
    end = _record(2, struct.pack("<QQI", len(start) + len(chunk), 0, 0))
    folder.mkdir()
    (folder / "a.mcap").write_bytes(start + chunk + summary + end + b"\x89MCAP0\r\n")
    return folder / "a.mcap"


def _text(content: bytes) -> bytes:
    return struct.pack("<I", len(content)) + content


def _record(kind: int, content: bytes) -> bytes:
    return struct.pack("<BQ", kind, len(content)) + content


def endless_view(folder: Path) -> Path:
    """A database whose `schema` is a view that never ends."""
    return _changed(
        folder,
        "DROP TABLE schema",
        "CREATE VIEW schema AS WITH RECURSIVE n(schema_version) AS (SELECT 1 UNION ALL SELECT schema_version + 1 "
        "FROM n) SELECT max(schema_version) AS schema_version, 'jazzy' AS ros_distro FROM n",
    )


def endless_column(folder: Path) -> Path:
    """A database whose messages have a generated column that fills the memory when it is read."""
    return _changed(
        folder,
        "ALTER TABLE messages RENAME TO others",
        "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, "
        "data BLOB AS (zeroblob(900000000 + id)))",
        "INSERT INTO messages(id, topic_id, timestamp) SELECT id, topic_id, timestamp FROM others",
    )


def qualities_of_service(folder: Path) -> Path:
    """A database whose qualities of service are a text of YAML with merge keys in merge keys."""
    levels = "".join(f"a{n + 1}: &a{n + 1} {{<<: [{', '.join([f'*a{n}'] * 9)}]}}\n" for n in range(9))
    text = f"a0: &a0 {{x: 1}}\n{levels}"
    return _changed(folder, f"UPDATE topics SET offered_qos_profiles = '{text}'")


def _changed(folder: Path, *statements: str) -> Path:
    (file,) = good(folder, "sqlite3").glob("*.db3")
    with sqlite3.connect(file) as database:
        for one in statements:
            database.execute(one)
    database.close()
    return file


def metadata(folder: Path) -> Path:
    """Metadata with aliases in aliases."""
    levels = "".join(f"a{n + 1}: &a{n + 1} [{', '.join([f'*a{n}'] * 9)}]\n" for n in range(9))
    with (good(folder) / "metadata.yaml").open("a") as file:
        file.write(f"a0: &a0 {{x: 1}}\n{levels}")
    return folder


def definition(folder: Path) -> Path:
    """A message whose definition nests arrays of arrays: 10^36 numbers."""
    (file,) = good(folder, "sqlite3").glob("*.db3")
    text = "a/T0[1000000] x\n" + "".join(
        f"{'=' * 80}\nMSG: a/T{n}\n" + (f"a/T{n + 1}[1000000] x\n" if n < 6 else "") for n in range(7)
    )
    with sqlite3.connect(file) as database:
        database.execute(
            "UPDATE message_definitions SET encoded_message_definition = ?, type_description_hash = '' "
            "WHERE topic_type LIKE '%Gas%'",
            [text],
        )
        database.execute("UPDATE topics SET type_description_hash = ''")
    database.close()
    return file


def test_what_is_read_there_is_what_is_read_here(tmp_path: Path) -> None:
    bag = good(tmp_path / "a")
    (there,), (here,) = bag_readings.read(bag), bag_readings.read_here(bag, bag_readings.BagOptions())
    for name, value in vars(here).items():
        assert np.array_equal(vars(there)[name], value)


@pytest.mark.parametrize(
    ("made", "reported"),
    [
        (compressed_file, "File too large"),
        (compressed_chunk, "memory"),
        (endless_view, "computing time"),
        (endless_column, "out of memory"),
        (qualities_of_service, "computing time"),
        (metadata, "anchors and aliases are not allowed"),
        (definition, "memory|computing time"),
    ],
)
def test_each_ends_in_a_line(
    made: Callable[[Path], Path], reported: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if reported == "computing time":
        monkeypatch.setattr(bags, "SECONDS", 0.5)
    (tmp_path / "tmp").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "tmp"))
    bag = made(tmp_path / "a")
    with refused(BagError, bag, reported):
        bag_readings.read(bag)
    assert not list((tmp_path / "tmp").iterdir())  # what was unpacked is gone
