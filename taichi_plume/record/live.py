"""The viewer beside a run: opened when asked for, listening on the loopback alone, sending nothing elsewhere."""

import json
import os
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from taichi_plume.files.run_folder import RunFolderError
from taichi_plume.files.tables import plain

PATIENCE = 30.0  # s until its window is there
LOOPBACK = "127.0.0.1"
VIEWER = (sys.executable, "-m", "rerun_cli")
OPTIONS = ("--hide-welcome-screen", "--expect-data-soon")
NOWHERE = f"http://{LOOPBACK}:9"  # the port of old whose listener throws all away; hardly ever is there one
SEVERED = "gRPC connection severed"
"""How rerun begins to tell that the viewer is gone."""


def open_viewer() -> str:
    """Open a viewer in a process of its own, which outlives ours; returns where it takes recordings.

    Raises RunFolderError where it cannot be opened, as without a screen, or would send reports to its makers.
    """
    with tempfile.TemporaryDirectory(prefix="taichi_plume-", ignore_cleanup_errors=True) as settings:
        environment = quiet(settings)  # it reads them before it listens
        with socket.socket() as free:
            free.bind((LOOPBACK, 0))
            port = free.getsockname()[1]
        told = Path(settings, "told.txt")
        with told.open("wb") as file:
            viewer = subprocess.Popen(
                [*VIEWER, "--bind", LOOPBACK, "--port", str(port), *OPTIONS],
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=file,
                stderr=file,
                start_new_session=True,  # Ctrl-C ends the run, not the viewer
            )
        fault = _fault(viewer, port, told)
        if fault:
            raise RunFolderError(f"--live: the viewer cannot be opened: {plain(fault)}")
        viewer.returncode = 0  # not ours to wait for
    return f"rerun+http://{LOOPBACK}:{port}/proxy"


def _fault(viewer: subprocess.Popen[bytes], port: int, told: Path) -> str:
    """What keeps it from listening, once that is known; nothing where it does."""
    until = time.monotonic() + PATIENCE
    while time.monotonic() < until:
        if viewer.poll() is not None:
            lines = told.read_text(errors="replace").splitlines()
            reason = next((line for line in lines if "rror" in line or "panicked" in line), "")
            return reason.rpartition(": ")[2] or f"exit code {viewer.returncode}; is there a screen?"
        try:
            socket.create_connection((LOOPBACK, port), timeout=1.0).close()
            return ""
        except OSError:
            time.sleep(0.1)
    viewer.terminate()
    return f"nothing came of it in {PATIENCE:g} s"


def quiet(settings: str) -> dict[str, str]:
    """The environment of a viewer that sends nothing; its settings, but for its own user's, go to that folder.

    Raises RunFolderError where the viewer reads them elsewhere, and there says that it will send reports.
    """
    environment = os.environ | {"XDG_CONFIG_HOME": settings}
    for name in ("HTTPS_PROXY", "HTTP_PROXY", "ALL_PROXY"):  # or it asks whether there is a newer version
        environment |= {name: NOWHERE, name.lower(): NOWHERE}
    subprocess.run([*VIEWER, "analytics", "disable"], env=environment, capture_output=True, check=False)
    asked = subprocess.run(
        [*VIEWER, "analytics", "config"], env=environment, capture_output=True, text=True, check=False
    )
    try:
        enabled = json.loads(asked.stdout)["analytics_enabled"]
    except (ValueError, LookupError, TypeError):
        enabled = True
    if enabled:
        raise RunFolderError(
            "--live: the viewer would send reports to its makers; `rerun analytics disable` switches that off"
        )
    return environment
