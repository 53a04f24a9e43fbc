"""Options that several commands share, and the types of options that take numbers."""

from argparse import ArgumentTypeError, _ActionsContainer
from collections.abc import Callable
from math import inf
from pathlib import Path
from typing import Any

ARCHS = ("auto", "cpu", "cuda", "vulkan", "metal")
_FLAG: dict[str, Any] = {"action": "store_true"}
OPTIONS: dict[str, dict[str, Any]] = {
    "run": {"type": Path, "metavar": "RUN", "help": "the run's folder"},
    "--out": {"type": Path, "metavar": "DIR", "help": "run directory (default: runs/NAME-N)"},
    "--arch": {
        "choices": ARCHS,
        "default": "cpu",
        "help": "where to compute; auto takes a GPU if there is one (default: cpu)",
    },
    "--set": {
        "action": "append",
        "default": [],
        "metavar": "PATH=VALUE",
        "help": "change any key, such as robots.0.count=3; may be repeated",
    },
    "--no-recording": _FLAG | {"help": "write no recording.rrd"},
    "--no-report": _FLAG | {"help": "write no report.html"},
    "--quiet": _FLAG | {"help": "print errors only"},
    "--force": _FLAG | {"help": "replace an earlier run in --out"},
    "--retry": _FLAG | {"help": "make runs again that have failed"},
    "--allow-code": _FLAG | {"help": "execute Python files that the scenario names (kind: own)"},
    "--allow-outside": _FLAG | {"help": "read files that lie outside the scenario's folder"},
    "--debug": _FLAG | {"help": "show where an unexpected error came from"},
}
OTHER_MAPS = "read maps and meshes outside the run's folder that are not those of the run"  # --allow-outside


def add(parser: _ActionsContainer, *names: str, **changes: Any) -> None:
    """Add shared arguments to a parser. changes: keywords of `add_argument` that differ for this command."""
    for name in names:
        parser.add_argument(name, **OPTIONS[name] | changes)


def whole_number(least: int, most: int) -> Callable[[str], int]:
    """Type of an option that takes a whole number from `least` to `most`."""

    def read(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            value = least - 1
        if not least <= value <= most:
            raise ArgumentTypeError(f"must be a whole number from {least} to {most}, got '{text}'")
        return value

    return read


def number(text: str) -> float:
    """Type of an option that takes a finite number."""
    try:
        value = float(text)
    except ValueError:
        value = inf
    if not -inf < value < inf:
        raise ArgumentTypeError(f"must be a number without a unit, got '{text}'")
    return value


def positive(text: str) -> float:
    """Type of an option that takes a number above 0."""
    value = number(text)
    if value <= 0.0:
        raise ArgumentTypeError(f"must be a number above 0, got '{text}'")
    return value


def from_zero(text: str) -> float:
    """Type of an option that takes a number that is not negative."""
    value = number(text)
    if value < 0.0:
        raise ArgumentTypeError(f"must be a number from 0 on, got '{text}'")
    return value
