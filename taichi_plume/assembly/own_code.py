"""Execution of own algorithms (Python files that a scenario names), only with the user's permission."""

import sys

from taichi_plume.assembly.preparation import Prepared
from taichi_plume.files.own_class import OwnAlgorithmError, OwnFile, Permission
from taichi_plume.guard.terminal import say
from taichi_plume.scenario.loading import ScenarioError

DIGITS = 16  # of a SHA-256 that are shown


def execute(prepared: Prepared, allow: Permission, ask: bool = False) -> None:
    """Execute the files of own algorithms and store their classes and the permission in the resources.

    ask: whether the user is asked at a terminal about files that `allow` does not permit. Raises ScenarioError without
    permission, or if a file holds no algorithm.
    """
    resources = prepared.resources
    files = {where: file for where, file in resources.code.items() if where not in resources.own}
    refused = [
        f"{where}.file: {_refusal(file, allow)}"
        for where, file in files.items()
        if not file.is_allowed(allow)
        and not (ask and has_permission(f"{where}.file: {file.path}", file.digest))
    ]
    if refused:
        raise ScenarioError(refused)
    faults = []
    for where, file in files.items():
        try:
            resources.own[where] = file.execute()
        except OwnAlgorithmError as error:
            faults.append(f"{where}.file: {error}")
    if faults:
        raise ScenarioError(faults)
    resources.allow_code = allow


def _refusal(file: OwnFile, allow: Permission) -> str:
    if allow:
        return (
            f"{file.path} is not the Python code that was allowed: its SHA-256 is {file.digest[:DIGITS]}... now; "
            "look at it, then allow it again"
        )
    return not_allowed(str(file.path))


def not_allowed(file: str) -> str:
    """Return the line about a Python file that the user has not allowed to be executed."""
    return (
        f"{file} holds Python code, which runs with all your rights; look at it, then add --allow-code "
        "(in Python: allow_code=True)"
    )


def question(where: str, digest: str) -> str:
    """Return what the user is asked about a Python file: its path after `where`, and its SHA-256."""
    return f"{where} holds Python code, which will run with all your rights (SHA-256 {digest[:DIGITS]}...)."


def has_permission(where: str, digest: str) -> bool:
    """Ask the user at the terminal whether a Python file may be executed; return False without a terminal."""
    if not (sys.stdin and sys.stdin.isatty() and sys.stderr.isatty()):
        return False
    say(question(where, digest), error=True)
    say("Run it? [y/N]", error=True, end=" ")
    return sys.stdin.readline().strip().lower() in ("y", "yes")
