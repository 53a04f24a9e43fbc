"""Progress, gas, wind and robots of a running simulation in one small file, for a program that shows the run.

The file is replaced about twice a second of wall-clock time; `read` returns its content.
"""

import time
from contextlib import suppress
from math import ceil
from pathlib import Path
from typing import NamedTuple
from zipfile import BadZipFile

import numpy as np

from taichi_plume.execution.progress import phase
from taichi_plume.files.disk import written_whole
from taichi_plume.grid.sampler import Sampler
from taichi_plume.guard.safe_open import open_regular
from taichi_plume.observed.planes import planes
from taichi_plume.time_loop import TimeLoop

PERIOD = 0.5  # s of wall-clock time between updates
PIXELS = 160  # along the longer side
ARROWS = 24  # along the longer side
SAMPLES = 1000  # of the readings, in a run
MOST_ROBOTS = 12  # whose readings are noted


class Sight(NamedTuple):
    """State of a run at one moment. t: simulated time [s]; end: of the run; done: completed fraction.

    speed: simulated over wall-clock time; phase: "compiling", "warm-up" or "running". gas: summed over the gases [ppm],
    (ny, nx) in the horizontal slice of the recording; wind: (x, y, u, v) of arrows, (4, n); robots: (x, y, heading) of
    the first trial, (3, robots); readings: time [s] and the readings [ppm] of these robots since the start,
    (samples, 1 + robots).
    """

    t: float
    end: float
    done: float
    speed: float
    phase: str
    gas: np.ndarray
    wind: np.ndarray
    robots: np.ndarray
    readings: np.ndarray


class WatchFile:
    """Observer that writes the state of a simulation to an NPZ file. A file that cannot be written is left out."""

    def __init__(self, sim: TimeLoop, path: Path):
        self.path, self.written = path, -PERIOD
        self.begun, self.first = time.monotonic(), sim.tick
        extent = sim.grid.extent
        level = next(plane.level for plane in planes(sim.scenario, extent) if plane.name == "slice")
        height = () if level is None else (level,)
        points, self.shape = _lattice(extent, PIXELS, height)
        arrows, _ = _lattice(extent, ARROWS, height)
        self.arrows = arrows[:, :2]
        self.sampler = Sampler(
            np.concatenate([points, arrows]), sim.wind, sim.gas, [], sim.air.solid, sim.grid
        )
        self.pixels, self.dim, self.gases = len(points), sim.grid.dim, len(sim.gas.species)
        groups = sim.swarm.groups if sim.swarm.count else []
        self.robots = np.concatenate(
            [np.arange(group.count * group.trials) < group.count for group in groups] or [np.empty(0, bool)]
        )

        self.readings: list[np.ndarray] = []
        self.every = max(1, (sim.last_tick - sim.tick) // SAMPLES)

    def update(self, sim: TimeLoop) -> None:
        """Note the readings, and replace the file unless it has just been written."""
        if sim.swarm.count and sim.tick >= 0 and sim.tick % self.every == 0:
            readings = sim.swarm.snapshot()["reading_ppm"][self.robots][:MOST_ROBOTS]
            self.readings.append(np.concatenate([[sim.t], readings]))
        now = time.monotonic()
        if now < self.written + PERIOD and not sim.finished:
            return
        self.written = now
        values = self.sampler.sample(sim.t)
        gas = values[self.dim : self.dim + self.gases, : self.pixels].sum(axis=0).reshape(self.shape)
        wind = np.concatenate([self.arrows.T, values[:2, self.pixels :]])
        robots = np.empty((3, 0), np.float32)
        if sim.swarm.count:
            state = sim.swarm.snapshot()
            robots = np.stack([*state["position"][:, :2].T, state["heading"]])[:, self.robots]
        elapsed = max(now - self.begun, 1e-9)
        first, last = sim.scenario.first_tick, sim.last_tick
        content = {
            "t": sim.t,
            "end": sim.scenario.duration,
            "done": (sim.tick - first) / max(1, last - first),
            "speed": (sim.tick - self.first) * sim.dt / elapsed,
            "phase": phase(sim),
            "gas": gas.astype(np.float32),
            "wind": wind.astype(np.float32),
            "robots": robots.astype(np.float32),
            "readings": np.array(self.readings or np.empty((0, 1)), np.float32),
        }
        with suppress(OSError), written_whole(self.path, durable=False) as fresh, fresh.open("wb") as file:
            np.savez(file, **content)  # a program that watches may have left: the run goes on


def _lattice(
    extent: tuple[float, ...], most: int, height: tuple[float, ...]
) -> tuple[np.ndarray, tuple[int, int]]:
    """Return the centres (n, dim) [m] of square pixels over the floor, row by row, and the numbers (rows, columns)."""
    step = max(extent[:2]) / most
    nx, ny = (max(1, ceil(length / step - 1e-9)) for length in extent[:2])
    x, y = ((np.arange(n) + 0.5) * length / n for n, length in zip((nx, ny), extent[:2], strict=True))
    grid = np.stack(np.meshgrid(x, y, indexing="xy"), axis=-1).reshape(-1, 2)
    return np.concatenate([grid, np.full((len(grid), len(height)), height)], axis=1), (ny, nx)


def read(path: Path) -> Sight | None:
    """Return the content of a watch file; None if there is none yet, or if it cannot be read."""
    try:
        with open_regular(path) as content, np.load(content, allow_pickle=False) as file:
            values = {key: file[key] for key in Sight._fields}
    except (OSError, ValueError, KeyError, EOFError, BadZipFile):
        return None
    t, end, done, speed = (float(values[key]) for key in ("t", "end", "done", "speed"))
    arrays = (values[key] for key in ("gas", "wind", "robots", "readings"))
    return Sight(t, end, done, speed, str(values["phase"]), *arrays)
