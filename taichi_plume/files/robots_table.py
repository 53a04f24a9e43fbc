"""`robots.parquet`: one row per robot and sample."""

from math import ceil
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from taichi_plume.files import disk
from taichi_plume.simulation import Every, Simulation

MOST_ROWS = 2_000_000  # of robots.parquet: larger swarms are sampled less often
ROW_GROUP = 50_000


class RobotTable:
    """`robots.parquet`: one row per robot and sample. `close()` makes it readable, whatever happened."""

    def __init__(self, sim: Simulation, path: Path):
        self.path = path
        count = sim.swarm.count
        rows = count * (sim.scenario.duration / sim.dt + 1)
        self.period = sim.dt * ceil(max(1.0, rows / MOST_ROWS))
        self.pending: list[pa.RecordBatch] = []
        self.rows = 0
        groups = sim.swarm.groups
        self.group = np.concatenate([np.full(g.count * g.trials, n, np.int32) for n, g in enumerate(groups)])
        self.trial = np.concatenate([np.repeat(np.arange(g.trials, dtype=np.int32), g.count) for g in groups])
        self.robot = np.concatenate([np.tile(np.arange(g.count, dtype=np.int32), g.trials) for g in groups])
        self.group_names = pa.array([g.name for g in groups])
        teams: list[Any] = list(sim.teams)
        states = [team.state_names for team in teams]
        self.first_state = np.cumsum([0, *[len(names) for names in states]])[:-1].astype(np.int32)
        self.state_names = pa.array([name for names in states for name in names])
        names = pa.dictionary(pa.int32(), pa.string())
        self.schema = pa.schema(
            [
                ("t", pa.float64()),
                ("group", names),
                ("trial", pa.int32()),
                ("robot", pa.int32()),
                *[
                    (name, pa.float32())
                    for name in ("x", "y", "heading", "reading_ppm", "resistance_ohm", "true_ppm")
                ],
                ("wind_x", pa.float32()),
                ("wind_y", pa.float32()),
                ("believed_x", pa.float32()),
                ("believed_y", pa.float32()),
                ("believed_heading", pa.float32()),
                ("state", names),
                ("found", pa.bool_()),
            ]
        )
        disk.require_room(path)
        self.writer = pq.ParquetWriter(path, self.schema, compression="zstd")

    def observer(self) -> Every:
        """What the simulation has to call."""
        return Every(self.period, self.sample)

    def sample(self, sim: Simulation) -> None:
        """Take a row of every robot. Raises OSError when the disk is full."""
        now = sim.swarm.snapshot()
        state = self.first_state[self.group] + now["state"].astype(np.int32)
        columns = [
            np.full(len(self.group), sim.t),
            pa.DictionaryArray.from_arrays(self.group, self.group_names),
            self.trial,
            self.robot,
            now["position"][:, 0],
            now["position"][:, 1],
            now["heading"],
            now["reading_ppm"],
            pa.array(now["resistance_ohm"], from_pandas=True),  # null where a sensor has none
            now["true_ppm"],
            now["wind"][:, 0],
            now["wind"][:, 1],
            now["believed_position"][:, 0],
            now["believed_position"][:, 1],
            now["believed_heading"],
            pa.DictionaryArray.from_arrays(state, self.state_names),
            now["found"].astype(bool),
        ]
        arrays = [
            pa.array(column).cast(kind) for column, kind in zip(columns, self.schema.types, strict=True)
        ]
        self.pending.append(pa.RecordBatch.from_arrays(arrays, schema=self.schema))
        self.rows += len(self.group)
        if self.rows >= ROW_GROUP:
            self._write()

    def _write(self) -> None:
        if not self.pending:
            return
        table = pa.Table.from_batches(self.pending)
        disk.require_room(self.path, table.nbytes)
        self.pending.clear()
        self.rows = 0
        self.writer.write_table(table)

    def close(self) -> None:
        """Write the rest and the footer."""
        if not self.writer.is_open:
            return
        try:
            self._write()
        finally:
            self.writer.close()
