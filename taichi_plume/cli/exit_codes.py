"""What a command's end is for a shell: its exit code, and on stderr why."""

import traceback
from collections.abc import Callable

from taichi_plume.guard.terminal import say, visible


def exit_code(work: Callable[[], int], interrupted: str, debug: bool = False) -> int:
    """That of a command's work, or of what cut it short, which is told in a line for each fault.

    2: what it was given is wrong; 130: `interrupted`; 1: a file could not be read or written.
    """
    from taichi_plume.files.run_folder import RunFolderError
    from taichi_plume.scenario.loading import ScenarioError

    try:
        return work()
    except ScenarioError as error:
        say(error, error=True)
        return 2
    except RunFolderError as error:
        say(visible(error), error=True)
        return 2
    except KeyboardInterrupt:
        say(interrupted, error=True)
        return 130
    except OSError as error:
        if debug:
            say(traceback.format_exc(), error=True)
        at = f"{error.filename}: " if error.filename else ""
        say(visible(f"{at}{error.strerror or error}"), error=True)
        return 1
