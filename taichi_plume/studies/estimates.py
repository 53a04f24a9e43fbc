"""Estimates of a study: means with confidence intervals for each combination of axis values and group of robots."""

from collections.abc import Hashable, Iterator, Sequence
from math import inf
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from taichi_plume.files import run_tables
from taichi_plume.scoring.declarations import DECLARED, REACHED
from taichi_plume.studies import intervals
from taichi_plume.studies.messages import Row
from taichi_plume.studies.outcomes import limits_of
from taichi_plume.studies.tables import Planned, Tables

if TYPE_CHECKING:
    import pandas as pd


NO_BREAK = "\u2011"  # a hyphen at which no line ends


class Quantity(NamedTuple):
    """A quantity of searches or runs. share: whether it is a fraction, shown in per cent; what: noun of what counts;
    limits: least and largest value.
    """

    name: str
    title: str
    unit: str
    share: bool = False
    what: str = "searches"
    limits: tuple[float, float] = (0.0, inf)

    @property
    def heading(self) -> str:
        """Title with the unit in brackets, for tables and figures."""
        unit = "%" if self.share else "" if self.unit == "1" else self.unit
        return self.title + (f" [{unit}]" if unit else "")

    def words(self, estimate: intervals.Estimate | None) -> str:
        """Return the sentence of an estimate."""
        return intervals.words(estimate, self.unit, self.share, self.what)

    def mean(self, estimate: intervals.Estimate | None) -> str:
        """Return the mean of an estimate, for a table."""
        return intervals.number(estimate.mean, "", self.share) if estimate and estimate.n else "-"

    def cell(self, estimate: intervals.Estimate | None) -> str:
        """Return the mean of an estimate with its interval in brackets, for a table."""
        if estimate is None or not estimate.n or not np.isfinite(estimate.low):
            return self.mean(estimate)
        ends = intervals.ends(estimate, "", self.share).removesuffix(" %")
        return f"{self.mean(estimate)} ({ends if ' to ' in ends else ends.replace('-', NO_BREAK)})"


SUCCESS = Quantity("success", "success", "1", share=True)
TIME = Quantity("time_with_failures_s", "time with failures", "s")
QUANTITIES = (
    SUCCESS,
    TIME,
    Quantity("time_s", "time to find the source", "s", what="successes"),
    Quantity("overhead", "way / straight", "1", what="successes"),
    Quantity("acquisitions", "stops", "1"),
)
"""Quantities of searches. Those with what="successes" count successful searches only."""
DECLARATIONS = (
    Quantity("declared", "declared rightly", "1", share=True),
    Quantity("reached", "reached, not declared", "1", share=True),
    Quantity("localisation_error_m", "localisation error", "m", what="searches with a declaration"),
    Quantity("declared_time_s", "time to declare", "s", what="searches with a declaration"),
    Quantity("false_declarations", "false declarations", "1"),
)
"""Quantities of searches in which robots may declare; listed if any robot has declared."""


def outcomes(plan: Planned, tables: Tables) -> tuple[Quantity, ...]:
    """Return the quantities of whole runs that the study requests as outcomes."""
    units = run_tables.units(tables.runs.schema)
    return tuple(
        Quantity(name, name, units[name], what="runs", limits=limits_of(path))
        for name, path in plan.outcomes.items()
    )


def estimated(
    of: "pd.DataFrame", q: Quantity, keys: Sequence[str], longest_s: float = inf
) -> dict[Hashable, intervals.Estimate]:
    """Estimate a quantity for each combination of values of the columns `keys` of a table of trials or runs.

    The table has the columns air_seed and air_by_chance. Airs with equal seeds share eddies and gusts at all points.
    longest_s: duration of the longest run [s], which no time of a search exceeds.
    """
    known = [key for key in keys if key in of.columns]
    if not len(of):
        return {}
    if not known:  # all together
        known, of = ["all"], of.assign(all=0)
    key = of[known[0]] if len(known) == 1 else list(zip(*(of[name] for name in known), strict=True))
    limits = (0.0, longest_s) if q.unit == "s" and q.what != "runs" else q.limits
    return intervals.estimates(_numbers(of, q), key, of["air_seed"], of["air_by_chance"], q.share, limits)


def _numbers(of: "pd.DataFrame", q: Quantity) -> np.ndarray:
    return of[q.name].astype("Float64").to_numpy(float, na_value=np.nan)


class Points:
    """Points (combinations of axis values) of a study, with an estimate of each quantity.

    table: a row per point and group, sorted: point, the axes, group, algorithm, number of runs, of failed and missing
    runs; estimates: by name of the quantity, for each row; None without data.
    """

    def __init__(self, plan: Planned, tables: Tables):
        self.plan = plan
        self.runs = tables.runs.to_pandas()
        axes = [field.name for field in plan.fields]
        several = self.runs.groupby("point")[axes].nunique().max() if axes else {}
        self.axes = [axis for axis in axes if several[axis] <= 1]  # seeds vary within a point
        self.trials = tables.trials.to_pandas()
        self.trials["air_by_chance"] = self.trials["run"].map(self.runs.set_index("run")["air_by_chance"])
        of_trials = QUANTITIES if len(self.trials) else ()
        if self._declared():
            of_trials += DECLARATIONS
        self.quantities = (*of_trials, *outcomes(plan, tables))
        self.table = self._table()
        self.estimates = {quantity.name: self._of_rows(quantity) for quantity in self.quantities}

    def _declared(self) -> bool:
        """Return whether any robot has declared a source position; if so, add columns of declarations to the trials."""
        trials = self.trials
        searched = trials["searched"].astype(bool)
        if not (trials["declarations"][searched] > 0).any():
            return False
        trials.loc[~searched, ["declared_time_s", "localisation_error_m", "false_declarations"]] = None
        counted = trials["declarations"].notna() & trials["outcome"].notna()
        for name in (DECLARED, REACHED):
            trials[name] = (trials["outcome"] == name).astype("boolean").where(counted)
        return True

    def _table(self) -> "pd.DataFrame":
        runs = self.runs
        of_point = runs.groupby("point", sort=True)
        table = of_point[self.axes].first()
        table["runs"] = of_point.size()
        for name in ("failed", "missing"):
            table[name] = (runs["status"] == name).groupby(runs["point"]).sum()
        who = [name for name in ("group", "algorithm") if name not in self.axes]
        groups = self.trials[["point", *who]].drop_duplicates(["point", "group"])
        table = table.reset_index().merge(groups, on="point", how="left", sort=False)
        return table[["point", *self.axes, *who, "runs", "failed", "missing"]]

    def _rows(self, quantity: Quantity) -> tuple["pd.DataFrame", list[str]]:
        """Return the table that has a quantity as a column, and the columns that identify a row of `table`."""
        return (self.runs, ["point"]) if quantity.what == "runs" else (self.trials, ["point", "group"])

    def estimated(self, quantity: Quantity, keys: Sequence[str]) -> dict[Hashable, intervals.Estimate]:
        """Estimate a quantity for each combination of values of the columns `keys` of the trials or runs."""
        return estimated(self._rows(quantity)[0], quantity, keys, self.plan.longest_s)

    def _of_rows(self, quantity: Quantity) -> list[intervals.Estimate | None]:
        _, keys = self._rows(quantity)
        found = self.estimated(quantity, keys)
        rows = zip(*(self.table[key] for key in keys), strict=True)
        return [found.get(row if len(keys) > 1 else row[0]) for row in rows]

    def between_airs(self, quantity: Quantity) -> dict[Hashable, float]:
        """Return the squared standard error of the mean at each point (and group), from the means of the point's airs.

        NaN if there is a single air.
        """
        of, keys = self._rows(quantity)
        values = of.assign(value=_numbers(of, quantity))
        means = values[values["value"].notna()].groupby([*keys, "air"], sort=False)["value"].mean()
        by = means.groupby(level=keys, sort=False)
        return (by.var(ddof=1) / by.size()).to_dict()

    def frame(self) -> "pd.DataFrame":
        """Return a row per point and group: mean, interval and words of each quantity; units in `attrs`."""
        import pandas as pd

        made: Row = {name: self.table[name] for name in self.table.columns}
        units = run_tables.units(self.plan.table.schema)
        for quantity in self.quantities:
            found = self.estimates[quantity.name]
            for place, end in enumerate(("", "_low", "_high")):
                made[quantity.name + end] = [each[place] if each else np.nan for each in found]
                units[quantity.name + end] = quantity.unit
            made[f"{quantity.name}_words"] = list(map(quantity.words, found))
        first = self.estimates[self.quantities[0].name] if self.quantities else []
        made["airs"] = [each.airs if each else 0 for each in first] if first else 0
        frame = pd.DataFrame(made)
        frame.attrs["units"] = {name: units.get(name, "1") for name in frame.columns}
        return frame

    def brief(self) -> "pd.DataFrame":
        """Return a row per point and group, with each quantity and its interval as text, to be shown."""
        shown = self.table.drop(columns="point")
        for q in self.quantities:
            shown[q.heading] = list(map(q.cell, self.estimates[q.name]))
        return shown

    def differences(self, axis: str, quantity: Quantity = SUCCESS) -> Iterator[Row]:
        """Compare each value of an axis with the first value, in the same airs and at equal values of other axes.

        A row has the values of the other axes, the group, the `first` and `second` value, and the Estimate `apart` of
        the second mean minus the first. Only airs with searches of both count.
        """
        others = [name for name in self.axes if name != axis]
        trials = self.trials.assign(value=_numbers(self.trials, quantity))
        trials = trials[trials["value"].notna()]
        keys = [*others, "group"]
        for values, part in trials.groupby(keys, sort=False, dropna=False):
            cells = part.groupby([axis, "air"], sort=False)["value"].agg(["sum", "count"])
            first, *rest = list(dict.fromkeys(part[axis]))
            base = cells.loc[first]
            for second in rest:
                beside = cells.loc[second]
                airs = [air for air in base.index if air in beside.index]
                pair = [
                    (each.loc[airs, "sum"].to_numpy(float), each.loc[airs, "count"].to_numpy(float))
                    for each in (base, beside)
                ]
                yield {
                    **dict(zip(keys, values, strict=True)),
                    "first": first,
                    "second": second,
                    "apart": intervals.differences(*pair, most=1.0 if quantity.share else inf),
                }
