"""Every command: its help, its errors in one line, its exit codes."""

import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from scripts import refusal, refused

import taichi_plume
from taichi_plume import __main__ as commands
from taichi_plume import __version__
from taichi_plume.cli.exit_codes import exit_code
from taichi_plume.files.film import FilmError
from taichi_plume.files.readings import ReadingsError
from taichi_plume.files.run_folder import RunFolderError
from taichi_plume.guard.input_error import InputError
from taichi_plume.scenario.loading import ScenarioError
from taichi_plume.serve.links import LinkError
from taichi_plume.time_loop import UnstableError

HERE = Path(commands.__file__).parent
FOLDERS = [Path(folder) for folder in taichi_plume.__path__]  # in a checkout also the one above


@pytest.mark.parametrize("name", commands.COMMANDS)
def test_each_command_tells_of_itself(name, capsys):
    with pytest.raises(SystemExit) as end:
        commands.main([name, "--help"])
    assert end.value.code == 0
    assert "usage:" in capsys.readouterr().out


def test_every_module_with_a_main_is_a_command():
    alone = {path.stem for path in HERE.glob("*.py") if 'if __name__ == "__main__"' in path.read_text()}
    inside = {path.parent.name for folder in FOLDERS for path in folder.glob("*/__main__.py")} - {HERE.name}
    assert alone - {"__main__"} | inside <= set(commands.COMMANDS)


@pytest.mark.parametrize("line", [[], ["fly"], ["casting_room.yaml"], ["\x1b[2J"]])
def test_what_is_no_command_is_reported(line, capsys):
    with pytest.raises(SystemExit) as end:
        commands.main(line)
    assert end.value.code == 2
    reported = capsys.readouterr().err
    assert "taichi-plume: error:" in reported
    assert "\x1b" not in reported


WRONG = {
    "examples": ["{}"], "draw": ["{}"],
    "run": ["{}"], "serve": ["{}"], "report": ["{}"], "picture": ["{}"], "export": ["{}", "--to", "csv"],
    "maps": ["{}", "--size", "1", "1", "--out", "out"], "repair": ["{}"], "scenario": ["--explain", "{}"],
    "study": ["{}"], "contest": ["--entry", "{}"], "envs": ["{}"], "statistics": ["{}"], "validation": ["{}"],
}  # fmt: skip
"""Command lines that name something that does not exist."""
WICKED = "a\x1b]0;x\x07\nb\u202e"


@pytest.mark.parametrize("name", commands.COMMANDS)
def test_input_that_does_not_exist_is_one_line_and_exit_code_2(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    reported = refusal(capsys, name, *(part.format(WICKED) for part in WRONG[name]))
    assert r"a\x1b]0;x\x07\nb\u202e" in reported
    assert reported[:-1].isprintable()
    assert not list(tmp_path.iterdir())


NO_RUN = "report .;picture .;export . --to csv;repair .;repair . --verify;statistics .;study report ."


@pytest.mark.parametrize("line", NO_RUN.split(";"))
def test_a_folder_of_no_run_is_one_line_and_exit_code_2(line, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert refusal(capsys, *line.split()).startswith(".: ")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", commands.COMMANDS)
def test_every_command_ends_by_the_one_table_of_exit_codes(name, monkeypatch):
    module = "cli.options" if name in commands.CALLS else commands.MODULES.get(name, f"cli.{name}")
    monkeypatch.setattr(f"taichi_plume.{module}.exit_code", lambda *_, **__: 77)
    assert commands.main([name, *WRONG[name]]) == 77


@pytest.mark.parametrize(
    ("error", "code", "lines"),
    [
        (InputError("a\nb", "c"), 2, [r"a\nb", "c"]),
        (ScenarioError([f"{n}" for n in range(25)]), 2, [*(f"{n}" for n in range(20)), "... and 5 more"]),
        *((kind("f: no"), 2, ["f: no"]) for kind in (RunFolderError, FilmError, ReadingsError, LinkError)),
        (KeyboardInterrupt(), 130, ["stopped"]),
        (OSError(28, "full", "f\x1b"), 1, [r"f\x1b: full"]),
        (OSError(28, "full", "part", None, "f"), 1, ["f: full"]),
        (OSError(28, "full"), 1, ["out: full"]),
        (OSError("of a library"), 1, ["out: of a library"]),
        (UnstableError("u > 9 m/s"), 1, ["u > 9 m/s"]),
    ],
)
def test_exit_codes(error, code, lines, capsys):
    def work():
        raise error

    assert exit_code(work, "stopped", debug=False, out=Path("out")) == code
    assert capsys.readouterr().err.splitlines() == lines


def test_an_unexpected_error_is_one_line_or_with_debug_a_traceback(capsys):
    def work():
        raise TypeError("a\nb")

    assert exit_code(work, debug=False) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert "TypeError" in line
    assert exit_code(work, debug=True) == 1
    assert capsys.readouterr().err.startswith("Traceback")
    with pytest.raises(TypeError):
        exit_code(work)


@pytest.mark.parametrize(
    "line",
    [
        "export . --to mcap --trial -1", "export . --to mcap --begin nan", "export . --to mcap --begin -1",
        "export . --to mcap --points 0", "export . --to mcap --least inf", "picture . --at inf", "picture . --fps 51",
        "picture . --width 199", "picture . --frames 0", "maps . --out a --trial -1", "serve . --websocket 65536",
        "study . --workers 0", "study . --workers many", "contest --airs 0", "contest --seed -1",
        "validation --trials 0", "statistics . --threshold 0", "statistics . --threshold nan",
        "statistics . --from inf",
        "statistics . --from 2_s", "statistics . --range 3 1", "statistics . --range 1",
    ],
)  # fmt: skip
def test_numbers_out_of_their_range_are_refused(line, capsys):
    assert refused(*line.split()) == 2
    option = next(part for part in reversed(line.split()) if part.startswith("--"))
    assert option.lstrip("-") in capsys.readouterr().err.splitlines()[-1]


def test_help_lists_all(capsys):
    for option, reported in (("--help", list(commands.COMMANDS)), ("--version", [__version__])):
        with pytest.raises(SystemExit) as end:
            commands.main([option])
        assert end.value.code == 0
        out = capsys.readouterr().out
        assert all(one in out for one in reported)


def at_a_shell(script, folder):
    """Exit code and standard error of a shell's script, in which $python runs this Python."""
    done = subprocess.run(
        ["sh", "-c", script.replace("$python", shlex.quote(sys.executable))],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(HERE.parent)},
    )
    return done.returncode, done.stderr


@pytest.mark.skipif(os.name != "posix", reason="a shell of POSIX")
@pytest.mark.parametrize("command", [" run s.yaml --check", ".scenario --explain gas", ".report none"])
def test_a_working_folder_that_was_deleted_is_reported_in_a_line(command, tmp_path):
    script = f'mkdir gone && cd gone && rmdir "$PWD" && $python -m taichi_plume{command}'
    code, reported = at_a_shell(script, tmp_path)
    assert code == 2
    assert reported.count("\n") == 1
    assert "folder" in reported


@pytest.mark.skipif(os.name != "posix", reason="a shell of POSIX")
@pytest.mark.parametrize("closed", ["<&-", ">&-", "<&- >&-"])
def test_a_stream_that_is_closed_goes_nowhere_and_no_file_takes_its_number(closed, tmp_path):
    look = "import sys, taichi_plume; f = open('f', 'w'); print(f.fileno(), file=sys.stderr); print('out'); input"
    code, reported = at_a_shell(f'$python -c "{look}" {closed}', tmp_path)
    assert (code, int(reported) > 2) == (0, True), reported


@pytest.mark.skipif(os.name != "posix", reason="a shell of POSIX")
def test_a_check_with_nowhere_to_print_ends_well(tmp_path):
    (tmp_path / "s.yaml").write_text(
        "{duration: 1, domain: {size: [1, 1], spacing: 0.1}, wind: {kind: uniform, velocity: [0.3, 0]},"
        " gas: {kind: eulerian, sources: [{position: [0.2, 0.4], rate: 1.0e-6}]}}"
    )
    for closed in (">&-", "2>&-", ">&- 2>&-"):
        code, reported = at_a_shell(f"$python -m taichi_plume.run s.yaml --check {closed}", tmp_path)
        assert (code, "Traceback" in reported) == (0, False), reported
