"""Tables of numbers that kernels read for each robot, several in one field.

Some devices give a kernel no more than 31 or 32 arrays, and each array costs time at each launch. On a CPU each table
has a field of its own.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from taichi_plume.engine import ti
from taichi_plume.engine.fields import Field, on_cpu


class Parameter:
    """View in kernels of a parameter, indexed like a field over robots: ``x[n]`` or, for tuples, ``x[n, k]``.

    table: numbers of several parameters. first: place of the first number of this one, None in a field of its own.
    rows: how many groups or robots it has numbers of. group: field with each robot's row; None if they share the row.
    each: whether robot n has row n.
    """

    def __init__(self, table: Field, first: int | None, rows: int, group: Field | None, each: bool):
        self.table, self.first, self.rows, self.group, self.each = table, first, rows, group, each

    def __getitem__(self, at: Any) -> Any:
        n, *entry = at if isinstance(at, tuple) else (at,)
        row: Any = n if self.each else 0 if self.group is None else self.group[n]
        place = row if self.first is None else row + self.first
        return self.table[place + entry[0] * self.rows if entry else place]

    def to_numpy(self) -> np.ndarray:
        """Return a copy of the numbers (rows,), of a tuple its first entries."""
        return self.table.to_numpy()[self.first or 0 :][: self.rows]


def share_field(
    owner: object, tables: Mapping[str, tuple[np.ndarray, bool]], dtype: Any, group: Field | None = None
) -> None:
    """Set an attribute of `owner` for each table, by name; on a device all tables share a field.

    tables: numbers (rows,) or (rows, entries), and whether the rows are those of robots instead of groups. group: field
    with each robot's group; None if single.
    """
    flat = {name: table.ravel(order="F") for name, (table, _) in tables.items()}
    field, place = None if on_cpu() else ti.filled(np.concatenate(list(flat.values())), dtype), 0
    for name, (table, each) in tables.items():
        own = ti.filled(flat[name], dtype) if field is None else field
        setattr(owner, name, Parameter(own, None if field is None else place, len(table), group, each))
        place += table.size
