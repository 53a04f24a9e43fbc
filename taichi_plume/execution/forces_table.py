"""Writer of `forces.csv`: pressure and friction force of the air on each obstacle."""

import os
from contextlib import ExitStack
from pathlib import Path

from taichi_plume.files.run_folder import cut
from taichi_plume.time_loop import Every, EveryStep, TimeLoop


class ForceTable:
    """Writer of `forces.csv`: force of the air on each obstacle [N], a row per obstacle and sampling time."""

    STATE = ("size",)

    def __init__(self, sim: TimeLoop, path: Path):
        self.path, self.size = path, 0
        self.every: float | str = sim.scenario.forces.every  # a time [s], or step
        self.head = ",".join(["t_s", "obstacle", *(f"{axis}_N" for axis in "xyz"[: sim.grid.dim])]) + "\n"
        self.closing = ExitStack()

    def start(self) -> None:
        self.file = self.closing.enter_context(self.path.open("xb"))
        self.file.write(self.head.encode())

    def resume(self) -> None:
        """Resume the table: cut off rows after the last `flush`. Raises RunFolderError if the file is shorter."""
        cut(self.path, self.size)
        self.file = self.closing.enter_context(self.path.open("ab"))

    def observer(self) -> Every | EveryStep:
        if isinstance(self.every, str):
            return EveryStep(self.sample)
        return Every(self.every, lambda sim: self.sample(sim, sim.t))

    def sample(self, sim: TimeLoop, t: float) -> None:
        """Write the force on each obstacle at t [s], a row each; none if t < 0. Raises OSError if the disk is full."""
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
        self.closing.close()
