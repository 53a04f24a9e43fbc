"""All that our commands print: no character of a file, name or message gets to command a terminal."""

import argparse
import re
import sys
from contextlib import nullcontext, suppress
from typing import TYPE_CHECKING, Any, NoReturn

if TYPE_CHECKING:
    from rich.console import Console, RenderableType

LONGEST_LINE = 1000  # characters of a message
LONGEST_VALUE = 100  # characters of a name or value within one
_KEPT_AT_END = 300  # characters: where a message begins with a long path, they say what is wrong


def visible(text: object, longest: int | None = LONGEST_LINE) -> str:
    """One line of a text: what does not print (controls, line ends, marks of direction, surrogates) as its escape.

    longest: characters; of more, some are left out from the middle; None: all are shown.
    """
    line = str(text)
    if longest is not None:
        line = _cut(line, longest)  # first: escaping gigabytes would take long
    if not line.isprintable():
        line = "".join(one if one.isprintable() else one.encode("unicode_escape").decode() for one in line)
    return line if longest is None else _cut(line, longest)


def _cut(line: str, longest: int) -> str:
    if len(line) <= longest:
        return line
    end = min(_KEPT_AT_END, longest // 3)
    return f"{line[: longest - end - 5]} ... {line[len(line) - end :]}"


def say(
    *lines: object,
    error: bool = False,
    longest: int | None = LONGEST_LINE,
    end: str = "\n",
    flush: bool = False,
) -> None:
    """Print lines, escaped and cut to `longest` as by `visible`, to stdout or, of an `error`, to stderr.

    A line feed within a line is escaped as well: no name or value of a file begins a line. end: of each line.
    """
    _write("".join(visible(line, longest) + end for line in lines), error, flush)


def _write(text: str, error: bool = False, flush: bool = False) -> None:
    stream = sys.stderr if error else sys.stdout
    encoding = getattr(stream, "encoding", None) or "utf-8"
    with suppress(OSError) if error else nullcontext():  # a message that nobody reads ends no run
        print(
            text.encode(encoding, "backslashreplace").decode(encoding),
            file=stream,
            end="",
            flush=flush or error,
        )


def show(*parts: "RenderableType", soft_wrap: bool = False) -> None:
    """Print parts of rich's, such as tables, to stdout; where its reader is gone, rich itself would end the program."""
    one = terminal()
    with one.capture() as text:
        for part in parts:
            one.print(part, soft_wrap=soft_wrap)
    _write(text.get())


def terminal(error: bool = False, **options: Any) -> "Console":
    """A rich console on stdout or, for `error`, on stderr, that prints as `say` and knows no markup."""
    from rich.console import Console, ConsoleOptions, RenderableType
    from rich.segment import Segment

    class Visible(Console):
        """Its own codes for colours and the cursor are the only ones that it sends."""

        def render(self, renderable: RenderableType, options: ConsoleOptions | None = None):
            for segment in super().render(renderable, options):
                text = segment.text
                # a lone \r is an `end` of ours: rich leaves it out of texts
                if segment.control or text.isprintable() or text in ("\n", "\r"):
                    yield segment
                else:
                    parts = re.split("(\n)", text)
                    clean = "".join(part if part == "\n" else visible(part, None) for part in parts)
                    yield Segment(clean, segment.style)

    return Visible(stderr=error, markup=False, highlight=False, **options)


class Parser(argparse.ArgumentParser):
    """One whose messages show no characters that command a terminal."""

    def error(self, message: str) -> NoReturn:
        """Say what is wrong with the command line and exit with 2."""
        super().error(visible(message))
