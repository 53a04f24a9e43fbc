"""Parquet tables of a study's folder: `plan.parquet`, `runs.parquet`, `costs.parquet`, and the folder `trials`.

Trials are partitioned in folders by the values of axes with few values. Each table is written to a temporary path and
renamed. All tables but the costs are reproducible to the bit, in whatever order and wherever the runs were executed:
rows are sorted by the number in the plan and hold no times. The costs are written last, with a hash of the data behind
all tables, from which readers see whether the tables are up to date (`studies/results.py`).
"""

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple
from urllib.parse import quote

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from taichi_plume.files import disk, parquet
from taichi_plume.guard.safe_open import open_regular
from taichi_plume.quantities import parse
from taichi_plume.studies import columns
from taichi_plume.studies.messages import Axis, Data, Row
from taichi_plume.version import __version__

if TYPE_CHECKING:
    from taichi_plume.studies.plan import Plan

PLAN, RUNS, TRIALS, COSTS, PARTS = "plan.parquet", "runs.parquet", "trials", "costs.parquet", "parts"
MADE_OF, HELD = b"made_of", b"trials"
ROW_GROUP = 50_000


class Tables(NamedTuple):
    """Result tables of a study. runs: a row per planned run; trials: a row per trial of each robot group of the
    finished runs; costs: a row per finished run.
    """

    runs: pa.Table
    trials: pa.Table
    costs: pa.Table


class Planned(NamedTuple):
    """Plan of a study, a row per run. about: metadata: name, kind, outcomes (path by column) and other settings."""

    table: pa.Table
    about: Data

    @property
    def axes(self) -> tuple[Axis, ...]:
        """Axes of the study as table columns: name, unit, and whether the tables are partitioned by the axis."""
        return tuple(Axis(*axis) for axis in self.about["axes"])

    @property
    def outcomes(self) -> dict[str, str]:
        """Outcomes of runs that the study requests: path of the number in a run's results, by column name."""
        return self.about["outcomes"]

    @property
    def longest_s(self) -> float:
        """Duration of the longest run [s]; inf for tables that do not state it."""
        return self.about.get("longest_s", inf)

    @property
    def fields(self) -> list[pa.Field]:
        """Arrow fields of the columns of the study's axes, without axes that set random seeds."""
        kinds = {axis.name: self.table.schema.field(axis.name).type for axis in self.axes}
        return columns.axis_columns(self.axes, kinds)


# ---------------------------------------------------------------- making


def planned(plan: "Plan") -> Planned:
    """Return the plan of a study as a table with a row for each run, and its metadata."""
    requests = sorted(plan.requests, key=lambda request: request.number)
    kinds = {
        axis.name: columns.kind_of(request.values[axis.name] for request in requests) for axis in plan.axes
    }
    study = plan.study.model_dump(mode="json")
    about = {
        "name": study["name"],
        "kind": study["kind"],
        "axes": [list(axis) for axis in plan.axes],
        "outcomes": dict(study.get("outcomes") or {}),
        "file": plan.file.name,
        "longest_s": max(parse((plan.base | request.changes)["duration"], "s") for request in requests),
        "version": __version__,
        "study": study,
    }
    schema = columns.plan_schema(columns.axis_columns(plan.axes, kinds), about)
    made: dict[str, list[object]] = {field.name: [] for field in schema}
    for request in requests:
        row = dict(request.values) | request._asdict()
        for field in schema:
            value = row[field.name]
            text = field.type == pa.string() and not isinstance(value, str)
            made[field.name].append(json.dumps(value) if text else value)
    return Planned(_table(made, schema), about)


def make_tables(plan: Planned, records: pa.Table, made_of: str = "") -> Tables:
    """Return the result tables of a study, from its plan and a table of run records (`Store.table`) in any order.

    Records of runs that are not in the plan are left out. made_of: hash of the data, stored in the costs table.
    """
    place = pc.index_in(records["run"], value_set=plan.table["run"].combine_chunks())
    records = (
        records.append_column("place", place).filter(pc.is_valid(place)).sort_by("place").combine_chunks()
    )
    trials = _trials(plan, records)
    return Tables(_runs(plan, records), trials, _costs(records, made_of, len(trials)))


def _runs(plan: Planned, records: pa.Table) -> pa.Table:
    row = pc.index_in(plan.table["run"], value_set=records["run"].combine_chunks())
    of_plan = records.take(row)  # a row of nulls for a missing run
    made = {name: plan.table[name] for name in plan.table.column_names}
    made["status"] = pc.fill_null(of_plan["status"], "missing")
    made["message"] = pc.fill_null(of_plan["message"], "")
    made |= {name: pc.map_lookup(of_plan["outcomes"], path, "first") for name, path in plan.outcomes.items()}
    return _table(made, columns.runs_schema(plan.fields, plan.outcomes))


def _trials(plan: Planned, records: pa.Table) -> pa.Table:
    trials = pc.list_flatten(records["trials"])
    of_plan = plan.table.take(records["place"].take(pc.list_parent_indices(records["trials"])))
    made = {name: of_plan[name] for name in of_plan.column_names}
    made |= {field.name: pc.struct_field(trials, field.name) for field in columns.of_trials(plan.fields)}
    return _table(made, columns.trials_schema(plan.fields))


def _costs(records: pa.Table, made_of: str, trials: int) -> pa.Table:
    schema = columns.costs_schema(made_of, trials)
    made = {name: pc.struct_field(records["cost"], name) for name in schema.names[1:]}
    return _table({"run": records["run"]} | made, schema)


def _table(made: Mapping[str, Sequence[object] | pa.ChunkedArray], schema: pa.Schema) -> pa.Table:
    """Return an Arrow table of columns `made`, one chunk per column, so that equal tables have equal bytes."""
    arrays = []
    for field in schema:
        values = made[field.name]
        if isinstance(values, pa.ChunkedArray):
            values = values.combine_chunks().cast(field.type)
        else:
            values = pa.array(values, field.type)
        arrays.append(values)
    return pa.Table.from_arrays(arrays, schema=schema)


# ---------------------------------------------------------------- writing


def write_plan(folder: Path, plan: "Plan") -> None:
    """Write `plan.parquet` into a study's folder: a table with a row for each run of the plan. Raises OSError."""
    write(folder / PLAN, planned(plan).table)


def read_plan(folder: Path) -> Planned:
    """Read the plan of a study from `plan.parquet` in its folder. Raises OSError, ValueError, LookupError."""
    table = read(folder / PLAN)
    return Planned(table, json.loads(table.schema.metadata[b"study"]))


def publish(folder: Path, records: Callable[[], pa.Table]) -> None:
    """Write a study's result tables into its folder unless up to date. records: function that returns the run records.

    Raises OSError.
    """
    made_of = state(folder)
    if held(folder, made_of) is not None:
        return
    plan = read_plan(folder)
    made = make_tables(plan, records(), made_of)
    (folder / COSTS).unlink(missing_ok=True)  # readers ignore tables without costs
    write(folder / RUNS, made.runs)
    _write_trials(folder, [axis.name for axis in plan.axes if axis.partition], made.trials)
    write(folder / COSTS, made.costs)


def state(folder: Path) -> str:
    """Return a hash of the data behind a study's tables: the plan, and names and sizes of the record files."""
    with open_regular(folder / PLAN) as plan:
        found = hashlib.file_digest(plan, "sha256")
    for part in sorted((folder / PARTS).glob("*.parquet")):
        with suppress(FileNotFoundError):  # replaced by a merge
            found.update(f"{part.name} {part.stat().st_size}\n".encode())
    return found.hexdigest()


def held(folder: Path, made_of: str) -> int | None:
    """Return the number of trials in a folder's tables; None if any is missing or their hash is not `made_of`."""
    try:
        with parquet.opened(folder / COSTS) as file:
            metadata = file.schema_arrow.metadata or {}
    except (OSError, pa.ArrowException):
        return None
    there = (folder / RUNS).is_file() and (folder / TRIALS).is_dir()
    return int(metadata[HELD]) if there and metadata.get(MADE_OF) == made_of.encode() else None


def written(folder: Path) -> tuple[int, int] | None:
    """Return what identifies the costs table in a folder, which `publish` replaces; None if there is none."""
    with suppress(OSError):
        about = (folder / COSTS).stat()
        return about.st_ino, about.st_mtime_ns
    return None


def _write_trials(folder: Path, names: Sequence[str], trials: pa.Table) -> None:
    """Write the trials in folders by values of the columns `names`, under a temporary path that is then renamed."""
    fresh, old = folder / f"{TRIALS}.new", folder / f"{TRIALS}.old"
    for left in (fresh, old):
        disk.discard(left)
    for values, table in _split(trials, names):
        keys = [f"by_{quote(name, safe='')}={_key(value)}" for name, value in values.items()]
        place = fresh.joinpath(*keys)
        place.mkdir(parents=True)
        write(place / "part-0.parquet", table)
    if (folder / TRIALS).exists():
        (folder / TRIALS).rename(old)
    fresh.rename(folder / TRIALS)
    disk.discard(old)


def _split(trials: pa.Table, names: Sequence[str]) -> list[tuple[Row, pa.Table]]:
    """Split a table of trials: return (values of the columns `names`, their rows in order) for each combination."""
    if not names or not len(trials):
        return [({}, trials)]
    made = []
    groups = trials.group_by(names, use_threads=False).aggregate([]).to_pylist()
    for values in sorted(groups, key=lambda group: str(list(group.values()))):
        chosen = pa.scalar(True)
        for name in names:
            value = pa.scalar(values[name], trials.schema.field(name).type)
            chosen = pc.and_(chosen, pc.equal(trials[name], value))
        made.append(({name: values[name] for name in names}, trials.filter(chosen).combine_chunks()))
    return made


def _key(value: object) -> str:
    """Return a value percent-encoded for a folder name (Hive partitioning); numbers as Python writes them."""
    return quote(str(value), safe=" ") or "__HIVE_DEFAULT_PARTITION__"


def write(path: Path, table: pa.Table) -> None:
    """Write an Arrow table to a Parquet file, atomically. Raises OSError."""
    disk.require_room(path, table.nbytes)
    options = {"compression": "zstd", "write_page_checksum": True}
    with disk.written_whole(path) as fresh, pq.ParquetWriter(fresh, table.schema, **options) as writer:
        writer.write_table(table, ROW_GROUP)


def read(path: Path) -> pa.Table:
    """Read a table from a Parquet file, or from all such files below a folder in order. Raises OSError, ValueError."""
    files = sorted(path.rglob("*.parquet")) if path.is_dir() else [path]
    tables = []
    for part in files:
        with parquet.opened(part) as file:
            tables.append(file.read(use_threads=False))
    return pa.concat_tables(tables).combine_chunks()
