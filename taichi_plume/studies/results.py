"""Results of a study as tables, for notebooks and plots: ``results = tp.open_study("studies/wind-speeds")``.

    results.trials()    pandas.DataFrame: a row for each trial of each group, with the values of all axes
    results.runs()      a row for each run of the plan, finished or missing
    results.points()    a row for each point and group: means with intervals over airs
    results.costs()     cost of each run
    results.plot()      figure of a quantity over an axis

Units are in ``frame.attrs["units"]``. The tables of a running or killed study hold the records written so far. Missing
or damaged files raise a RunFolderError of one line.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from taichi_plume.files import run_tables
from taichi_plume.files.run_folder import RunFolderError
from taichi_plume.files.tables import LONGEST_TEXT, plain
from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.safe_open import as_path, unopenable
from taichi_plume.guard.terminal import visible
from taichi_plume.studies import tables as files
from taichi_plume.studies.store import Store, StoreError
from taichi_plume.version import __version__

if TYPE_CHECKING:
    import pandas
    import polars
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from taichi_plume.studies.estimates import Points

PAUSE = 60.0  # s; longer pauses without a run count as interruptions
FAULTS = (pa.ArrowException, OSError, ValueError, LookupError, TypeError)


def open_study(folder: Path | str) -> "Results":
    """Return the tables of the study in a folder, also while its runs are executed.

    Raises RunFolderError for other folders, damaged files and other versions.

    >>> import taichi_plume as tp
    >>> tp.open_study("nowhere")
    Traceback (most recent call last):
    taichi_plume.files.run_folder.RunFolderError: nowhere: does not exist; give the folder of a study
    """
    return Results(as_path(folder, "folder", RunFolderError))


class Results:
    """Tables of a study; see `open_study`. Every method may raise RunFolderError."""

    def __init__(self, folder: Path):
        self.folder = folder
        fault = unopenable(folder, folder=True)
        if fault:
            raise RunFolderError(f"{folder}: {fault}; give the folder of a study")
        path = folder / files.PLAN
        fault = unopenable(path)
        if fault:
            raise RunFolderError(f"{folder}: is not the folder of a study: {files.PLAN} {fault}")
        with _damage(path):
            self.plan = files.read_plan(folder)
            made = str(self.plan.about["version"])
            self.fields, self.outcomes = self.plan.fields, self.plan.outcomes
        if made.split(".")[:2] != __version__.split(".")[:2]:
            of = visible(made, LONGEST_TEXT)
            raise RunFolderError(
                f"{folder}: was made by taichi_plume {of}, this is {__version__}; use that version"
            )

    @cached_property
    def tables(self) -> files.Tables:
        """Arrow tables: read from the folder if they are up to date, else made from the records."""
        with _damage(self.folder):
            written = files.written(self.folder)
            held = files.held(self.folder, files.state(self.folder))
            if held is None:
                return files.make_tables(self.plan, Store(self.folder).table())
            try:
                return self._read(held)
            except RunFolderError:
                if files.written(self.folder) == written:
                    raise
        return self.tables  # written again meanwhile

    def _read(self, held: int) -> files.Tables:
        made = []
        for name, field in ((files.RUNS, "number"), (files.TRIALS, "point"), (files.COSTS, "run")):
            with _damage(self.folder / name):
                table = files.read(self.folder / name)
                if not {"run", field} <= set(table.column_names):
                    raise ValueError("holds other columns")
            made.append(table)
        runs, trials, costs = made
        if len(trials) != held:
            path = self.folder / files.TRIALS
            raise RunFolderError(f"{path}: holds {len(trials):,} of {held:,} rows; is a file missing?")
        place = pc.index_in(trials["run"], value_set=runs["run"].combine_chunks())
        order = place.to_numpy().argsort(kind="stable")
        return files.Tables(runs, trials.take(pa.array(order)), costs)

    def trials(self) -> "pandas.DataFrame":
        """Return a row for each trial of each group."""
        return frame(self.tables.trials)

    def runs(self) -> "pandas.DataFrame":
        """Return a row for each run of the plan; `status` is missing for runs without a record."""
        return frame(self.tables.runs)

    def costs(self) -> "pandas.DataFrame":
        """Return the cost of each finished run, a row per run."""
        return frame(self.tables.costs)

    @cached_property
    def by_points(self) -> "Points":
        """Points with their estimates, see `studies/estimates.py`."""
        from taichi_plume.studies.estimates import Points

        tables = self.tables
        with _damage(self.folder):
            return Points(self.plan, tables)

    def points(self) -> "pandas.DataFrame":
        """Return a row for each combination of axis values and group: means with 95 % intervals over airs."""
        return self.by_points.frame()

    def differences(self, axis: str, quantity: str = "success") -> "pandas.DataFrame":
        """Compare each value of an axis with the first value, in the same airs: difference `apart`, interval, words.

        quantity: a column of trials. Values of an axis that changes the air itself, such as the wind's speed, have no
        air in common: `apart` is NaN then, and the words say so. Raises InputError for an unknown axis or quantity.
        """
        import pandas

        from taichi_plume.studies import intervals

        points = self.by_points
        known = {measure.name: measure for measure in points.quantities if measure.what != "runs"}
        for name, there in ((axis, points.axes), (quantity, list(known))):
            if name not in there:
                raise InputError(f"{name!r}: there are {', '.join(there)}")
        measure = known[quantity]
        made = []
        for row in points.differences(axis, measure):
            apart = row.pop("apart")
            text = intervals.words(apart, measure.unit, measure.share, "searches in both")
            if not apart.airs:
                pair = f"{axis} = {row['first']} and {row['second']}"
                text = f"no air in common at {pair}: the axis changes the air, or runs are missing; compare points()"
            ends = {"apart": apart.mean, "low": apart.low, "high": apart.high}
            made.append(row | ends | {"airs": apart.airs, "words": text})
        return pandas.DataFrame(made)

    def plot(
        self,
        x: str | None = None,
        quantity: str = "success",
        by: str | None = None,
        *,
        ax: "Axes | None" = None,
        figsize: tuple[float, float] | None = None,
    ) -> "Figure":
        """Return a figure of a quantity over an axis `x` of the study, as on its page: means with 95 % intervals.

        x: by default the first axis with several values, a numeric one if there is any. quantity: a column of trials or
        an outcome. by: another axis, with a line per value, or "group". ax: axes of a figure of yours to draw into;
        figsize: width and height of a new figure [inches]. Raises ValueError for an unknown name.
        """
        from taichi_plume.report.theme import Place
        from taichi_plume.studies import plots

        points = self.by_points
        known = {measure.name: measure for measure in points.quantities}
        lines, numeric = plots.named(points), plots.numeric(points)
        axes = [*numeric, *lines]
        x = x if x is not None else next(iter(axes), None)
        others = [name for name in axes if name != x] if x in numeric else []
        for key, name, there in (
            ("x", x, axes),
            ("quantity", quantity, list(known)),
            ("by", by, [None, *others]),
        ):
            if name not in there:
                allowed = ", ".join(map(str, there)) or "none, as no axis has several values"
                raise InputError(f"{key}: got {visible(name)}; allowed are {allowed}")
        assert x is not None
        return plots.of_axis(points, x, by, known[quantity], Place.of(ax, figsize))

    def indices(self) -> "pandas.DataFrame":
        """Return the Sobol indices of each axis of a sensitivity study, for each quantity and group, and words."""
        import pandas

        from taichi_plume.studies import indices

        self._require("sensitivity")
        made = []
        for quantity, group, found in indices.found(self.by_points):
            about = {"quantity": quantity.name, "group": group, "used": found.used, "asked": found.asked}
            about |= {"variance": found.variance, "noise": found.noise}
            about["words"] = "; ".join(indices.words(found))
            made += [{"axis": axis, **index._asdict(), **about} for axis, index in found.indices.items()]
        return pandas.DataFrame(made)

    def orders(self) -> "pandas.DataFrame":
        """Return order of convergence, extrapolated value and grid convergence index of each quantity, and words."""
        import pandas

        from taichi_plume.studies import grid_refinement

        self._require("refinement")
        axis = grid_refinement.axis_of(self.plan.about)
        if axis is None:
            raise RunFolderError(f"{self.folder}: no axis of the study varies {grid_refinement.SPACING}")
        return pandas.DataFrame(
            [
                {**row, "words": grid_refinement.words(row)}
                for row in grid_refinement.orders(self.by_points, axis)
            ]
        )

    def _require(self, kind: str) -> None:
        if self.plan.about["kind"] != kind:
            raise RunFolderError(f"{self.folder}: is a study of kind {self.plan.about['kind']}, not {kind}")

    def polars(self, name: str) -> "polars.DataFrame":
        """Return the table "trials", "runs" or "costs" as a polars.DataFrame; needs polars."""
        import polars

        if name not in files.Tables._fields:
            raise ValueError(f"{name!r}: there are {', '.join(files.Tables._fields)}")
        made = polars.from_arrow(self.tables._asdict()[name])
        assert isinstance(made, polars.DataFrame)
        return made

    def _repr_html_(self) -> str:
        from taichi_plume.report.html import in_notebook

        brief = self.by_points.brief()
        return in_notebook(brief.to_numpy().tolist(), list(brief.columns), notes=[repr(self)])

    def __repr__(self) -> str:
        counts = self.runs()["status"].value_counts().sort_index()
        runs = ", ".join(f"{count:,} {status}" for status, count in counts.items())
        axes = ", ".join(axis.name for axis in self.plan.axes) or "none"
        return visible(f"{self.folder}: study {self.plan.about['name']}; axes: {axes}; runs: {runs}")


def frame(table: pa.Table) -> "pandas.DataFrame":
    """Return a table as a pandas.DataFrame with units and meanings in `attrs`; nulls stay nulls."""
    made = table.to_pandas()
    made.attrs["units"] = run_tables.units(table.schema)
    made.attrs["meanings"] = run_tables.meanings(table.schema)
    return made


@contextmanager
def _damage(path: Path) -> Iterator[None]:
    """Raise errors of damaged files in the block as a RunFolderError of one line."""
    try:
        yield
    except (RunFolderError, StoreError) as error:
        raise RunFolderError(str(error)) from None
    except FAULTS as error:
        reason = plain(" ".join(f"{error}".split())) or type(error).__name__
        raise RunFolderError(f"{path}: is damaged: {reason}") from None


def cost_words(costs: pa.Table) -> list[tuple[str, str]]:
    """Return (title, text) of the cost: wall time, time per run, utilisation of the workers, compiled kernels."""
    if not len(costs):
        return []
    table = costs.sort_by("begun").to_pandas()
    table["end"] = table["begun"] + table["total_s"]
    pauses = table["begun"].to_numpy()[1:] - np.maximum.accumulate(table["end"].to_numpy())[:-1]
    table["stretch"] = np.concatenate([[0], np.cumsum(pauses > PAUSE)])
    stretches, stays = (
        table.groupby(keys).agg({"begun": "min", "end": "max"}) for keys in ("stretch", ["stretch", "worker"])
    )
    wall, presence = (float((part["end"] - part["begun"]).sum()) for part in (stretches, stays))
    busy = min(1.0, table["total_s"].sum() / max(presence, 1e-9))
    each, beyond = table["total_s"].mean(), (table["total_s"] - table["simulation_s"]).mean()
    count = len(stretches)
    pauses_left_out = f", in {count} stretches, pauses between them left out" if count > 1 else ""
    runs = f"{len(table):,}; {duration(each)} each, of which {duration(beyond)} beyond the simulation itself"
    workers = stays.groupby("stretch").size().max()
    return [
        ("wall time", duration(wall) + pauses_left_out),
        ("runs", runs),
        ("workers", f"{workers:,}; at work {100 * busy:.0f} % of the time"),
        ("kernels compiled", f"{table['compiled'].sum():,}"),
    ]


def duration(seconds: float) -> str:
    """Return a duration with a suitable unit and three digits."""
    if seconds < 1:
        return f"{1000 * seconds:.3g} ms"
    if seconds < 120:
        return f"{seconds:.3g} s"
    return f"{seconds / 60:.3g} min" if seconds < 7200 else f"{seconds / 3600:.3g} h"
