"""Recorded readings: the robots.parquet of a run, or a CSV file of a real robot's log.

A CSV has the columns t [s], x, y [m] and reading [ppm] and, where they are known, wind_x, wind_y [m/s], trial (whole
numbers) and group (names); others do not matter. Commas, semicolons or tabs part its columns. Of a run the places are
those where its robots believed to be, and the wind is the one that they took it for: what its maps were made of.
"""

import csv
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

NAMES = {
    "t": ("t",),
    "x": ("believed_x", "x"),
    "y": ("believed_y", "y"),
    "reading": ("reading_ppm", "reading"),
    "wind_x": ("wind_x",),
    "wind_y": ("wind_y",),
    "trial": ("trial",),
    "group": ("group",),
}
"""Of which the first that a file has is taken."""
NEEDED = ("t", "x", "y", "reading")
DELIMITERS = ",;\t"
LONGEST_HEADER = 1 << 16  # bytes


class ReadingsError(ValueError):
    """Readings or parameters that no map can be made of; the message is one line."""


@dataclass(frozen=True)
class Readings:
    """In order of time: t (n,) [s], place (n, 2) [m], reading (n,) [ppm], wind (n, 2) [m/s], zero if unknown.

    A reading that is no finite number is NaN. row: (n,), of the file, from 1 on below the header.
    """

    t: np.ndarray
    place: np.ndarray
    reading: np.ndarray
    wind: np.ndarray
    row: np.ndarray


def read(path: str | Path, trial: int | None = None, group: str | None = None) -> Readings:
    """Readings of a file (see above): of one trial, the first unless given, and of one group or of all.

    Raises ReadingsError.
    """
    path = Path(path)
    table, names = _table(path)
    columns = {key: next((name for name in of if name in names), None) for key, of in NAMES.items()}
    missing = [key for key in NEEDED if columns[key] is None]
    if missing:
        raise ReadingsError(f"{path}: has no column {', '.join(missing)}; it has {', '.join(names)}")
    chosen = _chosen(path, table, columns, trial, group)
    if columns["x"] == "believed_x":
        chosen &= _numbers(path, table, "t") > 0.0  # when a run begins nothing has been measured yet
    row = np.flatnonzero(chosen)
    if not len(row):
        raise ReadingsError(f"{path}: has no readings")
    values = {}
    for key in ("t", "x", "y", "reading", "wind_x", "wind_y"):
        name = columns[key]
        values[key] = np.zeros(len(row)) if name is None else _numbers(path, table, name)[row]
        if key in ("t", "x", "y") and not np.isfinite(values[key]).all():
            first = row[~np.isfinite(values[key])][0]
            raise ReadingsError(f"{path}: {name} of row {first + 1} is not a number")
    order = np.argsort(values["t"], kind="stable")
    return Readings(
        values["t"][order],
        np.column_stack([values["x"], values["y"]])[order],
        np.where(np.isfinite(values["reading"]), values["reading"], np.nan)[order],
        np.nan_to_num(np.column_stack([values["wind_x"], values["wind_y"]])[order], posinf=0.0, neginf=0.0),
        row[order] + 1,
    )


def _table(path: Path) -> tuple[Any, list[str]]:
    """The Arrow table of a file, with those columns alone that may be needed, and the names of all it has."""
    import pyarrow as pa
    import pyarrow.csv
    import pyarrow.parquet as pq

    known = {name for names in NAMES.values() for name in names}
    try:
        if path.suffix.lower() == ".parquet":
            with pq.ParquetFile(path) as file:
                names = list(file.schema_arrow.names)
                _refuse_twins(path, names)
                return file.read(columns=[name for name in names if name in known]), names
        with pa.input_stream(str(path)) as stream:
            delimiter, names = _header(path, stream.read(LONGEST_HEADER))
        table = pa.csv.read_csv(
            path,
            pa.csv.ReadOptions(column_names=names, skip_rows=1),
            pa.csv.ParseOptions(delimiter=delimiter),
            pa.csv.ConvertOptions(
                include_columns=[name for name in names if name in known],
                column_types={"group": pa.string()},
            ),
        )
        return table, names
    except (pa.ArrowException, OSError) as error:
        number = getattr(error, "errno", None)
        reason = os.strerror(number) if number else (str(error).splitlines() or ["not in this format"])[0]
        raise ReadingsError(f"{path}: cannot be read: {reason}") from None


def _header(path: Path, begin: bytes) -> tuple[str, list[str]]:
    """The delimiter and the names in the first line of a CSV that begins so."""
    try:
        line = begin.partition(b"\n")[0].decode("utf-8-sig")
    except UnicodeDecodeError:
        raise ReadingsError(f"{path}: line 1 is not UTF-8 text") from None
    if not line.strip():
        raise ReadingsError(f"{path}: line 1 is empty; it must name the columns {', '.join(NEEDED)}")
    delimiter = max(DELIMITERS, key=line.count)
    names = [name.strip() for name in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))]
    _refuse_twins(path, names)
    return delimiter, names


def _refuse_twins(path: Path, names: list[str]) -> None:
    for name in sum(NAMES.values(), ()):
        if names.count(name) > 1:
            raise ReadingsError(f"{path}: has several columns '{name}'; remove or rename all but one")


def _chosen(
    path: Path, table: Any, columns: dict[str, str | None], trial: int | None, group: str | None
) -> np.ndarray:
    """Whether each row belongs to the trial, by default the first, and to the group, by default any."""
    chosen = np.ones(table.num_rows, bool)
    if columns["group"] is None and group is not None:
        raise ReadingsError(f"{path}: has no column group, so there is no group '{group}'")
    if group is not None:
        groups = np.array(table["group"].cast("string").to_pylist(), object)
        chosen = groups == group
        if not chosen.any():
            known = ", ".join(sorted({str(name) for name in groups}))
            raise ReadingsError(f"{path}: has no group '{group}'; it has {known}")
    if columns["trial"] is None:
        if trial is not None:
            raise ReadingsError(f"{path}: has no column trial, so there is no trial {trial}")
        return chosen
    trials = _numbers(path, table, "trial")
    known = trials[chosen & np.isfinite(trials)]
    if not len(known):
        return chosen & False
    wanted = known.min() if trial is None else trial
    if not (known == wanted).any():
        raise ReadingsError(
            f"{path}: has no trial {wanted:g}; the first is {known.min():g}, the last {known.max():g}"
        )
    return chosen & (trials == wanted)


def _numbers(path: Path, table: Any, name: str) -> np.ndarray:
    """A column as floats (n,); NaN where there is nothing."""
    import pyarrow as pa
    import pyarrow.types

    kind = table[name].type
    if pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_null(kind):
        return table[name].cast("float64", safe=False).to_numpy()
    values = np.full(table.num_rows, np.nan)
    for row, value in enumerate(table[name].to_pylist()):
        try:
            if isinstance(value, bool):
                raise TypeError
            values[row] = np.nan if value in (None, "") else float(value)
        except (TypeError, ValueError):
            raise ReadingsError(f"{path}: {name} of row {row + 1} must be a number, got {value!r}") from None
    return values
