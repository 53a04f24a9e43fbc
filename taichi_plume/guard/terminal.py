"""Printing to the terminal; control characters in files, names and messages are escaped."""

import argparse
import difflib
import re
import sys
from contextlib import nullcontext, suppress
from typing import TYPE_CHECKING, Any, NoReturn

if TYPE_CHECKING:
    from rich.console import Console, RenderableType

LONGEST_LINE = 1000  # characters of a message
LONGEST_VALUE = 100  # characters of a name or value within one
_KEPT_AT_END = 300  # characters, of messages that begin with a long path


def visible(text: object, longest: int | None = LONGEST_LINE) -> str:
    """Return a text in one line; control characters, line ends, direction marks and surrogates are escaped.

    longest: limit of characters, beyond which the middle is left out; None: no limit.
    """
    try:
        line = str(text)
    except Exception:  # thousands of digits have no text; the __str__ of a class may raise anything
        line = f"a value of type {type(text).__name__}"
    if longest is not None:
        line = _cut(line, longest)  # first: escaping gigabytes would take long
    if not line.isprintable():
        line = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in line)
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
    """Print lines, escaped and cut to `longest` characters as by `visible`, to stdout or, if `error`, to stderr.

    A line feed within a line is escaped as well. end: text printed after each line.
    """
    _write("".join(visible(line, longest) + end for line in lines), error, flush)


def _write(text: str, error: bool = False, flush: bool = False) -> None:
    stream = sys.stderr if error else sys.stdout
    encoding = getattr(stream, "encoding", None) or "utf-8"  # a stream of the caller may have none
    with suppress(OSError) if error else nullcontext():  # a closed stream does not end the run
        print(
            text.encode(encoding, "backslashreplace").decode(encoding),
            file=stream,
            end="",
            flush=flush or error,
        )


def show(*parts: "RenderableType", soft_wrap: bool = False) -> None:
    """Print rich renderables, such as tables, to stdout. A closed pipe raises an error instead of ending Python."""
    console = terminal()
    with console.capture() as text:
        for part in parts:
            console.print(part, soft_wrap=soft_wrap)
    _write(text.get())


def terminal(error: bool = False, **options: Any) -> "Console":
    """Return a rich console without markup on stdout or stderr (`error`) that escapes control characters."""
    from rich.console import Console, ConsoleOptions, RenderableType
    from rich.segment import Segment

    class Visible(Console):
        """Console that prints no control codes except rich's own for colours and the cursor."""

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


def notebook_display() -> Any:
    """Return the module IPython.display if a notebook's kernel runs this code, else None."""
    if "IPython" not in sys.modules:
        return None
    import IPython

    kernel = getattr(IPython.get_ipython(), "kernel", None)
    return None if kernel is None else IPython.display


class Parser(argparse.ArgumentParser):
    """Command-line argument parser whose errors are one escaped line."""

    def error(self, message: str) -> NoReturn:
        """Print an escaped error on the command line's arguments and exit with 2."""
        self.exit(2, visible(f"{self.prog}: error: {message}; see --help") + "\n")

    def parse_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse the command line; an unknown option is an error that names the most similar option."""
        found, unknown = self.parse_known_args(args, namespace)
        if unknown:
            names = [name for action in self._actions for name in action.option_strings if name[:2] == "--"]
            close = difflib.get_close_matches(unknown[0].partition("=")[0], names, n=1)
            meant = f"did you mean '{close[0]}'? " if close else ""
            self.error(
                f"unexpected '{visible(unknown[0], LONGEST_VALUE)}'; {meant}options: {', '.join(names)}"
            )
        return found
