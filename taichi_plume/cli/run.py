"""``taichi-plume run scenario.yaml`` runs a scenario into a run directory, as `simulate` does.

Exit code 0: done; 1: stopped by an error, the files written so far are kept; 2: the scenario or the command line is
wrong, or there is no such device; 130: interrupted. Heavy imports wait until the scenario has been checked.
"""

import gc
import sys
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from taichi_plume.api.simulate import simulate
from taichi_plume.cli.exit_codes import exit_code
from taichi_plume.cli.options import parser_of
from taichi_plume.execution.signals import reader_may_leave
from taichi_plume.guard.terminal import say

if TYPE_CHECKING:
    from taichi_plume.execution.execute import Outcome

FIXED = ("scenario", "out", "seed", "duration", "overrides", "check", "force", "watch", "recording")
"""Arguments that a run keeps when it is resumed."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv` (without the program's name) and return its exit code."""
    parser = parser_of("run", run, simulate)
    given = {name: value for name, value in vars(parser.parse_args(argv)).items() if value is not None}
    if "resume" not in given and "scenario" not in given:
        parser.error("the following arguments are required: scenario")
    if "live" in given and "recording" in given:
        parser.error("--live shows the recording; it cannot go with --no-recording")
    if "all" in given and "check" not in given:
        parser.error("--all goes with --check")
    fixed = [name for name in FIXED if name in given]
    if "resume" in given and fixed:
        option = {"overrides": "--set", "recording": "--no-recording"}.get(fixed[0], f"--{fixed[0]}")
        what = option if fixed[0] != "scenario" else given["scenario"]
        parser.error(f"--resume continues the run unchanged; it cannot go with {what}")
    debug = given.pop("debug")
    gc.disable()  # until the run begins: garbage collection makes a start 7 % slower
    try:
        return exit_code(
            lambda: run(**given, debug=debug), "interrupted before the run began", debug, given.get("out")
        )
    finally:
        gc.enable()


def run(
    scenario: Path | None = None,
    *,
    check: bool = False,
    all: bool = False,
    resume: Annotated[Path | None, "RUN"] = None,
    **options: Any,
) -> int:
    """Run a scenario: air flow, gas, robots, maps. The results go to a folder.

    scenario: YAML file. check: only check: print the scenario, derived quantities, unlikely settings and the size, and
    draw the scene. all: with --check: print all keys, with their defaults and meanings. resume: resume an interrupted
    run from its checkpoint. Other options are those of `simulate`.
    """
    quiet, debug = options.get("progress") is False, options.pop("debug")
    digests = [text.lower() for text in options.pop("allow_sha256", ())]
    options["allow_code"] = options.get("allow_code") or digests
    if resume is not None:
        from taichi_plume.execution.execute import resumed

        return carry_out(lambda: resumed(resume, **options), quiet, debug)
    from taichi_plume.assembly.preparation import load

    assert scenario is not None, "main requires a scenario unless --resume is given"
    prepared = load(scenario, overrides_of(options), options.pop("allow_outside", False))
    at_the_end = check and sys.stdout.isatty()  # after the output, where notes would scroll away
    for warning in () if quiet or at_the_end else prepared.resources.warnings:
        say(f"note: {warning}", error=True)
    if check:
        from taichi_plume.cli.check import print_check

        with reader_may_leave():
            print_check(prepared, options.get("out"), all)
        return 0
    from taichi_plume.execution.execute import new_run

    return carry_out(lambda: new_run(prepared, **options, ask=True), quiet, debug)


def overrides_of(options: dict[str, Any]) -> list[str]:
    """Remove ``--set``, ``--seed`` and ``--duration`` from the options and return them as changes of keys."""
    values = {key: options.pop(key) for key in ("seed", "duration") if key in options}
    return [*options.pop("overrides", ()), *(f"{key}={value}" for key, value in values.items())]


def carry_out(run: "Callable[[], Outcome]", quiet: bool, debug: bool) -> int:
    """Execute a run, print its summary or how it ended, and return the exit code."""
    from taichi_plume.execution.execute import RunError
    from taichi_plume.execution.summary import print_summary

    try:
        folder, result = run()
    except RunError as error:
        if debug and error.__cause__ is not None:
            say(*"".join(traceback.format_exception(error.__cause__)).splitlines(), error=True)
        say(*error.lines, error=True, longest=None)
        return error.code
    if not quiet:
        with reader_may_leave():
            print_summary(result, folder)
    return 0
