"""Wall time from the start of a process to the first tick of a scenario, and number of kernels.

    python -m taichi_plume.validation.benchmark start CONFIG ... [--checkout FOLDER ...] [--repeats N] [--arch ARCH]

Each run is a process that imports the code of one checkout: once cold, with an empty kernel cache, then N times warm,
with the cache of the cold run. The warm-up of the scenario is skipped, so that the tick includes robots and maps. As
the file imports nothing of the package around it, it can measure checkouts older than itself.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from importlib import import_module
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
CACHES = ("TI_OFFLINE_CACHE_FILE_PATH", "QD_OFFLINE_CACHE_FILE_PATH")
"""Variables of both engines with the folder of compiled kernels."""


@dataclass(frozen=True)
class Start:
    """Cost of the start of a process up to the first tick; `cold`: with an empty kernel cache."""

    checkout: str
    config: str
    cold: bool
    seconds: float
    cpu_seconds: float
    kernels: int

    def __str__(self) -> str:
        return (
            f"{self.checkout:24} {self.config:20} {'cold' if self.cold else 'warm'}  {self.seconds:6.2f} s "
            f"({self.cpu_seconds:6.2f} of CPU), {self.kernels} kernels"
        )


def first_tick(config: Path, arch: str = "cpu") -> int:
    """Run a scenario to the end of its first tick; return the number of kernels, compiled or cached."""
    from taichi_plume import load_scenario

    engine = os.environ.get("TAICHI_PLUME_ENGINE") or "taichi"
    ti, impl = import_module(engine), import_module(f"{engine}.lang.impl")

    try:
        from taichi_plume.assembly.assemble import assemble
    except ImportError:  # older checkouts
        from taichi_plume.assemble import assemble  # pyright: ignore[reportMissingImports]
    try:
        from taichi_plume.engine import program
    except ImportError:  # older checkouts
        from taichi_plume.grid import kernels as program
    try:
        scenario = load_scenario(config, ["warm_up=0"])
    except ValueError:  # a scenario that requires a warm-up
        scenario = load_scenario(config)
    program.start(arch)
    sim = assemble(scenario, config.parent)
    sim.observe()
    sim.advance()
    ti.sync()
    kernels_of_runtime = impl.get_runtime().kernels
    if compiled := program.compiled():
        return compiled
    # a checkout without `grid.engine`
    return sum(len(kernel.compiled_kernels) for kernel in kernels_of_runtime)


def _measured(checkout: Path, config: Path, cold: bool, cache: str, arch: str) -> Start:
    """Return the cost of the start of a process. Raises RuntimeError if the process fails."""
    environment = os.environ | {"PYTHONPATH": str(checkout), **dict.fromkeys(CACHES, cache)}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)  # the second start of a user finds compiled modules
    command = [sys.executable, __file__, "--tick", str(config), "--arch", arch]
    begin = time.perf_counter()
    with subprocess.Popen(
        command, cwd=checkout, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        line = ""
        while not line.startswith("{"):
            line = process.stdout.readline()
            if not line:
                raise RuntimeError(f"{config.name} in {checkout}:\n{process.communicate()[1]}")
        seconds = time.perf_counter() - begin
        process.communicate()  # the process saves its kernels for the next one
    return Start(checkout.name, config.stem, cold, seconds, **json.loads(line))


def starts(
    checkouts: Sequence[Path], configs: Sequence[str], repeats: int = 1, arch: str = "cpu"
) -> Iterator[Start]:
    """Yield the cost of cold and warm starts of scenarios, given by their name in `configs/` or by path."""
    for name in configs:
        for checkout in (path.resolve() for path in checkouts):
            here = checkout / "configs" / f"{name}.yaml"
            config = here if here.exists() else Path(name).resolve()
            with tempfile.TemporaryDirectory() as cache:
                yield _measured(checkout, config, True, cache, arch)
                for _ in range(repeats):
                    yield _measured(checkout, config, False, cache, arch)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark with these command-line arguments and return its exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m taichi_plume.validation.benchmark start", description=__doc__
    )
    parser.add_argument("configs", nargs="+", metavar="CONFIG", help="scenario: name in configs/, or file")
    parser.add_argument("--checkout", nargs="+", type=Path, default=[ROOT], metavar="FOLDER")
    parser.add_argument("--repeats", type=int, default=1, metavar="N", help="warm starts (default: 1)")
    parser.add_argument("--arch", default="cpu", choices=("auto", "cpu", "cuda", "vulkan", "metal"))
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.add_argument("--tick", action="store_true", help=argparse.SUPPRESS)
    args = parser.parse_args(argv)
    if args.tick:
        kernels = first_tick(Path(args.configs[0]), args.arch)
        print(json.dumps({"kernels": kernels, "cpu_seconds": sum(os.times()[:4])}), flush=True)
        return 0
    rows = []
    for row in starts(args.checkout, args.configs, args.repeats, args.arch):
        rows.append(row)
        if not args.json:
            print(row, flush=True)
    if args.json:
        print(json.dumps([asdict(row) for row in rows], indent=2))
    return 0


if __name__ == "__main__":
    sys.exit(main())
