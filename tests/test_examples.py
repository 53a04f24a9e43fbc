"""The examples that travel with the package: their names, files and kinds; the command lists, runs and copies them."""

import re
import shutil
import tomllib
from pathlib import Path

import pytest

from taichi_plume import load_scenario
from taichi_plume.__main__ import main as command
from taichi_plume.cli.examples import KINDS
from taichi_plume.files import bundled
from taichi_plume.files.bundled import names, path_of
from taichi_plume.scenario.loading import ScenarioError
from taichi_plume.studies.plan import load_plan

ROOT = Path(__file__).parents[1]
ALL = [bundled.example(name) for name in names()]
SETUP = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]


def test_all_files_have_a_name():
    files = {*(ROOT / "configs").rglob("*.yaml"), *(ROOT / "examples").glob("*.py")}
    assert {path_of(name) for name in names()} == files
    assert len(names()) == len(files)


@pytest.mark.parametrize("one", ALL, ids=lambda one: one.name)
def test_an_example_states_its_story_and_time_and_can_be_read(one):
    assert len(one.story) > 40
    assert re.fullmatch(r"\d+ (s|min)", one.time)
    if one.kind == "study":
        assert load_plan(one.path).requests
    elif one.kind not in ("program", "launch"):
        load_scenario(one.path)


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("casting_room", "scenario"), ("studies/small_room", "scenario"), ("live/room", "live"),
        ("studies/wind_speeds", "study"), ("tasks/search_whiffs", "task"), ("learn_search.py", "program"),
        ("live_room.launch.py", "launch"),
    ],
)  # fmt: skip
def test_kinds_are_distinguished(name, kind):
    assert bundled.example(name).kind == kind
    assert {one.kind for one in ALL} == set(KINDS) == {*bundled.KINDS, "program", "launch"}


def test_in_a_wheel_the_files_lie_inside_the_package(tmp_path, monkeypatch):
    (tmp_path / "configs/live").mkdir(parents=True)
    (tmp_path / "configs/live/room.yaml").touch()
    monkeypatch.setattr(bundled, "ROOTS", [tmp_path])
    assert names() == ["live/room"]
    assert path_of("live/room") == tmp_path / "configs/live/room.yaml"


def test_a_wheel_has_all_packages_and_the_files_of_configs():
    places = SETUP["package-dir"]

    def folder(package):
        parts = package.split(".")
        place = next(n for n in range(len(parts), 0, -1) if ".".join(parts[:n]) in places)
        return ROOT.joinpath(places[".".join(parts[:place])], *parts[place:])

    roots = [ROOT / name for name in ("taichi_plume", "solvers", "agents", "validation")]
    packages = {path.parent for root in roots for path in root.rglob("__init__.py")}
    assert set(map(folder, SETUP["packages"])) == packages | {ROOT / "configs", ROOT / "examples"}
    patterns = SETUP["package-data"]["taichi_plume.configs"]
    shipped = {path for pattern in patterns for path in (ROOT / "configs").glob(pattern)}
    assert shipped == {path for path in (ROOT / "configs").rglob("*") if path.is_file()}
    (pattern,) = SETUP["package-data"]["taichi_plume.examples"]
    layouts = {path for path in (ROOT / "examples").iterdir() if path.is_file() and path.suffix != ".py"}
    assert set((ROOT / "examples").glob(pattern)) == layouts


def test_an_unknown_name_is_refused_with_the_nearest_and_all_names():
    with pytest.raises(ScenarioError) as refused:
        path_of("casting_rom")
    (line,) = refused.value.lines
    assert line.startswith("example: got 'casting_rom'; did you mean casting_room?")
    assert all(name in line for name in names())


def test_the_list_has_a_line_for_each(capsys):
    assert command(["examples"]) == 0
    lines = capsys.readouterr().out.splitlines()
    for one in ALL:
        (line,) = (line for line in lines if line.split()[0] == one.name)
        assert one.time in line
        assert one.story[:40] in line
    assert max(map(len, lines)) <= 120


@pytest.mark.parametrize(
    ("name", "runner"), [("playback", "run"), ("live/room", "serve"), ("studies/wind_speeds", "study")]
)
def test_an_example_is_run_by_the_command_of_its_kind(name, runner, monkeypatch):
    lines = []
    monkeypatch.setattr(f"taichi_plume.cli.{runner}.main", lambda line: lines.append(line) or 5)
    assert command(["examples", name, "--set", "seed=3"]) == 5
    assert lines == [[str(path_of(name)), "--set", "seed=3"]]


@pytest.mark.parametrize("line", ["casting_rom", "tasks/search_whiffs", "learn_search.py", "--copy none"])
def test_an_example_that_no_command_runs_is_one_line_and_exit_code_2(line, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert command(["examples", *line.split()]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert line.split()[-1] in error
    assert not list(tmp_path.iterdir())


def test_the_options_are_checked(capsys):
    with pytest.raises(SystemExit) as end:
        command(["examples", "--out", "x"])
    assert end.value.code == 2
    assert "--copy" in capsys.readouterr().err


def test_a_copy_has_the_files_that_an_example_reads(tmp_path, monkeypatch, capsys):
    for one in ALL:
        out = tmp_path / one.name
        assert command(["examples", "--copy", one.name, "--out", str(out)]) == 0
        assert (out / one.path.name).read_bytes() == one.path.read_bytes()
        assert str(out / one.path.name) in capsys.readouterr().out
    assert (tmp_path / "live_room.launch.py/live_room.foxglove.json").is_file()
    monkeypatch.chdir(tmp_path / "playback")
    assert sorted(path.name for path in Path().rglob("*.*")) == ["casting_room.pslog", "playback.yaml"]
    assert load_scenario("playback.yaml").name == "playback"
    assert load_plan(tmp_path / "studies/wind_speeds/wind_speeds.yaml").requests


def test_a_copy_overwrites_no_file(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    base = Path("small_room.yaml")
    base.write_text("name: mine")
    assert command(["examples", "--copy", "studies/wind_speeds"]) == 2
    assert capsys.readouterr().err.startswith("small_room.yaml: ")
    assert [(path, path.read_text()) for path in Path().iterdir()] == [(base, "name: mine")]
    base.unlink()
    assert command(["examples", "--copy", "studies/wind_speeds"]) == 0
    assert command(["examples", "--copy", "studies/sensitivity"]) == 0  # the same base
    capsys.readouterr()
    assert command(["examples", "--copy", "studies/wind_speeds"]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert {path.stem for path in Path().iterdir()} == {"small_room", "sensitivity", "wind_speeds"}


def test_a_copy_overwrites_no_file_that_appears_after_the_check(tmp_path, monkeypatch):
    mine, copied = tmp_path / "casting_room.yaml", shutil.copyfile
    monkeypatch.setattr(shutil, "copyfile", lambda *paths: (mine.write_text("mine"), copied(*paths)))
    assert command(["examples", "--copy", "casting_room", "--out", str(tmp_path)]) != 0
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {mine.name: "mine"}
