"""Conversion of exceptions to error messages and exit codes, the same for all commands."""

import traceback
from collections.abc import Callable
from pathlib import Path

from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.terminal import say


def exit_code(
    work: Callable[[], int],
    interrupted: str = "interrupted",
    debug: bool | None = None,
    out: Path | None = None,
) -> int:
    """Do the work of a command and return its exit code; if an exception ends the work, print its message.

    2: the user's input is wrong (InputError); 130: Ctrl-C, with the message `interrupted`; 1: a file cannot be read or
    written (OSError), or any other error. out: where the command writes, for an OSError that names no file. debug:
    print the traceback as well; None: the command has no --debug, so an unexpected error is raised again.
    """
    try:
        return work()
    except InputError as error:
        say(*error.lines, error=True)
        return 2
    except KeyboardInterrupt:
        say(interrupted, error=True)
        return 130
    except Exception as error:
        if debug is None and not isinstance(error, OSError):
            raise
        if debug:
            say(*traceback.format_exc().splitlines(), error=True)
        if isinstance(error, OSError):
            file = error.filename2 or error.filename or out
            message = f"{file}: " * bool(file) + str(error.strerror or error)
        else:
            from taichi_plume.execution.execute import explain  # imports rich and pyarrow

            message = explain(error)[1]
        say(message, error=True)
        return 1
