"""What Dask loads into each worker that runs on the user's own machine."""

import os
import signal
from contextlib import suppress
from pathlib import Path
from typing import Any

from distributed import WorkerPlugin


class LocalWorker(WorkerPlugin):
    """What workers print goes to a file, as the terminal is the command's, and Ctrl-C is heard by the command alone."""

    name = "taichi-plume-local"

    def __init__(self, log: Path):
        self.log = log

    def setup(self, worker: Any) -> None:
        """Called by Dask when the worker begins."""
        with suppress(ValueError):  # not in its main thread
            signal.signal(signal.SIGINT, signal.SIG_IGN)
        with suppress(OSError):
            file = os.open(self.log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
            os.dup2(file, 1)
            os.dup2(file, 2)
            os.close(file)
