"""Start of Taichi, and the cache of compiled kernels."""

import atexit
import contextlib
import io
import os
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from taichi_plume.engine import kernels, tracing  # noqa: F401  it makes the tracing of kernels quicker
from taichi_plume.engine.choice import DEFAULT
from taichi_plume.engine.fields import on_cpu
from taichi_plume.engine.library import CACHE_LOCK, NAME, PREFIX, impl, taichi
from taichi_plume.engine.process import ForkError, require_no_fork
from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.terminal import LONGEST_VALUE, say, visible

# Limit of compiled kernels on disk. At Taichi's own 100 MB a dozen scenarios, or the tests, evict each other's kernels.
CACHE_BYTES = 2_000_000_000
_CACHE_FOLDER = f"{PREFIX}OFFLINE_CACHE_FILE_PATH"  # a variable of Taichi, as is the next
_CACHE_SWITCH = f"{PREFIX}OFFLINE_CACHE"
STALE_S = 60.0  # age of the cache's lock, which Taichi holds for less than a second
_started: list[Any] = []  # program, arch, debug and threads of the last start


class DeviceError(InputError, RuntimeError):
    """Error of a machine without a device of the requested kind."""


def start(arch: str = "cpu", debug: bool = False, threads: int | None = None) -> str:
    """Initialise Taichi on `arch` (auto, cpu, cuda, vulkan, metal) and return the backend that Taichi chose.

    threads: number of CPU threads, by default one per core. If Taichi already runs with the same arguments, nothing is
    done. Otherwise it restarts: simulations on the CPU go on, those on a device raise EngineError. Raises DeviceError
    if there is no such device; Taichi is then not running.
    """
    known = {
        "auto": taichi.gpu,
        "cpu": taichi.cpu,
        "cuda": taichi.cuda,
        "vulkan": taichi.vulkan,
        "metal": taichi.metal,
    }
    if not isinstance(arch, str) or arch not in known:
        raise DeviceError(f"got '{visible(arch, LONGEST_VALUE)}', allowed are {', '.join(known)}")
    require_no_fork()
    if not is_running() or _started != [impl.get_runtime().prog, arch, debug, threads]:
        try:
            _restart(known[arch], debug, threads)
        except RuntimeError as error:  # from Taichi: the driver of the device failed
            raise DeviceError(error) from None
        if on_cpu() and arch not in ("auto", "cpu"):
            taichi.reset()
            raise DeviceError(f"no {arch} device was found; use --arch cpu or auto")
        _started[:] = impl.get_runtime().prog, arch, debug, threads
    return "cpu" if on_cpu() else taichi.cfg.arch.name


def _restart(arch: object, debug: bool, threads: int | None) -> None:
    checks: dict[str, Any] = {"debug": True} if debug else {}  # the default is Taichi's own TI_DEBUG
    checks |= {} if threads is None else {"cpu_max_num_threads": threads}
    with contextlib.redirect_stdout(io.StringIO()):  # "[Taichi] Starting on arch=..."
        taichi.init(
            arch=arch,
            default_fp=taichi.f32,
            default_ip=taichi.i32,
            log_level=taichi.ERROR,
            unrolling_limit=0,  # no warning where more than 32 fields are filled at once
            **_cache(),
            **checks,
        )


@atexit.register
def _store_kernels() -> None:
    """Finish Taichi, which stores the compiled kernels: only a finished program does, and kernels keep it alive."""
    with contextlib.suppress(ForkError):
        require_no_fork()
        if is_running():
            impl.get_runtime().prog.finalize()


def is_running() -> bool:
    """Return whether Taichi has been started."""
    return impl.get_runtime().prog is not None


def ensure_started() -> None:
    """Start Taichi on the CPU unless Taichi runs."""
    if not is_running():
        start()


def cache_folder() -> Path:
    """Return the folder of compiled kernels: that of the library's variable, or a folder in the user's cache folder."""
    chosen = os.environ.get(_CACHE_FOLDER)
    if chosen:
        return Path(chosen)
    home = Path(os.path.expanduser("~"))
    folder = {"win32": home / "AppData/Local", "darwin": home / "Library/Caches"}.get(
        sys.platform, home / ".cache"
    )
    if sys.platform != "darwin":
        given = Path(os.environ.get("LOCALAPPDATA" if sys.platform == "win32" else "XDG_CACHE_HOME", ""))
        folder = given if given.is_absolute() else folder  # the XDG rules: a relative path is ignored
    return folder / "taichi_plume" / ("kernels" if NAME == DEFAULT else f"kernels_{NAME}")


def _cache() -> dict[str, str | int]:
    """Return the options of `taichi.init` for the cache of compiled kernels.

    If the cache folder cannot be written, the cache is switched off by a variable and a note says so once. Child
    processes inherit the variable. Taichi creates the folder even then, and crashes if that fails: the root exists.
    """
    folder = cache_folder()
    if os.environ.get(_CACHE_SWITCH) != "0":
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=folder):
                pass
            _remove_stale_lock(folder / CACHE_LOCK)
            options: dict[str, str | int] = {"offline_cache_max_size_of_files": CACHE_BYTES}
            return (
                options if _CACHE_FOLDER in os.environ else options | {"offline_cache_file_path": str(folder)}
            )
        except OSError as error:
            why = f"{folder} cannot be written ({error.strerror or error}), so every run compiles its kernels again"
            say(f"note: {why}; set {_CACHE_FOLDER} to a folder that can be written", error=True)
            os.environ[_CACHE_SWITCH] = "0"
    os.environ[_CACHE_FOLDER] = os.sep
    return {}


def _remove_stale_lock(lock: Path) -> None:
    """Remove Taichi's lock of a kernel cache if a killed process left it: no kernel would be stored any more."""
    with contextlib.suppress(OSError):
        if time.time() - lock.stat().st_mtime > STALE_S:
            lock.unlink()


def compiled() -> int:
    """Return the number of kernels that this process has compiled, or taken from the cache."""
    return kernels.compiled
