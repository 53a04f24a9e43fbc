"""What is no regular file is refused at once."""

import os
import re
import socket
from pathlib import Path

import pytest

from taichi_plume.guard.safe_open import (
    admit,
    content_of,
    gate,
    irregular,
    open_regular,
    read_regular,
    unopenable,
)


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
    assert content_of(tmp_path / "a", 3, ValueError) == b"abc"
    for name, most, start, fault in (
        ("a", 2, None, f"{tmp_path / 'a'}: is larger than 0 KiB"),
        ("b", 3, "my b", f"my b: no such file in {tmp_path}"),
        ("b", 3, "", "cannot be read: No such file or directory"),
    ):
        with pytest.raises(ValueError, match=f"^{re.escape(fault)}$"):
            content_of(tmp_path / name, most, ValueError, start)


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


@pytest.fixture
def home(tmp_path) -> Path:
    """A folder with a file in it, a link to that file, and links to a file and a folder outside."""
    home = tmp_path / "home"
    (home / "sub").mkdir(parents=True)
    (tmp_path / "away").mkdir()
    for file in (home / "a", tmp_path / "away/a"):
        file.write_text("a")
    (home / "sub/inner").symlink_to("../a")
    (home / "sub/link").symlink_to(tmp_path / "away/a")
    (home / "sub/folder").symlink_to(tmp_path / "away")
    return home


@pytest.mark.parametrize(
    "name", ["../away/a", "sub/link", "sub/folder/a", "sub/folder/none", "sub/../../away/a"]
)
def test_a_gate_keeps_files_outside_out(home, name):
    with gate(home) as files:
        assert "--allow-outside" in refused(home / name)
        for read in (lambda: read_regular(home / name, 9), lambda: admit(home / name)):
            with pytest.raises(PermissionError, match="outside"):
                read()
    assert not files
    if "none" not in name:
        with gate(None) as files:
            assert read_regular(home / name, 9) == b"a"
        assert files == [home / name]
        assert read_regular(home / name, 9) == b"a"  # the gate is over


def test_a_gate_keeps_folders_outside_out(home):
    with gate(home):
        assert "--allow-outside" in (unopenable(home / "sub/folder", folder=True) or "")
        assert "--allow-outside" in (irregular(home / "sub/folder") or "")


def test_a_gate_lists_what_was_opened(home):
    (home / "link").symlink_to(home)  # links that lead to the inside are no fault
    with gate(home / "link") as files:
        assert read_regular(home / "sub/inner", 9) == b"a"
        assert unopenable(home / "none")
        assert unopenable(home / "a") is None
        assert read_regular(home / "a", 9) == b"a"
    assert files == [home / "sub/inner", home / "a"]
