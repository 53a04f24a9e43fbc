"""Entry point of all commands: ``taichi-plume run CONFIG``, or ``python -m taichi_plume run CONFIG``, and so on.

A command without a module in `cli` calls the function of its name in `api` and prints the result. Exit codes are those
of the commands; 2 for an unknown command.
"""

import sys
from argparse import RawDescriptionHelpFormatter
from collections.abc import Sequence
from importlib import import_module
from typing import NoReturn

from taichi_plume.execution.signals import leave
from taichi_plume.guard.terminal import Parser
from taichi_plume.version import __version__

COMMANDS = {
    "run": "run a scenario, or only check it; resume an interrupted run",
    "examples": "list the scenarios that travel with the package, run one by name, or copy one",
    "draw": "draw a scenario in the browser, check it and run it",
    "serve": "run a scenario in real time, with robots that are driven from outside",
    "report": "write the report of a run again",
    "picture": "draw a run at a time, or as a film",
    "export": "write a run's data for ParaView, NetCDF or spreadsheets",
    "maps": "make a gas map of recorded readings",
    "repair": "complete the files of a run that was killed",
    "scenario": "print the JSON schema of scenarios, or explain a key",
    "study": "run many scenarios from one file, and make tables of them",
    "contest": "compare all search algorithms, and your own, in the same scenarios",
    "envs": "record the airs that learners meet",
    "statistics": "mean and fluctuations of a plume, its whiffs and blanks",
    "validation": "run the solvers against exact solutions, and published experiments",
}


MODULES = {"validation": "validation.__main__"}
"""Modules of commands that are not in `cli`."""
CALLS = ("report", "picture", "export", "repair")
"""Commands that print the result of the call of their name."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv` (without the program's name) and return its exit code."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    if arguments and arguments[0] in CALLS:
        from taichi_plume.cli.options import command

        call = getattr(import_module(f"taichi_plume.api.{arguments[0]}"), arguments[0])
        return command(arguments[0], call, arguments[1:])
    if arguments and arguments[0] in COMMANDS:
        module = import_module(f"taichi_plume.{MODULES.get(arguments[0], f'cli.{arguments[0]}')}")
        return module.main(arguments[1:])
    parser = Parser(
        prog="taichi-plume",
        description="Mobile-robot olfaction: air flow, gas, robots and maps from one YAML file.",
        epilog="commands:\n"
        + "\n".join(f"  {name:<12} {what}" for name, what in COMMANDS.items())
        + "\n\n`taichi-plume COMMAND --help` explains a command.",
        formatter_class=RawDescriptionHelpFormatter,
    )
    parser.add_argument("command", metavar="COMMAND", choices=COMMANDS, help="see below")
    parser.add_argument("--version", action="version", version=f"taichi_plume {__version__}")
    parser.parse_args(arguments[:1])
    return 2  # not reached: the parser has refused an unknown command


def end_by(name: str = "") -> NoReturn:
    """Run this process's command line and exit with its code. name: the command, unless the first argument names it."""
    leave(main([name, *sys.argv[1:]] if name else None))


if __name__ == "__main__":
    end_by()
