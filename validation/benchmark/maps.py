"""Speed of online gas maps: time series, kernel DM+V and Gauss-Markov random fields, early and late in a run."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import isnan
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from taichi_plume.agents.gas_map import Floor
from taichi_plume.agents.mapping import mappers
from taichi_plume.engine import program, ti
from taichi_plume.scenario.maps import Map

WINDOW = 5.0  # s
WARM_UP = 12  # windows, the first minute
LATE = 720  # windows, an hour
READINGS = 250  # per window and trial, e.g. 5 robots at 10 Hz
MEASURED = 8  # windows
WAKING = 300  # terms: about 40 ms on two cores


class Robots:
    """Stand-in for the swarm that maps read: robots at random positions, `team` per trial."""

    def __init__(self, trials: int, team: int, extent: tuple[float, float]):
        n = trials * team
        self.rng, self.extent = np.random.default_rng(0), extent
        self.believed_position: Any = ti.vector_field(2, ti.f32, n)
        self.wind: Any = ti.vector_field(2, ti.f32, n)
        self.reading, self.wind_known = ti.field(ti.f32, n), ti.field(ti.i32, n)
        self.members, self.team_size = ti.field(ti.i32, (trials, team)), ti.field(ti.i32, trials)
        self.members.from_numpy(np.arange(n, dtype=np.int32).reshape(trials, team))
        self.team_size.fill(team)

    def wander(self) -> None:
        """Set random positions and readings of all robots."""
        n = self.reading.shape[0]
        self.believed_position.from_numpy(self.rng.uniform(0, self.extent, (n, 2)).astype(np.float32))
        self.reading.from_numpy(self.rng.exponential(20.0, n).astype(np.float32))


@dataclass(frozen=True)
class MapCost:
    """Cost of a window of 5 s with 250 readings per trial: medians [ms] of wall time and of CPU time of all cores.

    `last_`: tick that ends the window, with all cores awake. estimate_ms, variance_ms: reading the first map; NaN if a
    map has no variance.
    """

    case: str
    ticks: int
    cells: tuple[int, int]
    trials: int
    minute: int
    window_ms: float
    cpu_ms: float
    last_ms: float
    last_cpu_ms: float
    estimate_ms: float
    variance_ms: float

    def __str__(self) -> str:
        size = f"{self.cells[0]} x {self.cells[1]} cells x {self.trials}"
        return (
            f"{self.case:20} {size:22} minute {self.minute:2}  {self.ticks:2} ticks {self.window_ms:7.2f} ms "
            f"({self.cpu_ms:7.2f} of CPU), the last {self.last_ms:6.2f} ({self.last_cpu_ms:6.2f} of CPU), "
            f"estimate {self.estimate_ms:6.2f} ms"
            + ("" if isnan(self.variance_ms) else f", variance {self.variance_ms:6.2f} ms")
        )


def _timed(work: Callable[[], object]) -> np.ndarray:
    """Return wall time and CPU time [ms] of a call of `work`."""
    ti.sync()
    begin, cpu = time.perf_counter(), time.process_time()
    work()
    ti.sync()
    return 1e3 * np.array([time.perf_counter() - begin, time.process_time() - cpu])


@ti.kernel
def _wake(sums: int) -> float:
    """Keep all cores busy, as the flow step does in a run: a sleeping core may take 15 ms to wake up."""
    total = 0.0
    for i in range(1 << 14):
        part = 0.0
        for n in range(sums):
            part += ti.sin(1.0 * n + i)
        total += part
    return total


def cost(
    case: str, arch: str, keys: list[dict], extent: tuple[float, float], trials: int, ticks: int = 50
) -> list[MapCost]:
    """Return the cost of several maps at once, in the first minute of a run and after an hour."""
    program.start(arch)
    models = TypeAdapter(list[Map]).validate_python(keys)
    made = mappers(models, Floor(extent, trials, READINGS // ticks, WINDOW / ticks))
    robots = Robots(trials, READINGS // ticks, extent)
    result = []
    window = 0
    for until, minute in ((WARM_UP, 1), (LATE, 60)):
        while window < until - MEASURED:
            _window(made, robots, window, ticks)
            window += 1
        parts = []
        for _ in range(MEASURED):
            parts.append(_window(made, robots, window, ticks))
            window += 1
        spent = np.median(parts, axis=0).ravel()[[0, 1, 2, 3, 4, 6]].tolist()
        cells = made[0].estimate().shape[1:]
        result.append(MapCost(case, ticks, cells, trials, minute, *spent))
    return result


def _window(made: Sequence[Any], robots: Robots, number: int, ticks: int) -> np.ndarray:
    """Return times of all updates of a window, the last update, the estimate and the variance, (4, 2) [ms]."""
    first, dt = number * ticks, WINDOW / ticks
    spent = []
    for tick in range(first + 1, first + ticks + 1):
        robots.wander()
        if tick == first + ticks:
            _wake(WAKING)
        spent.append(_timed(lambda tick=tick: [mapper.update(robots, tick * dt, dt) for mapper in made]))
    variance = getattr(made[0], "variance", None)
    unsure = _timed(variance) if variance else np.full(2, np.nan)
    return np.array([np.sum(spent, axis=0), spent[-1], _timed(made[0].estimate), unsure])


ARENA = (4.0, 3.0)  # m
FINE, COARSE = 0.05, 0.25  # m: 80 x 60 and 16 x 12 cells
PAPER = [{"kind": "time_series", "alpha": alpha} for alpha in (0.4, 0.6, 0.8, 0.9, 0.95, 0.98)]
CASES: dict[str, tuple[list[dict], tuple[float, float], int, int]] = {
    "time series": ([{"kind": "time_series", "cell": FINE}], ARENA, 1, 50),
    "time series, trials": ([{"kind": "time_series", "cell": COARSE}], ARENA, 1000, 50),
    "six time series": (PAPER, ARENA, 1000, 50),
    "kernel": ([{"kind": "kernel_dmv", "cell": FINE}], ARENA, 1, 50),
    "kernel, at once": ([{"kind": "kernel_dmv", "cell": FINE}], ARENA, 1, 1),
    "Markov field": ([{"kind": "gmrf", "cell": FINE}], ARENA, 1, 50),
}


def maps(arch: str) -> list[MapCost]:
    """Return the costs of all cases of gas maps."""
    return [row for case, about in CASES.items() for row in cost(case, arch, *about)]
