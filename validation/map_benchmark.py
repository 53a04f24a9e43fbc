"""How fast online gas maps are: snaps, updates by Gaussian weights, and Markov fields, early and late in a run."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import taichi as ti
from pydantic import TypeAdapter

from taichi_plume import kernels
from taichi_plume.agents.mapping import Mapper
from taichi_plume.assemble import mapper
from taichi_plume.map_models import Map

TICK = 0.1  # s
WINDOW = 5.0  # s
WARM_UP = 12  # windows, the first minute
LATE = 720  # windows, an hour
ROBOTS = 5  # of a trial: 250 readings per window
MEASURED = 8  # windows


class Robots:
    """What a map sees of robots that jump about the floor."""

    def __init__(self, trials: int, extent: tuple[float, float]):
        n = trials * ROBOTS
        self.rng, self.extent = np.random.default_rng(0), extent
        self.believed_position: Any = ti.Vector.field(2, ti.f32, n)
        self.reading, self.wind_known = ti.field(ti.f32, n), ti.field(ti.i32, n)
        self.members, self.team_size = ti.field(ti.i32, (trials, ROBOTS)), ti.field(ti.i32, trials)
        self.members.from_numpy(np.arange(n, dtype=np.int32).reshape(trials, ROBOTS))
        self.team_size.fill(ROBOTS)

    def wander(self) -> None:
        """Be and read anything."""
        n = self.reading.shape[0]
        self.believed_position.from_numpy(self.rng.uniform(0, self.extent, (n, 2)).astype(np.float32))
        self.reading.from_numpy(self.rng.exponential(20.0, n).astype(np.float32))


@dataclass(frozen=True)
class MapCost:
    """Of a window of 5 s, 50 updates, and of asking for the estimate at its end: medians [ms] of what passes and of the
    time of all cores; `last_` of the tick that ends the window.
    """

    case: str
    cells: tuple[int, int]
    trials: int
    minute: int
    window_ms: float
    cpu_ms: float
    last_ms: float
    last_cpu_ms: float
    estimate_ms: float

    def __str__(self) -> str:
        size = f"{self.cells[0]} x {self.cells[1]} cells x {self.trials}"
        return (
            f"{self.case:28} {size:22} minute {self.minute:2}  window {self.window_ms:7.2f} ms "
            f"({self.cpu_ms:7.2f} of CPU), its last tick {self.last_ms:6.2f} ({self.last_cpu_ms:6.2f} of CPU), "
            f"estimate {self.estimate_ms:6.2f} ms"
        )


def _timed(work: Callable[[], object]) -> np.ndarray:
    """Milliseconds that pass, and of all cores."""
    ti.sync()
    begin, cpu = time.perf_counter(), time.process_time()
    work()
    ti.sync()
    return 1e3 * np.array([time.perf_counter() - begin, time.process_time() - cpu])


def cost(case: str, arch: str, keys: dict, extent: tuple[float, float], trials: int) -> list[MapCost]:
    """In the first minute and, for single trials, after an hour of 5 robots at 10 Hz."""
    kernels.start(arch)
    model = TypeAdapter(Map).validate_python(keys)
    one = mapper(model, extent, trials, lambda points: np.full(points.shape[:-1], np.inf))
    robots = Robots(trials, extent)
    result = []
    window = 0
    for until, minute in ((WARM_UP, 1), (LATE, 60)):
        if minute > 1 and trials > 1:
            break
        while window < until - MEASURED:
            _window(one, robots, window)
            window += 1
        parts = []
        for _ in range(MEASURED):
            parts.append(_window(one, robots, window))
            window += 1
        whole, last, asked = np.median(parts, axis=0)
        cells = one.estimate().shape[1:]
        result.append(MapCost(case, cells, trials, minute, *whole, *last, asked[0]))
    return result


def _window(one: Mapper, robots: Robots, number: int) -> np.ndarray:
    """Times of all updates of a window, of the last of them, and of the estimate, (3, 2) [ms]."""
    first = round(number * WINDOW / TICK)
    ticks = round(WINDOW / TICK)
    spent = []
    for tick in range(first + 1, first + ticks + 1):
        robots.wander()
        spent.append(_timed(lambda tick=tick: one.update(robots, tick, tick * TICK, TICK)))
    return np.array([np.sum(spent, axis=0), spent[-1], _timed(one.estimate)])


CASES: dict[str, tuple[dict, tuple[float, float], int]] = {
    "time series": ({"kind": "time_series", "cell": 0.05}, (4.0, 3.0), 1),
    "time series, trials": ({"kind": "time_series", "cell": 0.25}, (4.0, 3.0), 1000),
    "kernel": ({"kind": "kernel_dmv", "cell": 0.05}, (4.0, 3.0), 1),
    "Markov field": ({"kind": "gmrf", "cell": 0.05}, (4.0, 3.0), 1),
}


def maps(arch: str) -> list[MapCost]:
    """All cases."""
    return [
        row
        for case, (keys, extent, trials) in CASES.items()
        for row in cost(case, arch, keys, extent, trials)
    ]
