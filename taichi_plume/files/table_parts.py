"""A Parquet table that grows while a run lasts, units and meanings as metadata of its columns, and of the whole.

pandas finds them in `attrs["units"]` and `attrs["meanings"]`, polars as texts in JSON, `units` and `meanings` of
``polars.read_parquet_metadata``.

Until its end its rows are in a folder beside it, in small files each of which can be read; then they become one. Each
is named after its first row: a row that is in two files, as the process was killed between two steps, counts once.
"""

import json
from collections.abc import Iterator, Sequence
from math import inf
from pathlib import Path
from typing import Any

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
Found = tuple[int, Path]
"""The number of a file's first row, and the file."""


def column(name: str, kind: pa.DataType, unit: str, meaning: str, **more: str) -> pa.Field:
    """A column of a table; more: other metadata."""
    return pa.field(name, kind, metadata={"unit": unit, "meaning": meaning, **more})


def schema_of(columns: Sequence[pa.Field]) -> pa.Schema:
    """A table's columns, and what others look for: pandas takes what its own files have as `attributes`."""
    told = {
        "units": {one.name: one.metadata[b"unit"].decode() for one in columns},
        "meanings": {one.name: one.metadata[b"meaning"].decode() for one in columns},
    }
    pandas = {"index_columns": [], "column_indexes": [], "columns": [], "attributes": told}
    return pa.schema(columns, {name: json.dumps(one) for name, one in {"pandas": pandas, **told}.items()})


def units(schema: pa.Schema) -> dict[str, str]:
    """Return the unit of each column."""
    return {one.name: (one.metadata or {}).get(b"unit", b"1").decode() for one in schema}


def meanings(schema: pa.Schema) -> dict[str, str]:
    """Return what each column says."""
    return {one.name: (one.metadata or {}).get(b"meaning", b"").decode() for one in schema}


def parts_of(path: Path) -> Path:
    """The folder of a table's parts."""
    return path.with_suffix(".parts")


class PartsTable:
    """A table of samples, each of `count` rows. `close()` makes it, whatever happened.

    values: what was sampled and is in no part yet, (samples, count) by the column's name; names: all that stand in its
    columns of names, of which values are numbers. `start()` begins it, `go_on()` continues that of a run that was
    resumed. Raises OSError when the disk is full.
    """

    STATE = ("rows",)

    def __init__(self, path: Path, columns: Sequence[pa.Field], names: dict[str, pa.Array], count: int):
        self.path, self.parts = path, parts_of(path)
        self.rows = 0  # that are in the parts
        self.open = False
        self.names = names
        self.schema = schema_of(columns)
        self.kept = 0  # samples that are in no part yet
        samples = max(1, ROW_GROUP // count)
        self.values = {
            field.name: np.empty((samples, count), _numpy_kind(field.type)) for field in self.schema
        }

    def start(self) -> None:
        disk.require_room(self.path)
        self.parts.mkdir()
        self.open = True

    def go_on(self) -> None:
        """Keep the first `rows` rows of what there is, and begin after them. Raises RunFolderError where some lack."""
        found = _found(self.path)
        self.parts.mkdir(exist_ok=True)
        disk.require_room(self.path, sum(file.stat().st_size for _, file in found))
        fresh, first = self.parts / "first.new", self.parts / part_name(0)
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

    def took(self) -> None:
        """A sample has been taken, as number `kept` of the values."""
        self.kept += 1
        if self.kept == len(next(iter(self.values.values()))):
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
        part = self.parts / part_name(self.rows)
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


def part_name(begin: int) -> str:
    """Of the part that begins with that row."""
    return f"{begin:012d}.parquet"


def part_files(folder: Path) -> list[Path]:
    """The parts of a table that is not finished, in their order."""
    return sorted(folder.glob("*.parquet"))


def _found(path: Path) -> list[Found]:
    """The files that hold rows of a table: itself, if it has been made before, and its parts."""
    whole = [(0, path)] if path.exists() else []
    return whole + [(int(file.stem), file) for file in part_files(parts_of(path))]


def batches(
    path: Path, columns: Sequence[str] | None = None, optional: Sequence[str] = ()
) -> Iterator[pa.RecordBatch]:
    """The rows of a table, at least one batch, as far as they are: of its parts where it is not finished.

    columns: names of those that are read, in this order; unless given, all. optional: of those that are read besides,
    where there are such. The bytes are checked, by the manifest
    beside it and the sums of its pages. Raises RunFolderError, in a line.
    """
    damage = manifest.changed(path) if path.exists() else None
    if damage:
        raise RunFolderError(damage)
    try:
        files = _found(path)
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
    """All rows of `batches`. Raises RunFolderError."""
    first, *rest = batches(path)
    return pa.Table.from_batches([first, *rest], first.schema).unify_dictionaries()


def join(path: Path, names: dict[str, pa.Array] | None = None) -> None:
    """Make the file `path` of the parts beside it, and remove these.

    names: all that stand in columns of names; unless given, those that are found. Raises OSError.
    """
    parts = parts_of(path)
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


def _once(
    files: list[Found], rows: int | None, columns: Sequence[str] | None = None
) -> Iterator[pa.RecordBatch]:
    """The rows of files up to number `rows`, or all; what one repeats of those before it is left out."""
    last, done = inf if rows is None else rows, 0
    for begin, file in files:
        with pq.ParquetFile(file, page_checksum_verification=True) as part:
            if begin + part.metadata.num_rows <= done or begin >= last:
                continue
            for batch in part.iter_batches(ROW_GROUP, columns=columns):
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
    """Measured values hardly repeat: with each of their four bytes in a stream of its own, tables are a third smaller
    than with dictionaries, and written in a third of the time.
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
