"""Reader of recorded gas-sensor readings: robots.parquet of a run, a ROS bag or CSV file of real robots, a DataFrame.

A CSV or a DataFrame has the columns t [s], x, y [m] and reading [ppm] and, if known, wind_x, wind_y [m/s], trial
(integers), group and robot (names); other columns are ignored. Columns of a CSV are separated by commas, semicolons or
tabs. Positions and wind of a run are those that the robots believed, from which the run made its maps. Robots of a bag
(see `bag_readings`) are groups.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from taichi_plume.files import bag_readings, bags, manifest
from taichi_plume.files.bag_readings import BagOptions
from taichi_plume.files.tables import Table, TextFile, cells_of, delimiter_of, listed, plain
from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.safe_open import unopenable
from taichi_plume.scenario.changes import shown

if TYPE_CHECKING:
    import pandas
    import pyarrow

NAMES = {
    "t": ("t",),
    "x": ("believed_x", "x"),
    "y": ("believed_y", "y"),
    "reading": ("reading_ppm", "reading"),
    "wind_x": ("wind_x",),
    "wind_y": ("wind_y",),
    "trial": ("trial",),
    "group": ("group",),
    "robot": ("robot",),
}
"""Accepted column names, preferred names first."""
TEXTS = ("group", "robot")
"""Columns of names, all others are numbers."""
MOST_ROWS = 10_000_000
NEEDED = ("t", "x", "y", "reading")
MOST = {"t": 1e13, "x": 1e8, "y": 1e8, "reading": 1e9, "wind_x": 1e4, "wind_y": 1e4}
"""Largest absolute values; larger values are mistakes: a Unix time is 2e12 ms, pure vapour 1e6 ppm."""


class ReadingsError(InputError):
    """Error: no gas map can be made of these readings or parameters; the message is one line."""


@dataclass(frozen=True)
class Readings:
    """Gas readings sorted by time: t (n,) [s], place (n, 2) [m], reading (n,) [ppm], wind (n, 2) [m/s], 0 if unknown.

    A reading that is no finite number is NaN. row: (n,) row of the file, from 1 on below the header. topics: for a
    bag, a line for each robot on the topics that were read. path: the file, if any. robot: (n,) numbers of the robots
    from 0 on, None if unknown.
    """

    t: np.ndarray
    place: np.ndarray
    reading: np.ndarray
    wind: np.ndarray
    row: np.ndarray
    topics: tuple[str, ...] = ()
    path: Path | None = None
    robot: np.ndarray | None = None


def read(
    source: "str | Path | pandas.DataFrame",
    trial: int | None = None,
    group: str | None = None,
    options: BagOptions | None = None,
) -> Readings:
    """Return the gas readings of a file or a table.

    trial, group: by default the first trial and all groups. options: for a bag. Raises ReadingsError.
    """
    file = Path(source) if isinstance(source, str | Path) else None
    path, topics = file or Path("DataFrame"), ()
    if file is not None and bags.is_bag(file):
        names, known, topics = _bag(file, options)
    elif options is not None and options != BagOptions():
        raise ReadingsError(f"{path}: is no bag, so it has no topics, frames and units to choose")
    elif not isinstance(source, str | Path):
        names, known = _data_frame(path, source)
    else:
        names, known = _parquet(path) if path.suffix.lower() == ".parquet" else _csv(path)
    chosen = _of_trial(path, known.get("trial"), trial, _of_group(path, known, group))
    if names["x"] == "believed_x":
        chosen &= known["t"] > 0.0  # a run measures nothing before its first tick
    row = np.flatnonzero(chosen)
    if not len(row):
        raise ReadingsError(f"{path}: has no readings")
    for key in ("t", "x", "y"):
        unknown = row[~np.isfinite(known[key][row])]
        if len(unknown):
            raise ReadingsError(f"{path}: {names[key]} of row {unknown[0] + 1} is not a number")
    for key, most in MOST.items():
        values = known[key][row] if key in known else np.zeros(1)
        large = np.flatnonzero((np.abs(values) > most) & np.isfinite(values))
        if len(large):
            where = f"{path}: {names[key]} of row {row[large[0]] + 1}"
            raise ReadingsError(f"{where} is {values[large[0]]:g}, a mistake; at most {most:g} is allowed")
    row = row[np.argsort(known["t"][row], kind="stable")]
    still = np.zeros(len(chosen))
    wind = np.column_stack([known.get("wind_x", still), known.get("wind_y", still)])[row]
    return Readings(
        known["t"][row],
        np.column_stack([known["x"], known["y"]])[row],
        np.where(np.isfinite(known["reading"]), known["reading"], np.nan)[row],
        np.nan_to_num(wind, posinf=0.0, neginf=0.0),
        row + 1,
        topics,
        file,
        _robots([known[key][row] for key in TEXTS if key in known]),
    )


def _robots(names: list[np.ndarray]) -> np.ndarray | None:
    """Return the numbers (n,) of the robots with these names, from 0 on; names: columns (n,), whose rows count."""
    if not names:
        return None
    together = np.column_stack([column.astype(str) for column in names])
    return np.unique(together, axis=0, return_inverse=True)[1].reshape(-1)


def _bag(
    path: Path, options: BagOptions | None
) -> tuple[dict[str, str], dict[str, np.ndarray], tuple[str, ...]]:
    """Return a ROS bag's gas readings as columns like `_csv`, and a line of text on each robot's topics."""
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
    lines = tuple(f"{robot.name}: {robot.topics}" for robot in robots)
    return {name: name for name in names}, dict(zip(names, columns, strict=True)), lines


def _csv(path: Path) -> tuple[dict[str, str], dict[str, np.ndarray]]:
    """Return a CSV's columns of readings: names in the file and values, both by standard key such as t, x, reading."""
    file = TextFile(path, ReadingsError)
    delimiter = delimiter_of(file.lines[0])
    all_names = cells_of(file.lines[0], delimiter)
    names = _picked(path, all_names)
    table = Table(file, file.rows(1), len(all_names), delimiter, gaps=True)
    keys = [key for key in names if key not in TEXTS]
    numbers = table.numbers(*(all_names.index(names[key]) for key in keys))
    known = dict(zip(keys, numbers.T, strict=True))
    for key in TEXTS:
        if key in names:
            known[key] = table.texts(all_names.index(names[key]))
    return names, known


def _parquet(path: Path) -> tuple[dict[str, str], dict[str, np.ndarray]]:
    """Return a Parquet file's columns of readings: names and values by standard key such as t, x, reading.

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
            names = _picked(path, file.schema_arrow.names)
            if file.metadata.num_rows > MOST_ROWS:  # a page of equal values takes a few bytes
                raise ReadingsError(f"{path}: has {file.metadata.num_rows:,} rows; at most {MOST_ROWS:,}")
            table = file.read(columns=list(names.values()), use_threads=False)
    except ReadingsError:
        raise
    except (pa.ArrowException, OSError, ValueError, KeyError) as error:  # the last two: of names and types
        raise ReadingsError(f"{path}: cannot be read: {plain(str(error))}") from None
    return names, _columns(path, table, names)


def _data_frame(path: Path, frame: object) -> tuple[dict[str, str], dict[str, np.ndarray]]:
    """Return the columns of readings of a pandas table like `_parquet`. path: name of the table in messages."""
    import pandas
    import pyarrow as pa

    if not isinstance(frame, pandas.DataFrame):
        raise ReadingsError(f"readings: got {shown(frame)}; give a file, a run or a pandas.DataFrame")
    names = _picked(path, [str(name) for name in frame.columns])
    try:
        table = pa.Table.from_pandas(frame[list(names.values())], preserve_index=False)
    except (pa.ArrowException, ValueError, TypeError, KeyError) as error:
        raise ReadingsError(f"{path}: cannot be read: {plain(str(error))}") from None
    return names, _columns(path, table, names)


def _columns(path: Path, table: "pyarrow.Table", names: dict[str, str]) -> dict[str, np.ndarray]:
    """Return the columns of a pyarrow table by standard key: names as texts, all others as numbers."""
    import pyarrow as pa

    known = {}
    for key, name in names.items():
        kind = table[name].type
        try:
            known[key] = table[name].cast("string" if key in TEXTS else "float64", safe=False).to_numpy()
        except (pa.ArrowException, ValueError):
            raise ReadingsError(f"{path}: {name} must be numbers, not {plain(str(kind))}") from None
    return known


def _picked(path: Path, names: list[str]) -> dict[str, str]:
    """Return the column name in the file for each standard key (t, x, reading ...). Raises ReadingsError."""
    for name in sum(NAMES.values(), ()):
        if names.count(name) > 1:
            raise ReadingsError(f"{path}: has several columns '{name}'; remove or rename all but one")
    picked = {key: name for key, of in NAMES.items() for name in reversed(of) if name in names}
    missing = [key for key in NEEDED if key not in picked]
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
