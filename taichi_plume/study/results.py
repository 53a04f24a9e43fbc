"""What a study has left, for notebooks and plots: ``results = study.open("studies/success-against-wind")``.

    results.trials()    pandas.DataFrame: a row for each trial of each group, with the values of all axes
    results.runs()      a row for each run of the plan, whether it has been run or not
    results.points()    a row for each combination of the axes' values and group: means, with intervals over airs
    results.costs()     what each run took

Units are in ``frame.attrs["units"]``. All of them are also there while a study runs, and after it was killed: of what
has come to the disk. What is missing or damaged is told in one line, as a RunFolderError.
"""

from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import pyarrow as pa
import pyarrow.compute as pc

from taichi_plume import __version__
from taichi_plume.files import table_parts
from taichi_plume.files.run_folder import RunFolderError
from taichi_plume.files.tables import LONGEST_TEXT, plain
from taichi_plume.guard.opening import unopenable
from taichi_plume.guard.terminal import visible
from taichi_plume.study import table_rows, tables

if TYPE_CHECKING:
    import pandas
    import polars

    from taichi_plume.study.points import Points

FAULTS = (pa.ArrowException, OSError, ValueError, LookupError, TypeError)


def open_study(folder: Path | str) -> "Results":
    """The results of a study's folder. Raises RunFolderError, in a line, where it is none or of another version."""
    return Results(Path(folder))


class Results:
    """What a study has left; see `study.open`. Every method may raise RunFolderError."""

    def __init__(self, folder: Path):
        self.folder = folder
        fault = unopenable(folder, folder=True)
        if fault:
            raise RunFolderError(f"{folder}: {fault}; give the folder of a study")
        path = folder / tables.PLAN
        fault = unopenable(path)
        if fault:
            raise RunFolderError(f"{folder}: is not the folder of a study: {tables.PLAN} {fault}")
        try:
            self.plan = tables.read_plan(folder)
            made = str(self.plan.about["version"])
            self.fields, self.outcomes = self.plan.fields, self.plan.outcomes
        except FAULTS as error:
            raise RunFolderError(f"{path}: is damaged: {_reason(error)}") from None
        if made.split(".")[:2] != __version__.split(".")[:2]:
            of = visible(made, LONGEST_TEXT)
            raise RunFolderError(
                f"{folder}: was made by taichi_plume {of}, this is {__version__}; use that one"
            )

    @cached_property
    def tables(self) -> table_rows.Tables:
        """The tables as Arrow has them: those of the folder where they are made of what it holds, else made anew."""
        try:
            held = tables.held(self.folder, tables.state(self.folder))
        except FAULTS as error:
            raise RunFolderError(f"{self.folder}: cannot be read: {_reason(error)}") from None
        return self._made() if held is None else self._read(held)

    def _read(self, held: int) -> table_rows.Tables:
        made = []
        for name, field in ((tables.RUNS, "number"), (tables.TRIALS, "point"), (tables.COSTS, "run")):
            path = self.folder / name
            try:
                table = tables.read(path)
                if not {"run", field} <= set(table.column_names):
                    raise ValueError("holds other columns")
            except FAULTS as error:
                raise RunFolderError(f"{path}: is damaged: {_reason(error)}") from None
            made.append(table)
        runs, trials, costs = made
        if len(trials) != held:
            path = self.folder / tables.TRIALS
            raise RunFolderError(f"{path}: holds {len(trials):,} of {held:,} rows; is a file of it gone?")
        place = pc.index_in(trials["run"], value_set=runs["run"].combine_chunks())
        order = place.to_numpy().argsort(kind="stable")
        return table_rows.Tables(runs, trials.take(pa.array(order)), costs)

    def _made(self) -> table_rows.Tables:
        """Of the plan and what tasks have brought so far."""
        from taichi_plume.study.store import Store, StoreError

        try:
            return table_rows.tables(self.plan, Store(self.folder).records())
        except StoreError as error:
            raise RunFolderError(str(error)) from None
        except FAULTS as error:
            raise RunFolderError(f"{self.folder / tables.PARTS}: is damaged: {_reason(error)}") from None

    def trials(self) -> "pandas.DataFrame":
        """A row for each trial of each group."""
        return frame(self.tables.trials)

    def runs(self) -> "pandas.DataFrame":
        """A row for each run of the plan; `status` is missing where it has not been run."""
        return frame(self.tables.runs)

    def costs(self) -> "pandas.DataFrame":
        """A row for each run that has been run: what it took."""
        return frame(self.tables.costs)

    @cached_property
    def by_points(self) -> "Points":
        """The points as `study/points.py` has them."""
        from taichi_plume.study.points import Points

        try:
            return Points(self.plan, self.tables)
        except (KeyError, TypeError, ValueError) as error:
            raise RunFolderError(f"{self.folder}: its tables are damaged: {_reason(error)}") from None

    def points(self) -> "pandas.DataFrame":
        """A row for each point and group: means with 95 % intervals over airs, as numbers and in words."""
        return self.by_points.frame()

    def differences(self, axis: str, quantity: str = "success") -> "pandas.DataFrame":
        """What each value of an axis makes beside its first one, in the same airs: `apart`, its interval, words.

        quantity: a column of trials. Raises ValueError where there is no such axis or quantity.
        """
        import pandas

        from taichi_plume.study import intervals

        points = self.by_points
        known = {one.name: one for one in points.quantities if one.what != "runs"}
        for name, there in ((axis, points.axes), (quantity, list(known))):
            if name not in there:
                raise ValueError(f"{name!r}: there are {', '.join(there)}")
        one = known[quantity]
        made = []
        for row in points.differences(axis, one):
            apart = row.pop("apart")
            text = intervals.words(apart, one.unit, one.share, "searches in both")
            made.append(
                {
                    **row,
                    "apart": apart.mean,
                    "low": apart.low,
                    "high": apart.high,
                    "airs": apart.airs,
                    "words": text,
                }
            )
        return pandas.DataFrame(made)

    def indices(self) -> "pandas.DataFrame":
        """Of a study of kind sensitivity: Sobol indices of each axis, for each quantity and group, and words."""
        import pandas

        from taichi_plume.study import indices

        self._require("sensitivity")
        made = []
        for one, group, found in indices.found(self.by_points):
            about = {"quantity": one.name, "group": group, "used": found.used, "asked": found.asked}
            about |= {
                "variance": found.variance,
                "noise": found.noise,
                "words": "; ".join(indices.words(found)),
            }
            made += [{"axis": axis, **index._asdict(), **about} for axis, index in found.indices.items()]
        return pandas.DataFrame(made)

    def orders(self) -> "pandas.DataFrame":
        """Of a study of kind refinement: observed order, extrapolated value and index of each quantity, and words."""
        import pandas

        from taichi_plume.study import refine

        self._require("refinement")
        axis = refine.axis_of(self.plan.about)
        if axis is None:
            raise RunFolderError(f"{self.folder}: the study has no axis on {refine.KEY}")
        return pandas.DataFrame(
            [{**row, "words": refine.words(row)} for row in refine.orders(self.by_points, axis)]
        )

    def _require(self, kind: str) -> None:
        if self.plan.about["kind"] != kind:
            raise RunFolderError(f"{self.folder}: is a study of kind {self.plan.about['kind']}, not {kind}")

    def polars(self, name: str) -> "polars.DataFrame":
        """The table "trials", "runs" or "costs" as polars has it, if that is installed."""
        import polars

        if name not in table_rows.Tables._fields:
            raise ValueError(f"{name!r}: there are {', '.join(table_rows.Tables._fields)}")
        made = polars.from_arrow(getattr(self.tables, name))
        assert isinstance(made, polars.DataFrame)
        return made

    def __repr__(self) -> str:
        done = self.tables.runs["status"].value_counts().to_pylist()
        told = ", ".join(
            f"{one['counts']:,} {one['values']}" for one in sorted(done, key=lambda one: one["values"])
        )
        axes = ", ".join(axis.name for axis in self.plan.axes) or "none"
        return visible(f"{self.folder}: study {self.plan.about['name']}; axes: {axes}; runs: {told}")


def frame(table: pa.Table) -> "pandas.DataFrame":
    """A table as pandas has it, with units and meanings; nulls stay nulls of truths and whole numbers."""
    made = table.to_pandas()
    made.attrs["units"] = table_parts.units(table.schema)
    made.attrs["meanings"] = table_parts.meanings(table.schema)
    return made


def _reason(error: BaseException) -> str:
    return plain(" ".join(f"{error}".split())) or type(error).__name__
