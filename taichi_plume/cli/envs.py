"""``taichi-plume envs TASK.yaml --out bank.zarr`` records the flow realisations (airs) that learners meet.

Exit code 0: done; 1: stopped by an error, nothing is kept; 2: the scenario or the command line is wrong, or there is no
such device; 130: interrupted.
"""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from taichi_plume.cli.exit_codes import exit_code
from taichi_plume.cli.options import parser_of
from taichi_plume.engine.choice import Arch
from taichi_plume.guard.terminal import say


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv` (without the program's name) and return its exit code."""
    given = vars(parser_of("envs", record).parse_args(argv))
    debug = given.pop("debug")
    return exit_code(lambda: record(**given), "interrupted: no bank was written", debug, given.get("out"))


def record(
    task: Path,
    *,
    out: Annotated[Path | None, "BANK.zarr"] = None,
    arch: Arch = "cpu",
    overrides: Annotated[Sequence[str], "--set PATH=VALUE ..."] = (),
    progress: bool = True,
    allow_outside: bool = False,
) -> int:
    """Record the airs of a scenario's task, so that environments need not solve for them.

    task: YAML file of a scenario; its section `task` sets the films. out: file to write, by default NAME_bank.zarr.
    arch: where to compute; auto takes a GPU if there is one. overrides: change any key, such as robots.0.count=3; may
    be repeated. allow_outside: read files that lie outside the scenario's folder.
    """
    from taichi_plume.assembly.preparation import load

    prepared = load(task, overrides, allow_outside)
    from taichi_plume.engine import program
    from taichi_plume.envs import bank
    from taichi_plume.files.disk import require_room

    out, folder = out or Path(f"{prepared.scenario.name}_bank.zarr"), task.resolve().parent
    _, films = bank.check(prepared.scenario)
    for warning in bank.warnings(prepared.scenario, folder, True) if progress else ():
        say(f"note: {warning}", error=True)
    if os.path.lexists(out):
        bank.require_bank(out)
    out.parent.mkdir(parents=True, exist_ok=True)
    require_room(out.parent / out.name)
    if progress:
        say(f"{films}, at most as much on disk", error=True)
    program.start(arch)
    recorded = bank.record(prepared.scenario, folder, True, _print_progress if progress else None)
    recorded.write(out)
    if progress:
        disk = sum(file.stat().st_size for file in out.rglob("*") if file.is_file())
        say(f"{out}: {films}, {disk / 1e6:.3g} MB on disk")
    return 0


def _print_progress(done: int, films: int) -> None:
    if done < films:
        say(f"film {done + 1} of {films} ...", error=True)
