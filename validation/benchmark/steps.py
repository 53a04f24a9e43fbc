"""Speed of time steps of a flow with eddy viscosity and one gas, compared with the memory bandwidth."""

import os
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from math import prod

import numpy as np
import psutil

from taichi_plume.engine import program, ti
from taichi_plume.grid.blas import one_blas_thread
from taichi_plume.solvers.flow import FlowSolver
from taichi_plume.solvers.gas import EulerianSolver
from taichi_plume.validation.arena import ARENA, arena
from taichi_plume.validation.flow_cases import laminar_flow, periodic
from taichi_plume.validation.setups import cfd, gas_on


@dataclass(frozen=True)
class Measured:
    """Figures of a case of time steps; bandwidth in GB/s. wall_per_simulated: wall time per simulated second."""

    case: str
    cells: int
    Mcell_steps_per_s: float
    ms_per_step: float
    wall_per_simulated: float
    pressure_iterations: float
    first_step_s: float
    bytes_per_cell: float
    bandwidth: float

    def __str__(self) -> str:
        return (
            f"{self.case:16} {self.cells:8,} cells  {self.Mcell_steps_per_s:6.2f} Mcell-steps/s  "
            f"{self.ms_per_step:7.2f} ms/step  {self.wall_per_simulated:6.3f} s/s  "
            f"{self.pressure_iterations:4.1f} iterations  first step {self.first_step_s:5.1f} s  "
            f"{self.bytes_per_cell:5.0f} B/cell  bandwidth {self.bandwidth:4.1f} GB/s"
        )


def bandwidth(size: int = 1 << 24) -> float:
    """Return the memory bandwidth [GB/s] of the triad a = b + s c in NumPy on all cores: three reads, two writes."""
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


def arena_flow(
    shape: tuple[int, ...], obstacles: bool
) -> tuple[FlowSolver, EulerianSolver, Callable[[], float]]:
    """Return the solvers of flow and gas, and a function that advances both by a step and returns dt [s]."""
    grid, air = arena(shape, obstacles)
    flow = FlowSolver(cfd(ARENA), grid, air)
    source = {"position": (0.6, 1.3, 0.1)[: len(shape)], "rate": 2e-5}
    gas = gas_on(grid, flow, air, sources=[source])

    @one_blas_thread
    def step() -> float:
        dt = flow.stable_dt()
        flow.advance(0.0, dt)
        gas.advance(0.0, dt)
        return dt

    return flow, gas, step


def arena_step(shape: tuple[int, ...], obstacles: bool) -> tuple[FlowSolver, Callable[[], float]]:
    """Return the flow solver, and a function that advances flow and gas by a step and returns dt [s]."""
    flow, _, step = arena_flow(shape, obstacles)
    return flow, step


def periodic_step(shape: tuple[int, ...]) -> tuple[FlowSolver, Callable[[], float]]:
    """Return the flow solver of a periodic box, and a function that advances it by a step and returns dt [s]."""
    flow = laminar_flow(shape, 2 * np.pi / shape[0], 1e-3, periodic("xyz"[: len(shape)]))
    rng = np.random.default_rng(0)
    k = rng.integers(1, 4, (3, 3))

    def vortices(x: np.ndarray) -> np.ndarray:
        return np.stack([np.sin((x * k[d, : x.shape[-1]]).sum(-1) + d) for d in range(x.shape[-1])], axis=-1)

    @one_blas_thread
    def step() -> float:
        dt = flow.stable_dt()
        flow.advance(0.0, dt)
        return dt

    flow.start_from(vortices)
    return flow, step


CASES: dict[str, Callable[[], tuple[FlowSolver, Callable[[], float]]]] = {
    "arena_2d": lambda: arena_step((200, 150), True),
    "arena_2d_empty": lambda: arena_step((200, 150), False),
    "arena_3d_coarse": lambda: arena_step((80, 60, 10), True),
    "arena_3d": lambda: arena_step((200, 150, 25), True),
    "arena_3d_empty": lambda: arena_step((200, 150, 25), False),
    "box_2d": lambda: periodic_step((256, 256)),
    "box_3d": lambda: periodic_step((64, 64, 64)),
}


def measure(name: str, arch: str, seconds: float) -> Measured:
    """Run the case `name` for about `seconds` after its first steps, and return its figures."""
    rate = bandwidth()
    program.start(arch)
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
    iterations, steps, simulated, begin = 0, 0, 0.0, time.perf_counter()
    while time.perf_counter() - begin < seconds:
        simulated += step()
        iterations += flow.solver.iterations
        steps += 1
    ti.sync()
    wall, cells = time.perf_counter() - begin, prod(flow.grid.shape)
    per_step = wall / steps
    speeds = cells / per_step / 1e6, 1e3 * per_step, wall / simulated
    return Measured(name, cells, *speeds, iterations / steps, first, memory / cells, rate)
