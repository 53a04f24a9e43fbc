"""What `--check` prints can be read by people and by YAML, and its picture spoils no folder."""

import io
import re
import sys
import types
from pathlib import Path

import pytest
import yaml
from test_checks import FLOOR, ROOM

from taichi_plume import checking, run
from taichi_plume.files.run_folder import RunFolder, RunFolderError, to_yaml
from taichi_plume.prepare import load

CONFIGS = sorted((Path(__file__).parent.parent / "configs").glob("*.yaml"))
PIXEL = checking.PNG + b"a picture"


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    """A folder with s.yaml, in which the scene is drawn at no cost."""
    monkeypatch.chdir(tmp_path)
    drawn = types.ModuleType("taichi_plume.report.scene")
    drawn.save_check = lambda prepared, path: path.write_bytes(PIXEL)  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "taichi_plume.report.scene", drawn)
    (tmp_path / "s.yaml").write_text(FLOOR)
    return tmp_path


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_what_is_explained_is_the_same_yaml(path):
    scenario = load(path).scenario
    for wide in (60, 120):
        text = checking.explained(scenario, wide)
        assert yaml.safe_load(text) == yaml.safe_load(to_yaml(scenario))
        told = [line for line in text.splitlines() if "# " in line]
        assert max(map(len, told)) <= wide or any(re.match(r" *[-\w]+: .{40}", line) for line in told)


def test_every_key_is_explained_where_it_comes_first(tmp_path):
    (tmp_path / "s.yaml").write_text(FLOOR)
    lines = checking.explained(load(tmp_path / "s.yaml").scenario).splitlines()
    for n, line in enumerate(lines):
        if key := re.match(r" *(?:- )?(\w+):", line):
            first = next(k for k, one in enumerate(lines) if re.match(rf" *(?:- )?{key[1]}:", one))
            assert "# " in lines[first] or "# " in lines[first - 1], (n, line)
    (spacing,) = [line for line in lines if "spacing:" in line]
    assert spacing.endswith("# Edge of the square or cubic cells of the grid [m]")


def test_a_check_can_be_run_again_and_lists_what_is_unlikely(folder, capsys):
    overrides = ["--set", "robots.0.reach=0", "--set", "gas.sources.0.rate=0"]
    assert run.main(["s.yaml", *overrides, "--check"]) == 0
    told = capsys.readouterr()
    notes = [line.removeprefix("note: ") for line in told.err.splitlines()]
    assert len(notes) >= 2
    assert [f"# unlikely {n}: {note}" for n, note in enumerate(notes, 1)] == [
        line for line in told.out.splitlines() if line.startswith("# unlikely")
    ]
    (folder / "again.yaml").write_text(told.out)
    assert load("again.yaml").scenario == load("s.yaml", overrides[1::2]).scenario


def test_notes_stand_at_the_end_of_what_a_terminal_shows(folder, capsys, monkeypatch):
    class Terminal(io.StringIO):
        def isatty(self):
            return True

    monkeypatch.setattr(sys, "stdout", Terminal())
    monkeypatch.setenv("COLUMNS", "70")
    assert run.main(["s.yaml", "--set", "robots.0.reach=0", "--check"]) == 0
    lines = sys.stdout.getvalue().splitlines()  # type: ignore[attr-defined]
    assert capsys.readouterr().err == ""
    assert max(len(line) for line in lines if "# " in line and not line.startswith("# ")) <= 70
    assert any(line.startswith("# unlikely 1: robots[0].reach: 0 m") for line in lines[-4:])


def test_the_scene_is_drawn_and_told(folder, capsys):
    assert run.main(["s.yaml", "--check"]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == f"# scene: {Path('runs/run-check.png')}"
    assert Path("runs/run-check.png").read_bytes() == PIXEL
    assert run.main(["s.yaml", "--check", "--out", "there"]) == 0
    assert [file.name for file in Path("there").iterdir()] == ["check.png"]
    with RunFolder("a", Path("there")) as begun:  # a run may begin in it
        assert begun.path == Path("there")
    assert [file.name for file in Path("there").iterdir() if file.suffix] == ["check.png"]


def test_what_is_no_picture_is_kept(folder, capsys):
    Path("there").mkdir()
    Path("there/check.png").write_text("mine")
    assert run.main(["s.yaml", "--check", "--out", "there"]) == 0
    told = capsys.readouterr()
    assert told.err == f"note: {Path('there/check.png')}: is no picture, and stays as it is\n"
    assert Path("there/check.png").read_text() == "mine"
    assert [file.name for file in Path("there").iterdir()] == ["check.png"]
    Path("there/other").touch()
    with pytest.raises(RunFolderError, match="not empty"):
        RunFolder("a", Path("there"))


@pytest.mark.parametrize("name", ["a", "a/b", "runs"])
def test_a_folder_that_cannot_be_written_to_is_a_note(folder, name, capsys):
    Path(name.split("/")[0]).write_text("a file")
    options = ["--out", name] if name != "runs" else []
    assert run.main(["s.yaml", "--check", *options]) == 0
    told = capsys.readouterr()
    assert re.fullmatch(r"note: .*check\.png: cannot be written: .*\n", told.err)
    assert "# scene: not drawn" in told.out
    assert yaml.safe_load(told.out)["duration"] == 10.0


def test_a_link_is_replaced_and_not_followed(folder, capsys):
    Path("target").write_bytes(PIXEL + b"mine")
    Path("there").mkdir()
    Path("there/check.png").symlink_to(folder / "target")
    assert run.main(["s.yaml", "--check", "--out", "there"]) == 0
    assert Path("target").read_bytes() == PIXEL + b"mine"
    assert Path("there/check.png").read_bytes() == PIXEL


def test_in_3d_too(folder, capsys):
    Path("s.yaml").write_text(ROOM)
    assert run.main(["s.yaml", "--check"]) == 0
    assert len(yaml.safe_load(capsys.readouterr().out)["domain"]["size"]) == 3
