"""`robots.parquet`: one row per robot and sample, units and meanings as metadata of its columns."""

from math import ceil
from pathlib import Path
from typing import Protocol

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from taichi_plume.files import disk
from taichi_plume.simulation import Every, Simulation

MOST_ROWS = 2_000_000  # of robots.parquet: larger swarms are sampled less often
ROW_GROUP = 50_000
NAMES = pa.dictionary(pa.int32(), pa.string())


class Column(Protocol):
    """A quantity of every robot, see agents/columns.py: the swarm's `columns` say what there is."""

    unit: str
    meaning: str
    dtype: type
    key: str
    """Its name in a snapshot."""
    table: tuple[str, ...]
    """Its names here, one per component; none where it is not for this table."""
    named: bool
    """Whether its numbers stand for names: the states of the group's algorithm."""


def _field(name: str, kind: pa.DataType, unit: str, meaning: str) -> pa.Field:
    return pa.field(name, kind, metadata={"unit": unit, "meaning": meaning})


def _fields(column: Column) -> list[pa.Field]:
    """Those of a column; a whole number without names keeps 32 bits."""
    kind = NAMES if column.named else pa.from_numpy_dtype(column.dtype)
    return [_field(name, kind, column.unit, column.meaning) for name in column.table]


WHO = (
    _field("t", pa.float64(), "s", "simulated time"),
    _field("group", NAMES, "1", "name of the group"),
    _field("trial", pa.int32(), "1", "number of the trial, of those computed"),
    _field("robot", pa.int32(), "1", "number of the robot in its team"),
)


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
        states = sim.state_names()
        self.first_state = np.cumsum([0, *[len(names) for names in states]])[:-1].astype(np.int32)
        self.state_names = pa.array([name for names in states for name in names])
        self.columns = [column for column in sim.swarm.columns if column.table]
        self.schema = pa.schema([*WHO, *(field for column in self.columns for field in _fields(column))])
        disk.require_room(path)
        self.writer = pq.ParquetWriter(path, self.schema, compression="zstd")

    def observer(self) -> Every:
        """What the simulation has to call."""
        return Every(self.period, self.sample)

    def sample(self, sim: Simulation) -> None:
        """Take a row of every robot. Raises OSError when the disk is full."""
        now = sim.swarm.snapshot()
        arrays = [
            pa.array(np.full(len(self.group), sim.t)),
            pa.DictionaryArray.from_arrays(self.group, self.group_names),
            pa.array(self.trial),
            pa.array(self.robot),
        ]
        for column in self.columns:
            values = now[column.key]
            if column.named:
                state = self.first_state[self.group] + values.astype(np.int32)
                arrays.append(pa.DictionaryArray.from_arrays(state, self.state_names))
            else:
                parts = values.reshape(len(values), -1).T.astype(column.dtype)
                arrays += [pa.array(np.ascontiguousarray(part), from_pandas=True) for part in parts]
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
