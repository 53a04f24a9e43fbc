"""What `--check` prints can be read by people and by YAML, and its picture spoils no folder."""

import io
import re
import sys
import types
from pathlib import Path

import pytest
import yaml
from test_messages import FLOOR

from taichi_plume.assembly.preparation import load
from taichi_plume.cli import check as checking
from taichi_plume.cli import run
from taichi_plume.files.run_folder import RunFolder, RunFolderError, to_yaml
from taichi_plume.scenario.scenario import Scenario

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


def same_keys(one, other):
    """Whether two nested mappings have the same keys."""
    return not isinstance(one, dict) or (
        set(one) == set(other) and all(same_keys(one[k], other[k]) for k in one)
    )


LONG = re.compile(r"\d{16}|\d\.\d{15}")  # digits of no number that somebody wrote


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_a_check_fits_on_a_screen_and_is_the_same_scenario(path, folder, capsys):
    """The keys of the file, what follows from them, and the size; of the defaults nothing, unless asked for."""
    written = yaml.safe_load(path.read_text())
    assert run.main([str(path), "--check", "--out", str(folder / "there")]) == 0
    reported = capsys.readouterr().out
    assert len(reported.splitlines()) <= 60
    assert max(map(len, reported.splitlines())) <= 160
    assert not LONG.search(reported)
    for name in ("room", "time", "size", "scene"):
        assert re.search(rf"^# {name} ", reported, re.MULTILINE), name
    assert set(yaml.safe_load(reported)) == set(written)
    scenario = Scenario.model_validate(yaml.safe_load(reported))
    assert scenario == Scenario.model_validate(written)
    for wide in (60, 120):
        text = checking.explained(scenario, wide)
        assert Scenario.model_validate(yaml.safe_load(text)) == scenario
        assert same_keys(yaml.safe_load(text), yaml.safe_load(to_yaml(scenario)))
        lines = [line for line in text.splitlines() if "# " in line]
        assert max(map(len, lines)) <= wide or any(re.match(r" *[-\w]+: .{40}", line) for line in lines)


def test_numbers_are_printed_as_they_were_meant(folder, capsys):
    values = ["gas.sources.0.rate=20 mg/s", "domain.spacing=7 cm", "warm_up=0.3 s", "robots.0.reach=35 cm"]
    options = [f"--set={value}" for value in values]
    for whole in ([], ["--all"]):
        assert run.main(["s.yaml", *options, "--check", *whole]) == 0
        reported = capsys.readouterr().out
        for text in ("rate: 20 mg/s", "spacing: 7 cm", "warm_up: 0.3 s", "reach: 0.35 m"):
            assert text in reported
        assert not LONG.search(reported)
    assert run.main(["s.yaml", "--set", "gas.sources.0.rate=1.9999999999999998e-05", "--check"]) == 0
    assert "rate: 20 mg/s" in capsys.readouterr().out


def test_what_follows_from_a_scenario(folder, capsys):
    """Of 4 x 3 m with an inlet over a face: the flow rate, the air changes, the Reynolds number, the mean ppm."""
    Path("s.yaml").write_text(
        "duration: 60 s\ndomain: {size: [4, 3], spacing: 0.1, depth: 0.5}\n"
        "wind: {kind: cfd, viscosity: 1.5e-5, openings: [{kind: inlet, face: x-, speed: 0.5}, "
        "{kind: outlet, face: x+}]}\n"
        "gas: {kind: eulerian, species: acetone, sources: [{position: [1, 1.5], rate: 15 mg/s}]}\n"
    )
    assert run.main(["s.yaml", "--check"]) == 0
    lines = dict(re.findall(r"^# (\w+) +(.*)$", capsys.readouterr().out, re.MULTILINE))
    assert "40 x 30 = 1,200 cells of 0.1 m" in lines["room"]
    assert "600 ticks of 0.1 s" in lines["time"]
    assert lines["air"].startswith("0.75 m^3/s")  # 0.5 m/s x 3 m x 0.5 m
    assert "every 8 s, 7.5 in the run" in lines["air"]  # 6 m^3
    assert "100,000 of the room" in lines["Reynolds"]  # 0.5 x 3 / 1.5e-5
    assert "3,300 of a cell" in lines["Reynolds"]
    assert "8.4 ppm" in lines["gas"]  # 20 mg/m^3 of 58.08 g/mol, 24.47 L/mol


def test_equal_parts_of_the_gas_are_one_line(folder, capsys):
    source = "sources: [{position: [1, 1.5], rate: 15 mg/s}]"
    part = f"{{kind: gaussian_plume, species: acetone, intensity: 0.1, {source}}}"
    head = "duration: 60 s\ndomain: {size: [4, 3], spacing: 0.1}\nwind: {kind: uniform, velocity: [0.5, 0]}\n"
    Path("s.yaml").write_text(f"{head}gas: {{kind: mixture, parts: [{part}, {part}]}}\n")
    assert run.main(["s.yaml", "--check"]) == 0
    shown = capsys.readouterr().out
    assert re.search(r"^# gas +2 parts, .*acetone", shown, re.MULTILINE)
    assert "# gas.parts" not in shown
    size = re.search(r"^# size +about (\d+) MB of memory", shown, re.MULTILINE)
    assert size
    assert int(size[1]) >= 400, "the program's own memory counts"


def test_all_goes_with_a_check(folder, capsys):
    with pytest.raises(SystemExit) as caught:
        run.main(["s.yaml", "--all"])
    assert caught.value.code == 2
    assert "--check" in capsys.readouterr().err
    assert run.main(["s.yaml", "--check", "--all"]) == 0
    whole = capsys.readouterr().out
    assert "# Edge of the square or cubic cells of the grid [m]" in whole
    assert yaml.safe_load(whole)["stop_early"] is True


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
    reported = capsys.readouterr()
    notes = [line.removeprefix("note: ") for line in reported.err.splitlines()]
    assert len(notes) >= 2
    assert [f"# unlikely {n}: {note}" for n, note in enumerate(notes, 1)] == [
        line for line in reported.out.splitlines() if line.startswith("# unlikely")
    ]
    (folder / "again.yaml").write_text(reported.out)
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
    assert any(line.startswith("# unlikely 1: robots[0].reach: 0 m") for line in lines[-5:])


def test_the_scene_is_drawn_and_reported(folder, capsys):
    assert run.main(["s.yaml", "--check"]) == 0
    (scene,) = re.findall(r"^# scene +(.*)$", capsys.readouterr().out, re.MULTILINE)
    assert scene == str(Path("runs/run-check.png"))
    assert [file.read_bytes() for file in Path("runs").iterdir()] == [PIXEL]
    assert run.main(["s.yaml", "--check", "--out", "there"]) == 0
    assert [file.name for file in Path("there").iterdir()] == ["check.png"]
    with RunFolder("a", Path("there")) as begun:  # a run may begin in it
        assert begun.path == Path("there")
    assert [file.name for file in Path("there").iterdir() if file.suffix] == ["check.png"]


def test_what_is_no_picture_is_kept(folder, capsys):
    Path("there").mkdir()
    Path("there/check.png").write_text("mine")
    assert run.main(["s.yaml", "--check", "--out", "there"]) == 0
    reported = capsys.readouterr()
    assert reported.err == f"note: {Path('there/check.png')}: is no picture, and stays as it is\n"
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
    reported = capsys.readouterr()
    assert re.fullmatch(r"note: .*check\.png: cannot be written: .*\n", reported.err)
    assert re.search(r"^# scene +not drawn", reported.out, re.MULTILINE)
    assert yaml.safe_load(reported.out)["duration"] == "10 s"


def test_a_link_is_replaced_and_not_followed(folder, capsys):
    Path("target").write_bytes(PIXEL + b"mine")
    Path("there").mkdir()
    Path("there/check.png").symlink_to(folder / "target")
    assert run.main(["s.yaml", "--check", "--out", "there"]) == 0
    assert Path("target").read_bytes() == PIXEL + b"mine"
    assert Path("there/check.png").read_bytes() == PIXEL
