"""``python -m taichi_plume examples`` lists the examples of the package, runs one by its name, or copies one.

``NAME --duration 10`` passes the options after the name to the command that runs this kind of example: `run`, `serve`
or `study`. ``--copy NAME`` copies an example with its input files. Exit codes are those of these commands; 2 for an
unknown name, for an example that is not run by a command, and for a copy that would overwrite a file.
"""

import shutil
import sys
import textwrap
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Annotated, NamedTuple

from taichi_plume.cli.exit_codes import exit_code
from taichi_plume.cli.options import parser_of
from taichi_plume.execution.signals import reader_may_leave
from taichi_plume.files.bundled import Example, copied, example, names
from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.terminal import say

WIDTH = 120  # columns where the output is no terminal


class Kind(NamedTuple):
    """Kind of examples. use: how to use a file of this kind; command: module of the command, if one runs the kind."""

    heading: str
    use: str
    command: str = ""


KINDS = {
    "scenario": Kind("scenarios, with the time of a run on a laptop", "python -m taichi_plume.run {}", "run"),
    "live": Kind("scenarios in real time, with external robots", "python -m taichi_plume.serve {}", "serve"),
    "study": Kind("studies", "python -m taichi_plume.study {}", "study"),
    "task": Kind("learning tasks", 'gymnasium.make("taichi_plume/Search-v0", scenario="{}")'),
    "program": Kind("programs", "python {}"),
    "launch": Kind("launch files of ROS 2, with a layout of Foxglove", "ros2 launch {}"),
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv` (without the program's name) and return its exit code."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    if arguments and not arguments[0].startswith("-"):
        return exit_code(lambda: _run(*arguments))
    epilog = (
        "NAME [OPTIONS]: run an example; OPTIONS, such as --duration 10, are those of run, serve or study"
    )
    usage = "%(prog)s [NAME [OPTIONS] | --copy NAME [--out DIR]]"
    parser = parser_of("examples", examples, usage=usage, epilog=epilog)
    given = vars(parser.parse_args(arguments))
    debug = given.pop("debug")
    if "out" in given and "copy" not in given:
        parser.error("--out goes with --copy")
    return exit_code(lambda: examples(**given), debug=debug, out=given.get("out"))


def examples(*, copy: Annotated[str | None, "NAME"] = None, out: Annotated[Path, "DIR"] = Path()) -> int:
    """List the examples that travel with the package, run one by its name, or copy one.

    copy: copy an example and its input files; no file is overwritten. out: folder of the copies, by default the working
    folder.
    """
    return _list() if copy is None else _copy(example(copy), out)


def _list() -> int:
    """Print a line for each example: name, time of a run and story; return the exit code."""
    entries = [example(name) for name in names()]
    wide = shutil.get_terminal_size((WIDTH, 24)).columns if sys.stdout.isatty() else WIDTH
    longest = max(len(entry.name) for entry in entries)
    with reader_may_leave():
        for name, kind in KINDS.items():
            say(f"{kind.heading}:")
            for entry in entries:
                if entry.kind == name:
                    start = f"  {entry.name:<{longest}} {entry.time:>6}  "
                    say(start + textwrap.shorten(entry.story, max(wide - len(start), 20), placeholder=" ..."))
        say(
            "python -m taichi_plume examples NAME runs a scenario or study; --copy NAME copies any of these files"
        )
    return 0


def _run(name: str, *options: str) -> int:
    """Run an example by the command for its kind; return the exit code."""
    found = example(name)
    kind = KINDS[found.kind]
    if not kind.command:
        raise InputError(f"{name}: no command runs this kind of example; use {kind.use.format(found.path)}")
    return import_module(f"taichi_plume.cli.{kind.command}").main([str(found.path), *options])


def _copy(chosen: Example, out: Path) -> int:
    base = None
    if chosen.kind == "study":
        from taichi_plume.studies.plan import read_study

        base = chosen.path.parent / read_study(chosen.path).base
    copies = copied(chosen, out, base)
    for path, is_new in copies.items():
        say(f"{path}: {'copied' if is_new else 'unchanged'}")
    say(f"use: {KINDS[chosen.kind].use.format(next(iter(copies)))}")
    return 0
