"""How fast whole steps are, beside the memory bandwidth of the same minute.

python -m taichi_plume.validation.benchmark [NAMES] [--pressure] [--json] [--arch ARCH] [--seconds S]

A step is the flow with its eddy viscosity and one gas, as a run takes it; puffs, robots and maps are measured by
themselves. With --pressure, only the pressure is solved, of cubes of N³ cells with obstacles: how its iterations grow
with N. Every figure is a rate on a machine that may be shared: compare the ratios to the bandwidth, and rates of one
run with each other.
"""

import argparse
import json
import os
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import taichi as ti
from pydantic import TypeAdapter

from taichi_plume.grid import kernels
from taichi_plume.grid.cut_cells import Air, air_of
from taichi_plume.grid.grid import Grid
from taichi_plume.scenario.domain import Domain
from taichi_plume.scenario.gases import EulerianGas
from taichi_plume.scenario.obstacles import Obstacle
from taichi_plume.scenario.resources import shape as shape_of
from taichi_plume.scenario.winds import CfdWind
from taichi_plume.solvers.flow import FlowSolver
from taichi_plume.solvers.gas import EulerianSolver
from taichi_plume.solvers.patches import periodic_axes
from taichi_plume.validation import map_benchmark, puff_benchmark, robot_benchmark, trial_benchmark

ARENA = (
    {"kind": "honeycomb", "face": "x-", "speed": 0.7},
    {"kind": "honeycomb", "face": "x+", "loss_coefficient": 2.0},
)

SIDES = (64, 96, 128)  # N of the cubes whose pressure is solved


@dataclass(frozen=True)
class Measured:
    """One case; bandwidth in GB/s."""

    case: str
    cells: int
    Mcell_steps_per_s: float
    ms_per_step: float
    pressure_iterations: float
    first_step_s: float
    bytes_per_cell: float
    bandwidth: float

    def __str__(self) -> str:
        return (
            f"{self.case:16} {self.cells:8,} cells  {self.Mcell_steps_per_s:6.2f} Mcell-steps/s  "
            f"{self.ms_per_step:7.2f} ms/step  {self.pressure_iterations:4.1f} iterations  "
            f"first step {self.first_step_s:5.1f} s  {self.bytes_per_cell:5.0f} B/cell  "
            f"bandwidth {self.bandwidth:4.1f} GB/s"
        )


def bandwidth(size: int = 1 << 24) -> float:
    """Memory bandwidth [GB/s] of a = b + s c in NumPy on all cores: five arrays pass, three read and two written."""
    threads = os.cpu_count() or 1
    a, b, c = (np.ones(size, np.float32) for _ in range(3))
    parts = np.array_split(np.arange(size), threads)
    spans = [slice(int(part[0]), int(part[-1]) + 1) for part in parts]

    def triad(span: slice) -> None:
        for begin in range(span.start, span.stop, 1 << 22):
            chunk = slice(begin, min(begin + (1 << 22), span.stop))
            np.multiply(c[chunk], 3.0, out=a[chunk])
            np.add(a[chunk], b[chunk], out=a[chunk])

    with ThreadPoolExecutor(threads) as pool:
        times = []
        for _ in range(5):
            begin = time.perf_counter()
            list(pool.map(triad, spans))
            times.append(time.perf_counter() - begin)
    return 5 * 4 * size / min(times) / 1e9


OBSTACLES = (
    {"kind": "box", "center": (2.4, 2.35, 0.25), "size": (0.4, 0.3, 0.5)},
    {"kind": "box", "center": (2.3, 0.9, 0.25), "size": (0.36, 0.36, 0.5), "yaw_deg": 20.0},
    {"kind": "cylinder", "center": (1.0, 1.9), "radius": 0.12},
)


def arena(shape: tuple[int, ...], obstacles: bool, periodic: tuple[bool, ...] = ()) -> tuple[Grid, Air]:
    """The 4 x 3 (x 0.5) m odour arena, with two boxes and a pillar."""
    grid = Grid(shape, 4.0 / shape[0], depth=0.5, periodic=periodic)
    domain = Domain(size=grid.extent, spacing=grid.dx)
    bodies = [TypeAdapter(Obstacle).validate_python(o) for o in OBSTACLES] if obstacles else []
    return grid, air_of([shape_of(body, domain, Path()) for body in bodies], grid)


def arena_step(shape: tuple[int, ...], obstacles: bool) -> tuple[FlowSolver, Callable[[], None]]:
    """The solver and one whole step of flow, eddies and gas."""
    grid, air = arena(shape, obstacles)
    flow = FlowSolver(CfdWind.model_validate({"kind": "cfd", "openings": ARENA}), grid, air)
    source = {"position": (0.6, 1.3, 0.1)[: len(shape)], "rate": 2e-5}
    gas = EulerianSolver(
        EulerianGas.model_validate({"kind": "eulerian", "sources": [source]}), grid, flow, air
    )

    def step() -> None:
        dt = flow.stable_dt()
        flow.advance(0.0, dt)
        gas.advance(0.0, dt)

    return flow, step


def periodic_step(shape: tuple[int, ...]) -> tuple[FlowSolver, Callable[[], None]]:
    """The solver and one step of the flow alone in a periodic box."""
    openings = tuple({"kind": "periodic", "axis": axis} for axis in "xyz"[: len(shape)])
    wind = CfdWind.model_validate(
        {"kind": "cfd", "viscosity": 1e-3, "turbulence": {"kind": "none"}, "openings": openings}
    )
    grid = Grid(shape, 2 * np.pi / shape[0], periodic=periodic_axes(wind.openings, len(shape)))
    flow = FlowSolver(wind, grid, Air.everywhere(grid))
    rng = np.random.default_rng(0)
    k = rng.integers(1, 4, (3, 3))

    def vortices(x: np.ndarray) -> np.ndarray:
        return np.stack([np.sin((x * k[d, : x.shape[-1]]).sum(-1) + d) for d in range(x.shape[-1])], axis=-1)

    flow.start_from(vortices)
    return flow, lambda: flow.advance(0.0, flow.stable_dt())


CASES: dict[str, Callable[[], tuple[FlowSolver, Callable[[], None]]]] = {
    "arena_2d": lambda: arena_step((200, 150), True),
    "arena_2d_empty": lambda: arena_step((200, 150), False),
    "arena_3d_coarse": lambda: arena_step((80, 60, 10), True),
    "arena_3d": lambda: arena_step((200, 150, 25), True),
    "arena_3d_empty": lambda: arena_step((200, 150, 25), False),
    "box_2d": lambda: periodic_step((256, 256)),
    "box_3d": lambda: periodic_step((64, 64, 64)),
}


# ---------------------------------------------------------------- puffs, robots and maps


def _arena_puffs(puffs: int) -> puff_benchmark.PuffSolver:
    return puff_benchmark.in_arena(*arena((80, 60, 10), True), ARENA, puffs)


OTHER_CASES: dict[str, Callable[[str], Sequence[Any]]] = {
    "puffs_step": lambda arch: puff_benchmark.step("puffs_step", arch, _arena_puffs),
    "puffs_query": lambda arch: [
        *puff_benchmark.query("puffs_query room", arch, puff_benchmark.in_room),
        *puff_benchmark.query("puffs_query arena", arch, _arena_puffs),
    ],
    "robots": lambda arch: [
        robot_benchmark.ticks("robots", arch, algorithm) for algorithm in ("casting", "spiral")
    ],
    "spiral_trials": lambda arch: trial_benchmark.spiral_trials("spiral_trials", arch),
    "maps": map_benchmark.maps,
}


# ---------------------------------------------------------------- the pressure alone


@dataclass(frozen=True)
class Solved:
    """One solve of the pressure in a closed room with obstacles."""

    N: int
    cells: int
    right_side: str
    solver: str
    tolerance: float
    iterations: int
    residual: float
    """Largest of any cell, over the largest entry of the right side, reckoned anew from the solution.

    That of a smooth right side stays above the tolerance: phi is then of size N², and so is its rounding.
    """
    ms: float
    Mcell_per_s: float

    def __str__(self) -> str:
        return (
            f"{self.N:4}³ {self.right_side:7} {self.solver:12} {self.iterations:3} iterations to "
            f"{self.residual:.1e}  {self.ms:8.1f} ms  {self.Mcell_per_s:6.2f} Mcells/s"
        )


def cluttered(n: int) -> tuple[Grid, np.ndarray]:
    """A cube of 1 m with two boxes and a pillar, n cells along each edge."""
    grid = Grid((n, n, n), 1.0 / n)
    x = grid.centers()
    solid = (np.abs(x - (0.3, 0.35, 0.2)) < (0.12, 0.1, 0.2)).all(axis=-1)
    solid |= (np.abs(x - (0.65, 0.7, 0.6)) < (0.15, 0.06, 0.1)).all(axis=-1)
    solid |= np.hypot(x[..., 0] - 0.7, x[..., 1] - 0.25) < 0.08
    return grid, solid


def right_sides(grid: Grid, air: np.ndarray) -> dict[str, np.ndarray]:
    """Of largest entry 1: the divergence of random velocities, which is rough, a smooth field, and their sum."""
    rng = np.random.default_rng(0)
    rough = np.zeros(grid.shape)
    for d in range(grid.dim):
        faces = rng.standard_normal(grid.shape) * air * np.roll(air, 1, axis=d)
        np.moveaxis(faces, d, 0)[0] = 0.0
        rough += faces - np.roll(faces, -1, axis=d)
    smooth = np.prod(np.cos(np.pi * grid.centers()), axis=-1)
    smooth = np.where(air, smooth - smooth[air].mean(), 0.0)
    rough, smooth = (b / np.abs(b).max() for b in (rough, smooth))
    both = rough + smooth
    return {"random": rough, "smooth": smooth, "both": both / np.abs(both).max()}


def solve_pressure(n: int, arch: str, tolerance: float = 1e-4) -> list[Solved]:
    """Solve the pressure in a cube of n³ cells for each right side, down to `tolerance` of its largest entry."""
    kernels.start(arch)
    grid, solid = cluttered(n)
    flow = FlowSolver(CfdWind.model_validate({"kind": "cfd"}), grid, Air.of(solid, grid))
    b, phi = grid.field(), grid.field()
    openness = [grid.inner(field.to_numpy()) > 0 for field in flow.open]
    rows = []
    for name, values in right_sides(grid, ~solid).items():
        grid.write(b, values)
        seconds = []
        for _ in range(3):
            begin = time.perf_counter()
            flow.solver.solve(b, phi, tolerance)
            ti.sync()
            seconds.append(time.perf_counter() - begin)
        solution, applied = grid.read(phi).astype(float), np.zeros(grid.shape)
        for d, is_open in enumerate(openness):
            flux = (solution - np.roll(solution, 1, axis=d)) * is_open
            applied += flux - np.roll(flux, -1, axis=d)
        residual = float(np.abs(applied - values).max())
        cells, best = prod(grid.shape), min(seconds)
        solver = type(flow.solver).__name__
        rows.append(
            Solved(
                n,
                cells,
                name,
                solver,
                tolerance,
                flow.solver.iterations,
                residual,
                1e3 * best,
                cells / best / 1e6,
            )
        )
    return rows


def measure(name: str, arch: str, seconds: float) -> Measured:
    """Run a case for about `seconds` after its first steps."""
    rate = bandwidth()
    kernels.start(arch)
    process = psutil.Process()
    before = process.memory_info().rss
    begin = time.perf_counter()
    flow, step = CASES[name]()
    step()
    ti.sync()
    first = time.perf_counter() - begin
    memory = process.memory_info().rss - before
    for _ in range(10):  # past the start from rest
        step()
    ti.sync()
    iterations, steps, begin = 0, 0, time.perf_counter()
    while time.perf_counter() - begin < seconds:
        step()
        iterations += flow.solver.iterations
        steps += 1
    ti.sync()
    per_step = (time.perf_counter() - begin) / steps
    cells = prod(flow.grid.shape)
    return Measured(
        name, cells, cells / per_step / 1e6, 1e3 * per_step, iterations / steps, first, memory / cells, rate
    )


def main(argv: list[str] | None = None) -> int:
    """Measure the named cases, or all of them."""
    known = [*CASES, *OTHER_CASES]
    parser = argparse.ArgumentParser(prog="python -m taichi_plume.validation.benchmark", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(known)}")
    parser.add_argument(
        "--pressure", action="store_true", help="iterations of the pressure solver against N instead"
    )
    parser.add_argument("--arch", default="cpu", choices=("auto", "cpu", "cuda", "vulkan", "metal"))
    parser.add_argument("--seconds", type=float, default=8.0, help="per case (default: 8)")
    parser.add_argument("--json", action="store_true", help="print JSON")
    args = parser.parse_args(argv)
    unknown = [name for name in args.names if name not in known]
    if unknown:
        print(f"unknown case {unknown[0]!r}; known: {', '.join(known)}", file=sys.stderr)
        return 2
    rows: list[Any] = []

    def tell(found: Sequence[Any]) -> None:
        rows.extend(found)
        if not args.json:
            for row in found:
                print(row, flush=True)

    for n in SIDES if args.pressure else ():
        tell(solve_pressure(n, args.arch))
    for name in () if args.pressure else args.names or known:
        tell(
            OTHER_CASES[name](args.arch) if name in OTHER_CASES else [measure(name, args.arch, args.seconds)]
        )
    if args.json:
        print(json.dumps([asdict(row) for row in rows], indent=2))
    return 0


if __name__ == "__main__":
    sys.exit(main())
