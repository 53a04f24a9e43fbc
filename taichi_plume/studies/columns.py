"""Columns of a study's tables (Arrow schemas): names, types, units and meanings. They depend only on the plan.

pandas reads booleans as `boolean` and integers as `Int64`, so that nulls stay nulls.
"""

import json
import re
from collections.abc import Iterable, Sequence

import pyarrow as pa

from taichi_plume.files.run_tables import column, schema_of
from taichi_plume.files.trials_table import TRIAL
from taichi_plume.studies.messages import Axis

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
TABLE_NAMES = {field.name for field in (*WHICH, AIR, BY_CHANCE, NUMBER, *CAME, *TRIAL)} | {
    "declared",
    "reached",
}
"""Names of columns that every study's tables have, besides the seeds."""
SUFFIX = re.compile(r"_(s|m|ppm|kg|m_s|kg_s)$")
"""Suffix of a name in result.json that states the unit."""
NUMPY = {pa.bool_(): ("bool", "boolean"), pa.int64(): ("int64", "Int64")}
"""pandas name and NumPy dtype of the column types that can hold nulls."""


def taken(outcomes: Iterable[str] = ()) -> set[str]:
    """Return column names that the tables of a study with these outcomes use already, forbidden as names of axes.

    An axis called `seed` or `air_seed` becomes that column; an axis called `algorithm` replaces the robots' column.
    """
    return TABLE_NAMES - {"algorithm"} | set(outcomes)


def kind_of(values: Iterable[object]) -> pa.DataType:
    """Return the Arrow type of a table's column from its values: boolean, integer, float, else string."""
    kinds = {type(value) for value in values}
    if kinds == {bool}:
        return pa.bool_()
    if kinds == {int}:
        return pa.int64()
    return pa.float64() if kinds and kinds <= {int, float} else pa.string()


def axis_columns(axes: Sequence[Axis], kinds: dict[str, pa.DataType]) -> list[pa.Field]:
    """Return an Arrow column for each axis but `seed` and `air_seed`, which every table has. kinds: types by axis."""
    seeds = {field.name for field in SEEDS}
    return [
        column(axis.name, kinds[axis.name], axis.unit or "1", "axis of the study")
        for axis in axes
        if axis.name not in seeds
    ]


def plan_schema(axes: Sequence[pa.Field], about: dict[str, object]) -> pa.Schema:
    """Return the Arrow schema of `plan.parquet`, the list of runs. about: the study, for the metadata `study`."""
    return _schema([WHICH[0], NUMBER, WHICH[1], *axes, *SEEDS, AIR, BY_CHANCE], study=json.dumps(about))


def runs_schema(axes: Sequence[pa.Field], outcomes: dict[str, str]) -> pa.Schema:
    """Return the Arrow schema of `runs.parquet`. outcomes: path in result.json by name of the column."""
    numbers = [column(name, pa.float64(), _unit(path), path) for name, path in outcomes.items()]
    return _schema([WHICH[0], NUMBER, WHICH[1], *axes, *SEEDS, AIR, BY_CHANCE, *CAME, *numbers])


def trials_schema(axes: Sequence[pa.Field]) -> pa.Schema:
    """Return the schema of the files in `trials`."""
    return _schema([*WHICH, AIR, *reversed(SEEDS), *axes, *of_trials(axes)])


def of_trials(axes: Sequence[pa.Field]) -> list[pa.Field]:
    """Return the columns of the table of trials, without those that have the name of an axis."""
    names = {field.name for field in axes}
    return [field for field in TRIAL if field.name not in names]


def costs_schema(made_of: str, trials: int) -> pa.Schema:
    """Return the schema of `costs.parquet`. made_of, trials: state of the tables and number of trials, as metadata."""
    return _schema(list(COST), made_of=made_of, trials=str(trials))


def _unit(path: str) -> str:
    """Return the unit of a number in result.json by its name; "" if unknown."""
    found = SUFFIX.search(path)
    return found[1].replace("m_s", "m/s").replace("kg_s", "kg/s") if found else ""


def _schema(columns: list[pa.Field], **more: str) -> pa.Schema:
    """Return a schema with metadata from which pandas reads types that hold nulls."""
    schema = schema_of(columns)
    metadata = {key.decode(): value.decode() for key, value in schema.metadata.items()}
    pandas = json.loads(metadata["pandas"])
    pandas["columns"] = [
        {"name": c.name, "field_name": c.name, "pandas_type": kind, "numpy_type": dtype, "metadata": None}
        for c in columns
        if c.type in NUMPY
        for kind, dtype in [NUMPY[c.type]]
    ]
    return schema.with_metadata(metadata | {"pandas": json.dumps(pandas)} | more)


def is_number(table: pa.Table, name: str) -> bool:
    """Whether a column holds numbers."""
    return name in table.column_names and table.schema.field(name).type in (pa.int64(), pa.float64())
