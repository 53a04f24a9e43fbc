"""Writer of `robots.parquet`: one row per robot and sample."""

import json
from collections.abc import Sequence
from math import ceil
from pathlib import Path

import numpy as np
import pyarrow as pa

from taichi_plume.agents.columns import Column
from taichi_plume.files.run_tables import DECISION, NAMES, VOCABULARY, GrowingTable, column
from taichi_plume.time_loop import Every, TimeLoop

MOST_ROWS = 2_000_000  # of robots.parquet: larger swarms are sampled less often


def _fields(quantity: Column, states: Sequence[str]) -> list[pa.Field]:
    """Return the table columns (name, type, unit, meaning) that hold a quantity of the robots, one per component.

    states: names of all states, which a column of names keeps in its metadata.
    """
    kind = NAMES if quantity.named else pa.from_numpy_dtype(quantity.dtype)
    more = {VOCABULARY: json.dumps(states)} if quantity.named else {}
    return [column(name, kind, quantity.unit, quantity.meaning, **more) for name in quantity.table]


WHO = (
    column("t", pa.float64(), "s", "simulated time"),
    column("group", NAMES, "1", "name of the group"),
    column("trial", pa.int32(), "1", "number of the trial, of those computed"),
    column("robot", pa.int32(), "1", "number of the robot in its team"),
)


class RobotTable(GrowingTable):
    """Writer of `robots.parquet`: a row per robot and sampling time."""

    def __init__(self, sim: TimeLoop, path: Path):
        count = sim.swarm.count
        rows = count * (sim.scenario.duration / sim.dt + 1)
        self.period = sim.dt * ceil(max(1.0, rows / MOST_ROWS))
        groups = sim.swarm.groups
        states = sim.state_names()
        listed = [name for names in states for name in names]
        distinct = list(dict.fromkeys(listed))  # groups may share names; pandas takes each only once
        names = {"group": pa.array([g.name for g in groups]), "state": pa.array(distinct)}
        self.name_numbers = np.array([distinct.index(name) for name in listed])
        self.columns = [quantity for quantity in sim.swarm.columns if quantity.table]
        fields = [field for quantity in self.columns for field in _fields(quantity, distinct)]
        decided = [
            column(
                each.name,
                pa.float32(),
                each.unit,
                f"{each.meaning}; null for other algorithms",
                **{DECISION: "1"},
            )
            for each in sim.decision_columns()
        ]
        super().__init__(path, [*WHO, *fields, *decided], names, count)
        group = np.concatenate([np.full(g.count * g.trials, n) for n, g in enumerate(groups)])
        self.first_state = np.cumsum([0, *[len(names) for names in states]])[:-1][group]
        self.values["group"][:] = group
        self.values["trial"][:] = np.concatenate([np.repeat(np.arange(g.trials), g.count) for g in groups])
        self.values["robot"][:] = np.concatenate([np.tile(np.arange(g.count), g.trials) for g in groups])

    def observer(self) -> Every:
        return Every(self.period, self.sample)

    def sample(self, sim: TimeLoop) -> None:
        """Store a row for every robot at the present time."""
        now = sim.swarm.snapshot()
        n = self.pending
        self.values["t"][n] = sim.t
        for quantity in self.columns:
            values = now[quantity.key]
            if quantity.named:
                self.values[quantity.table[0]][n] = self.name_numbers[self.first_state + values]
            else:
                for name, part in zip(quantity.table, values.reshape(len(values), -1).T, strict=True):
                    self.values[name][n] = part
        for name, numbers in sim.decisions().items():
            self.values[name][n] = numbers
        self.took()
