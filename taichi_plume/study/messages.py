"""Messages between a study's command and its workers: plain tuples, which can be pickled."""

from pathlib import Path
from typing import Any, NamedTuple

Value = float | int | str | bool
Data = dict[str, Any]
"""Nested data as in YAML or JSON."""
Row = dict[str, Any]
"""A row of a table, by column."""


class Axis(NamedTuple):
    """A column that the study varies. unit: as in the vocabulary, "" if none; partition: whether the tables are laid
    out in a folder per value.
    """

    name: str
    unit: str
    partition: bool


class Request(NamedTuple):
    """A run of the plan.

    run: id, 16 hex digits, a hash of the completed scenario, its input files and the version; number: position in the
    plan; point: number of the combination of the axes' values, shared by runs of other seeds; values: by axis, in SI
    units; air: id of the air, a hash of all that decides wind and gas, with the seed if random numbers matter; changes:
    changes to the base scenario, by path; structure: a hash shared by runs that one compiled simulation can execute.
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
    """Options that all runs of a study share. out: the study's folder; keep: names of files to keep of each run;
    outcomes: paths in result.json, or `probes.NAME.QUANTITY`, by their names in records.
    """

    out: Path
    keep: tuple[str, ...]
    outcomes: dict[str, str]
    allow_code: bool
    allow_outside: bool
    version: str


class Task(NamedTuple):
    """Runs that a worker executes one after another or, if `solve`, the film of the air that they share.

    base: the base scenario's data; folder: where its files lie; film: path of the film of the shared air, None where
    each run solves its own air. limit_s: after this time the worker returns the runs that it has finished, at least
    one.
    """

    base: Data
    folder: Path
    requests: tuple[Request, ...]
    options: Options
    film: Path | None = None
    solve: bool = False
    limit_s: float = float("inf")


class Cost(NamedTuple):
    """Cost of a run. begun: seconds since the epoch; total_s: all of the worker's time for the run, of which the
    simulation took simulation_s; compiled: number of kernels; worker: Dask address or process id.
    """

    begun: float
    total_s: float
    simulation_s: float
    compiled: int
    worker: str


class Record(NamedTuple):
    """Result of a run.

    status: completed, stopped (no robot searched any more) or failed; message: the reason, in a line; trials: a row
    per trial of each group; outcomes: numbers of the whole run, or None. Only the cost depends on when, where and after
    which other run the run was executed.
    """

    run: str
    status: str
    message: str
    trials: list[Row]
    outcomes: dict[str, float | None]
    cost: Cost


class AirRecord(NamedTuple):
    """Result of filming an air. seconds: duration; frames, bytes: size of the film; message: why it failed."""

    air: str
    seconds: float
    frames: int
    bytes: int
    message: str = ""
