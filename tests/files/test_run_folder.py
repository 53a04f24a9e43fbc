"""The run directory: free ones, those that are refused, and earlier runs, which get another name."""

import json
import os
from pathlib import Path

import fake_run
import pytest
import yaml
from refusals import cut_off

from taichi_plume.files import run_folder
from taichi_plume.files.run_folder import RunFolder, RunFolderError
from taichi_plume.scenario.input_files import input_paths
from taichi_plume.scenario.scenario import Scenario

RESULT = json.dumps({"name": "a", "status": "completed", "seed": 1})


@pytest.fixture
def earlier(tmp_path) -> Path:
    """The directory of an earlier run, with a file of the user's in it."""
    folder = tmp_path / "earlier"
    folder.mkdir()
    (folder / "result.json").write_text(RESULT)
    (folder / "fields.zarr").mkdir()
    (folder / "notes.txt").write_text("mine")
    return folder


def test_next_free_folder(tmp_path):
    runs = tmp_path / "runs"
    with RunFolder("a", runs=runs) as first, RunFolder("a", runs=runs) as second:
        (first.path / "result.json").write_text(RESULT)
        (second.path / "result.json").write_text(RESULT)
        (second.path / "result.json").unlink()
    assert [first.path.name, second.path.name] == ["a-1", "a-2"]
    assert not second.path.exists(), "what was made and left empty goes"
    with RunFolder("a", runs=runs) as third:
        assert third.path.name == "a-2"


def test_an_earlier_run_gets_another_name_with_all_its_files(earlier, capsys):
    with pytest.raises(RunFolderError, match="is not empty; choose another --out or add --force"):
        RunFolder("a", earlier)
    before = contents(earlier)
    for name in ("earlier.old", "earlier.old-2", "earlier.old-3"):
        with RunFolder("a", earlier, force=True) as folder:
            assert contents(earlier) == before, "until the new run starts"
            folder.start()
            assert capsys.readouterr().err == f"the earlier run is now {earlier.with_name(name)}\n"
            assert contents(earlier) == {}
            with pytest.raises(RunFolderError, match="another run is writing there"):
                RunFolder("a", earlier, force=True)
            (earlier / "result.json").write_text(RESULT)
        assert contents(earlier.with_name(name)) == before
        assert not (earlier.with_name(name) / run_folder.LOCK).exists()
        before = {"result.json": RESULT}


def test_a_folder_without_files_of_a_run_keeps_its_name(tmp_path):
    (tmp_path / run_folder.CHECK).touch()
    with RunFolder("a", tmp_path, force=True) as folder:
        folder.start()
    assert (tmp_path / run_folder.CHECK).exists()


def test_of_a_linked_folder_the_target_is_renamed(earlier, tmp_path):
    (tmp_path / "link").symlink_to(earlier)
    with RunFolder("a", tmp_path / "link", force=True) as folder:
        folder.start()
        (folder.path / "result.json").write_text("new")
    assert (tmp_path / "link").is_symlink()
    assert (earlier / "result.json").read_text() == "new"
    assert (tmp_path / "earlier.old" / "notes.txt").exists()


def test_the_working_folder_is_not_renamed(earlier, monkeypatch):
    (earlier / "inner").mkdir()
    for working, out in ((earlier, "."), (earlier / "inner", "..")):
        monkeypatch.chdir(working)
        with pytest.raises(RunFolderError, match="working folder"):
            RunFolder("a", Path(out), force=True)


@pytest.mark.parametrize(
    "files",
    [{"result.json": "{}"}, {"result.json": "[" * 9999}, {"scenario.yaml": "name: mine"}, {"thesis.tex": ""}],
)
def test_what_no_run_has_left_is_not_overwritten(tmp_path, files):
    for name, content in files.items():
        (tmp_path / name).write_text(content)
    with pytest.raises(RunFolderError, match="choose another --out"):
        RunFolder("a", tmp_path, force=True)
    assert {file.name: file.read_text() for file in tmp_path.iterdir() if file.name != ".lock"} == files


@pytest.mark.parametrize("name", ["fields.zarr", "scenario.yaml", "../earlier"])
def test_a_folder_that_holds_an_input_is_refused(earlier, tmp_path, name):
    file = earlier / name
    file.touch() if not file.exists() else None
    (tmp_path / "link").symlink_to(earlier)
    for out in (earlier, tmp_path / "link"):
        with pytest.raises(RunFolderError, match="which this run reads"):
            RunFolder("a", out, force=True, inputs=[Path("/somewhere/else"), file])
    assert (earlier / "result.json").exists()


def test_two_runs_do_not_write_into_one_folder(tmp_path):
    with RunFolder("a", tmp_path / "out") as first:
        (first.path / "result.json").write_text(RESULT)
        for again in (
            lambda: RunFolder("a", tmp_path / "out", force=True),
            lambda: RunFolder.again(first.path),
        ):
            with pytest.raises(RunFolderError, match="another run is writing there"):
                again()
    with RunFolder.again(first.path):
        pass


def test_folders_that_are_refused(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(RunFolderError, match="is no folder"):
        RunFolder.again(tmp_path / "nowhere")
    with pytest.raises(RunFolderError, match="cannot be made"):
        RunFolder("a", tmp_path / "file" / "run")
    with pytest.raises(RunFolderError, match="file: is a file"):
        RunFolder("a", tmp_path / "file", force=True)


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="a folder in which not even root may write")
def test_proc_cannot_be_written_to():
    with pytest.raises(RunFolderError, match=r"^/proc/self: cannot be written to: \w"):
        RunFolder("a", Path("/proc/self"))


@pytest.mark.skipif(os.name == "nt" or os.geteuid() == 0, reason="permissions do not bind root")
def test_folder_that_cannot_be_written_to(earlier):
    earlier.chmod(0o500)
    with pytest.raises(RunFolderError, match="cannot be written to: Permission denied"):
        RunFolder("a", earlier, force=True)
    assert (earlier / "result.json").exists()


def test_input_files_are_all_that_a_scenario_reads(tmp_path):
    for n in range(3):
        (tmp_path / f"wind_{n}.csv").touch()
    data = fake_run.scenario(2).model_dump(mode="json", exclude_none=True)
    data["obstacles"] = [{"kind": "mesh", "file": "box.stl"}]
    data["wind"] = {"kind": "imported", "files": "wind_%d.csv", "occupancy": "cells.csv"}
    data["task"] = {"films": ["one.zarr", "two.zarr"]}
    scenario = Scenario.model_validate(data)
    found = input_paths(scenario, tmp_path / "a.yaml", {})
    names = "a.yaml box.stl cells.csv one.zarr two.zarr wind_0.csv wind_1.csv wind_2.csv"
    assert sorted(file.name for file in found) == names.split()
    reported = yaml.safe_load(run_folder.to_yaml(scenario, tmp_path, tmp_path / "run"))
    assert reported["task"]["films"] == ["../one.zarr", "../two.zarr"]
    assert reported["obstacles"][0]["file"] == "../box.stl"


def test_null_is_written_where_it_is_not_what_a_missing_key_means():
    data = fake_run.scenario(2).model_dump(mode="json", exclude_none=True)
    data |= {"maps": [{"kind": "gmrf", "memory": None}], "checkpoint": None}
    scenario = Scenario.model_validate(data)
    assert Scenario.model_validate(yaml.safe_load(run_folder.to_yaml(scenario))) == scenario


def contents(folder: Path) -> dict[str, str]:
    """What a folder holds, but for its lock."""
    return {
        file.relative_to(folder).as_posix(): file.read_text() if file.is_file() else ""
        for file in sorted(folder.rglob("*"))
        if file.name != run_folder.LOCK
    }


def test_a_run_that_is_killed_while_it_starts_leaves_the_earlier_one_whole(tmp_path, monkeypatch):
    """Under its name or the new one, whatever call on the disk was the last; nobody has to repair anything."""
    old = {"result.json": RESULT, "robots.parquet": "old", "notes.txt": "mine"}
    places = []
    for last in range(100):
        path = tmp_path / str(last) / "out"
        path.mkdir(parents=True)
        for name, text in old.items():
            (path / name).write_text(text)
        folder = RunFolder("a", path, force=True)
        killed = cut_off(monkeypatch, last, folder.start)
        folder.close()
        aside = path.with_name("out.old")
        places.append(path if path.is_dir() and contents(path) else aside)
        assert contents(places[-1]) == old
        with RunFolder("a", path, force=True) as again:
            again.start()
        if not killed:
            break
    assert (places[0].name, places[-1].name) == ("out", "out.old")


def test_a_folder_goes_only_while_nobody_else_is_in_it(tmp_path, monkeypatch):
    """Between the last look and the end another run may have begun there."""
    folder, unlink = RunFolder("a", tmp_path / "out"), os.unlink

    def late(*args, **more):
        unlink(*args, **more)
        (tmp_path / "out" / "result.json").write_text(RESULT)

    monkeypatch.setattr(os, "unlink", late)
    folder.close()
    assert (tmp_path / "out" / "result.json").read_text() == RESULT


@pytest.mark.parametrize("how", ["link", "hard link"])
@pytest.mark.parametrize(
    "name", ["forces.csv", "result.json", "robots.arrows", "fields.zarr/zarr.json", ".lock"]
)
def test_a_folder_whose_files_are_links_is_refused(tmp_path, name, how):
    """To be completed or resumed: the links' targets would be cut, or their content overwritten."""
    folder, target = tmp_path / "run", tmp_path / "mine"
    folder.mkdir()
    (folder / "result.json").write_text(RESULT)
    (folder / "scenario.yaml").write_text(run_folder.HEADER)
    target.write_text(RESULT)
    (folder / name).parent.mkdir(exist_ok=True)
    (folder / name).unlink(missing_ok=True)
    (folder / name).symlink_to(target) if how == "link" else (folder / name).hardlink_to(target)
    before = {file: file.lstat().st_ino for file in folder.rglob("*")}
    for use in (RunFolder.again, lambda path: RunFolder("a", path)):
        with pytest.raises(RunFolderError, match=rf"{name.rpartition('/')[2]}|is not empty"):
            use(folder)
    assert target.read_text() == RESULT
    assert {file: file.lstat().st_ino for file in folder.rglob("*")} == before


def test_links_to_folders_are_refused(earlier, tmp_path):
    """Files in a linked folder would be removed; a folder that gets another name keeps its links."""
    target = tmp_path / "mine"
    target.mkdir()
    (target / "photo.jpg").write_text("mine")
    (earlier / "maps.part").symlink_to(target)
    with pytest.raises(RunFolderError, match=r"maps\.part"):
        RunFolder.again(earlier)
    with RunFolder("a", earlier, force=True) as folder:
        folder.start()
    assert (target / "photo.jpg").read_text() == "mine"
    assert (tmp_path / "earlier.old" / "maps.part").is_symlink()


def test_nothing_is_left_in_a_folder_that_is_refused(tmp_path):
    (tmp_path / "thesis.tex").write_text("")
    for force in (False, True):
        with pytest.raises(RunFolderError):
            RunFolder("a", tmp_path, force)
    with pytest.raises(RunFolderError, match="is not the folder of a run"):
        RunFolder.again(tmp_path)
    assert [file.name for file in tmp_path.iterdir()] == ["thesis.tex"]


def test_a_lock_of_someone_elses_is_not_cut(tmp_path):
    (tmp_path / ".lock").write_text("mine")
    with pytest.raises(RunFolderError, match="is no lock"):
        RunFolder("a", tmp_path)
    assert (tmp_path / ".lock").read_text() == "mine"


def test_pipes_in_a_folder_are_not_waited_for(tmp_path):
    for name in ("result.json", "scenario.yaml"):
        os.mkfifo(tmp_path / name)
    assert not run_folder.is_run(tmp_path)
