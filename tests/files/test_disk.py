"""Files are written under a new name and then take their place: links are not followed, a failure changes nothing."""

import errno
import os

import pytest

from taichi_plume.execution.result import write_result
from taichi_plume.files import checkpoint, manifest
from taichi_plume.files.disk import discard, left_in, new_beside, new_folder_beside, remove, written_whole
from taichi_plume.report import html
from taichi_plume.results import export
from tests.pipes_in_folders import ended

WRITERS = {
    "result.json": lambda folder: write_result(folder, {"name": "a"}),
    "report.html": lambda folder: html.write(
        folder / "report.html", [], name="", status="", good=True, message="", began=[]
    ),
    "checkpoint.npz": lambda folder: checkpoint.write(folder / "checkpoint.npz", {"t": 1.0}),
    "manifest.json": lambda folder: manifest.write(folder, {}, []),
}


@pytest.mark.parametrize("name", WRITERS)
def test_targets_of_links_stay_as_they_are(tmp_path, name):
    folder, target = tmp_path / "run", tmp_path / "mine"
    folder.mkdir()
    target.write_text("mine")
    stem = name.partition(".")[0]
    for link in (name, f"{name}.part", f"{stem}.new", f".{name}.part"):
        (folder / link).symlink_to(target)
    WRITERS[name](folder)
    assert target.read_text() == "mine"
    assert not (folder / name).is_symlink()
    assert (folder / name).stat().st_size
    (folder / name).unlink()
    (folder / name).hardlink_to(target)
    WRITERS[name](folder)
    assert target.read_text() == "mine"


def test_a_failure_changes_nothing(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("old")
    with pytest.raises(FileNotFoundError), written_whole(path) as fresh:
        os.stat(fresh.with_name("missing"))
    assert {file.name: file.read_text() for file in tmp_path.iterdir()} == {"a.txt": "old"}


def test_new_files_are_exclusive_and_have_the_usual_rights(tmp_path, monkeypatch):
    monkeypatch.setattr("secrets.token_hex", lambda _: "0123abcd")
    fresh = new_beside(tmp_path / "a.txt")
    assert left_in(tmp_path) == [fresh]
    with pytest.raises(FileExistsError):
        new_beside(tmp_path / "a.txt")
    plain = tmp_path / "plain"
    plain.write_text("")
    assert os.stat(fresh).st_mode == os.stat(plain).st_mode


@pytest.mark.parametrize("durable", [True, False])
def test_a_link_is_replaced_and_not_followed(tmp_path, durable):
    (tmp_path / "victim").write_text("mine")
    (tmp_path / "a.txt").symlink_to(tmp_path / "victim")
    with written_whole(tmp_path / "a.txt", durable) as fresh:
        fresh.write_text("new")
    assert (tmp_path / "victim").read_text() == "mine"
    assert (tmp_path / "a.txt").read_text() == "new"
    assert not (tmp_path / "a.txt").is_symlink()


@pytest.mark.parametrize("links", [True, False])
def test_a_file_that_is_there_stays_unless_it_may_be_replaced(tmp_path, monkeypatch, links):
    def refused(*_):
        raise OSError(errno.EOPNOTSUPP, "no hard links")

    if not links:
        monkeypatch.setattr(os, "link", refused)
    (tmp_path / "a.txt").write_text("mine")
    with pytest.raises(FileExistsError), written_whole(tmp_path / "a.txt", replace=False) as fresh:
        fresh.write_text("new")
    with written_whole(tmp_path / "b.txt", replace=False) as fresh:
        fresh.write_text("new")
    assert {file.name: file.read_text() for file in tmp_path.iterdir()} == {"a.txt": "mine", "b.txt": "new"}


@pytest.mark.parametrize("name", ["a\0b", "a\ud800"])
def test_a_name_that_no_file_can_have_is_an_error_of_the_system(tmp_path, name):
    with pytest.raises(OSError, match="null byte or half a character"), written_whole(tmp_path / name):
        pass


def test_temporary_folders_are_new_and_found_again(tmp_path):
    one, other = new_folder_beside(tmp_path / "bag"), new_folder_beside(tmp_path / "bag")
    assert one != other
    assert set(left_in(tmp_path)) == {one, other}


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes in folders")
@pytest.mark.parametrize("delete", [remove, discard])
def test_pipes_links_and_folders_are_deleted_and_not_opened(tmp_path, delete):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "kept").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "kept")
    (tmp_path / "folder").mkdir()
    os.mkfifo(tmp_path / "folder" / "pipe")
    for name in ("pipe", "link", "folder", "nothing"):
        ends, outcome = ended(lambda path=tmp_path / name: delete(path), tmp_path / "pipe")
        assert ends
        assert outcome is None
    assert [path.name for path in tmp_path.iterdir()] == ["kept"]


def test_an_export_replaces_no_file_that_appears_meanwhile(tmp_path):
    file = tmp_path / "a.csv"

    def exported(force: bool) -> None:
        with export._fresh([file], force) as (part,):
            part.write_text("new")
            file.write_text("mine")

    with pytest.raises(FileExistsError):
        exported(force=False)
    assert [path.read_text() for path in tmp_path.iterdir()] == ["mine"]
    exported(force=True)
    assert [path.read_text() for path in tmp_path.iterdir()] == ["new"]
