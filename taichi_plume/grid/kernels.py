"""Kernels: start of Taichi, cache of compiled kernels, type aliases, and launches of several passes in a kernel."""

import contextlib
import gc
import io
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from math import prod
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import taichi as ti
from taichi.lang import impl

from taichi_plume.grid import tracing  # noqa: F401  it makes the tracing of kernels quicker
from taichi_plume.grid.engine import KERNELS, EngineError, free_unused_trees, live_fields, require_usable
from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.terminal import LONGEST_VALUE, say, visible

if TYPE_CHECKING:
    Template = Any
else:
    Template = ti.template()
"""Annotation of compile-time arguments of kernels: fields, axes, objects with `ti.func` methods."""
Field: TypeAlias = Any
"""Taichi field of scalars or vectors; its type is opaque to type checkers."""
Expression: TypeAlias = Any
"""Value inside a kernel (number, vector or point) whose type Taichi infers."""

# Limit of compiled kernels on disk. At Taichi's own 100 MB a dozen scenarios, or the tests, evict each other's kernels.
CACHE_BYTES = 2_000_000_000
_CACHE_FOLDER = "TI_OFFLINE_CACHE_FILE_PATH"  # Taichi's own variable
STALE_S = 60.0  # age of the cache's lock, which Taichi holds for less than a second
STRIP = 32  # cells per strip; 100 and more are six times slower (LLVM stops using registers)
MANY_CELLS = 50_000  # cells set by a pass: from here on a separate launch costs comparatively little
FEW_CELLS = 300_000  # cells set by a pass: up to here the caller's thread is done before another wakes up
FEW_ROWS = 2000  # Taichi gives a CPU thread 512 iterations at least: with fewer rows, strips are tasks too

_started: list[Any] = []  # program, arch, debug and threads of the last start


class DeviceError(InputError, RuntimeError):
    """Error of a machine without a device of the requested kind."""


def start(arch: str = "cpu", debug: bool = False, threads: int | None = None) -> str:
    """Initialise Taichi on `arch` (auto, cpu, cuda, vulkan, metal) and return the backend that Taichi chose.

    threads: number of CPU threads, by default one per core. If Taichi already runs with the same arguments and fields
    in use, only the memory of other fields is freed. Otherwise Taichi restarts, and simulations assembled before raise
    EngineError. Raises DeviceError if there is no such device; Taichi is then not running.
    """
    known = {"auto": ti.gpu, "cpu": ti.cpu, "cuda": ti.cuda, "vulkan": ti.vulkan, "metal": ti.metal}
    if not isinstance(arch, str) or arch not in known:
        raise DeviceError(f"got '{visible(arch, LONGEST_VALUE)}', allowed are {', '.join(known)}")
    live = _fields_in_use() if is_running() else []
    require_usable(in_use=bool(live))
    if live and _started == [impl.get_runtime().prog, arch, debug, threads]:
        _free_all_but(live)
    else:
        try:
            _restart(known[arch], debug, threads)
        except RuntimeError as error:  # from Taichi: the driver of the device failed
            raise DeviceError(error) from None
        if on_cpu() and arch not in ("auto", "cpu"):
            ti.reset()
            raise DeviceError(f"no {arch} device was found; use --arch cpu or auto")
        _started[:] = impl.get_runtime().prog, arch, debug, threads
    return "cpu" if on_cpu() else ti.cfg.arch.name


def _restart(arch: object, debug: bool, threads: int | None) -> None:
    checks: dict[str, Any] = {"debug": True} if debug else {}  # the default is Taichi's own TI_DEBUG
    checks |= {} if threads is None else {"cpu_max_num_threads": threads}
    with contextlib.redirect_stdout(io.StringIO()):  # "[Taichi] Starting on arch=..."
        ti.init(
            arch=arch,
            default_fp=ti.f32,
            default_ip=ti.i32,
            log_level=ti.ERROR,
            unrolling_limit=0,  # no warning where more than 32 fields are filled at once
            **_cache(),
            **checks,
        )


def is_running() -> bool:
    """Return whether Taichi has been started."""
    return impl.get_runtime().prog is not None


def ensure_started() -> None:
    """Start Taichi on the CPU unless Taichi runs; free the memory of simulations that are no longer referenced."""
    if not is_running():
        start()
    elif _started and _started[0] is impl.get_runtime().prog:
        start(*_started[1:])
    else:
        _free_all_but(_fields_in_use())


def _fields_in_use() -> list[Any]:
    """Return the fields of the running Taichi program that are still referenced."""
    for kernel in KERNELS:
        if kernel.template_slot_locations:  # the kernel holds the fields that were its arguments
            kernel.mapper.mapping.clear()
            kernel.compiled_kernels.clear()
    gc.collect()
    return live_fields()


def _free_all_but(live: list[Any]) -> None:
    """Free the memory of all other fields, on a CPU."""
    if on_cpu():
        free_unused_trees(live)


def cache_folder() -> Path:
    """Return the folder of compiled kernels: TI_OFFLINE_CACHE_FILE_PATH, or a folder in the user's cache folder."""
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
    return folder / "taichi_plume" / "kernels"


def _cache() -> dict[str, str | int]:
    """Return the options of `ti.init` for the cache of compiled kernels.

    If the cache folder cannot be written, the cache is switched off by TI_OFFLINE_CACHE and a note says so once. Child
    processes inherit the variable. Taichi creates the folder even then, and crashes if that fails: the root exists.
    """
    folder = cache_folder()
    if os.environ.get("TI_OFFLINE_CACHE") != "0":
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=folder):
                pass
            _remove_stale_lock(folder / "ticache.lock")
            options: dict[str, str | int] = {"offline_cache_max_size_of_files": CACHE_BYTES}
            return (
                options if _CACHE_FOLDER in os.environ else options | {"offline_cache_file_path": str(folder)}
            )
        except OSError as error:
            why = f"{folder} cannot be written ({error.strerror or error}), so every run compiles its kernels again"
            say(f"note: {why}; set {_CACHE_FOLDER} to a folder that can be written", error=True)
            os.environ["TI_OFFLINE_CACHE"] = "0"
    os.environ[_CACHE_FOLDER] = os.sep
    return {}


def _remove_stale_lock(lock: Path) -> None:
    """Remove Taichi's lock of a kernel cache if a killed process left it: no kernel would be stored any more."""
    with contextlib.suppress(OSError):
        if time.time() - lock.stat().st_mtime > STALE_S:
            lock.unlink()


def on_cpu() -> bool:
    """Return whether kernels run on the CPU."""
    return ti.cfg.arch in (ti.x64, ti.arm64)


def compiled() -> int:
    """Return the number of kernels that have been compiled since `start`."""
    return KERNELS.compiled


def double_field(shape: tuple[int, ...] = ()) -> Field:
    """Return a new f64 field in its own SNode tree: beside 32-bit fields Vulkan would misplace the numbers."""
    field: Field = ti.field(ti.f64)
    apart = ti.FieldsBuilder()
    axes: Any = range(len(shape))
    (apart.dense(ti.axes(*axes), shape) if shape else apart).place(field)
    apart.finalize()
    return field


@dataclass(frozen=True)
class Pass:
    """Part of a kernel for `launch`: ti.func ``run(a, b)``, and the approximate number of cells that it sets."""

    run: Callable[[Expression, Expression], None]
    cells: int


def visit(bodies: Sequence[Callable], shapes: Sequence[tuple[int, ...]]) -> Pass:
    """Return a pass that calls each ``body(I, a, b)``, which may store, at all indices I of the body's shape."""
    dim = len(shapes[0])
    pairs = tuple(range(len(bodies)))
    bodies, shapes = tuple(bodies), tuple(shapes)
    # axis 0 is contiguous: the innermost loop on a CPU, neighbouring threads on a GPU
    rows = tuple(shape[:0:-1] if on_cpu() else shape[::-1] for shape in shapes)

    @ti.func
    def run(a, b):
        for q in ti.static(pairs):
            for J in ti.grouped(ti.ndrange(*rows[q])):
                I = ti.Vector.zero(ti.i32, dim)
                for d in ti.static(range(dim - len(rows[0]), dim)):
                    I[d] = J[dim - 1 - d]
                if ti.static(on_cpu()):
                    for i in range(shapes[q][0]):
                        I[0] = i
                        bodies[q](I, a, b)
                else:
                    bodies[q](I, a, b)

    return Pass(run, sum(prod(shape) for shape in shapes))


def launch(*passes: Pass) -> Callable[..., None]:
    """Return a function ``run(a=0, b=0)`` that executes several passes in order, in as few kernels as is fast.

    On a CPU, consecutive passes of few cells are one task of the caller's thread: waking another thread takes 0.1 ms. A
    pass of many cells is a kernel of its own, which costs 2 us: the time in which Taichi compiles a kernel grows with
    the square of the kernel's length.
    """
    groups = groupby(enumerate(passes), lambda nth: nth[0] if on_cpu() and nth[1].cells > MANY_CELLS else -1)
    parts = tuple(_launcher(_kernel([part for _, part in group])) for _, group in groups)
    if len(parts) == 1:
        return parts[0]

    def run(a: float = 0.0, b: float = 0.0) -> None:
        for part in parts:
            part(a, b)

    return run


def _kernel(passes: Sequence[Pass]) -> Any:
    """Return a single kernel of several passes, which runs in the caller's thread if that is faster."""
    serial = on_cpu() and passes[0].cells <= FEW_CELLS
    bodies = tuple(part.run for part in passes)

    @ti.kernel
    def run(a: ti.f32, b: ti.f32):
        if ti.static(serial):
            ti.loop_config(serialize=True)
            for _ in range(1):
                for body in ti.static(bodies):
                    body(a, b)
        else:
            for body in ti.static(bodies):
                body(a, b)

    return run


def _launcher(kernel: Any) -> Callable[..., None]:
    """Return ``run(a=0, b=0)``, which launches a kernel of two f32 in 2 us from the second call on (Taichi: 16 us).

    Taichi looks up the instance of a kernel by the kind of each argument, and the compiled kernel by its hash. Here a
    single instance and kernel exist. After a restart of Taichi the kernel is compiled again.
    """
    program: Any = None
    traced: Any = None
    compiled: Any = None

    def run(a: float = 0.0, b: float = 0.0) -> None:
        nonlocal program, compiled, traced
        if impl.get_runtime().prog is not program or program is None:
            if not is_running():
                raise EngineError
            with data_flow_by_llvm():
                kernel(a, b)
                program = impl.get_runtime().prog
                (traced,) = kernel._primal.compiled_kernels.values()
                compiled = program.compile_kernel(program.config(), program.get_device_caps(), traced)
            return
        arguments = traced.make_launch_context()
        arguments.set_arg_float((0,), a)
        arguments.set_arg_float((1,), b)
        program.launch_kernel(compiled, arguments)

    return run


@contextlib.contextmanager
def data_flow_by_llvm() -> Iterator[None]:
    """Context in which kernels compile without Taichi's store-to-load analysis, which LLVM then does.

    The analysis takes up to half of the compile time, as it grows with the square of a kernel's length. The V-cycle
    needs it: without it Taichi 1.7 gives LLVM faulty code for those kernels, and aborts. Taichi's other simplifications
    (`advanced_optimization`) are needed too: without them the flow of the helium box is wrong by a factor of two.
    """
    before, ti.cfg.cfg_optimization = ti.cfg.cfg_optimization, not on_cpu()
    try:
        yield
    finally:
        ti.cfg.cfg_optimization = before
