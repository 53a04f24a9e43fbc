"""Reader of recorded gas-sensor readings: robots.parquet of a run, a ROS bag or CSV file of real robots, a DataFrame.

A CSV or a DataFrame has the columns t [s], x, y [m] and reading [ppm] and, if known, wind_x, wind_y [m/s], trial
(integers), group and robot (names), or columns that the user names for these; other columns are ignored. Units in the
names of columns count, see `named_columns`. Positions and wind of a run are those that the robots believed, from which
the run made its maps. Robots of a bag (see `bag_readings`) are groups.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from taichi_plume.files import bag_readings, bags, manifest
from taichi_plume.files.bag_readings import BagOptions
from taichi_plume.files.conventions import ConventionError, FileFacts, iso_times, spans, when
from taichi_plume.files.named_columns import Column, Picked, cleared, pick, read_columns
from taichi_plume.files.tables import TextFile, listed, plain
from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.safe_open import unopenable
from taichi_plume.scenario.changes import shown

if TYPE_CHECKING:
    import pandas
    import pyarrow

COLUMNS = {
    "date": Column(("date",), is_text=True, is_needed=False),
    "t": Column(("t", "time", "timestamp", "datetime", "date_time"), "s"),
    "x": Column(("believed_x", "x"), "m"),
    "y": Column(("believed_y", "y"), "m"),
    "reading": Column(("reading_ppm", "reading", "concentration"), "ppm", may_lack=True),
    "wind_x": Column(("wind_x",), "m/s", is_needed=False, may_lack=True),
    "wind_y": Column(("wind_y",), "m/s", is_needed=False, may_lack=True),
    "trial": Column(("trial",), is_needed=False),
    "group": Column(("group",), is_text=True, is_needed=False),
    "robot": Column(("robot",), is_text=True, is_needed=False),
}
TEXTS = ("group", "robot")
OVERFLOWS = (999.0, 9999.0, 32767.0, 65535.0)  # readings that often mean none
MOST_NEGATIVE = 0.2  # of the largest reading: more is no noise
MOST_ROWS = 10_000_000
MOST = {"t": 1e10, "x": 1e8, "y": 1e8, "reading": 1e9, "wind_x": 1e4, "wind_y": 1e4}
"""Largest absolute values; larger values are mistakes: a Unix time is 2e9 s, pure vapour 1e6 ppm."""


class ReadingsError(InputError):
    """Error: no gas map can be made of these readings or parameters; the message is one line."""


@dataclass(frozen=True)
class Readings:
    """Gas readings sorted by time: t (n,) [s], place (n, 2) [m], reading (n,) [ppm], wind (n, 2) [m/s], 0 if unknown.

    A reading that is missing is NaN. row: (n,) row of the file, from 1 on below the header. topics: for a bag, a line
    for each robot on the topics that were read. path: the file, if any. robot: (n,) numbers of the robots from 0 on,
    None if unknown. facts: units, ranges and what was assumed.
    """

    t: np.ndarray
    place: np.ndarray
    reading: np.ndarray
    wind: np.ndarray
    row: np.ndarray
    topics: tuple[str, ...] = ()
    path: Path | None = None
    robot: np.ndarray | None = None
    facts: FileFacts = field(default=FileFacts(""))


class Columns(NamedTuple):
    """Columns of readings by the keys of COLUMNS, in the units there, as `picked`; remarks: what was assumed."""

    known: dict[str, np.ndarray]
    picked: Mapping[str, Picked]
    remarks: tuple[str, ...] = ()
    topics: tuple[str, ...] = ()


def read(
    source: "str | Path | pandas.DataFrame",
    trial: int | None = None,
    group: str | None = None,
    options: BagOptions | None = None,
    columns: Mapping[str, str] | None = None,
    missing: Sequence[float] = (),
) -> Readings:
    """Return the gas readings of a file or a table.

    trial, group: by default the first trial and all groups. options: for a bag. columns: names of the table's columns
    for t, x, y, reading and so on, with or without a unit. missing: numbers that mean no reading, besides the usual
    ones. Raises ReadingsError.
    """
    file = Path(source) if isinstance(source, str | Path) else None
    path, is_bag = file or Path("DataFrame"), file is not None and bags.is_bag(file)
    given = dict(columns or {})
    unknown = [key for key in given if key not in COLUMNS]
    if unknown:
        raise ReadingsError(f"columns: '{unknown[0]}' is none of {', '.join(COLUMNS)}")
    if given and is_bag:
        raise ReadingsError(f"{path}: is a bag, which has topics instead of columns")
    if not is_bag and options is not None and options != BagOptions():
        raise ReadingsError(f"{path}: is no bag, so it has no topics, frames and units to choose")
    if is_bag:
        read_in = _bag(path, options)
    elif not isinstance(source, str | Path):
        read_in = _data_frame(path, source, given, missing)
    elif path.suffix.lower() == ".parquet":
        read_in = _parquet(path, given, missing)
    else:
        read_in = _csv(path, given, missing)
    known, names = read_in.known, {key: column.name for key, column in read_in.picked.items()}
    chosen = _of_trial(path, known.get("trial"), trial, _of_group(path, known, group))
    if names["x"] == "believed_x":
        chosen &= known["t"] > 0.0  # a run measures nothing before its first tick
    row = np.flatnonzero(chosen)
    if not len(row):
        raise ReadingsError(f"{path}: has no readings")
    for key in ("t", "x", "y"):
        unknown_at = row[~np.isfinite(known[key][row])]
        if len(unknown_at):
            raise ReadingsError(f"{path}: {names[key]} of row {unknown_at[0] + 1} is not a number")
    for key, most in MOST.items():
        values = known[key][row] if key in known else np.zeros(1)
        large = np.flatnonzero((np.abs(values) > most) & np.isfinite(values))
        if len(large):
            where = f"{path}: {names[key]} of row {row[large[0]] + 1}"
            hint = "; if it is in another unit, name it, such as t=stamp [ms]" if key == "t" else ""
            raise ReadingsError(
                f"{where} is {values[large[0]]:g}, a mistake; at most {most:g} is allowed{hint}"
            )
    row = row[np.argsort(known["t"][row], kind="stable")]
    still = np.zeros(len(chosen))
    wind = np.column_stack([known.get("wind_x", still), known.get("wind_y", still)])[row]
    readings = Readings(
        known["t"][row],
        np.column_stack([known["x"], known["y"]])[row],
        np.where(np.isfinite(known["reading"]), known["reading"], np.nan)[row],
        np.nan_to_num(wind, posinf=0.0, neginf=0.0),
        row + 1,
        read_in.topics,
        file,
        _robots([known[key][row] for key in TEXTS if key in known]),
    )
    facts = FileFacts(_facts(readings, _assumed(read_in.picked)), (*read_in.remarks, *_doubts(readings)))
    return replace(readings, facts=facts)


def _doubts(readings: Readings) -> Iterator[str]:
    """Yield remarks on readings that may mean none, though they count."""
    known = readings.reading[np.isfinite(readings.reading)]
    most = known.max(initial=0.0)
    if known.min(initial=0.0) < -MOST_NEGATIVE * most:
        yield f"readings go down to {known.min():g} ppm; if that means none, name it as missing"
    if most in OVERFLOWS:
        yield f"{(known == most).sum()} readings are {most:g} ppm; if that means none, name it as missing"


def _facts(readings: Readings, units: str) -> str:
    """Return a line on times, places, readings and missing readings; units: a text on units that were assumed."""
    known = readings.reading[np.isfinite(readings.reading)]
    missing = len(readings.reading) - len(known)
    values = f"{known.min():.4g} to {known.max():.4g} ppm" if len(known) else "no values"
    box = spans(readings.place.min(axis=0), readings.place.max(axis=0))
    none = f"{missing} missing" if missing else "none missing"
    parts = (f"{len(readings.t)} readings", when(readings.t), values, box, none, units)
    return ", ".join(filter(None, parts))


def _robots(names: list[np.ndarray]) -> np.ndarray | None:
    """Return the numbers (n,) of the robots with these names, from 0 on; names: columns (n,), whose rows count."""
    if not names:
        return None
    together = np.column_stack([column.astype(str) for column in names])
    return np.unique(together, axis=0, return_inverse=True)[1].reshape(-1)


def _bag(path: Path, options: BagOptions | None) -> Columns:
    """Return a ROS bag's gas readings as columns, with a line of text on each robot's topics."""
    try:
        robots = bag_readings.read(path, options)
    except bags.BagError as error:
        raise ReadingsError(str(error)) from None
    rows = [
        [robot.read_at, *robot.at.T, robot.ppm, *robot.wind.T, np.full(len(robot.ppm), robot.name, object)]
        for robot in robots
    ]
    names = ("t", "x", "y", "reading", "wind_x", "wind_y", "group")
    columns = map(np.concatenate, zip(*rows, strict=True))
    assumed: dict[str, list[str]] = {}
    for robot in robots:
        for remark in robot.remarks:
            assumed.setdefault(remark, []).append(robot.name)
    remarks = tuple(f"{listed(of)}: {remark}" for remark, of in assumed.items())
    lines = tuple(f"{robot.name}: {robot.topics}" for robot in robots)
    picked = {name: Picked(n, name, COLUMNS[name].unit) for n, name in enumerate(names)}
    return Columns(dict(zip(names, columns, strict=True)), picked, remarks, lines)


def _csv(path: Path, given: Mapping[str, str], missing: Sequence[float]) -> Columns:
    """Return a CSV's columns of readings. given, missing: see `read`."""
    named = read_columns(TextFile(path, ReadingsError), COLUMNS, given, missing, gaps=True)
    return Columns(named.values, named.picked, named.remarks)


def _assumed(picked: Mapping[str, Picked]) -> str:
    """Return a text on the units that the columns do not state."""
    silent = {key: column for key, column in picked.items() if key in MOST and not column.unit}
    units = ", ".join(f"{column.name} in {COLUMNS[key].unit}" for key, column in silent.items())
    return f"assumed: {units}" if units else ""


def _parquet(path: Path, given: Mapping[str, str], missing: Sequence[float]) -> Columns:
    """Return a Parquet file's columns of readings. given, missing: see `read`.

    Pages have checksums; the metadata have none, so the table of a run is compared with the manifest beside it.
    """
    import pyarrow as pa

    from taichi_plume.files import parquet

    reason = unopenable(path)
    if reason:
        raise ReadingsError(f"{path}: {reason}")
    manifest.require_unchanged(path, ReadingsError)
    try:
        with parquet.opened(path) as file:
            picked = _picked(path, file.schema_arrow.names, given)
            if file.metadata.num_rows > MOST_ROWS:  # a page of equal values takes a few bytes
                raise ReadingsError(f"{path}: has {file.metadata.num_rows:,} rows; at most {MOST_ROWS:,}")
            names = [column.name for column in picked.values()]
            table = file.read(columns=names, use_threads=False).select(names)
    except ReadingsError:
        raise
    except (pa.ArrowException, OSError, ValueError, KeyError) as error:  # the last two: of names and types
        raise ReadingsError(f"{path}: cannot be read: {plain(str(error))}") from None
    return _columns(path, table, picked, missing)


def _data_frame(path: Path, frame: object, given: Mapping[str, str], missing: Sequence[float]) -> Columns:
    """Return the columns of readings of a pandas table like `_parquet`. path: name of the table in messages."""
    import pandas
    import pyarrow as pa

    if not isinstance(frame, pandas.DataFrame):
        raise ReadingsError(f"readings: got {shown(frame)}; give a file, a run or a pandas.DataFrame")
    is_timed = isinstance(frame.index, pandas.DatetimeIndex | pandas.TimedeltaIndex)
    if is_timed and "t" not in given and not {*COLUMNS["t"].names} & {*map(str, frame.columns)}:
        frame = frame.reset_index(names="t")
    names = [str(name) for name in frame.columns]
    picked = _picked(path, names, given)
    try:
        taken = frame.iloc[:, [column.index for column in picked.values()]]
        taken = taken.set_axis([column.name for column in picked.values()], axis=1)
        table = pa.Table.from_pandas(taken, preserve_index=False)
    except (pa.ArrowException, ValueError, TypeError, KeyError) as error:
        raise ReadingsError(f"{path}: cannot be read: {plain(str(error))}") from None
    return _columns(path, table, picked, missing)


def _columns(
    path: Path, table: "pyarrow.Table", picked: Mapping[str, Picked], missing: Sequence[float]
) -> Columns:
    """Return the columns of a pyarrow table by key: names as texts, dates as Unix times, all others as numbers."""
    import pyarrow as pa

    known, remarks = {}, []
    for n, (key, column) in enumerate(picked.items()):
        values, kind = table.column(n), table.column(n).type
        try:
            if key == "t" and (pa.types.is_timestamp(kind) or pa.types.is_duration(kind)):
                whole = pa.timestamp("ns", kind.tz) if pa.types.is_timestamp(kind) else pa.duration("ns")
                known[key] = 1e-9 * values.cast(whole).cast("int64").to_numpy()
                continue
            if key == "t" and (pa.types.is_string(kind) or pa.types.is_large_string(kind)):
                known[key] = iso_times(values.to_pylist())
                continue
            if COLUMNS[key].is_text:
                known[key] = values.cast("string").to_numpy()
                continue
            numbers = values.cast("float64", safe=False).to_numpy()
            known[key], more = cleared(numbers, column, COLUMNS[key], missing)
        except (pa.ArrowException, ValueError):
            raise ReadingsError(f"{path}: {column.name} must be numbers, not {plain(str(kind))}") from None
        remarks += more
    return Columns(known, picked, tuple(remarks))


def _picked(path: Path, names: list[str], given: Mapping[str, str]) -> dict[str, Picked]:
    """Return the column of each key (t, x, reading ...) among these names. Raises ReadingsError."""
    try:
        picked = pick(names, COLUMNS, given)
    except ConventionError as error:
        raise ReadingsError(f"{path}: {error}") from None
    missing = [key for key, column in COLUMNS.items() if column.is_needed and key not in picked]
    if missing:
        raise ReadingsError(f"{path}: has no column {', '.join(missing)}; it has {listed(names)}")
    return picked


def _of_group(path: Path, known: dict[str, np.ndarray], group: str | None) -> np.ndarray:
    """Return a mask of the rows in this group of robots, by default all. Raises ReadingsError if there are none."""
    if group is None:
        return np.ones(len(known["t"]), bool)
    if "group" not in known:
        raise ReadingsError(f"{path}: has no column 'group' from which to select group '{group}'")
    # each sensor of a bag's robot with several sensors is a group, named by its topic
    names = [str(name) for name in known["group"]]
    chosen = np.array([name == group or name.startswith(f"{group}/") for name in names], bool)
    if not chosen.any():
        raise ReadingsError(f"{path}: has no group '{group}'; it has {listed(sorted(set(names)))}")
    return chosen


def _of_trial(path: Path, trials: np.ndarray | None, trial: int | None, chosen: np.ndarray) -> np.ndarray:
    """Return a mask of the `chosen` rows in this trial, by default the first. trials: (rows,), None if unknown."""
    if trials is None:
        if trial is not None:
            raise ReadingsError(f"{path}: has no column 'trial' from which to select trial {trial}")
        return chosen
    there = trials[chosen & np.isfinite(trials)]
    if not len(there):
        return chosen & False
    number = there.min() if trial is None else trial
    if number not in there:
        first, last = there.min(), there.max()
        raise ReadingsError(f"{path}: has no trial {number:g}; the first is {first:g}, the last {last:g}")
    return chosen & (trials == number)
