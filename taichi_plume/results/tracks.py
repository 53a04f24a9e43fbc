"""Trajectories and readings of the robots of a run, from robots.parquet or, during the run, from the row stream."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pyarrow as pa

from taichi_plume.files.run_folder import RunFolderError
from taichi_plume.files.run_tables import (
    FAULTS,
    decisions,
    schema_in,
    stream_of,
    units,
    unverified,
    vocabulary,
)
from taichi_plume.files.tables import plain

if TYPE_CHECKING:
    from taichi_plume.scenario.robots import Group

MOST_ROBOTS = 50
COLUMNS = ("x", "y", "heading", "reading_ppm", "true_ppm", "believed_x", "believed_y", "found")
ABOVE = "above_ppm"
"""Column with the reading above clean air; equal to `reading_ppm` in tables of runs without a background."""
MORE = {"declared_x": np.nan, "declared_y": np.nan, "declarations": 0, "false_declarations": 0, "z": 0.0}
"""Columns that a table may lack, and their values then: z of ground robots, declarations in older tables."""


class Track(NamedTuple):
    """Trajectory of a robot: t (n,) [s]; values: table columns (n,) by name; states: names of all states."""

    name: str
    number: int
    """Index of the robot in a trial, counted through the groups. The index sets the colour."""
    group: "Group"
    t: np.ndarray
    values: dict[str, np.ndarray]
    states: list[str]
    state: np.ndarray
    """Index in `states` over time."""
    decisions: dict[str, str]
    """Unit of each decision quantity of the run's algorithms by its column, whose numbers are in `values`."""

    @property
    def found_at(self) -> int | None:
        """Index of the first row in which the robot has found a source; None if there is none."""
        found = self.values["found"]
        return int(found.argmax()) if found.any() else None

    def declared(self, n: int) -> tuple[np.ndarray, bool] | None:
        """Return the robot's last source declaration up to row n, (2,) [m], and whether it was right; or None."""
        count, false = (int(self.values[key][n]) for key in ("declarations", "false_declarations"))
        if n < 0 or not count:  # -1: before the first row
            return None
        return np.array([self.values["declared_x"][n], self.values["declared_y"][n]]), count > false

    def at(self, t: float) -> int:
        """Return the index of the trajectory's last row that is not later than t [s]; -1 before the first."""
        return int(np.searchsorted(self.t, t + 1e-6, side="right")) - 1


def tracks(path: Path, groups: "Sequence[Group]") -> list[Track]:
    """Return robots' trajectories, equal shares of each group's first trial; [] if no table. Raises RunFolderError."""
    try:
        share = max(1, MOST_ROBOTS // max(1, len(groups)))
        table = _table(path, {group.name: group.first_trial for group in groups}, share)
    except (*FAULTS, TypeError) as error:
        raise RunFolderError(f"{path}: is damaged: {plain(' '.join(str(error).split()))}") from None
    return [] if table is None else tracks_of(table, groups, share)


def tracks_of(table: pa.Table, groups: "Sequence[Group]", share: int = MOST_ROBOTS) -> list[Track]:
    """Return trajectories from table rows of a trial of each group, of the first `share` robots of each."""
    names = np.asarray(table["group"].cast(pa.string()).to_pylist(), object)
    robot = table["robot"].to_numpy()
    tracks: list[Track] = []
    first = 0
    for group in groups:
        mine = np.flatnonzero(names == group.name)
        for k in range(min(group.count, share)):
            rows = mine[robot[mine] == k]
            if len(rows) and len(tracks) < MOST_ROBOTS:
                label = group.name if group.count == 1 else f"{group.name} {k}"
                tracks.append(_track(table.take(rows), label, first + k, group))
        first += group.count
    return tracks


def _track(rows: pa.Table, name: str, number: int, group: "Group") -> Track:
    values = {key: rows[key].to_numpy() for key in COLUMNS}
    for key, none in MORE.items():
        values[key] = rows[key].to_numpy() if key in rows.column_names else np.full(len(rows), none)
    values[ABOVE] = rows[ABOVE].to_numpy() if ABOVE in rows.column_names else values["reading_ppm"]
    unit = units(rows.schema)
    decided = {key: unit[key] for key in decisions(rows.schema)}
    values |= {key: rows[key].to_numpy() for key in decided}
    state = rows["state"].combine_chunks().cast(pa.string()).dictionary_encode()
    state = state.combine_chunks() if isinstance(state, pa.ChunkedArray) else state
    occurring = state.dictionary.to_pylist()
    states = list(dict.fromkeys([*vocabulary(rows.schema.field("state")), *occurring]))
    number_of = np.array([states.index(each) for each in occurring], int)
    indices = number_of[state.indices.to_numpy(zero_copy_only=False)]
    return Track(name, number, group, rows["t"].to_numpy(), values, states, indices, decided)


def _table(path: Path, first: dict[str, int], share: int) -> pa.Table | None:
    """Return table rows of the first `share` robots per group; first: trial of each group. None without a table."""
    if not path.exists() and not stream_of(path).exists():
        return None
    batches = unverified(
        path, ["t", "group", "trial", "robot", "state", *COLUMNS], [ABOVE, *MORE, *decisions(schema_in(path))]
    )
    return pa.concat_tables(_firsts(pa.Table.from_batches([batch]), first, share) for batch in batches)


def first_rows(rows: pa.Table, groups: "Sequence[Group]") -> pa.Table:
    """Filter table rows: robots in the first trial of each group that are drawn, at most MOST_ROBOTS in all."""
    share = max(1, MOST_ROBOTS // max(1, len(groups)))
    return _firsts(rows, {group.name: group.first_trial for group in groups}, share)


def _firsts(rows: pa.Table, first: dict[str, int], share: int) -> pa.Table:
    """Filter table rows: robots numbered below `share`, in the trial that `first` names for their group."""
    import pyarrow.compute as pc

    selected = pa.nulls(len(rows), pa.bool_()).fill_null(False)
    for trial in set(first.values()):
        names = pa.array([name for name, number in first.items() if number == trial])
        mask = pc.and_(pc.equal(rows["trial"], trial), pc.is_in(rows["group"].cast(pa.string()), names))
        selected = pc.or_(selected, mask)
    return rows.filter(pc.and_(selected, pc.less(rows["robot"], share)))
