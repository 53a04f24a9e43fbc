"""`forces.csv`: the force of the air on each obstacle."""

import os
from pathlib import Path
from typing import BinaryIO

from taichi_plume.files.run_folder import cut
from taichi_plume.simulation import Every, Simulation


class ForceTable:
    """`forces.csv`: the force of the air on each obstacle [N], a row per obstacle and simulated second.

    `start()` begins it, `go_on()` continues that of a run that was resumed.
    """

    STATE = ("size",)

    file: BinaryIO

    def __init__(self, sim: Simulation, path: Path):
        self.path = path
        self.head = ",".join(["t_s", "obstacle", *(f"{axis}_N" for axis in "xyz"[: sim.grid.dim])]) + "\n"
        self.size = 0

    def start(self) -> None:
        """Begin the table."""
        self.file = self.path.open("wb")
        self.file.write(self.head.encode())

    def go_on(self) -> None:
        """Cut off what came after the last `flush`. Raises RunFolderError where not so much is left."""
        cut(self.path, self.size)
        self.file = self.path.open("ab")

    def observer(self) -> Every:
        """What the simulation has to call."""
        return Every(1.0, self.sample)

    def sample(self, sim: Simulation) -> None:
        """Write a row per obstacle. Raises OSError when the disk is full."""
        assert sim.forces is not None
        for number, force in enumerate(sim.forces()):
            row = ",".join([f"{sim.t:.6g}", str(number), *(f"{f:.6g}" for f in force)]) + "\n"
            self.file.write(row.encode())

    def flush(self) -> None:
        """Bring the rows to the disk."""
        self.file.flush()
        os.fsync(self.file.fileno())
        self.size = self.file.tell()

    def close(self) -> None:
        """Close the file."""
        if hasattr(self, "file"):
            self.file.close()
