"""Viewer of a running simulation (--live) or of a recording: a server on the loopback interface; nothing is sent."""

import json
import os
import re
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from urllib.request import ProxyHandler, build_opener

from taichi_plume.files.run_folder import RunFolderError
from taichi_plume.files.tables import plain
from taichi_plume.guard.safe_open import read_regular, unopenable
from taichi_plume.guard.terminal import notebook_display

PATIENCE = 30.0  # s until the viewer's window is open
NOTEBOOK = 960, 600  # pixels: size of the viewer in a notebook
LOOPBACK = "127.0.0.1"
VIEWER = (sys.executable, "-m", "rerun_cli")
OPTIONS = ("--hide-welcome-screen", "--expect-data-soon")
NOWHERE = f"http://{LOOPBACK}:9"  # the discard port, closed on nearly all machines
WEB_VIEWER = ("index.html", "re_viewer.js", "re_viewer_bg.wasm")
"""Files of the viewer for browsers."""
SEVERED = "gRPC connection severed"
"""Start of rerun's message when the viewer is gone."""


def show(recording: Path) -> object:
    """Show a recording in a viewer: in a notebook as its widget, which is returned, else in a window of its own.

    Raises RunFolderError if there is no viewer, and OSError.
    """
    fault = unopenable(recording)
    if fault:
        raise RunFolderError(f"{recording}: {fault}")
    if notebook_display() is None:
        open_viewer(str(recording), what=str(recording))
        return None
    try:
        from rerun_notebook import Viewer  # pyright: ignore[reportMissingImports]
    except ImportError:
        how = "`run.plot()` and `run.animate()` work without it"
        raise RunFolderError(
            f"{recording}: the viewer for notebooks is missing: pip install 'taichi_plume[notebook]'; {how}"
        ) from None
    viewer = Viewer(width=NOTEBOOK[0], height=NOTEBOOK[1], url=None)
    viewer.send_rrd(read_regular(recording))
    return viewer


def open_viewer(*files: str, what: str = "--live") -> str:
    """Open a viewer in its own process, which outlives this process; return the address for recordings.

    files: recordings to show; what: start of messages. Raises RunFolderError if the viewer cannot be opened, as without
    a screen, or would send usage reports.
    """
    with tempfile.TemporaryDirectory(prefix="taichi_plume-", ignore_cleanup_errors=True) as settings:
        environment = quiet(settings, what)  # the viewer reads its settings before it opens the port
        with socket.socket() as free:
            free.bind((LOOPBACK, 0))
            port = free.getsockname()[1]
        output = Path(settings, "output.txt")
        with output.open("wb") as file:
            viewer = subprocess.Popen(
                [*VIEWER, *files, "--bind", LOOPBACK, "--port", str(port), *OPTIONS],
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=file,
                stderr=file,
                start_new_session=True,  # Ctrl-C ends the run, not the viewer
            )
        fault = _fault(viewer, port, output)
        if fault:
            raise RunFolderError(f"{what}: the viewer cannot be opened: {plain(fault)}")
        viewer.returncode = 0  # Python need not wait for the viewer
    return f"rerun+http://{LOOPBACK}:{port}/proxy"


def _fault(viewer: subprocess.Popen[bytes], port: int, output: Path) -> str:
    """Wait until the viewer's port is open and return "", or the reason for the failure."""
    until = time.monotonic() + PATIENCE
    while time.monotonic() < until:
        if viewer.poll() is not None:
            lines = output.read_text(errors="replace").splitlines()
            reason = next((line for line in lines if "rror" in line or "panicked" in line), "")
            return reason.rpartition(": ")[2] or f"exit code {viewer.returncode}; is there a screen?"
        try:
            socket.create_connection((LOOPBACK, port), timeout=1.0).close()
            return ""
        except OSError:
            time.sleep(0.1)
    viewer.terminate()
    return f"its port did not open within {PATIENCE:g} s"


def quiet(settings: str, what: str = "--live") -> dict[str, str]:
    """Return the environment of a viewer that sends nothing, with its own settings folder.

    Raises RunFolderError if the viewer reads other settings, which make it send usage reports.
    """
    environment = os.environ | {"XDG_CONFIG_HOME": settings}
    for name in ("HTTPS_PROXY", "HTTP_PROXY", "ALL_PROXY"):  # otherwise the viewer asks for newer versions
        environment |= {name: NOWHERE, name.lower(): NOWHERE}
    subprocess.run([*VIEWER, "analytics", "disable"], env=environment, capture_output=True, check=False)
    command = [*VIEWER, "analytics", "config"]
    answer = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    try:
        enabled = json.loads(answer.stdout)["analytics_enabled"]
    except (ValueError, LookupError, TypeError):
        enabled = True
    if enabled:
        raise RunFolderError(
            f"{what}: the viewer would send reports to its makers; `rerun analytics disable` switches that off"
        )
    return environment


def web_viewer_files() -> dict[str, bytes]:
    """Return the files of rerun's viewer for browsers, by name, to be served by another server; takes seconds.

    The page is without its links to fonts elsewhere. Raises RunFolderError.
    """
    with tempfile.TemporaryDirectory(prefix="taichi_plume-", ignore_cleanup_errors=True) as settings:
        environment = quiet(settings, "recording")
        ports = []
        for _ in range(2):
            with socket.socket() as free:
                free.bind((LOOPBACK, 0))
                ports.append(free.getsockname()[1])
        output = Path(settings, "output.txt")
        command = [*VIEWER, "--serve-web", "--bind", LOOPBACK, "--port", str(ports[0])]
        with output.open("wb") as file:
            server = subprocess.Popen(
                [*command, "--web-viewer-port", str(ports[1])],
                env=environment, stdin=subprocess.DEVNULL, stdout=file, stderr=file, start_new_session=True,
            )  # fmt: skip
        try:
            if fault := _fault(server, ports[1], output):
                raise RunFolderError(f"the viewer cannot be opened: {plain(fault)}")
            opener = build_opener(ProxyHandler({}))
            files = {}
            for name in WEB_VIEWER:
                address = f"http://{LOOPBACK}:{ports[1]}/{name.removesuffix('index.html')}"
                with opener.open(address, timeout=PATIENCE) as answer:
                    files[name] = answer.read()
        except OSError as error:
            raise RunFolderError(f"the viewer cannot be opened: {error}") from None
        finally:
            server.terminate()
            server.wait()
    files["index.html"] = re.sub(rb"<link[^>]*https://[^>]*>", b"", files["index.html"])
    return files
