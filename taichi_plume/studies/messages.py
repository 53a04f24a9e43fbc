"""Messages between the command of a study and its workers: named tuples that can be pickled."""

from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

from taichi_plume.files.own_class import Permission
from taichi_plume.studies.given_classes import PickledClass

Value = float | int | str | bool
Data = dict[str, Any]
"""Nested data as in YAML or JSON."""
Row = dict[str, Any]
"""A row of a table, by column."""
Outcomes = dict[str, float | None]
"""Numbers of a whole run, by path; None for a number that the run does not have."""


class Axis(NamedTuple):
    """An axis as a column of the tables. unit: as in the vocabulary, "" if none; partition: whether the tables have a
    folder per value.
    """

    name: str
    unit: str
    partition: bool


class Request(NamedTuple):
    """A run of the plan.

    run: id (16 hex digits), a hash of the completed scenario, its input files and the version; number: position in the
    plan; point: number of the combination of axis values, the same for runs that differ only in seeds; values: by axis,
    in SI units; air: id of the air, a hash of all that affects wind and gas, with the seed if they are random; changes:
    changes to the base scenario, by path; structure: a hash, equal for runs that differ in numbers and seeds alone.
    """

    run: str
    number: int
    point: int
    values: dict[str, Value]
    seed: int
    air_seed: int
    air: str
    air_by_chance: bool
    changes: Data
    structure: str


class Options(NamedTuple):
    """Options that all runs of a study share. out: folder of the study; keep: names of the files to keep of each run;
    outcomes: paths in result.json, or `probes.NAME.QUANTITY`, by name in the records; classes: algorithms that Python
    code gave, by name in the scenarios.
    """

    out: Path
    keep: tuple[str, ...]
    outcomes: dict[str, str]
    allow_code: Permission
    allow_outside: bool
    classes: dict[str, PickledClass]


class Task(NamedTuple):
    """Runs that a worker executes or, if `solve`, whose common flow and gas (air) the worker computes and films.

    base: data of the base scenario; folder: folder of the base's files; film: path of the film of the shared air, None
    if each run solves its own air. limit_s: time after which the worker returns its finished runs, at least one.
    """

    base: Data
    folder: Path
    requests: tuple[Request, ...]
    options: Options
    film: Path | None = None
    solve: bool = False
    limit_s: float = float("inf")


class Cost(NamedTuple):
    """Cost of a run. begun: start, seconds since the epoch; total_s: the worker's time for the run; simulation_s: part
    of total_s in the simulation; compiled: number of compiled kernels; worker: Dask address or process id.
    """

    begun: float
    total_s: float
    simulation_s: float
    compiled: int
    worker: str


class Record(NamedTuple):
    """Result of a run.

    status: completed, stopped (all robots had finished) or failed; message: the reason, in a line; trials: a row per
    trial of each group; outcomes: numbers of the whole run, or None. All fields but the cost are reproducible: they do
    not depend on the time, the worker or earlier runs.
    """

    run: str
    status: str
    message: str
    trials: list[Row]
    outcomes: Outcomes
    cost: Cost


class AirRecord(NamedTuple):
    """Result of filming an air. seconds: duration; frames, bytes: size of the film; message: the error, "" if none."""

    air: str
    seconds: float
    frames: int
    bytes: int
    message: str = ""


Result: TypeAlias = list[Record] | AirRecord
"""Result of a task."""
