"""`taichi-plume NAME` is `python -m taichi_plume.NAME`, for every command."""

from pathlib import Path

import pytest

from taichi_plume import __main__ as commands
from taichi_plume import __version__

HERE = Path(commands.__file__).parent


@pytest.mark.parametrize("name", [name for name in commands.COMMANDS if name != "report"])
def test_each_command_tells_of_itself(name, capsys):
    with pytest.raises(SystemExit) as end:
        commands.main([name, "--help"])
    assert end.value.code == 0
    assert "usage:" in capsys.readouterr().out


def test_every_module_with_a_main_is_a_command():
    """But for what is run from within."""
    alone = {path.stem for path in HERE.glob("*.py") if 'if __name__ == "__main__"' in path.read_text()}
    inside = {path.parent.name for path in HERE.glob("*/__main__.py")}
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


def test_help_lists_all(capsys):
    for option, told in (("--help", list(commands.COMMANDS)), ("--version", [__version__])):
        with pytest.raises(SystemExit) as end:
            commands.main([option])
        assert end.value.code == 0
        out = capsys.readouterr().out
        assert all(one in out for one in told)
