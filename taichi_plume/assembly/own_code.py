"""Code that a scenario names is executed here, and only where the user wants it."""

import sys
from collections.abc import Collection

from taichi_plume.assembly.prepare import Prepared
from taichi_plume.files.own_class import OwnAlgorithmError
from taichi_plume.guard.terminal import say
from taichi_plume.scenario.loading import ScenarioError

DIGITS = 16  # of a SHA-256 that are shown


def execute(prepared: Prepared, allow: bool, ask: bool = False, without: Collection[str] = ()) -> None:
    """Execute the files of own algorithms: their classes are among the resources then.

    allow: whether that is wanted; ask: or may be asked for at a terminal. without: names of groups whose classes were
    handed over. Raises ScenarioError where it is not wanted, or where a file holds no algorithm.
    """
    files = {}
    for n, group in enumerate(prepared.scenario.robots):
        where = f"robots[{n}].algorithm"
        if where in prepared.resources.code and group.name not in without:
            files[where] = prepared.resources.code[where]
    refused = [
        f"{where}.file: {file.path} holds Python code, which runs with all your rights; look at it, then add "
        "--allow-code (in Python: allow_code=True)"
        for where, file in files.items()
        if not allow and not (ask and wanted(f"{where}.file: {file.path}", file.digest))
    ]
    if refused:
        raise ScenarioError(refused)
    faults = []
    for where, file in files.items():
        try:
            prepared.resources.own[where] = file.execute()
        except OwnAlgorithmError as error:
            faults.append(f"{where}.file: {error}")
    if faults:
        raise ScenarioError(faults)


def wanted(where: str, digest: str) -> bool:
    """What the user answers; no where nobody is at a terminal."""
    if not (sys.stdin and sys.stdin.isatty() and sys.stderr.isatty()):
        return False
    say(
        f"{where} holds Python code, which will run with all your rights (SHA-256 {digest[:DIGITS]}...).",
        error=True,
    )
    say("Run it? [y/N]", error=True, end=" ")
    return sys.stdin.readline().strip().lower() in ("y", "yes")
