"""Calls of readers that find a pipe in place of a file, in threads that do not outlive the test."""

import os
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

PATIENCE = 60.0  # s


def ended(call: Callable[[], Any], pipe: Path) -> tuple[bool, object]:
    """Whether a call ends, and its result or exception; a call that waits for the pipe is released."""
    outcome: list[object] = []

    def work() -> None:
        try:
            outcome.append(call())
        except Exception as error:
            outcome.append(error)

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    thread.join(PATIENCE)
    if not thread.is_alive():
        return True, outcome[0]
    os.close(os.open(pipe, os.O_RDWR))
    thread.join(PATIENCE)
    return False, None
