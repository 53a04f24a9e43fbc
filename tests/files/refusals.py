"""What tests of damaged files share: ways to damage them, and the check of the error that refuses them."""

import os
import re
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from taichi_plume.files.run_tables import stream_of

Damage = Callable[[Path], object]


@contextmanager
def refused(error: type[Exception], path: Path, text: str) -> Iterator[None]:
    """The block raises an error of one line that begins with the path and holds a text (or pattern)."""
    with pytest.raises(error) as caught:
        yield
    message = str(caught.value)
    assert message.startswith(str(path))
    assert text in message or re.search(text, message), message
    assert "\n" not in message


def cut(name: str, keep: float = 0.5) -> Damage:
    """Cut off the end of a file."""

    def damage(folder: Path) -> None:
        content = (folder / name).read_bytes()
        (folder / name).write_bytes(content[: int(keep * len(content))])

    return damage


def gone(*names: str) -> Damage:
    """Remove files or folders."""

    def damage(folder: Path) -> None:
        for name in names:
            remove = shutil.rmtree if (folder / name).is_dir() else Path.unlink
            remove(folder / name)

    return damage


def flipped(name: str, place: int = 200) -> Damage:
    """Flip a bit of a file."""

    def damage(folder: Path) -> None:
        content = bytearray((folder / name).read_bytes())
        content[place] ^= 4
        (folder / name).write_bytes(content)

    return damage


def replaced(name: str, old: str, new: str) -> Damage:
    """Replace a text in a file, once."""

    def damage(folder: Path) -> None:
        text = (folder / name).read_text()
        assert old in text
        (folder / name).write_text(text.replace(old, new, 1))

    return damage


def unfinished(path: Path, rows: int = 40) -> None:
    """Replace a table of a run by its stream, of `rows` rows a batch, as if the run had not come to its end."""
    table = pq.read_table(path)
    with pa.ipc.new_stream(stream_of(path), table.schema) as stream:
        stream.write_table(table, rows)
    path.unlink()


class Killed(BaseException):
    """The process ends: nothing is tidied up."""


def cut_off(monkeypatch: pytest.MonkeyPatch, last: int, function: Callable[[], object]) -> bool:
    """Whether a function was killed before its end, at its call number `last` on the disk."""
    done = iter(range(last))

    def dying(call):
        def wrapped(*args, **more):
            if next(done, None) is None:
                raise Killed
            return call(*args, **more)

        return wrapped

    with monkeypatch.context() as patch:
        for name in ("rename", "replace", "unlink", "rmdir", "mkdir", "fsync"):
            patch.setattr(os, name, dying(getattr(os, name)))
        try:
            function()
        except Killed:
            return True
    return False
