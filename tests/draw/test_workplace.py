"""State of a session: nothing that was drawn is lost, and no file of another program is overwritten."""

import os
from pathlib import Path

import pytest
from test_document import CONFIGS, ROOT

from taichi_plume.draw import edits
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
    assert place.changed_on_disk
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


@pytest.mark.parametrize("name", [".room.yaml.draft", ".room.yaml.new", ".room.yaml.draft.new"])
def test_a_draft_is_not_written_through_a_link(place, name):
    victim = linked(place, name)
    place.put(edited(place))
    assert victim.read_text() == "mine"
    assert place.draft.read_text() == place.text
    assert not place.draft.is_symlink()


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


def test_unsaved_changes_survive_a_killed_server(place, tmp_path):
    place.put(edited(place))
    again = Workplace(tmp_path, place.file)  # the first one has been killed: nothing else was called
    assert again.text == ROOM
    assert again.recovered == place.text
    again.restore(True)
    assert again.text == place.text
    again.undo()
    assert again.text == ROOM
    again.redo()
    again.save()
    assert not again.draft.exists()
    assert Workplace(tmp_path, place.file).recovered is None


def test_a_draft_that_is_not_wanted_goes(place, tmp_path):
    place.put(edited(place))
    again = Workplace(tmp_path, place.file)
    again.restore(False)
    assert again.text == ROOM
    assert not again.draft.exists()


def test_a_draft_is_kept_until_the_question_about_it_is_answered(place, tmp_path):
    place.put(edited(place))
    again = Workplace(tmp_path, place.file)
    again.put(ROOM + "# more\n")
    assert again.draft.read_text() == place.text


def test_another_name_is_taken_if_it_is_free_and_inside(place, tmp_path):
    place.put(edited(place))
    place.save_as("other.yaml")
    assert (tmp_path / "other.yaml").read_text() == place.text
    assert place.saved
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
    before = place.file, place.on_disk, place.draft.read_text()
    with pytest.raises(InputError):
        place.save_as(name)
    assert (place.file, place.on_disk, place.draft.read_text()) == before
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
    place.found(text, findings)
    assert place.findings is None
    place.found(*place.check())
    assert place.findings.sound


def test_the_draft_stands_beside_the_file(place):
    assert place.draft == Path(place.folder / ".room.yaml.draft")
