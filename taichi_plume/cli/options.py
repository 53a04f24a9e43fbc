"""Command-line options that several commands share, and the types of options that take numbers."""

from argparse import Action, ArgumentParser, ArgumentTypeError, Namespace, _ActionsContainer
from collections.abc import Callable
from math import inf, isfinite, nan
from pathlib import Path
from typing import Any, TypeVar

from taichi_plume.engine.choice import ENGINES, VARIABLE, EngineChoiceError, choose

Number = TypeVar("Number", int, float)
Keywords = dict[str, Any]
"""Keywords of `add_argument`."""


class EngineOption(Action):
    """Option that chooses the engine as soon as it is read, since imports of the engine follow the choice."""

    def __call__(self, parser: ArgumentParser, namespace: Namespace, name: Any, *_: Any) -> None:
        try:
            choose(name)
        except EngineChoiceError as error:
            parser.error(str(error))
        setattr(namespace, self.dest, name)


ARCHS = ("auto", "cpu", "cuda", "vulkan", "metal")
_FLAG: Keywords = {"action": "store_true"}
OPTIONS: dict[str, Keywords] = {
    "run": {"type": Path, "metavar": "RUN", "help": "the run's folder"},
    "--out": {"type": Path, "metavar": "DIR", "help": "run directory (default: runs/NAME-N)"},
    "--arch": {
        "choices": ARCHS,
        "default": "cpu",
        "help": "where to compute; auto takes a GPU if there is one (default: cpu)",
    },
    "--engine": {
        "action": EngineOption,
        "choices": tuple(ENGINES),
        "help": f"library that compiles kernels (default: {VARIABLE} of the environment, or taichi)",
    },
    "--set": {
        "action": "append",
        "default": [],
        "metavar": "PATH=VALUE",
        "help": "change any key, such as robots.0.count=3; may be repeated",
    },
    "--duration": {"metavar": "S", "help": "seconds, instead of the scenario's"},
    "--no-recording": _FLAG | {"help": "write no recording.rrd"},
    "--no-report": _FLAG | {"help": "write no report.html"},
    "--quiet": _FLAG | {"help": "print errors only"},
    "--force": _FLAG | {"help": "rename the folder of an earlier run to OUT.old"},
    "--retry": _FLAG | {"help": "repeat failed runs"},
    "--allow-code": _FLAG | {"help": "execute Python files that the scenario names (kind: own)"},
    "--allow-outside": _FLAG | {"help": "read files that lie outside the scenario's folder"},
    "--debug": _FLAG | {"help": "show where an unexpected error came from"},
}
OTHER_MAPS = "read maps and meshes outside the run's folder that are not those of the run"  # --allow-outside


def add(parser: _ActionsContainer, *names: str, **changes: Any) -> None:
    """Add the named OPTIONS to a parser. changes: keywords of `add_argument` that override those of each."""
    for name in names:
        parser.add_argument(name, **OPTIONS[name] | changes)


def overrides_of(args: Namespace, *keys: str) -> list[str]:
    """Return the changes of `--set` and those of the options that are named as keys of a scenario."""
    return [*args.set, *(f"{key}={value}" for key in keys if (value := vars(args)[key]) is not None)]


def flag(parser: _ActionsContainer, name: str, meaning: str) -> None:
    """Add a boolean option to a parser: true if given; meaning: help text."""
    parser.add_argument(name, action="store_true", help=meaning)


def option(
    parser: _ActionsContainer, name: str, kind: Callable[[str], Any], value: str, meaning: str, **more: Any
) -> None:
    """Add an option with a value to a parser. kind: argparse type; value, meaning: placeholder and text of the help."""
    parser.add_argument(name, type=kind, metavar=value, help=meaning, **more)


def _number(kind: type[Number], allowed: Callable[[float], bool], words: str) -> Callable[[str], Number]:
    def read(text: str) -> Number:
        try:
            value = kind(text)
        except ValueError:
            value = nan
        if not allowed(value):
            raise ArgumentTypeError(f"must be {words}, got '{text}'")
        return kind(value)

    return read


def whole_number(least: int, most: int) -> Callable[[str], int]:
    """Return an argparse type that accepts whole numbers from `least` to `most`."""
    return _number(int, lambda value: least <= value <= most, f"a whole number from {least} to {most}")


number = _number(float, isfinite, "a number without a unit")
"""Type of an option that takes a finite number."""
positive = _number(float, lambda value: 0.0 < value < inf, "a number above 0")
from_zero = _number(float, lambda value: 0.0 <= value < inf, "a number from 0 on")
