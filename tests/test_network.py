"""A run wants nothing from the network, and tells nobody of itself."""

import os
import signal
import subprocess
from pathlib import Path

import no_sockets
import pytest
from scripts import ROOT, python
from test_meshes import box_triangles, write_stl

LINUX = pytest.mark.skipif(
    not no_sockets.can_watch(), reason="numbers of seccomp are of Linux on two machines"
)
SCENARIO = """
duration: 0.5
domain: {size: [1, 1], spacing: 0.1}
wind: {kind: cfd, openings: [{kind: inlet, face: x-, speed: 0.5}, {kind: outlet, face: x+}]}
obstacles: [{kind: mesh, file: box.stl, section: 0.1}]
gas: {kind: eulerian, sources: [{position: [0.3, 0.5], rate: 1 mg/s}]}
robots: [{count: 1, start: {kind: positions, positions: [[0.8, 0.8]]}, algorithm: {kind: casting}}]
maps: [{kind: time_series}]
fields: {rate: 2}
"""


def watched(folder: Path, *command: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """A module's run as a new user's, whom Taichi and rerun do not know yet."""
    kept = os.environ.get("XDG_CACHE_HOME", os.path.expanduser("~/.cache"))
    home = folder / "home"
    new = {name: value for name, value in os.environ.items() if name != "TI_SKIP_VERSION_CHECK"}
    new |= {"HOME": str(home), "PYTHONPATH": str(ROOT), "XDG_CACHE_HOME": str(home / "cache")}
    new |= {
        "TI_OFFLINE_CACHE_FILE_PATH": f"{kept}/taichi_plume/kernels"
    }  # kernels that were compiled already
    home.mkdir(exist_ok=True)
    return python(folder, str(ROOT / "tests" / "no_sockets.py"), *command, environment=new | environment)


@pytest.mark.slow
def test_a_run_with_all_that_it_may_write(tmp_path):
    write_stl(tmp_path / "box.stl", box_triangles((0.5, 0.3, 0), (0.6, 0.4, 0.5)))
    (tmp_path / "s.yaml").write_text(SCENARIO)
    done = watched(tmp_path, "taichi_plume.run", "s.yaml", "--out", "run", "--quiet")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "run" / "recording.rrd").exists()
    assert (tmp_path / "run" / "fields.zarr").exists()
    reported = [
        one for one in (tmp_path / "home").rglob("*") if one.name in ("version_info", "analytics.json")
    ]
    assert reported == []  # where Taichi and rerun keep the user's id


def test_the_watch_sees_what_python_looks_up(tmp_path):
    (tmp_path / "asks.py").write_text("import socket; socket.getaddrinfo('a.invalid', 80)")
    assert watched(tmp_path, "asks", PYTHONPATH=str(tmp_path)).returncode == no_sockets.LOOKED_UP


@LINUX
@pytest.mark.parametrize(("call", "kind"), [("connect", "SOCK_STREAM"), ("sendto", "SOCK_DGRAM")])
def test_the_watch_sees_every_thread(tmp_path, call, kind):
    """Here by the C library, of which Python knows nothing."""
    (tmp_path / "asks.py").write_text(
        f"""
import ctypes, socket, struct, threading
address = struct.pack("=H", socket.AF_INET) + struct.pack(">HI8x", 9, 0x7F000001)
one = socket.socket(socket.AF_INET, socket.{kind})
before = [b"", 0, 0] if "{call}" == "sendto" else []
threading.Thread(target=getattr(ctypes.CDLL(None), "{call}"), args=[one.fileno(), *before, address, 16]).start()
"""
    )
    assert watched(tmp_path, "asks", PYTHONPATH=str(tmp_path)).returncode == -signal.SIGSYS


@LINUX
def test_taichi_alone_would_tell(tmp_path):
    """As without the setting that the package makes."""
    (tmp_path / "asks.py").write_text("import taichi, time; taichi.init(); time.sleep(20)")
    done = watched(tmp_path, "asks", PYTHONPATH=str(tmp_path), TI_SKIP_VERSION_CHECK="OFF")
    assert done.returncode in (no_sockets.LOOKED_UP, -signal.SIGSYS)


def test_modules_of_the_working_folder_are_not_run(tmp_path):
    """`python -m` puts it first among the places of modules."""
    (tmp_path / "s.yaml").write_text(SCENARIO.replace("obstacles", "#"))
    spy = "import pathlib; pathlib.Path('executed').touch(); raise SystemExit(0)"
    for name in ("yaml", "pydantic", "numpy", "typing"):
        (tmp_path / f"{name}.py").write_text(spy)
    done = python(tmp_path, "-m", "taichi_plume.run", "s.yaml", "--check")
    assert done.returncode == 0, done.stderr
    assert "duration: 0.5" in done.stdout
    assert not (tmp_path / "executed").exists()
