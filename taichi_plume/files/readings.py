"""Recorded readings: the robots.parquet of a run, or of real robots a bag of ROS or a CSV file.

A CSV has the columns t [s], x, y [m] and reading [ppm] and, where they are known, wind_x, wind_y [m/s], trial (whole
numbers) and group (names); others do not matter. Commas, semicolons or tabs part its columns. Of a run the places are
those where its robots believed to be, and the wind is the one that they took it for: what its maps were made of. Of a
bag see `bag_readings`; its robots are groups.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from taichi_plume.files import bag_readings, bags, manifest
from taichi_plume.files.bag_readings import Wanted
from taichi_plume.files.tables import Table, TextFile, cells_of, delimiter_of, listed, plain
from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.opening import unopenable

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
MOST_ROWS = 10_000_000
NEEDED = ("t", "x", "y", "reading")
MOST = {"t": 1e13, "x": 1e8, "y": 1e8, "reading": 1e9, "wind_x": 1e4, "wind_y": 1e4}
"""What is larger, either way, is a mistake: a Unix time is 2e9 s, in milliseconds; pure vapour is 1e6 ppm."""


class ReadingsError(InputError):
    """Readings or parameters that no map can be made of; the message is one line."""


@dataclass(frozen=True)
class Readings:
    """In order of time: t (n,) [s], place (n, 2) [m], reading (n,) [ppm], wind (n, 2) [m/s], zero if unknown.

    A reading that is no finite number is NaN. row: (n,), of the file, from 1 on below the header. topics: of a bag,
    what was taken of it, a line for each robot.
    """

    t: np.ndarray
    place: np.ndarray
    reading: np.ndarray
    wind: np.ndarray
    row: np.ndarray
    topics: tuple[str, ...] = ()


def read(
    path: str | Path, trial: int | None = None, group: str | None = None, wanted: Wanted | None = None
) -> Readings:
    """Readings of a file (see above): of one trial, the first unless given, and of one group or of all.

    wanted: what of a bag is read. Raises ReadingsError.
    """
    path, topics = Path(path), ()
    if bags.is_bag(path):
        names, known, topics = _bag(path, wanted)
    elif wanted is not None and wanted.said:
        raise ReadingsError(f"{path}: is no bag, so it has no topics, frames and units to choose")
    else:
        names, known = _parquet(path) if path.suffix.lower() == ".parquet" else _csv(path)
    chosen = _of_trial(path, known.get("trial"), trial, _of_group(path, known, group))
    if names["x"] == "believed_x":
        chosen &= known["t"] > 0.0  # when a run begins nothing has been measured yet
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
            raise ReadingsError(f"{where} is {values[large[0]]:g}, a mistake: at most {most:g} is taken")
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
    )


def _bag(path: Path, wanted: Wanted | None) -> tuple[dict[str, str], dict[str, np.ndarray], tuple[str, ...]]:
    """The readings of a bag's robots as the columns of a CSV, and what was taken of it."""
    try:
        robots = bag_readings.read(path, wanted)
    except bags.BagError as error:
        raise ReadingsError(str(error)) from None
    columns = [
        [one.read_at, *one.at.T, one.ppm, *one.wind.T, np.full(len(one.ppm), one.name, object)]
        for one in robots
    ]
    names = ("t", "x", "y", "reading", "wind_x", "wind_y", "group")
    known = {
        name: np.concatenate(parts) for name, parts in zip(names, zip(*columns, strict=True), strict=True)
    }
    return dict(zip(names, names, strict=True)), known, tuple(f"{one.name}: {one.topics}" for one in robots)


def _csv(path: Path) -> tuple[dict[str, str], dict[str, np.ndarray]]:
    """The columns of a CSV, whose first line names them: their names and values by the keys of NAMES."""
    file = TextFile(path, ReadingsError)
    delimiter = delimiter_of(file.lines[0])
    all_names = cells_of(file.lines[0], delimiter)
    names = _picked(path, all_names)
    table = Table(file, file.told(1), len(all_names), delimiter, gaps=True)
    told = [key for key in names if key != "group"]
    numbers = table.numbers(*(all_names.index(names[key]) for key in told))
    known = dict(zip(told, numbers.T, strict=True))
    if "group" in names:
        known["group"] = table.texts(all_names.index(names["group"]))
    return names, known


def _parquet(path: Path) -> tuple[dict[str, str], dict[str, np.ndarray]]:
    """The columns of a Parquet file, as those of a CSV.

    Its pages have checksums; what tells of them has none, so a run's table is compared with the manifest beside it.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    reason = unopenable(path)
    if reason:
        raise ReadingsError(f"{path}: {reason}")
    damage = manifest.changed(path)
    if damage:
        raise ReadingsError(damage)
    try:
        with pq.ParquetFile(path, page_checksum_verification=True) as file:
            names = _picked(path, file.schema_arrow.names)
            if file.metadata.num_rows > MOST_ROWS:  # a page of equal values takes a few bytes
                raise ReadingsError(
                    f"{path}: has {file.metadata.num_rows:,} rows; at most {MOST_ROWS:,} are read"
                )
            table = file.read(columns=list(names.values()))
    except ReadingsError:
        raise
    except (pa.ArrowException, OSError, ValueError, KeyError) as error:  # the last two: of names and types
        raise ReadingsError(f"{path}: cannot be read: {plain(str(error))}") from None
    known = {}
    for key, name in names.items():
        kind = table[name].type
        try:
            known[key] = table[name].cast("string" if key == "group" else "float64", safe=False).to_numpy()
        except (pa.ArrowException, ValueError):
            raise ReadingsError(f"{path}: {name} must be numbers, not {plain(str(kind))}") from None
    return names, known


def _picked(path: Path, names: list[str]) -> dict[str, str]:
    """Which of a file's columns are taken, by the keys of NAMES."""
    for name in sum(NAMES.values(), ()):
        if names.count(name) > 1:
            raise ReadingsError(f"{path}: has several columns '{name}'; remove or rename all but one")
    picked = {key: name for key, of in NAMES.items() for name in reversed(of) if name in names}
    missing = [key for key in NEEDED if key not in picked]
    if missing:
        raise ReadingsError(f"{path}: has no column {', '.join(missing)}; it has {listed(names)}")
    return picked


def _of_group(path: Path, known: dict[str, np.ndarray], group: str | None) -> np.ndarray:
    """Whether each row belongs to the group, by default any."""
    if group is None:
        return np.ones(len(known["t"]), bool)
    if "group" not in known:
        raise ReadingsError(f"{path}: has no column group, so there is no group '{group}'")
    # of a bag's robot with several sensors each is one, by its topic
    chosen = np.array([one == group or str(one).startswith(f"{group}/") for one in known["group"]], bool)
    if not chosen.any():
        there = sorted({str(one) for one in known["group"]})
        raise ReadingsError(f"{path}: has no group '{group}'; it has {listed(there)}")
    return chosen


def _of_trial(path: Path, trials: np.ndarray | None, trial: int | None, chosen: np.ndarray) -> np.ndarray:
    """Which of the chosen rows belong to the trial, by default the first. trials: (rows,), if the file tells."""
    if trials is None:
        if trial is not None:
            raise ReadingsError(f"{path}: has no column trial, so there is no trial {trial}")
        return chosen
    there = trials[chosen & np.isfinite(trials)]
    if not len(there):
        return chosen & False
    wanted = there.min() if trial is None else trial
    if wanted not in there:
        raise ReadingsError(
            f"{path}: has no trial {wanted:g}; the first is {there.min():g}, the last {there.max():g}"
        )
    return chosen & (trials == wanted)
