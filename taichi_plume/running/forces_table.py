"""`forces.csv`: the force of the air on each obstacle."""

import os
from pathlib import Path
from typing import BinaryIO

from taichi_plume.files.run_folder import cut
from taichi_plume.simulation import Every, EveryStep, Simulation


class ForceTable:
    """`forces.csv`: the force of the air on each obstacle [N], a row per obstacle as often as the scenario says.

    `start()` begins it, `go_on()` continues that of a run that was resumed.
    """

    STATE = ("size",)

    file: BinaryIO

    def __init__(self, sim: Simulation, path: Path):
        self.path = path
        self.every: float | str = sim.scenario.forces.every  # a time [s], or step
        self.head = ",".join(["t_s", "obstacle", *(f"{axis}_N" for axis in "xyz"[: sim.grid.dim])]) + "\n"
        self.size = 0

    def start(self) -> None:
        self.file = self.path.open("wb")
        self.file.write(self.head.encode())

    def go_on(self) -> None:
        """Cut off what came after the last `flush`. Raises RunFolderError where not so much is left."""
        cut(self.path, self.size)
        self.file = self.path.open("ab")

    def observer(self) -> Every | EveryStep:
        """What the simulation has to call."""
        if isinstance(self.every, str):
            return EveryStep(self.sample)
        return Every(self.every, lambda sim: self.sample(sim, sim.t))

    def sample(self, sim: Simulation, t: float) -> None:
        """Write a row per obstacle, at time t [s] and not in the warm-up. Raises OSError when the disk is full."""
        assert sim.forces is not None
        if t < 0.0:
            return
        for number, force in enumerate(sim.forces()):
            row = ",".join([f"{t:.9g}", str(number), *(f"{f:.6g}" for f in force)]) + "\n"
            self.file.write(row.encode())

    def flush(self) -> None:
        self.file.flush()
        os.fsync(self.file.fileno())
        self.size = self.file.tell()

    def close(self) -> None:
        if hasattr(self, "file"):
            self.file.close()
