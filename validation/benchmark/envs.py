"""Speed of reinforcement-learning environments: a film played to thousands of episodes in one process.

    python -m taichi_plume.validation.benchmark envs [--arch ARCH] [--count N] [--seconds S] [--json]

Steps are counted as in `gymnasium.utils.performance`: random actions are drawn beforehand and the warm-up is not timed.
Only environments that step are counted, not those that reset in between. Reset times are medians.
"""

import json
import os
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import psutil

from taichi_plume.guard.terminal import Parser, say
from taichi_plume.validation.case import Keys

COUNT = 4096
RESETS = 10_000
FILMS, FRAMES = 4, 241
ACTIONS = 16  # different batches, in turn
TASK: Keys = {
    "duration": 60.0,
    "domain": {"size": [4.0, 3.0], "spacing": 0.04, "depth": 0.5},
    "wind": {"kind": "uniform", "velocity": [0.5, 0.0]},
    "gas": {
        "kind": "gaussian_plume",
        "species": "acetone",
        "intensity": 0.1,
        "sources": [{"position": [0.6, 1.5], "rate": "20 mg/s"}],
    },
    "obstacles": [{"kind": "box", "center": [2.0, 1.0], "size": [0.3, 0.4]}],
    "robots": [
        {
            "name": "learners",
            "count": 1,
            "start": {"kind": "area", "low": [2.5, 0.3], "high": [3.7, 2.7]},
            "algorithm": {"kind": "policy"},
            "sensors": {"gas": {"kind": "mox", "spread": 0.3}, "wind": {"kind": "ultrasonic"}},
        }
    ],
}
TARGETS = {"vector": 1e6, "single": 2e3}
"""Least steps per second, of COUNT environments and of a single environment."""
RESET_MS = 5.0


@dataclass(frozen=True)
class Measured:
    """Measured figure and its target; cpu_us: CPU time of all cores per step of an environment, for rates."""

    case: str
    figure: float
    unit: str
    target: str
    cpu_us: float = 0.0

    def __str__(self) -> str:
        cpu = f", {self.cpu_us:.2f} us of CPU each" if self.cpu_us else ""
        return f"{self.case:36} {self.figure:12,.2f} {self.unit:8} (target: {self.target}{cpu})"


def films() -> Any:
    """Return a bank of films of random noise: playback takes as long as that of a computed flow."""
    rng = np.random.default_rng(0)
    shape = (FILMS, FRAMES, 100, 75)
    values = np.empty((*shape, 3), np.float16)
    for film in values:
        film[..., 0] = rng.normal(0.5, 0.1, shape[1:])
        film[..., 1] = rng.normal(0.0, 0.1, shape[1:])
        film[..., 2] = rng.gamma(0.5, 20.0, shape[1:])
    from taichi_plume.scenario.species import SPECIES

    return SimpleNamespace(
        values=values,
        scale=np.ones((FILMS, 1), np.float32),
        air=np.ones((2, *shape[2:])),
        spacing=0.04,
        frame=0.5,
        species=(SPECIES["acetone"],),
        sources=((np.array([[0.6, 1.5]]),),) * FILMS,
        films=FILMS,
        length=(FRAMES - 1) * 0.5,
    )


def rate(engine: Any, seconds: float) -> tuple[float, float]:
    """Return an engine's environment steps per second, and CPU time of all cores per step [s]."""
    rng = np.random.default_rng(1)
    shape = (engine.count * engine.robots, engine.action_size)
    batches = [rng.uniform(-1.0, 1.0, shape).astype(np.float32) for _ in range(ACTIONS)]
    engine.reset(np.arange(engine.count, dtype=np.uint64))
    for actions in batches:
        engine.step(actions)
    steps, k, over = 0, 0, engine.terminated | engine.truncated
    cpu, begin = time.process_time(), time.perf_counter()
    while time.perf_counter() - begin < seconds:
        engine.step(batches[k % ACTIONS])
        steps += engine.count - int(over.sum())  # finished episodes were reset instead
        over = engine.terminated | engine.truncated
        k += 1
    return steps / (time.perf_counter() - begin), (time.process_time() - cpu) / max(1, steps)


def reset_ms(engine: Any, mask: np.ndarray | None, times: int = 100) -> float:
    """Return the median time of a reset [ms], of all environments or those in the mask."""
    spent = []
    for k in range(times):
        begin = time.perf_counter()
        if mask is None:
            engine.reset(np.arange(engine.count, dtype=np.uint64) + np.uint64(k))
        else:
            engine.reset(mask=mask)
        spent.append(time.perf_counter() - begin)
    return 1e3 * float(np.median(spent))


def growth_mb(engine: Any) -> float:
    """Return the growth of the process's memory [MB] over RESETS resets, after a warm-up of a tenth as many."""
    process = psutil.Process(os.getpid())
    for k in range(RESETS // 10):
        engine.reset(np.full(engine.count, k, np.uint64))
    before = process.memory_info().rss
    for k in range(RESETS):
        engine.reset(np.full(engine.count, k, np.uint64))
    return (process.memory_info().rss - before) / 1e6


def steps_of(what: str, kind: str, engine: Any, seconds: float) -> Measured:
    """Return the step rate of an engine against its target; what: words for the row."""
    steps, cpu = rate(engine, seconds)
    return Measured(f"steps of {what}", steps, "1/s", f">= {TARGETS[kind]:,.0f}", round(1e6 * cpu, 3))


def measure(arch: str, count: int, seconds: float) -> list[Measured]:
    """Return all figures of the environments benchmark."""
    from taichi_plume.engine import program
    from taichi_plume.envs.episodes import Episodes
    from taichi_plume.scenario.loading import scenario_from

    program.start(arch)
    scenario, bank = scenario_from(TASK), films()
    many = Episodes(scenario, count=count, bank=bank)
    one_of_them = np.arange(count) == count // 2
    rows = [
        steps_of(f"{count:,} environments", "vector", many, seconds),
        Measured("reset of one of them", reset_ms(many, one_of_them), "ms", f"<= {RESET_MS:g}"),
        Measured("reset of all", reset_ms(many, None), "ms", f"<= {RESET_MS:g}"),
    ]
    single = Episodes(scenario, count=1, bank=bank)
    return [
        *rows,
        steps_of("a single environment", "single", single, seconds),
        Measured(f"memory over {RESETS:,} resets", growth_mb(single), "MB more", "flat"),
    ]


def main(arguments: Sequence[str]) -> int:
    """Measure and print the figures of the environments benchmark; return the exit code."""
    parser = Parser(prog="python -m taichi_plume.validation.benchmark envs", description=__doc__)
    parser.add_argument("--arch", default="cpu", choices=("auto", "cpu", "cuda", "vulkan", "metal"))
    parser.add_argument("--count", type=int, default=COUNT, help=f"environments (default: {COUNT})")
    parser.add_argument("--seconds", type=float, default=5.0, help="per rate (default: 5)")
    parser.add_argument("--json", action="store_true", help="print JSON")
    args = parser.parse_args(arguments)
    if args.count < 1:
        parser.error(f"argument --count: {args.count} is below 1")
    rows = measure(args.arch, args.count, args.seconds)
    if args.json:
        say(*json.dumps([asdict(row) for row in rows], indent=2).splitlines(), longest=None)
    else:
        for row in rows:
            say(row)
    return 0
