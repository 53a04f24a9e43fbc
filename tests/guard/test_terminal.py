"""What is printed shows control characters and does not send them."""

import io
import sys

import pytest
from rich.progress import Progress
from rich.table import Table
from rich.text import Text

from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.terminal import LONGEST_LINE, Parser, say, terminal, visible

WICKED = "a\x1b]0;title\x07\r\x08\x9b31m\u202eb\u2066\u200f\ud800\u2028\x85c\0"


def harmless(text: str) -> bool:
    return all(one.isprintable() or one == "\n" for one in text)


def test_every_character_prints_as_itself_or_as_its_escape():
    assert visible("Lüftung 5 µm² 室 'x'") == "Lüftung 5 µm² 室 'x'"
    assert visible(WICKED) == (r"a\x1b]0;title\x07\r\x08\x9b31m\u202eb\u2066\u200f\ud800\u2028\x85c\x00")
    for code in range(0x11000):
        assert harmless(visible(chr(code)))
    assert "\n" not in visible("a\nb")


def test_long_lines_lose_their_middle():
    path = "/" + "a" * 5000 + ": cannot be read: File name too long"
    reported = visible(path)
    assert len(reported) <= LONGEST_LINE
    assert reported.startswith("/aaa")
    assert reported.endswith(": cannot be read: File name too long")
    assert len(visible("\x1b" * 5000)) <= LONGEST_LINE
    assert visible("b" * 5000, None) == "b" * 5000


def test_say(capsys):
    say("one\ntwo", WICKED)
    say(WICKED, error=True, end="")
    say()
    reported = capsys.readouterr()
    assert reported.out == f"one\\ntwo\n{visible(WICKED)}\n"
    assert reported.err == visible(WICKED)


def test_input_errors_escape_each_line():
    error = InputError(WICKED, "b" * 5000)
    assert error.lines == [visible(WICKED), visible("b" * 5000)]
    assert str(error) == "\n".join(error.lines)


def test_say_where_the_terminal_knows_few_letters(monkeypatch):
    stream = io.TextIOWrapper(io.BytesIO(), encoding="ascii")
    monkeypatch.setattr(sys, "stdout", stream)
    say("5 m²")
    stream.flush()
    assert stream.buffer.getvalue() == b"5 m\\xb2\n"  # type: ignore[attr-defined]


@pytest.mark.parametrize("coloured", [False, True])
def test_the_console_sends_its_own_codes_alone(monkeypatch, coloured):
    stream = io.StringIO()
    monkeypatch.setattr(sys, "stdout", stream)
    one = terminal(force_terminal=coloured)
    table = Table(show_header=False, box=None)
    table.add_row(WICKED, Text(WICKED, "bold"))
    one.print(table)
    one.print(f"[/x] {WICKED}", style="bold")
    with Progress(console=one) as bar:
        bar.add_task(WICKED, total=1)
        bar.refresh()
    reported = stream.getvalue()
    assert "[/x]" in reported
    assert ("\x1b[1m" in reported) == coloured
    assert not {"\x07", "\x08", "\x9b", "\u202e", "\u2066", "\ud800", "\x1b]"} & set(reported)
    assert "]0;title" in reported
    assert "\x1b]" not in reported


def test_the_command_line_is_printed_visibly(capsys):
    parser = Parser(prog="p")
    parser.add_argument("--n", type=int)
    with pytest.raises(SystemExit) as ended:
        parser.parse_args(["--n", WICKED])
    assert ended.value.code == 2
    assert harmless(capsys.readouterr().err)


def test_what_has_no_text_is_shown_by_its_type():
    assert "int" in visible(10**5000)
