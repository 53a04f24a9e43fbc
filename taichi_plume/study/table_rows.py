"""What the tables of a study hold: the plan beside what came of its runs, sorted by the plan's number."""

import json
from collections.abc import Iterable, Mapping
from math import isfinite
from typing import Any, NamedTuple

import pyarrow as pa
import pyarrow.compute as pc

from taichi_plume import __version__
from taichi_plume.study import columns
from taichi_plume.study.messages import Axis, Record


class Tables(NamedTuple):
    """The tables of a study. runs has a row for each run of the plan, trials for each trial of each group that has been
    run, costs for each run that has been run.
    """

    runs: pa.Table
    trials: pa.Table
    costs: pa.Table


class Planned(NamedTuple):
    """A plan as its table tells it. about: name, kind, outcomes (path by column) and more of the study."""

    table: pa.Table
    about: dict[str, Any]

    @property
    def axes(self) -> tuple[Axis, ...]:
        """The columns that the study varies."""
        return tuple(Axis(*one) for one in self.about["axes"])

    @property
    def outcomes(self) -> dict[str, str]:
        """The outcomes of runs, path by column."""
        return self.about["outcomes"]

    @property
    def fields(self) -> list[pa.Field]:
        """The axes' columns."""
        kinds = {one.name: self.table.schema.field(one.name).type for one in self.axes}
        return columns.axis_columns(self.axes, kinds)


def planned(plan: Any) -> Planned:
    """The table of a plan (study/plan.py), a row for each of its requests."""
    requests = sorted(plan.requests, key=lambda one: one.number)
    kinds = {
        axis.name: columns.kind_of({type(one.values[axis.name]): one.values[axis.name] for one in requests}.values())
        for axis in plan.axes
    }  # fmt: skip
    study = plan.study.model_dump(mode="json")
    about = {
        "name": study["name"],
        "kind": study["kind"],
        "axes": [list(axis) for axis in plan.axes],
        "outcomes": dict(study.get("outcomes") or {}),
        "file": plan.file.name,
        "version": __version__,
        "study": study,
    }
    schema = columns.plan_schema(columns.axis_columns(plan.axes, kinds), about)
    made: dict[str, list[Any]] = {field.name: [] for field in schema}
    for one in requests:
        row = dict(one.values) | one._asdict()
        for field in schema:
            value = row[field.name]
            made[field.name].append(_axis_text(value) if field.type == pa.string() else value)
    return Planned(_table(made, schema), about)


def _axis_text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)


def tables(plan: Planned, records: Iterable[Record], made_of: str = "") -> Tables:
    """The tables of a plan and what came of it.

    Neither the order of the records nor that of their rows matters; of several of one run the last that did not fail
    counts. Records of runs that are not in the plan are left out.
    """
    place = {run: n for n, run in enumerate(plan.table["run"].to_pylist())}
    latest: dict[str, Record] = {}
    for record in records:
        before = latest.get(record.run)
        if record.run in place and (before is None or before.status == "failed" or record.status != "failed"):
            latest[record.run] = record
    came = [latest[run] for run in sorted(latest, key=place.__getitem__)]
    trials = _trials(plan, came, place)
    return Tables(_runs(plan, latest), trials, _costs(came, columns.costs_schema(made_of, len(trials))))


def _runs(plan: Planned, latest: Mapping[str, Record]) -> pa.Table:
    schema = columns.runs_schema(plan.fields, plan.outcomes)
    runs = [latest.get(run) for run in plan.table["run"].to_pylist()]
    made: dict[str, Any] = {name: plan.table[name] for name in plan.table.column_names}
    made["status"] = [one.status if one else "missing" for one in runs]
    made["message"] = [one.message if one else "" for one in runs]
    for name, path in plan.outcomes.items():
        made[name] = [_number(one.outcomes.get(path)) if one else None for one in runs]
    return _table(made, schema)


def _trials(plan: Planned, came: list[Record], place: dict[str, int]) -> pa.Table:
    schema = columns.trials_schema(plan.fields)
    told = {field.name: field for field in columns.of_trials(plan.fields)}
    made: dict[str, list[Any]] = {name: [] for name in told}
    rows = []
    for record in came:
        for trial in record.trials:
            rows.append(place[record.run])
            for name, field in told.items():
                value = trial.get(name)
                made[name].append(value if field.type in (pa.string(), pa.bool_()) else _number(value))
    for name in (one.name for one in told.values() if one.type == pa.int64()):
        made[name] = [None if value is None else round(value) for value in made[name]]
    searched = made["searched"]
    made["success"] = [value if one else None for value, one in zip(made["success"], searched, strict=True)]
    of_run = plan.table.take(pa.array(rows, pa.int64()))
    return _table({name: of_run[name] for name in of_run.column_names} | made, schema)


def _costs(came: list[Record], schema: pa.Schema) -> pa.Table:
    made = {name: [getattr(one.cost, name) for one in came] for name in schema.names if name != "run"}
    return _table({"run": [one.run for one in came], **made}, schema)


def _number(value: Any) -> Any:
    """A number; None for what is none, or not finite."""
    return value if isinstance(value, int | float) and isfinite(value) else None


def _table(made: Mapping[str, Any], schema: pa.Schema) -> pa.Table:
    """A table of one chunk a column, so that its bytes do not tell how it came about."""
    arrays = []
    for field in schema:
        values = made[field.name]
        if isinstance(values, pa.ChunkedArray):
            values = values.combine_chunks().cast(field.type)
        else:
            values = pa.array(values, field.type)
        arrays.append(values)
    return pa.Table.from_arrays(arrays, schema=schema)


def by_folders(plan: Planned, most: int) -> tuple[str, ...]:
    """The axes by whose values the trials lie in folders: of those with few values, as many as make at most so many
    folders.
    """
    chosen: tuple[str, ...] = ()
    fields = {one.name for one in plan.fields}
    for axis in plan.axes:
        more = (*chosen, axis.name)
        if axis.partition and axis.name in fields and len(plan.table.group_by(more).aggregate([])) <= most:
            chosen = more
    return chosen


def parts(trials: pa.Table, names: tuple[str, ...]) -> list[tuple[tuple[Any, ...], pa.Table]]:
    """The trials by the values of some axes, each part in the order of the whole."""
    if not names or not len(trials):
        return [((), trials)]
    made = []
    for values in sorted(
        trials.group_by(names).aggregate([]).to_pylist(), key=lambda one: str(list(one.values()))
    ):
        chosen = None
        for name in names:
            is_it = pc.equal(trials[name], pa.scalar(values[name], trials.schema.field(name).type))
            chosen = is_it if chosen is None else pc.and_(chosen, is_it)
        made.append((tuple(values[name] for name in names), trials.filter(chosen).combine_chunks()))
    return made
