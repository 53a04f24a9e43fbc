"""Speed of Gaussian puffs: a whole time step, and the concentration at many points."""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from taichi_plume.engine import program, ti
from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.fields import concentration_at
from taichi_plume.grid.grid import Grid
from taichi_plume.solvers.flow import FlowSolver
from taichi_plume.solvers.puffs import PuffSolver
from taichi_plume.validation.setups import cfd, puffs_on, uniform

STEP = 0.05  # s
LONGEST = 30.0  # s, to fill the room
QUERIES = 1000
REPEATS = 15


@dataclass(frozen=True)
class PuffStep:
    """Cost of a whole time step of puffs: release, motion, walls, sorting."""

    case: str
    puffs: int
    ms_per_step: float
    cpu_ms_per_step: float
    first_step_s: float

    def __str__(self) -> str:
        return (
            f"{self.case:18} {self.puffs:7,} puffs  {self.ms_per_step:7.2f} ms/step "
            f"({self.cpu_ms_per_step:.2f} of CPU time)  "
            f"first step {self.first_step_s:5.1f} s"
        )


@dataclass(frozen=True)
class PuffQuery:
    """Cost of a query of the concentration at many points; seeing: puffs that reach a point, on average."""

    case: str
    where: str
    puffs: int
    queries: int
    seeing: float
    ms: float
    cpu_ms: float

    def __str__(self) -> str:
        return (
            f"{self.case:18} {self.puffs:7,} puffs  {self.ms:7.2f} ms ({self.cpu_ms:.2f} of CPU time) for "
            f"{self.queries:,} points {self.where}, "
            f"each reached by {self.seeing:,.0f} puffs"
        )


def filled(gas: PuffSolver, puffs: int) -> tuple[float, float]:
    """Release puffs until there are `puffs`; return the time [s] and the wall time of the first step [s]."""
    begin = time.perf_counter()
    gas.advance(0.0, STEP)
    ti.sync()
    first, t = time.perf_counter() - begin, STEP
    while gas.puffs.count < puffs and t < LONGEST:
        gas.advance(t, STEP)
        t += STEP
    return t, first


def in_arena(grid: Grid, air: Air, openings: tuple, puffs: int) -> PuffSolver:
    """Return puffs in a frozen computed flow through the arena, with a small velocity fluctuation."""
    flow = FlowSolver(cfd(openings), grid, air)
    for _ in range(50):
        flow.advance(0.0, flow.stable_dt())
    source = {"position": (0.6, 1.3, 0.1), "rate": 2e-5}
    keys = {"sources": [source], "release_rate": puffs / 5.0, "most": 2 * puffs, "fluctuation": 0.05}
    return puffs_on(grid, flow, air, **keys)


def in_room(puffs: int) -> PuffSolver:
    """Return puffs in a room of 10 x 6 x 2.6 m with a wind of 0.5 m/s."""
    grid = Grid((100, 60, 26), 0.1)
    source = {"position": (1.0, 3.0, 1.3), "rate": 2e-5}
    keys = {"sources": [source], "release_rate": puffs / 17.0, "most": 2 * puffs}
    return puffs_on(grid, uniform(grid, 0.5), **keys)


def median_ms(work: Callable[[int], object]) -> tuple[float, float]:
    """Return median wall and CPU time of repeated calls of work(n) [ms]; CPU time of all cores together."""
    times = []
    for n in range(REPEATS):
        begin = time.perf_counter(), time.process_time()
        work(n)
        ti.sync()
        times.append((time.perf_counter() - begin[0], time.process_time() - begin[1]))
    wall, cpu = 1e3 * np.median(times, axis=0)
    return float(wall), float(cpu)


def step(case: str, arch: str, make: Callable[[int], PuffSolver], puffs: int = 100_000) -> list[PuffStep]:
    """Return the cost of whole time steps of about `puffs` puffs."""
    program.start(arch)
    gas = make(puffs)
    t, first = filled(gas, puffs)
    ms = median_ms(lambda n: gas.advance(t + n * STEP, STEP))
    return [PuffStep(case, gas.puffs.count, *ms, first)]


def query(case: str, arch: str, make: Callable[[int], PuffSolver], puffs: int = 200_000) -> list[PuffQuery]:
    """Return the cost of queries of the concentration at random points and at centres of puffs."""
    program.start(arch)
    gas = make(puffs)
    filled(gas, puffs)
    count = gas.puffs.count
    rows = gas.puffs.rows()
    centers, reach = rows[:, :3], 3.5 * np.sqrt(rows[:, gas.puffs.variance])
    rng = np.random.default_rng(0)
    places = {
        "anywhere": rng.random((QUERIES, 3)) * gas.grid.extent,
        "in the plume": centers[rng.integers(count, size=QUERIES)],
    }
    rows = []
    for where, points in places.items():
        flat = points.astype(np.float32)
        concentration_at(gas, flat, 0.0)  # compiles
        seeing = [(np.linalg.norm(centers - p, axis=1) < reach).sum() for p in points[:50]]
        ms = median_ms(lambda n, flat=flat: concentration_at(gas, flat, 0.0))
        rows.append(PuffQuery(case, where, count, QUERIES, float(np.mean(seeing)), *ms))
    return rows
