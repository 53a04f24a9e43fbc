"""Parquet tables that grow during a run, with units and meanings of the columns as metadata.

pandas finds the metadata in `attrs["units"]` and `attrs["meanings"]`, polars as JSON texts `units` and `meanings` of
``polars.read_parquet_metadata``.

During the run the rows are in small readable files in a folder beside the table; at the end they are joined. Each file
is named after its first row: a row in two files, after the process was killed between two steps, counts once.
"""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from math import inf
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from taichi_plume.files import disk, manifest
from taichi_plume.files.run_folder import RunFolderError
from taichi_plume.files.tables import plain
from taichi_plume.guard.opening import unopenable

ROW_GROUP = 50_000
NAMES = pa.dictionary(pa.int32(), pa.string())
Part = tuple[int, Path]
"""Part of a table: number of the first row, and the file."""


def column(name: str, kind: pa.DataType, unit: str, meaning: str, **more: str) -> pa.Field:
    """Return a column of a table; more: other metadata."""
    return pa.field(name, kind, metadata={"unit": unit, "meaning": meaning, **more})


def schema_of(columns: Sequence[pa.Field]) -> pa.Schema:
    """Return the schema of a table, with metadata for pandas (`attributes` of its own files) and polars."""
    facts = {"units": units(columns), "meanings": meanings(columns)}
    pandas = {"index_columns": [], "column_indexes": [], "columns": [], "attributes": facts}
    return pa.schema(columns, {key: json.dumps(value) for key, value in {"pandas": pandas, **facts}.items()})


def units(columns: Iterable[pa.Field]) -> dict[str, str]:
    """Return the unit of each column."""
    return {column.name: (column.metadata or {}).get(b"unit", b"1").decode() for column in columns}


def meanings(columns: Iterable[pa.Field]) -> dict[str, str]:
    """Return the meaning of each column."""
    return {column.name: (column.metadata or {}).get(b"meaning", b"").decode() for column in columns}


def parts_of(path: Path) -> Path:
    """Return the folder of a table's parts."""
    return path.with_suffix(".parts")


class PartsTable:
    """A table of samples, each of `count` rows. `close()` writes the table, also after an error.

    values: samples that are in no part yet, (samples, count) by column; names: dictionaries of the columns of names,
    whose values are indices. `start()` creates the table, `go_on()` resumes that of a resumed run. Raises OSError if
    the disk is full.
    """

    STATE = ("rows",)

    def __init__(self, path: Path, columns: Sequence[pa.Field], names: Mapping[str, pa.Array], count: int):
        self.path, self.parts = path, parts_of(path)
        self.rows = 0  # in the parts
        self.open = False
        self.names = names
        self.schema = schema_of(columns)
        self.pending = 0  # samples in no part yet
        samples = max(1, ROW_GROUP // count)
        kinds = {c.name: np.int32 if c.type == NAMES else c.type.to_pandas_dtype() for c in self.schema}
        self.values = {name: np.empty((samples, count), kind) for name, kind in kinds.items()}

    def start(self) -> None:
        disk.require_room(self.path)
        self.parts.mkdir()
        self.open = True

    def go_on(self) -> None:
        """Resume after the first `rows` rows. Raises RunFolderError if fewer are left."""
        files = _part_files(self.path)
        self.parts.mkdir(exist_ok=True)
        disk.require_room(self.path, sum(file.stat().st_size for _, file in files))
        fresh, first = self.parts / "first.new", self.parts / part_name(0)
        held = _merge(files, fresh, self.schema, self.names, self.rows)
        if held < self.rows:
            raise RunFolderError(
                f"{self.path}: {held:,} of its first {self.rows:,} rows are left, without which the run cannot go on"
            )
        fresh.replace(first)  # the other files now repeat its rows
        for _, file in files:
            if file != first:
                file.unlink()
        self.open = True

    def took(self) -> None:
        """Count the sample that was put into row `pending` of the values."""
        self.pending += 1
        if self.pending == len(next(iter(self.values.values()))):
            self.flush()

    def flush(self) -> None:
        """Write the samples to the disk as another part."""
        if not self.pending:
            return
        arrays = []
        for field in self.schema:
            values = self.values[field.name][: self.pending].ravel()
            if field.type == NAMES:
                arrays.append(pa.DictionaryArray.from_arrays(values, self.names[field.name]))
            else:
                arrays.append(pa.array(values, field.type, from_pandas=True))
        table = pa.Table.from_arrays(arrays, schema=self.schema)
        disk.require_room(self.path, table.nbytes)
        part = self.parts / part_name(self.rows)
        fresh = part.with_suffix(".new")
        with _writer(fresh, self.schema) as writer:
            writer.write_table(table)
        disk.sync(fresh)
        fresh.replace(part)
        self.rows, self.pending = self.rows + len(table), 0

    def close(self) -> None:
        """Join the parts to one file."""
        if not self.open:
            return
        self.open = False
        try:
            self.flush()
        finally:
            join(self.path, self.names)


def part_name(begin: int) -> str:
    """Return the name of the part that begins with a row."""
    return f"{begin:012d}.parquet"


def part_files(folder: Path) -> list[Path]:
    """Return the parts of an unfinished table, in order."""
    return sorted(folder.glob("*.parquet"))


def _part_files(path: Path) -> list[Part]:
    """Return the files that hold rows of a table: the table itself, if it exists, and its parts."""
    whole = [(0, path)] if path.exists() else []
    return whole + [(int(file.stem), file) for file in part_files(parts_of(path))]


def batches(
    path: Path, columns: Sequence[str] | None = None, optional: Sequence[str] = ()
) -> Iterator[pa.RecordBatch]:
    """Yield the rows of a table in at least one batch; of an unfinished table from its parts.

    columns: names to read, in this order, by default all; optional: names to read if the table has them. Manifest and
    checksums of pages are checked. Raises RunFolderError, in a line.
    """
    if path.exists():
        manifest.require_unchanged(path, RunFolderError)
    try:
        files = _part_files(path)
        if not files:
            raise RunFolderError(f"{path}: holds no row yet")
        for _, file in files:
            fault = unopenable(file)
            if fault:
                raise RunFolderError(f"{file}: {fault}")
        schema = pq.read_schema(files[0][1])
        if columns is not None:
            columns = [*columns, *(name for name in optional if name in schema.names)]
            schema = pa.schema([schema.field(name) for name in columns], schema.metadata)
        yield pa.RecordBatch.from_pylist([], schema)
        yield from _once(files, None, columns)
    except (pa.ArrowException, OSError, ValueError, LookupError) as error:
        if isinstance(error, RunFolderError):
            raise
        raise RunFolderError(f"{path}: cannot be read: {plain(str(error))}") from None


def read(path: Path) -> pa.Table:
    """Return all rows of `batches`. Raises RunFolderError."""
    first, *rest = batches(path)
    return pa.Table.from_batches([first, *rest], first.schema).unify_dictionaries()


def robots_of(
    path: Path, columns: Sequence[str], trial: int
) -> tuple[dict[tuple[str, int], dict[str, np.ndarray]], set[int]]:
    """Return columns of robots.parquet in order of time by group and number of the robot, and the trials in the table.

    The result also has z, 0 for ground robots. Raises RunFolderError.
    """
    trials: set[int] = set()
    parts = []
    for batch in batches(path, ("group", "trial", "robot", *columns), optional=("z",)):
        trials.update(pc.unique(batch["trial"]).to_pylist())
        parts.append(batch.filter(pc.equal(batch["trial"], trial)))
    table = pa.Table.from_batches(parts).unify_dictionaries().sort_by("t")
    groups, numbers = (
        np.array(table["group"].cast(pa.string()).to_pylist(), object),
        table["robot"].to_numpy(),
    )
    values = {name: table[name].to_numpy() for name in table.column_names[3:]}
    values["z"] = np.nan_to_num(values.get("z", np.zeros(len(table))))
    robots = {}
    for group in dict.fromkeys(groups):
        for number in np.unique(numbers[groups == group]).tolist():
            rows = np.flatnonzero((groups == group) & (numbers == number))
            robots[group, number] = {name: column[rows] for name, column in values.items()}
    return robots, trials


def join(path: Path, names: Mapping[str, pa.Array] | None = None) -> None:
    """Join the parts of a table to the file `path`, and remove the parts.

    names: dictionaries of the columns of names; by default the names that occur. Raises OSError.
    """
    parts = parts_of(path)
    files = _part_files(path)
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
    files: list[Part], path: Path, schema: pa.Schema, names: Mapping[str, pa.Array], rows: int | None = None
) -> int:
    """Write the first `rows` rows of some files, or all, to one file, and return their number.

    The bytes of the file depend on these rows only.
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


def _in_groups(files: list[Part], rows: int | None) -> Iterator[pa.Table]:
    """Yield the rows of files as tables of ROW_GROUP rows, and one of the rest."""
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


def _once(
    files: list[Part], rows: int | None, columns: Sequence[str] | None = None
) -> Iterator[pa.RecordBatch]:
    """Yield the rows of files up to number `rows`, or all, without rows that a file repeats."""
    last, done = inf if rows is None else rows, 0
    for begin, file in files:
        with pq.ParquetFile(file, page_checksum_verification=True) as part:
            if begin + part.metadata.num_rows <= done or begin >= last:
                continue
            for batch in part.iter_batches(ROW_GROUP, columns=columns):
                count = max(0, int(min(last - max(begin, done), len(batch))))
                fresh = batch.slice(max(0, done - begin), count)
                begin += len(batch)
                if len(fresh):
                    done = begin
                    yield fresh


def _named(column: pa.ChunkedArray, names: pa.Array) -> pa.DictionaryArray:
    """Return a column of names with another dictionary."""
    numbers = pc.index_in(column.cast(pa.string()), value_set=names).combine_chunks()
    return pa.DictionaryArray.from_arrays(numbers, names)


def _names_in(files: list[Path], schema: pa.Schema) -> dict[str, pa.Array]:
    """Return all names in the columns of names."""
    columns = [field.name for field in schema if field.type == NAMES]
    tables = pa.concat_tables([pq.read_table(file, columns=columns) for file in files])
    return {name: pc.unique(tables[name].cast(pa.string())) for name in columns}


def _writer(path: Path, schema: pa.Schema) -> pq.ParquetWriter:
    """Return a writer that splits float32 values into streams of bytes.

    Measured values hardly repeat: tables are a third smaller than with dictionaries, written in a third of the time.
    """
    measured = [field.name for field in schema if field.type == pa.float32()]
    others = [field.name for field in schema if field.type != pa.float32()]
    return pq.ParquetWriter(
        path,
        schema,
        compression="zstd",
        write_page_checksum=True,
        use_dictionary=others,  # type: ignore[arg-type]
        use_byte_stream_split=measured,  # type: ignore[arg-type]
    )
