"""`taichi-plume NAME` is `python -m taichi_plume.NAME`, for every command."""

import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

import taichi_plume
from taichi_plume import __main__ as commands
from taichi_plume import __version__

HERE = Path(commands.__file__).parent
FOLDERS = [Path(folder) for folder in taichi_plume.__path__]  # in a checkout also the one above


@pytest.mark.parametrize("name", commands.COMMANDS)
def test_each_command_tells_of_itself(name, capsys):
    with pytest.raises(SystemExit) as end:
        commands.main([name, "--help"])
    assert end.value.code == 0
    assert "usage:" in capsys.readouterr().out


def test_every_module_with_a_main_is_a_command():
    """But for what is run from within."""
    alone = {path.stem for path in HERE.glob("*.py") if 'if __name__ == "__main__"' in path.read_text()}
    inside = {path.parent.name for folder in FOLDERS for path in folder.glob("*/__main__.py")}
    inside -= {HERE.name}
    assert alone - {"__main__"} | inside == set(commands.COMMANDS) - (
        set() if "report" in inside else {"report"}
    )


@pytest.mark.parametrize("line", [[], ["fly"], ["casting_room.yaml"], ["\x1b[2J"]])
def test_what_is_no_command_is_told(line, capsys):
    with pytest.raises(SystemExit) as end:
        commands.main(line)
    assert end.value.code == 2
    told = capsys.readouterr().err
    assert "taichi-plume: error:" in told
    assert "\x1b" not in told


def test_options_go_to_the_command(tmp_path, capsys):
    assert commands.main(["repair", str(tmp_path / "nowhere")]) == 2
    assert "nowhere: is no folder" in capsys.readouterr().err
    assert commands.main(["export", str(tmp_path), "--to", "csv"]) == 2
    assert "is not the folder of a run" in capsys.readouterr().err


def test_public_names_are_few_and_there():
    assert len(taichi_plume.__all__) <= 10
    assert all(getattr(taichi_plume, name) for name in taichi_plume.__all__)


def test_help_lists_all(capsys):
    for option, told in (("--help", list(commands.COMMANDS)), ("--version", [__version__])):
        with pytest.raises(SystemExit) as end:
            commands.main([option])
        assert end.value.code == 0
        out = capsys.readouterr().out
        assert all(one in out for one in told)


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
@pytest.mark.parametrize("command", ["run s.yaml --check", "scenario --explain gas", "report none"])
def test_a_working_folder_that_was_deleted_is_told_in_a_line(command, tmp_path):
    for name in (f"-m taichi_plume {command}", f"-m taichi_plume.{command}"):
        code, told = at_a_shell(f'mkdir gone && cd gone && rmdir "$PWD" && $python {name}', tmp_path)
        assert code == 2
        assert told.count("\n") == 1
        assert "folder" in told


@pytest.mark.skipif(os.name != "posix", reason="a shell of POSIX")
@pytest.mark.parametrize("closed", ["<&-", ">&-", "<&- >&-"])
def test_a_stream_that_is_closed_goes_nowhere_and_no_file_takes_its_number(closed, tmp_path):
    look = "import sys, taichi_plume; f = open('f', 'w'); print(f.fileno(), file=sys.stderr); print('out'); input"
    code, told = at_a_shell(f'$python -c "{look}" {closed}', tmp_path)
    assert (code, int(told) > 2) == (0, True), told


@pytest.mark.skipif(os.name != "posix", reason="a shell of POSIX")
def test_a_check_with_nowhere_to_print_ends_well(tmp_path):
    (tmp_path / "s.yaml").write_text(
        "{duration: 1, domain: {size: [1, 1], spacing: 0.1}, wind: {kind: uniform, velocity: [0.3, 0]},"
        " gas: {kind: eulerian, sources: [{position: [0.2, 0.4], rate: 1.0e-6}]}}"
    )
    for closed in (">&-", "2>&-", ">&- 2>&-"):
        code, told = at_a_shell(f"$python -m taichi_plume.run s.yaml --check {closed}", tmp_path)
        assert (code, "Traceback" in told) == (0, False), told
