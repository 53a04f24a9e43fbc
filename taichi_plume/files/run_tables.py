"""Parquet tables that grow during a run, with units and meanings of the columns as metadata.

pandas finds the metadata in `attrs["units"]` and `attrs["meanings"]`, polars as JSON texts `units` and `meanings` of
``polars.read_parquet_metadata``.

During the run the rows are in an Arrow IPC stream beside the table, which is readable up to the last complete record
batch; at the end the stream becomes the Parquet file.
"""

import io
import json
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import chain
from pathlib import Path
from zlib import crc32

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from taichi_plume.files import disk, manifest, parquet
from taichi_plume.files.run_folder import RunFolderError
from taichi_plume.files.tables import plain
from taichi_plume.guard.safe_open import open_regular

ROW_GROUP = 50_000
CHECKSUM = b"crc32"  # key of the metadata of each record batch of a stream
NAMES = pa.dictionary(pa.int32(), pa.string())
VOCABULARY = "vocabulary"  # key of a column's metadata: all names that may occur, as a JSON list
DECISION = "decision"  # key of the metadata of a column with a decision quantity of search algorithms
FAULTS = (pa.ArrowException, OSError, ValueError, LookupError, MemoryError)
"""Errors of reading a damaged table."""


def column(name: str, kind: pa.DataType, unit: str, meaning: str, **more: str) -> pa.Field:
    """Return the definition of a table's column with unit and meaning; more: other metadata."""
    return pa.field(name, kind, metadata={"unit": unit, "meaning": meaning, **more})


def schema_of(columns: Sequence[pa.Field]) -> pa.Schema:
    """Return a table's schema for these columns, with units and meanings as metadata that pandas and polars read."""
    facts = {"units": units(columns), "meanings": meanings(columns)}
    pandas = {"index_columns": [], "column_indexes": [], "columns": [], "attributes": facts}
    return pa.schema(columns, {key: json.dumps(value) for key, value in {"pandas": pandas, **facts}.items()})


def units(columns: Iterable[pa.Field]) -> dict[str, str]:
    """Return the unit of each column by name, from its metadata."""
    return {column.name: (column.metadata or {}).get(b"unit", b"1").decode() for column in columns}


def meanings(columns: Iterable[pa.Field]) -> dict[str, str]:
    """Return the meaning (description) of each column by name, from its metadata."""
    return {column.name: (column.metadata or {}).get(b"meaning", b"").decode() for column in columns}


def vocabulary(column: pa.Field) -> list[str]:
    """Return the names that may occur in a column, in their order; empty if the table does not keep them."""
    try:
        names = json.loads((column.metadata or {}).get(VOCABULARY.encode(), b"[]"))
    except ValueError:
        return []
    return [name for name in names if isinstance(name, str)] if isinstance(names, list) else []


def decisions(schema: pa.Schema) -> list[str]:
    """Return the names of the columns with decision quantities of search algorithms."""
    marked = [column for column in schema if DECISION.encode() in (column.metadata or {})]
    return [column.name for column in marked if column.type == pa.float32()]


def title_of(name: str, unit: str) -> str:
    """Return the title of a plot of a column: name and unit."""
    return name.replace("_", " ") + ("" if unit == "1" else f" [{unit}]")


def schema_in(path: Path) -> pa.Schema:
    """Return the schema of a run's table. Raises RunFolderError, read errors (FAULTS)."""
    return next(unverified(path)).schema


def stream_of(path: Path) -> Path:
    """Return the path of the Arrow stream that holds the rows of a Parquet table during the run."""
    return path.with_suffix(".arrows")


class GrowingTable:
    """Writer of a Parquet table in samples of `count` rows. `close()` writes the table, also after an error.

    values: samples that are not yet in the Arrow stream, (samples, count) by column; names: dictionaries of the
    columns of names, whose values are indices. `start()` creates the table, `resume()` continues it in a resumed run.
    Raises OSError if the disk is full.
    """

    STATE = ("rows",)

    def __init__(self, path: Path, columns: Sequence[pa.Field], names: Mapping[str, pa.Array], count: int):
        self.path, self.stream = path, stream_of(path)
        self.rows = 0  # in the stream
        self.size = 0  # of the stream [bytes]
        self.open = False
        self.names = names
        self.schema = schema_of(columns)
        self.unsaved = io.BytesIO()  # end of the stream that is not on the disk yet
        self.writer = pa.ipc.new_stream(
            self.unsaved, self.schema, options=pa.ipc.IpcWriteOptions(compression="zstd")
        )
        self.pending = 0  # samples not yet in the stream
        samples = max(1, ROW_GROUP // count)
        kinds = {c.name: np.int32 if c.type == NAMES else c.type.to_pandas_dtype() for c in self.schema}
        self.values = {name: np.empty((samples, count), kind) for name, kind in kinds.items()}

    def start(self) -> None:
        disk.require_room(self.path)
        self.stream.open("xb").close()
        self.open = True

    def resume(self) -> None:
        """Continue the table of a resumed run with its first `rows` rows.

        Raises RunFolderError if fewer are left, or if its columns are those of another version.
        """
        disk.require_room(self.path)
        rows, self.rows = self.rows, 0
        with disk.written_whole(self.stream) as fresh:
            for batch in batches(self.path) if rows else ():
                if batch.schema != self.schema:
                    raise RunFolderError(f"{self.path}: is of another version, with other columns")
                self._put(batch.slice(0, rows - self.rows))
                self._save(fresh)
            if self.rows < rows:
                raise RunFolderError(
                    f"{self.path}: {self.rows:,} of its first {rows:,} rows are left, "
                    "without which the run cannot go on"
                )
        self.path.unlink(missing_ok=True)
        self.open = True

    def took(self) -> None:
        """Count the sample that the caller put into row `pending` of `values`; flush if `values` is full."""
        self.pending += 1
        if self.pending == len(next(iter(self.values.values()))):
            self.flush()

    def flush(self) -> None:
        """Write all pending samples to the Arrow stream on disk."""
        if self.pending:
            self._put(self.take())
        self._save(self.stream)

    def take(self) -> pa.RecordBatch:
        """Return the rows of all pending samples, which are then no longer pending."""
        arrays = []
        for field in self.schema:
            values = self.values[field.name][: self.pending].ravel()
            if field.type == NAMES:
                arrays.append(pa.DictionaryArray.from_arrays(values, self.names[field.name]))
            else:
                arrays.append(pa.array(values, field.type, from_pandas=True))
        self.pending = 0
        return pa.record_batch(arrays, schema=self.schema)

    def _put(self, batch: pa.RecordBatch) -> None:
        if len(batch):
            self.writer.write_batch(batch, {CHECKSUM: _checksum(batch)})
            self.rows += len(batch)

    def _save(self, stream: Path) -> None:
        """Append buffered bytes to the stream file, after cutting off the remains of an interrupted write."""
        content = self.unsaved.getvalue()
        if not content:
            return
        disk.require_room(stream, len(content))
        with stream.open("rb+") as file:
            file.seek(self.size)
            file.truncate()
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        self.size += len(content)
        self.unsaved.seek(0)
        self.unsaved.truncate()

    def close(self) -> None:
        """Write the final Parquet table and remove the Arrow stream."""
        if not self.open:
            return
        self.open = False
        try:
            self.flush()
        finally:
            finish(self.path)


def finish(path: Path) -> None:
    """Convert the Arrow stream beside `path` to the Parquet file `path`, and remove the stream. Raises OSError.

    Only complete batches are kept. The bytes of the file depend on their rows only.
    """
    stream = stream_of(path)
    rows = _of_stream(stream)
    first = next(rows, None)
    if first is not None:
        disk.require_room(path, stream.stat().st_size)
        with disk.written_whole(path) as fresh, _writer(fresh, first.schema) as writer:
            for table in _in_groups(chain([first], rows)):
                writer.write_table(table)
    stream.unlink()


def batches(
    path: Path, columns: Sequence[str] | None = None, optional: Sequence[str] = ()
) -> Iterator[pa.RecordBatch]:
    """Yield an empty batch and the rows of a run's table, from its Arrow stream if the Parquet file is unfinished.

    columns: names to read, in this order, by default all; optional: names to read if the table has them. Manifest and
    checksums of pages are checked. Raises RunFolderError, in a line.
    """
    if path.exists():
        manifest.require_unchanged(path, RunFolderError)
    try:
        yield from unverified(path, columns, optional)
    except FAULTS as error:
        if isinstance(error, RunFolderError):
            raise
        raise RunFolderError(f"{path}: cannot be read: {plain(str(error) or type(error).__name__)}") from None


def unverified(
    path: Path, columns: Sequence[str] | None = None, optional: Sequence[str] = ()
) -> Iterator[pa.RecordBatch]:
    """Yield batches as `batches` does, without the manifest's check. Raises RunFolderError, read errors (FAULTS)."""
    stream = stream_of(path)
    rows = _of_stream(stream) if stream.exists() else _of_table(path, columns and [*columns, *optional])
    first = next(rows, None)
    if first is None:
        raise RunFolderError(f"{path}: holds no row yet")
    names = first.schema.names
    if columns is not None:
        names = [*columns, *(name for name in optional if name in names)]
    for batch in chain([first.slice(0, 0), first], rows):
        yield batch.select(names)


def _of_table(path: Path, columns: Sequence[str] | None) -> Iterator[pa.RecordBatch]:
    """Yield an empty batch and the rows of a Parquet table; columns: names to read, if the table has them."""
    with parquet.opened(path) as table:
        yield pa.RecordBatch.from_pylist([], table.schema_arrow)
        yield from table.iter_batches(ROW_GROUP, columns=columns, use_threads=False)


def _of_stream(stream: Path) -> Iterator[pa.RecordBatch]:
    """Yield the complete batches of an Arrow stream. Raises read errors (FAULTS) if damaged before the end."""
    with open_regular(stream) as file:
        size = os.fstat(file.fileno()).st_size
        try:
            for batch, facts in pa.ipc.open_stream(file).iter_batches_with_custom_metadata():
                batch.validate(full=True)
                if facts and facts[CHECKSUM] != _checksum(batch):
                    raise ValueError("a record batch has another checksum")
                yield batch
        except FAULTS:
            if file.tell() < size:
                raise


def _checksum(batch: pa.RecordBatch) -> bytes:
    return str(crc32(batch.serialize())).encode()


def read(path: Path) -> pa.Table:
    """Return all rows of a run's table, checked against the manifest. Raises RunFolderError."""
    first, *rest = batches(path)
    return pa.Table.from_batches([first, *rest], first.schema).unify_dictionaries()


def robots_of(
    path: Path, columns: Sequence[str], trial: int
) -> tuple[dict[tuple[str, int], dict[str, np.ndarray]], set[int]]:
    """Return a trial's columns (n,), sorted by time, by (robot group, number), and the set of all trials in the table.

    The columns also have z, 0 for ground robots. Raises RunFolderError.
    """
    trials: set[int] = set()
    parts = []
    for batch in batches(path, ("group", "trial", "robot", *columns), optional=("z",)):
        trials.update(pc.unique(batch["trial"]).to_pylist())
        parts.append(batch.filter(pc.equal(batch["trial"], trial)))
    rows = pa.Table.from_batches(parts).unify_dictionaries().sort_by("t").to_pandas()
    rows["z"] = rows["z"].fillna(0.0) if "z" in rows else 0.0
    robots = {
        (group, number): {name: part[name].to_numpy() for name in (*columns, "z")}
        for (group, number), part in rows.groupby(["group", "robot"], sort=False, observed=True)
    }
    return robots, trials


def _in_groups(batches: Iterable[pa.RecordBatch]) -> Iterator[pa.Table]:
    """Regroup batches of rows into tables of ROW_GROUP rows; the last table holds the rest."""
    waiting: list[pa.RecordBatch] = []
    held = 0
    for batch in batches:
        waiting.append(batch)
        held += len(batch)
        if held >= ROW_GROUP:
            table = pa.Table.from_batches(waiting)
            yield table.slice(0, ROW_GROUP)
            waiting, held = table.slice(ROW_GROUP).to_batches(), held - ROW_GROUP
    if held:
        yield pa.Table.from_batches(waiting)


def _writer(fresh: Path, schema: pa.Schema) -> pq.ParquetWriter:
    """Return a Parquet writer that stores float32 columns as byte streams, without dictionaries.

    Measured values hardly repeat: tables are a third smaller than with dictionaries, written in a third of the time.
    """
    measured = [field.name for field in schema if field.type == pa.float32()]
    others = [field.name for field in schema if field.type != pa.float32()]
    return pq.ParquetWriter(
        fresh,
        schema,
        compression="zstd",
        write_page_checksum=True,
        use_dictionary=others,  # type: ignore[arg-type]
        use_byte_stream_split=measured,  # type: ignore[arg-type]
    )
