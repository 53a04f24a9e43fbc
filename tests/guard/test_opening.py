"""What is no regular file is refused at once."""

import os
import socket
from pathlib import Path

import pytest

from taichi_plume.guard.opening import irregular, open_regular, unopenable


def refused(path: Path) -> str:
    with pytest.raises(OSError, match=r".") as caught:
        open_regular(path)
    assert caught.value.strerror
    assert unopenable(path)
    return caught.value.strerror


def test_a_file_is_read(tmp_path):
    (tmp_path / "a").write_bytes(b"abc")
    with open_regular(tmp_path / "a") as file:
        assert file.read() == b"abc"
    assert unopenable(tmp_path / "a") is None


def test_what_would_wait_or_never_end_is_refused(tmp_path, monkeypatch):
    os.mkfifo(tmp_path / "pipe")
    assert refused(tmp_path / "pipe") == "is a pipe, socket or device, not a file"
    (tmp_path / "link").symlink_to("/dev/zero")
    assert refused(tmp_path / "link") == "is a pipe, socket or device, not a file"
    assert refused(tmp_path) == "Is a directory"
    with socket.socket(socket.AF_UNIX) as one:
        monkeypatch.chdir(tmp_path)  # names of sockets are short
        one.bind("s")
        assert unopenable(tmp_path / "s") == "is a pipe, socket or device, not a file"
        with pytest.raises(OSError, match=r"."):
            open_regular(tmp_path / "s")


@pytest.mark.parametrize("name", ["a" * 5000, "a\0b", "a\ud800", "none", "/".join(["a"] * 5000)])
def test_names_that_no_file_has(tmp_path, name):
    refused(tmp_path / name)


def test_folders_may_be_wanted(tmp_path):
    (tmp_path / "a").touch()
    assert unopenable(tmp_path, folder=True) is None
    assert unopenable(tmp_path / "a", folder=True) == "is no folder"
    assert "null byte" in (unopenable(tmp_path / "\0", folder=True) or "")


def test_folders_hold_files_and_folders(tmp_path):
    (tmp_path / "a" / "b").mkdir(parents=True)
    (tmp_path / "a" / "b" / "c").touch()
    assert irregular(tmp_path) is None
    os.mkfifo(tmp_path / "a" / "b" / "pipe")
    assert irregular(tmp_path) == f"holds {Path('a/b/pipe')}, which is no plain file"
    (tmp_path / "a" / "b" / "pipe").unlink()
    (tmp_path / "a" / "link").symlink_to("/")
    assert irregular(tmp_path) == f"holds {Path('a/link')}, which is no plain file"
