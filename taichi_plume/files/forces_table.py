"""`forces.csv`: the force of the air on each obstacle."""

from pathlib import Path

from taichi_plume.simulation import Every, Simulation


class ForceTable:
    """`forces.csv`: the force of the air on each obstacle [N], a row per obstacle and simulated second."""

    def __init__(self, sim: Simulation, path: Path):
        self.file = path.open("w", encoding="utf-8")
        self.file.write(
            ",".join(["t_s", "obstacle", *(f"{axis}_N" for axis in "xyz"[: sim.grid.dim])]) + "\n"
        )

    def observer(self) -> Every:
        """What the simulation has to call."""
        return Every(1.0, self.sample)

    def sample(self, sim: Simulation) -> None:
        """Write a row per obstacle. Raises OSError when the disk is full."""
        assert sim.forces is not None
        for number, force in enumerate(sim.forces()):
            self.file.write(",".join([f"{sim.t:.6g}", str(number), *(f"{f:.6g}" for f in force)]) + "\n")

    def close(self) -> None:
        """Close the file."""
        self.file.close()
