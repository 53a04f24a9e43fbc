"""State of a session: nothing that was drawn is lost, and no file of another program is overwritten."""

import errno
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from test_document import CONFIGS, ROOT

from taichi_plume.draw import edits, workplace
from taichi_plume.draw.objects import scene
from taichi_plume.draw.workplace import FileChangedError, Workplace
from taichi_plume.guard.input_error import InputError
from taichi_plume.scenario.loading import read_scenario

ROOM = (ROOT / "configs/casting_room.yaml").read_text()


@pytest.fixture
def place(tmp_path):
    (tmp_path / "room.yaml").write_text(ROOM)
    return Workplace(tmp_path, tmp_path / "room.yaml")


def edited(place: Workplace) -> str:
    of = scene(place.text, place.folder)
    return edits.move_handle(place.text, of, "obstacles[1]", "center", (0, 1), (2.0, 1.0))


def test_a_new_room_takes_a_free_name_and_is_written_by_save_alone(tmp_path):
    (tmp_path / "room.yaml").write_text("mine")
    place = Workplace(tmp_path)
    assert place.file.name == "room-2.yaml"
    assert not place.file.exists()
    place.save()
    assert place.file.read_text() == edits.BLANK
    assert (tmp_path / "room.yaml").read_text() == "mine"


@pytest.mark.parametrize(
    "path", [path for path in CONFIGS if "axes:" not in path.read_text()], ids=lambda p: p.stem
)
def test_shipped_scenarios_save_to_the_same_scenario(path, tmp_path):
    """Opened and saved they are the same bytes; also after an edit and its undo; and with an edit, but for the edit."""
    file = tmp_path / path.name
    file.write_bytes(path.read_bytes())
    place = Workplace(tmp_path, file)
    place.save()
    assert file.read_bytes() == path.read_bytes()
    place.put(edits.with_values(place.text, "domain", {"spacing": 0.125}))
    place.undo()
    place.save()
    assert file.read_bytes() == path.read_bytes()
    place.redo()
    place.save()
    expected = read_scenario(path).model_copy(update={"domain": read_scenario(file).domain})
    assert read_scenario(file) == expected
    assert read_scenario(file).domain.spacing == 0.125


def test_comments_stay_when_an_obstacle_is_moved_and_saved(place):
    place.put(edited(place))
    place.save()
    old, new = ROOM.splitlines(), place.file.read_text().splitlines()
    changed = [(a, b) for a, b in zip(old, new, strict=True) if a != b]
    assert len(changed) == 1
    assert "center: [2, 1]" in changed[0][1]
    assert [line for line in new if line.startswith("#")] == [line for line in old if line.startswith("#")]


def test_a_file_that_another_program_changed_is_not_overwritten(place):
    place.put(edited(place))
    place.file.write_text(ROOM.replace("seed: 2", "seed: 7"))
    with pytest.raises(FileChangedError):
        place.save()
    assert "seed: 7" in place.file.read_text()
    mine = place.text
    place.reload()
    assert "seed: 7" in place.text
    place.undo()
    assert place.text == mine, "the reloaded text can be undone"
    place.save()
    assert place.file.read_text() == mine


def test_a_file_that_was_removed_is_not_written_unasked(place):
    place.file.unlink()
    with pytest.raises(FileChangedError) as error:
        place.save()
    place.save(error.value)
    assert place.file.read_text() == ROOM


def test_what_is_overwritten_is_what_was_asked_about(place):
    place.put(edited(place))
    place.file.write_text("theirs: 1\n")
    with pytest.raises(FileChangedError) as error:
        place.save()
    place.file.write_text("theirs: 2\n")
    with pytest.raises(FileChangedError) as again:
        place.save(error.value)
    assert place.file.read_text() == "theirs: 2\n"
    place.save(again.value)
    assert place.file.read_text() == place.text


def linked(place, name: str) -> Path:
    """A victim outside the folder, to which a link in the folder leads."""
    victim = place.folder.parent / "victim"
    victim.write_text("mine")
    (place.folder / name).symlink_to(victim)
    return victim


@pytest.mark.parametrize("end", ["draft", "lock"])
def test_a_draft_is_not_written_through_a_link(place, monkeypatch, end):
    monkeypatch.setattr("taichi_plume.draw.drafts.token_hex", lambda _: "0123abcd")
    victim = linked(place, f".room.yaml.0123abcd.{end}")
    place.put(edited(place))
    assert victim.read_text() == "mine"
    draft = place.folder / ".room.yaml.0123abcd.draft"
    if end == "lock":
        assert "0123abcd.lock" in place.drafts.fault
        assert not draft.exists()
    else:
        assert draft.read_text() == place.text
        assert not draft.is_symlink()


def test_a_file_is_not_written_through_a_link(place):
    victim = linked(place, "other.yaml")
    with pytest.raises(InputError, match=r"other.yaml: .*--allow-outside"):
        place.save_as("other.yaml")
    assert victim.read_text() == "mine"
    assert place.file.name == "room.yaml"


def test_another_name_that_another_program_takes_meanwhile_is_not_overwritten(place, monkeypatch):
    """Between the check and the rename."""
    fsync = os.fsync

    def slow(number):
        (place.folder / "other.yaml").write_text("theirs")
        fsync(number)

    monkeypatch.setattr(os, "fsync", slow)
    with pytest.raises(InputError, match=r"other.yaml: exists"):
        place.save_as("other.yaml")
    assert (place.folder / "other.yaml").read_text() == "theirs"
    assert [file.name for file in place.folder.iterdir() if file.suffix == ".part"] == []


def killed(place: Workplace) -> None:
    """Drop a server as SIGKILL does: nothing is called, and the locks of the server are free."""
    drafts = place.drafts
    for draft in filter(None, [drafts.own, *drafts.waiting, *drafts._earlier]):
        draft.release()


def offered(folder: Path) -> list[str]:
    """Texts that the next server offers, the first first; all are refused but in the files."""
    place = Workplace(folder, folder / "room.yaml")
    texts = [draft.text or "" for draft in reversed(place.drafts.waiting)]
    killed(place)
    return texts


def hidden(folder: Path) -> list[str]:
    return [file.name for file in folder.iterdir() if file.name.startswith(".")]


def test_unsaved_changes_survive_a_killed_server(place, tmp_path):
    place.put(edited(place))
    killed(place)
    again = Workplace(tmp_path, place.file)
    assert again.text == ROOM
    assert again.recovered.text == place.text
    again.restore(again.recovered, True)
    assert again.text == place.text
    again.undo()
    assert again.text == ROOM
    again.redo()
    again.save()
    assert hidden(tmp_path) == []
    assert Workplace(tmp_path, place.file).recovered is None


SERVER = """
import sys, time
from pathlib import Path
from taichi_plume.draw.workplace import Workplace
place = Workplace(Path.cwd(), Path("room.yaml"))
for move in sys.argv[1:]:
    if move in ("yes", "no"):
        place.restore(place.recovered, move == "yes")
    elif move == "save":
        place.save()
    else:
        place.put(place.text + f"# {move}\\n")
print("ready", flush=True)
time.sleep(600)
"""


def served_until_killed(folder: Path, *moves: str) -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", SERVER, *moves], cwd=folder, stdout=subprocess.PIPE, text=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
    )  # fmt: skip
    try:
        assert process.stdout.readline() == "ready\n"
    finally:
        process.kill()
        process.communicate()


@pytest.mark.slow
def test_a_server_killed_at_any_answer_loses_no_text(place, tmp_path):
    """By SIGKILL of processes: edits, edits while the question stands, both answers, and edits after these."""
    first, second, third = (f"{ROOM}# {n}\n" for n in ("first", "second", "third"))
    served_until_killed(tmp_path, "first")
    assert offered(tmp_path) == [first]
    served_until_killed(tmp_path)
    assert offered(tmp_path) == [first], "an unanswered question stands again"
    served_until_killed(tmp_path, "second")
    assert offered(tmp_path) == [second, first], "edits while the question stands"
    served_until_killed(tmp_path, "third", "yes")
    assert sorted(offered(tmp_path)) == sorted([third, second, first]), "also the text that was replaced"
    served_until_killed(tmp_path, "no")
    assert len(offered(tmp_path)) == 2, "a refused draft goes, and no other"
    served_until_killed(tmp_path, "yes", "fourth", "save")
    assert place._read().endswith("# fourth\n")
    assert len(offered(tmp_path)) == 1


def test_the_draft_of_a_server_that_is_alive_is_neither_offered_nor_removed(place, tmp_path):
    place.put(edited(place))
    other = Workplace(tmp_path, place.file)
    assert other.recovered is None
    other.put(ROOM + "# other\n")
    other.undo()
    assert place.drafts.own.path.read_text() == place.text
    other.redo()
    killed(other)
    assert offered(tmp_path) == [ROOM + "# other\n"]
    killed(place)
    assert sorted(offered(tmp_path)) == sorted([ROOM + "# other\n", place.text])


def test_one_server_alone_is_asked_about_a_draft(place, tmp_path):
    place.put(edited(place))
    killed(place)
    asked, other = Workplace(tmp_path, place.file), Workplace(tmp_path, place.file)
    assert other.recovered is None
    draft = asked.recovered
    asked.restore(draft, False)
    asked.restore(draft, True)  # of a page on which the question still stands
    assert asked.text == ROOM
    assert hidden(tmp_path) == []


@pytest.mark.parametrize("size", [5_000_000, 20_000_000])
def test_a_text_that_is_too_large_for_a_scenario_is_offered_again(place, tmp_path, size):
    text = f"{ROOM}#{'x' * size}\n"
    place.put(text)
    killed(place)
    assert offered(tmp_path) == [text]
    with pytest.raises(InputError, match="at most 4 MiB"):
        place.save()
    assert place.file.read_text() == ROOM
    _, findings = place.check()
    assert "4 MiB" in findings.remarks[0].line


def full(path: Path, _: bytes) -> None:
    """Raise ENOSPC, as `Path.write_bytes` does on a full disk."""
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))


def test_a_draft_that_cannot_be_written_is_reported_and_written_later(place, tmp_path, monkeypatch):
    faults = []
    place.pages.append(SimpleNamespace(follow=lambda _: faults.append(place.drafts.fault)))
    with monkeypatch.context() as patch:
        patch.setattr(Path, "write_bytes", full)
        place.put(edited(place))
        assert os.strerror(errno.ENOSPC) in faults[-1]
        place.retry_draft()
        assert place.drafts.fault
    place.retry_draft()
    assert faults[-1] == ""
    killed(place)
    assert offered(tmp_path) == [place.text]


def test_a_draft_that_cannot_be_read_is_reported_and_stays(place, tmp_path):
    for key, content in (("00000001", b"\xff"), ("00000002", ROOM.encode())):
        (tmp_path / f".room.yaml.{key}.draft").write_bytes(content)
    (tmp_path / ".room.yaml.00000003.draft").symlink_to("secret")
    again = Workplace(tmp_path, place.file)
    assert again.recovered is None, "the second one has the file's text"
    assert ".room.yaml.0000000" in again.drafts.unreadable
    assert [name for name in sorted(hidden(tmp_path)) if name.endswith("draft")] == [
        ".room.yaml.00000001.draft", ".room.yaml.00000003.draft",
    ]  # fmt: skip


def test_a_prepared_link_at_a_lock_is_not_written_through(place, tmp_path):
    (tmp_path / "victim").write_text("mine")
    (tmp_path / ".room.yaml.00000001.draft").write_text("text")
    (tmp_path / ".room.yaml.00000001.lock").symlink_to("victim")
    assert "cannot be locked" in Workplace(tmp_path, place.file).drafts.unreadable
    assert (tmp_path / "victim").read_text() == "mine"


def test_what_a_kill_left_of_a_first_draft_goes(place, tmp_path):
    (tmp_path / ".room.yaml.0123abcd.lock").touch()
    (tmp_path / "..room.yaml.0123abcd.draft.00000000.part").write_text("ha")
    (tmp_path / ".room.yaml.old.lock").touch()
    Workplace(tmp_path, place.file)
    assert hidden(tmp_path) == [".room.yaml.old.lock"]


def test_another_name_is_taken_if_it_is_free_and_inside(place, tmp_path):
    place.put(edited(place))
    place.save_as("other.yaml")
    assert (tmp_path / "other.yaml").read_text() == place.text
    assert place.saved
    assert hidden(tmp_path) == []
    for name in ("room.yaml", "../x.yaml", "notes.txt", "/tmp/x.yaml"):
        with pytest.raises(InputError):
            place.save_as(name)


def test_another_name_is_of_the_same_folder(tmp_path):
    """The files that a scenario names are sought there."""
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub/s.yaml").write_text(ROOM)
    place = Workplace(tmp_path, tmp_path / "sub/s.yaml")
    place.save_as("t.yaml")
    assert (tmp_path / "sub/t.yaml").read_text() == ROOM


@pytest.mark.parametrize(
    "name", ["none/x.yaml", f"{300 * 'x'}.yaml", "a\0b.yaml", "a\0/b.yaml", "a\udc80.yaml"]
)
def test_a_name_that_cannot_be_written_leaves_file_and_draft(place, name):
    place.put(edited(place))
    draft = place.drafts.own.path
    before = place.file, place.on_disk, draft.read_text()
    with pytest.raises(InputError):
        place.save_as(name)
    assert (place.file, place.on_disk, draft.read_text()) == before
    place.save()
    assert place.saved


def test_a_file_in_a_missing_folder_is_refused(tmp_path):
    with pytest.raises(InputError, match="no such folder"):
        Workplace(tmp_path, tmp_path / "none/x.yaml")


def test_files_outside_are_opened_if_allowed_alone(tmp_path):
    (tmp_path / "inner").mkdir()
    (tmp_path / "s.yaml").write_text(ROOM)
    with pytest.raises(InputError, match="allow-outside"):
        Workplace(tmp_path / "inner", tmp_path / "s.yaml")
    assert Workplace(tmp_path / "inner", tmp_path / "s.yaml", allow_outside=True).text == ROOM


def test_a_file_that_is_no_text_is_refused(tmp_path):
    (tmp_path / "s.yaml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="UTF-8"):
        Workplace(tmp_path, tmp_path / "s.yaml")
    (tmp_path / "d.yaml").mkdir()
    with pytest.raises(InputError):
        Workplace(tmp_path, tmp_path / "d.yaml")


def test_findings_of_an_earlier_text_are_not_taken(place):
    text, findings = place.check()
    place.put(edited(place))
    present = place.findings
    place.found(text, findings)
    assert place.findings is present
    assert place.checked != text
    place.found(*place.check())
    assert place.findings.sound


def test_another_file_is_opened_and_the_draft_of_the_first_is_offered_later(place, tmp_path):
    mine = edited(place)
    place.put(mine)
    place.open()
    assert (place.text, place.file.name, place.recovered) == (edits.BLANK, "room-2.yaml", None)
    assert not place.history.can_undo
    place.open("room.yaml")
    assert (place.text, place.recovered.text) == (ROOM, mine)
    place.restore(place.recovered, True)
    assert place.text == mine
    for name in ("../room.yaml", "room.txt"):
        with pytest.raises(InputError, match="room"):
            place.open(name)
    assert place.text == mine


def test_a_file_that_is_missing_or_empty_is_opened_as_it_is(place, tmp_path):
    place.put(edited(place))
    with pytest.raises(InputError, match=r"gone\.yaml"):
        place.open("gone.yaml")
    assert place.file.name == "room.yaml"
    (tmp_path / "empty.yaml").write_text("")
    place.open("empty.yaml")
    assert (place.text, place.saved) == ("", True)
    place.save()


def test_nothing_of_the_last_room_is_seen_in_a_file_that_is_no_yaml(place, tmp_path):
    assert len(place.scene.things) > 3
    (tmp_path / "broken.yaml").write_text("a: [")
    place.open("broken.yaml")
    assert place.scene.things == ()


def test_a_text_without_a_draft_is_not_left(place, monkeypatch):
    """A full disk: the changes would be lost."""
    with monkeypatch.context() as patch:
        patch.setattr(Path, "write_bytes", full)
        place.put(edited(place))
        for leave in (place.open, lambda: place.example("casting_room")):
            with pytest.raises(InputError, match="No space"):
                leave()
    assert place.text == edited(place) != ROOM


def test_a_draft_that_was_saved_is_not_offered_once_its_file_is_opened_again(place, tmp_path):
    place.put(edited(place))
    place.open()
    (tmp_path / "room.yaml").write_text(edits.BLANK)
    (draft,) = tmp_path.glob(".room.yaml.*.draft")
    draft.write_text(edits.BLANK)
    place.open("room.yaml")
    assert place.recovered is None


def test_an_example_that_cannot_be_copied_is_an_error_in_a_line(place, monkeypatch):
    monkeypatch.setattr("shutil.copyfile", full)
    with pytest.raises(InputError, match=r"quiet_room.*No space"):
        place.example("quiet_room")


def test_an_example_is_opened_as_a_copy_with_its_files(place, tmp_path):
    place.example("casting_room")
    assert place.file == tmp_path / "casting_room.yaml"
    assert place.text == ROOM
    with pytest.raises(InputError, match="is a study"):
        place.example("studies/wind_speeds")
    assert place.text == ROOM


def test_a_file_is_brought_into_the_folder_and_replaces_none(place, tmp_path):
    assert place.take("C:\\parts\\pillar.stl", b"solid").read_bytes() == b"solid"
    assert sorted(path.name for path in tmp_path.iterdir() if path.suffix == ".stl") == ["pillar.stl"]
    assert place.take("HALL.YAML", b"image: hall.png").name == "HALL.yaml"
    assert place.take("b.yaml", b"# no image: a room\nname: b").name == "b.yaml"
    assert place.files == ["b.yaml", "room.yaml"], "maps are no scenarios"
    for name, content, word in (
        ("room.yaml", b"name: a", "exists already"),
        ("../up.py", b"", "must end in"),
        (".stl", b"", "must end in"),
        ("large.stl", b"0" * (workplace.MOST_BROUGHT + 1), "at most 40 MiB"),
    ):
        with pytest.raises(InputError, match=word):
            place.take(name, content)
    assert (tmp_path / "room.yaml").read_text() == ROOM
    assert not (tmp_path.parent / "up.py").exists()
