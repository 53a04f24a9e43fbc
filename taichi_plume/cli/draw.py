"""``taichi-plume draw [scenario.yaml]`` opens a page in the browser on which a scenario is drawn, checked and run.

The page is served to this machine alone, under an address with a random token. Exit code 0: ended; 2: the scenario or
the command line is wrong, or the extra `draw` is missing.
"""

import argparse
import asyncio
import signal
import sys
import webbrowser
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from taichi_plume.cli.exit_codes import exit_code
from taichi_plume.cli.options import add, flag, option, whole_number
from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.terminal import Parser, say

if TYPE_CHECKING:
    from taichi_plume.draw.server import Service

NEEDED = ("bokeh",)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv` (without the program's name) and return its exit code."""
    args = _arguments(argv)
    return exit_code(lambda: _draw(args), debug=args.debug)


def _draw(args: argparse.Namespace) -> int:
    missing = [name for name in NEEDED if find_spec(name) is None]
    if missing:
        raise InputError(f"needs {', '.join(missing)}: pip install 'taichi_plume[draw]'")
    from taichi_plume.draw.workplace import Workplace
    from taichi_plume.files.bundled import file_or_example

    file = args.scenario
    if file is not None and file.suffix not in (".yaml", ".yml"):
        file = file_or_example(file)
    workplace = Workplace(Path.cwd(), file, args.allow_outside, args.allow_code)
    asyncio.run(_serve(args, workplace))
    return 0


async def _serve(args: argparse.Namespace, workplace) -> None:
    from taichi_plume.draw.server import Service

    service = Service(workplace, args.port, args.debug)
    ended = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        try:
            loop.add_signal_handler(number, lambda number=number: _asked(service, number, ended))
        except NotImplementedError:  # Windows: Ctrl-C raises KeyboardInterrupt
            break
    service.start()
    say(f"draw {workplace.file.name}: {service.address}", flush=True)
    say("Ctrl-C ends the command.", flush=True)
    if not args.no_browser:
        webbrowser.open(service.address)
    try:
        await ended.wait()
    finally:
        service.stop()
        workplace.keep_draft()
        for file in workplace.drafts.files:
            say(f"note: unsaved changes are kept in {file.name}", error=True)
        if workplace.drafts.fault:
            say(f"warning: {workplace.drafts.fault}; they are lost", error=True)


def _asked(service: "Service", number: int, ended: asyncio.Event) -> None:
    """End the command; if runs are alive and a user can answer, ask first whether they should go on."""
    alive = service.workplace.runs.alive
    if alive and number == signal.SIGINT and sys.stdin and sys.stdin.isatty():
        noun = "run is" if len(alive) == 1 else "runs are"
        say(
            f"{len(alive)} {noun} alive. [e]nd the page and let them go on, [s]top them too, [c]ontinue?",
            error=True,
            end=" ",
        )
        answer = sys.stdin.readline().strip().lower()
        if answer not in ("e", "s"):
            return
        if answer == "s":
            for run in alive:
                run.stop()
    elif alive:
        say(
            f"note: {len(alive)} runs go on; their files are in {service.workplace.root / 'runs'}", error=True
        )
    ended.set()


def _arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = Parser(
        prog="python -m taichi_plume.draw",
        description="Draw a scenario in the browser, see its YAML beside it, check and run it; on this machine alone.",
    )
    where = "YAML file, which need not exist yet (default: a new room.yaml)"
    parser.add_argument("scenario", type=Path, nargs="?", help=where)
    option(
        parser, "--port", whole_number(0, 65535), "PORT", "port of the page (default: a free one)", default=0
    )
    flag(parser, "--no-browser", "only print the address of the page")
    add(parser, "--allow-code", "--allow-outside", "--debug")
    return parser.parse_args(argv)
