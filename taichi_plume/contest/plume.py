"""The plume of a scenario for its picture: the mean gas at the sensors' height, of an air of its own."""

from contextlib import suppress
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from taichi_plume.contest.fixed import Fixed
from taichi_plume.files.disk import written_whole

SHOWN = 60.0  # s that the mean is over
EVERY = 1.0  # s
POINTS = 120  # along the longer side


def mean_plume(scenario: Fixed, folder: Path) -> np.ndarray:
    """Mean concentration [ppm] over the first minute of the first air, on (nx, ny) points that fill the floor.

    It is kept in `folder`, beside the scenario that it is of. Raises ScenarioError, OSError.
    """
    path = folder / f"{scenario.name}.plume.npz"
    key = repr(scenario.data)
    # there may be none, or one that was cut off
    with suppress(OSError, ValueError, LookupError, EOFError, BadZipFile), np.load(path) as held:
        if str(held["key"]) == key:
            return held["ppm"]
    ppm = _computed(scenario)
    with written_whole(path) as fresh, fresh.open("wb") as file:
        np.savez_compressed(file, ppm=ppm, key=np.array(key))
    return ppm


def _computed(scenario: Fixed) -> np.ndarray:
    from taichi_plume.assembly.assemble import assemble
    from taichi_plume.grid import fields, kernels
    from taichi_plume.simulation import Every

    whole = scenario.scenario
    end = min(SHOWN, whole.duration)
    alone = whole.model_copy(update={"robots": (), "duration": end})
    kernels.start("cpu")
    sim = assemble(alone)
    width, length = whole.floor.size
    step = max(width, length) / POINTS
    axes = [(np.arange(round(size / step)) + 0.5) * step for size in (width, length)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    if sim.grid.dim == 3:
        height = whole.robots[0].sensors.nose.height
        points = np.concatenate([points, np.full((*points.shape[:2], 1), height)], axis=-1)
    total, count = np.zeros(points.shape[:2]), 0

    def add(sim) -> None:
        nonlocal count
        if sim.t >= 0:
            total[:] += fields.ppm_at(sim.gas, points, sim.t).sum(axis=-1)
            count += 1

    sim.observers.append(Every(EVERY, add))
    sim.run()
    return (total / max(1, count)).astype(np.float32)
