"""``taichi-plume draw [scenario.yaml]`` opens a page in the browser on which a scenario is drawn, checked and run.

The page is served to this machine alone, under an address with a random token. Exit code 0: ended; 2: the scenario or
the command line is wrong, or the extra `draw` is missing.
"""

import asyncio
import os
import signal
import sys
import webbrowser
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from taichi_plume.cli.exit_codes import exit_code
from taichi_plume.cli.options import parser_of, port_number
from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.terminal import say

if TYPE_CHECKING:
    from taichi_plume.draw.server import Service
    from taichi_plume.draw.workplace import Workplace

NEEDED = ("bokeh",)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv` (without the program's name) and return its exit code."""
    given = vars(parser_of("draw", draw).parse_args(argv))
    return exit_code(lambda: draw(**given), debug=given["debug"])


def draw(
    scenario: Path | None = None,
    *,
    port: Annotated[int, "PORT", port_number] = 0,
    browser: bool = True,
    allow_code: bool = False,
    allow_outside: bool = False,
    **debug: bool,
) -> int:
    """Draw a scenario in the browser, see its YAML beside it, check and run it; on this machine alone.

    scenario: YAML file, which need not exist yet, or an example, of which a copy in the working folder is drawn; by
    default a new room.yaml. port: port of the page; 0: a free one.
    browser: open the browser; the command prints the address in any case. allow_code: execute Python files that the
    scenario names (kind: own). allow_outside: read files that lie outside the scenario's folder.
    """
    missing = [name for name in NEEDED if find_spec(name) is None]
    if missing:
        raise InputError(f"needs {', '.join(missing)}: pip install 'taichi_plume[draw]'")
    from taichi_plume.draw.workplace import Workplace

    named = (
        scenario is not None and scenario.suffix not in (".yaml", ".yml") and not os.path.lexists(scenario)
    )
    workplace = Workplace(Path.cwd(), None if named else scenario, allow_outside, allow_code)
    if named:
        workplace.example(str(scenario))
    asyncio.run(_serve(workplace, port, debug["debug"], browser))
    return 0


async def _serve(workplace: "Workplace", port: int, debug: bool, browser: bool) -> None:
    from taichi_plume.draw.server import Service

    service = Service(workplace, port, debug)  # takes the event loop that runs
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
    if browser:
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
    alive = [run for run in service.workplace.runs if run.alive]
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
