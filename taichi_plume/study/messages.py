"""What passes between the parts of a study: plain data, which other processes can be sent."""

from pathlib import Path
from typing import Any, NamedTuple


class Axis(NamedTuple):
    """A column of the table that the study varies. unit: as in the vocabulary, "" of none; partition: whether it has
    few values, by which the tables are laid out in folders.
    """

    name: str
    unit: str
    partition: bool


class Request(NamedTuple):
    """A run that is asked for.

    run: its id, 16 hex digits, a hash of the completed scenario, the files that it reads and the version; number: its
    place in the plan; point: number of the combination of the axes' values, which runs of other seeds share; values: by
    axis, in SI units; air: id of its air, a hash of all that decides wind and gas, the seed if chance is in it;
    changes: what the base becomes its scenario with, by path; structure: a hash that runs have in common which can
    follow one another in one simulation without compiling.
    """

    run: str
    number: int
    point: int
    values: dict[str, float | int | str | bool]
    seed: int
    air_seed: int
    air: str
    air_by_chance: bool
    changes: dict[str, Any]
    structure: str


class Options(NamedTuple):
    """What goes for all runs of a study. out: its folder; keep: names of the files to keep of each run; outcomes: by
    the name under which records tell them, of a study the path itself, a path in result.json or
    `probes.NAME.QUANTITY`.
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

    base: dict[str, Any]
    folder: Path
    requests: tuple[Request, ...]
    options: Options
    film: Path | None = None
    solve: bool = False
    limit_s: float = float("inf")


class Cost(NamedTuple):
    """Of a run: begun, seconds since the epoch; total_s, all that its worker did for it, simulation_s of that while
    simulated time went by; kernels compiled; the Dask address or process id of the worker.
    """

    begun: float
    total_s: float
    simulation_s: float
    compiled: int
    worker: str


class Record(NamedTuple):
    """What came of a run.

    status: completed, stopped (no robot searched any more) or failed; message: why, in a line; trials: a row for
    each trial of each group; outcomes: numbers of the whole run, None where there is none. Nothing in it but the cost
    depends on when, where or after what it was run.
    """

    run: str
    status: str
    message: str
    trials: list[dict[str, Any]]
    outcomes: dict[str, float | None]
    cost: Cost


class AirRecord(NamedTuple):
    """What came of solving an air for a film. seconds: it took; frames, bytes: of the film; message: why it failed."""

    air: str
    seconds: float
    frames: int
    bytes: int
    message: str = ""
