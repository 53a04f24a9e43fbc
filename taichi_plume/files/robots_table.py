"""`robots.parquet`: one row per robot and sample, units and meanings as metadata of its columns.

While a run lasts its rows are in `robots.parts`, small files each of which can be read; at the end they become one.
Each is named after its first row: a row that is in two files, as the process was killed between two steps, counts once.
"""

from collections.abc import Iterator
from math import ceil, inf
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from taichi_plume.files import disk
from taichi_plume.files.run_folder import RunFolderError
from taichi_plume.simulation import Every, Simulation

MOST_ROWS = 2_000_000  # of robots.parquet: larger swarms are sampled less often
ROW_GROUP = 50_000
PARTS = "robots.parts"
NAMES = pa.dictionary(pa.int32(), pa.string())
Found = tuple[int, Path]
"""The number of a file's first row, and the file."""


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
    """`robots.parquet`: one row per robot and sample. `close()` makes it, whatever happened.

    `start()` begins it, `go_on()` continues that of a run that was resumed. Raises OSError when the disk is full.
    """

    STATE = ("rows",)

    def __init__(self, sim: Simulation, path: Path):
        self.path, self.parts = path, path.with_name(PARTS)
        count = sim.swarm.count
        rows = count * (sim.scenario.duration / sim.dt + 1)
        self.period = sim.dt * ceil(max(1.0, rows / MOST_ROWS))
        self.rows = 0  # that are in the parts
        self.open = False
        groups = sim.swarm.groups
        states = sim.state_names()
        first_state = np.cumsum([0, *[len(names) for names in states]])[:-1]
        self.names = {
            "group": pa.array([g.name for g in groups]),
            "state": pa.array([name for names in states for name in names]),
        }
        self.columns = [column for column in sim.swarm.columns if column.table]
        self.schema = pa.schema([*WHO, *(field for column in self.columns for field in _fields(column))])
        self.kept = 0  # samples that are in no part yet
        samples = max(1, ROW_GROUP // count)
        self.values = {
            field.name: np.empty((samples, count), _numpy_kind(field.type)) for field in self.schema
        }
        group = np.concatenate([np.full(g.count * g.trials, n) for n, g in enumerate(groups)])
        self.first_state = first_state[group]
        self.values["group"][:] = group
        self.values["trial"][:] = np.concatenate([np.repeat(np.arange(g.trials), g.count) for g in groups])
        self.values["robot"][:] = np.concatenate([np.tile(np.arange(g.count), g.trials) for g in groups])

    def start(self) -> None:
        """Begin the table."""
        disk.require_room(self.path)
        self.parts.mkdir()
        self.open = True

    def go_on(self) -> None:
        """Keep the first `rows` rows of what there is, and begin after them. Raises RunFolderError where some lack."""
        found = _found(self.path)
        self.parts.mkdir(exist_ok=True)
        disk.require_room(self.path, sum(file.stat().st_size for _, file in found))
        fresh, first = self.parts / "first.new", self.parts / _name(0)
        held = _merge(found, fresh, self.schema, self.names, self.rows)
        if held < self.rows:
            raise RunFolderError(
                f"{self.path}: {held:,} of its first {self.rows:,} rows are left, without which the run cannot go on"
            )
        fresh.replace(first)  # from here on the others repeat what it holds
        for _, file in found:
            if file != first:
                file.unlink()
        self.open = True

    def observer(self) -> Every:
        """What the simulation has to call."""
        return Every(self.period, self.sample)

    def sample(self, sim: Simulation) -> None:
        """Take a row of every robot."""
        now = sim.swarm.snapshot()
        n = self.kept
        self.values["t"][n] = sim.t
        for column in self.columns:
            values = now[column.key]
            if column.named:
                self.values[column.table[0]][n] = self.first_state + values
            else:
                for name, part in zip(column.table, values.reshape(len(values), -1).T, strict=True):
                    self.values[name][n] = part
        self.kept += 1
        if self.kept == len(self.values["t"]):
            self.flush()

    def flush(self) -> None:
        """Bring the samples that were taken to the disk, as another part."""
        if not self.kept:
            return
        arrays = []
        for field in self.schema:
            values = self.values[field.name][: self.kept].ravel()
            if field.type == NAMES:
                arrays.append(pa.DictionaryArray.from_arrays(values, self.names[field.name]))
            else:
                arrays.append(pa.array(values, field.type, from_pandas=True))
        table = pa.Table.from_arrays(arrays, schema=self.schema)
        disk.require_room(self.path, table.nbytes)
        part = self.parts / _name(self.rows)
        fresh = part.with_suffix(".new")
        with _writer(fresh, self.schema) as writer:
            writer.write_table(table)
        disk.sync(fresh)
        fresh.replace(part)
        self.rows, self.kept = self.rows + len(table), 0

    def close(self) -> None:
        """Make one file of the parts."""
        if not self.open:
            return
        self.open = False
        try:
            self.flush()
        finally:
            join(self.path, self.names)


def _numpy_kind(kind: pa.DataType) -> Any:
    return np.int32 if kind == NAMES else kind.to_pandas_dtype()


def _name(begin: int) -> str:
    return f"{begin:012d}.parquet"


def part_files(folder: Path) -> list[Path]:
    """The parts of a table that is not finished, in their order."""
    return sorted(folder.glob("*.parquet"))


def _found(path: Path) -> list[Found]:
    """The files that hold rows of a table: itself, if it has been made before, and its parts."""
    whole = [(0, path)] if path.exists() else []
    return whole + [(int(file.stem), file) for file in part_files(path.with_name(PARTS))]


def join(path: Path, names: dict[str, pa.Array] | None = None) -> None:
    """Make the file `path` of the parts beside it, and remove these.

    names: all that stand in columns of names; unless given, those that are found. Raises OSError.
    """
    parts = path.with_name(PARTS)
    files = _found(path)
    schema = pq.read_schema(files[0][1]) if files else None
    if schema is not None:
        disk.require_room(path, sum(file.stat().st_size for _, file in files))
        fresh = parts / "joined.new"
        _merge(files, fresh, schema, names or _names_in([file for _, file in files], schema))
        disk.sync(fresh)
        fresh.replace(path)
    for file in parts.iterdir():
        file.unlink()
    parts.rmdir()


def _merge(
    files: list[Found],
    path: Path,
    schema: pa.Schema,
    names: dict[str, pa.Array],
    rows: int | None = None,
) -> int:
    """Write the first `rows` rows of some files, or all, into one whose bytes depend on these rows alone.

    Returns how many there were.
    """
    written = 0
    with _writer(path, schema) as writer:
        for table in _in_groups(files, rows):
            columns = [
                _named(column, names[field.name]) if field.type == NAMES else column
                for field, column in zip(schema, table.columns, strict=True)
            ]
            writer.write_table(pa.Table.from_arrays(columns, schema=schema))
            written += len(table)
    return written


def _in_groups(files: list[Found], rows: int | None) -> Iterator[pa.Table]:
    """The rows of files as tables of ROW_GROUP rows, and one of the rest."""
    waiting: list[pa.RecordBatch] = []
    held = 0
    for batch in _once(files, rows):
        waiting.append(batch)
        held += len(batch)
        if held >= ROW_GROUP:
            table = pa.Table.from_batches(waiting)
            yield table.slice(0, ROW_GROUP)
            waiting, held = table.slice(ROW_GROUP).to_batches(), held - ROW_GROUP
    if held:
        yield pa.Table.from_batches(waiting)


def _once(files: list[Found], rows: int | None) -> Iterator[pa.RecordBatch]:
    """The rows of files up to number `rows`, or all; what one repeats of those before it is left out."""
    last, done = inf if rows is None else rows, 0
    for begin, file in files:
        with pq.ParquetFile(file, page_checksum_verification=True) as part:
            if begin + part.metadata.num_rows <= done or begin >= last:
                continue
            for batch in part.iter_batches(ROW_GROUP):
                fresh = batch.slice(
                    max(0, done - begin), max(0, int(min(last - max(begin, done), len(batch))))
                )
                begin += len(batch)
                if len(fresh):
                    done = begin
                    yield fresh


def _named(column: pa.ChunkedArray, names: pa.Array) -> pa.DictionaryArray:
    """A column of names with that dictionary, whatever its own is."""
    numbers = pc.index_in(column.cast(pa.string()), value_set=names).combine_chunks()
    return pa.DictionaryArray.from_arrays(numbers, names)


def _names_in(files: list[Path], schema: pa.Schema) -> dict[str, pa.Array]:
    """All names in the columns of names."""
    wanted = [field.name for field in schema if field.type == NAMES]
    tables = pa.concat_tables([pq.read_table(file, columns=wanted) for file in files])
    return {name: pc.unique(tables[name].cast(pa.string())) for name in wanted}


def _writer(path: Path, schema: pa.Schema) -> pq.ParquetWriter:
    return pq.ParquetWriter(path, schema, compression="zstd", write_page_checksum=True)
