"""Runs with probes: time series at points, for cases of plume statistics."""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np

from taichi_plume.assembly.assemble import assemble
from taichi_plume.files.table_parts import read
from taichi_plume.running.probes_table import ProbeTable
from taichi_plume.simulation import Simulation
from taichi_plume.validation.case import Keys
from taichi_plume.validation.searches import scenario_of

if TYPE_CHECKING:
    import pyarrow as pa


def probed(data: Keys) -> tuple[Simulation, np.ndarray, "pa.Table"]:
    """Run a scenario, told as a YAML file would; its probes go through their table, as in any run.

    Returns the simulation at its end, the times (n,) [s], and the table: of each time all points. Taichi must have been
    started.
    """
    sim = assemble(scenario_of(data))
    model = sim.scenario.probes
    assert model is not None
    with TemporaryDirectory() as folder:
        table = ProbeTable(sim, Path(folder) / "probes.parquet", model)
        sim.step_observers.append(table.observer())
        table.start()
        sim.run()
        table.close()
        told = read(table.path)
    return sim, told["t"].to_numpy()[:: model.size], told
