"""The columns of a study's tables: names, types, units and meanings, fixed by the plan alone.

Types are such that a null stays one in pandas too: truths are its `boolean`, whole numbers its `Int64`.
"""

import json
import re
from collections.abc import Iterable, Sequence
from typing import Any

import pyarrow as pa

from taichi_plume.files.table_parts import column, schema_of
from taichi_plume.files.trials_table import TRIAL
from taichi_plume.study.messages import Axis

WHICH = (
    column("run", pa.string(), "1", "id of the run: a hash of its scenario and the version"),
    column("point", pa.int64(), "1", "number of the combination of the axes' values"),
)
SEEDS = (
    column("seed", pa.int64(), "1", "of starts, sensors and algorithms"),
    column("air_seed", pa.int64(), "1", "of wind and gas"),
)
AIR = column("air", pa.string(), "1", "id of the air: runs of one id met the same wind and gas")
BY_CHANCE = column("air_by_chance", pa.bool_(), "1", "whether other seeds make another air")
NUMBER = column("number", pa.int64(), "1", "place in the plan")
CAME = (
    column("status", pa.string(), "1", "completed, stopped (none searched any more), failed or missing"),
    column("message", pa.string(), "1", "why it failed or stopped"),
)
COST = (
    column("run", pa.string(), "1", "id of the run"),
    column("begun", pa.float64(), "s", "when it was begun, seconds since 1970 (UTC)"),
    column("total_s", pa.float64(), "s", "all that its worker did for it"),
    column("simulation_s", pa.float64(), "s", "of that, while simulated time went by"),
    column("compiled", pa.int64(), "1", "kernels that were compiled"),
    column("worker", pa.string(), "1", "address of the worker"),
)
OURS = {field.name for field in (*WHICH, AIR, BY_CHANCE, NUMBER, *CAME, *TRIAL)} | {"declared", "reached"}
"""Names of columns that a table has whatever is studied, besides the seeds."""
SUFFIX = re.compile(r"_(s|m|ppm|kg|m_s|kg_s)$")
"""How names of numbers in result.json end, after their unit."""
NUMPY = {pa.bool_(): ("bool", "boolean"), pa.int64(): ("int64", "Int64")}
"""What pandas calls the types that can hold nulls, by ours."""


def taken(outcomes: Iterable[str] = ()) -> set[str]:
    """Names that no axis of a study with these outcomes may have.

    One called `seed` or `air_seed` is that column, and one called `algorithm` stands where the robots' own would.
    """
    return OURS - {"algorithm"} | set(outcomes)


def kind_of(values: Iterable[Any]) -> pa.DataType:
    """The type of an axis by all of its values: truths, whole numbers, numbers, else text."""
    kinds = {type(value) for value in values}
    if kinds == {bool}:
        return pa.bool_()
    if kinds == {int}:
        return pa.int64()
    return pa.float64() if kinds and kinds <= {int, float} else pa.string()


def axis_columns(axes: Sequence[Axis], kinds: dict[str, pa.DataType]) -> list[pa.Field]:
    """Those of the axes; one that is a seed has its column already."""
    seeds = {field.name for field in SEEDS}
    return [
        column(one.name, kinds[one.name], one.unit or "1", "axis of the study")
        for one in axes
        if one.name not in seeds
    ]


def plan_schema(axes: Sequence[pa.Field], about: dict[str, Any]) -> pa.Schema:
    """Of `plan.parquet`. about: the study, as its metadata `study`."""
    return _schema([WHICH[0], NUMBER, WHICH[1], *axes, *SEEDS, AIR, BY_CHANCE], study=json.dumps(about))


def runs_schema(axes: Sequence[pa.Field], outcomes: dict[str, str]) -> pa.Schema:
    """Of `runs.parquet`. outcomes: path by column."""
    numbers = [column(name, pa.float64(), _unit(path), path) for name, path in outcomes.items()]
    return _schema([WHICH[0], NUMBER, WHICH[1], *axes, *SEEDS, AIR, BY_CHANCE, *CAME, *numbers])


def trials_schema(axes: Sequence[pa.Field]) -> pa.Schema:
    """Of the files in `trials`."""
    return _schema([*WHICH, AIR, *reversed(SEEDS), *axes, *of_trials(axes)])


def of_trials(axes: Sequence[pa.Field]) -> list[pa.Field]:
    """What tells of a trial, but for columns that are axes."""
    names = {one.name for one in axes}
    return [field for field in TRIAL if field.name not in names]


def costs_schema(made_of: str, trials: int) -> pa.Schema:
    """Of `costs.parquet`. made_of, trials: what the tables beside it were made of, and the rows of one, as metadata."""
    return _schema(list(COST), made_of=made_of, trials=str(trials))


def _unit(path: str) -> str:
    """The unit of a number in result.json, by its name; "" where that does not tell."""
    told = SUFFIX.search(path)
    return told[1].replace("m_s", "m/s").replace("kg_s", "kg/s") if told else ""


def _schema(columns: list[pa.Field], **more: str) -> pa.Schema:
    """As those of all our tables, which pandas reads with types that hold nulls."""
    schema = schema_of(columns)
    told = {key.decode(): value.decode() for key, value in schema.metadata.items()}
    pandas = json.loads(told["pandas"])
    pandas["columns"] = [
        {"name": one.name, "field_name": one.name, "pandas_type": kind, "numpy_type": dtype, "metadata": None}
        for one in columns
        if one.type in NUMPY
        for kind, dtype in [NUMPY[one.type]]
    ]
    return schema.with_metadata(told | {"pandas": json.dumps(pandas)} | more)


def is_number(table: pa.Table, name: str) -> bool:
    """Whether a column holds numbers."""
    return name in table.column_names and table.schema.field(name).type in (pa.int64(), pa.float64())
