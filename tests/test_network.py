"""A run wants nothing from the network, and tells nobody of itself."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import no_sockets
import pytest
from test_meshes import box_triangles, write_stl

ROOT = Path(__file__).parent.parent
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
    new = {
        **{name: value for name, value in os.environ.items() if name != "TI_SKIP_VERSION_CHECK"},
        "HOME": str(folder / "home"),
        "PYTHONPATH": str(ROOT),
        "XDG_CACHE_HOME": str(folder / "home" / "cache"),
        "TI_OFFLINE_CACHE_FILE_PATH": f"{kept}/taichi_plume/kernels",  # kernels that were compiled already
    }
    (folder / "home").mkdir(exist_ok=True)
    return subprocess.run(
        [sys.executable, str(ROOT / "tests" / "no_sockets.py"), *command],
        capture_output=True, text=True, check=False, env=new | environment, cwd=folder,
    )  # fmt: skip


def test_a_run_with_all_that_it_may_write(tmp_path):
    write_stl(tmp_path / "box.stl", box_triangles((0.5, 0.3, 0), (0.6, 0.4, 0.5)))
    (tmp_path / "s.yaml").write_text(SCENARIO)
    done = watched(tmp_path, "taichi_plume.run", "s.yaml", "--out", "run", "--quiet")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "run" / "recording.rrd").exists()
    assert (tmp_path / "run" / "fields.zarr").exists()
    told = [one for one in (tmp_path / "home").rglob("*") if one.name in ("version_info", "analytics.json")]
    assert told == []  # where Taichi and rerun keep the user's id


def test_the_watch_sees_what_python_looks_up(tmp_path):
    (tmp_path / "asks.py").write_text("import socket; socket.getaddrinfo('a.invalid', 80)")
    assert watched(tmp_path, "asks", PYTHONPATH=str(tmp_path)).returncode == no_sockets.LOOKED_UP


@pytest.mark.skipif(not no_sockets.can_watch(), reason="seccomp's numbers are those of Linux on two machines")
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


@pytest.mark.skipif(not no_sockets.can_watch(), reason="seccomp's numbers are those of Linux on two machines")
def test_taichi_alone_would_tell(tmp_path):
    """As without the setting that the package makes."""
    (tmp_path / "asks.py").write_text("import taichi, time; taichi.init(); time.sleep(20)")
    done = watched(tmp_path, "asks", PYTHONPATH=str(tmp_path), TI_SKIP_VERSION_CHECK="OFF")
    assert done.returncode in (no_sockets.LOOKED_UP, -signal.SIGSYS)


def test_modules_of_the_working_folder_are_not_run(tmp_path):
    """`python -m` puts it first among the places of modules."""
    (tmp_path / "s.yaml").write_text(SCENARIO.replace("obstacles", "#"))
    for name in ("yaml", "pydantic", "numpy", "typing"):
        (tmp_path / f"{name}.py").write_text(
            "import pathlib; pathlib.Path('executed').touch(); raise SystemExit(0)"
        )
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "taichi_plume.run", "s.yaml", "--check"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path, env=environment)
    assert done.returncode == 0, done.stderr
    assert "duration: 0.5" in done.stdout
    assert not (tmp_path / "executed").exists()
