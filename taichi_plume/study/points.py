"""A study by its points: of each combination of the axes' values and each group, means with intervals over airs."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from taichi_plume.files import table_parts
from taichi_plume.scoring.declarations import DECLARED, REACHED
from taichi_plume.study import intervals
from taichi_plume.study.table_rows import Planned, Tables

if TYPE_CHECKING:
    import pandas as pd


class Quantity(NamedTuple):
    """What is told of searches or runs. share: whether it is one, in per cent for people; what: that are counted."""

    name: str
    title: str
    unit: str
    share: bool = False
    what: str = "searches"


SUCCESS = Quantity("success", "success", "1", share=True)
TIME = Quantity("time_with_failures_s", "time with failures", "s")
QUANTITIES = (
    SUCCESS,
    TIME,
    Quantity("time_s", "time to find the source", "s", what="successes"),
    Quantity("overhead", "way / straight", "1", what="successes"),
    Quantity("acquisitions", "stops", "1"),
)
"""Of searches; those after the success and the time count successful ones alone, where a failure has none."""
SAID = (
    Quantity("declared", "declared rightly", "1", share=True),
    Quantity("reached", "reached, not declared", "1", share=True),
    Quantity("localisation_error_m", "localisation error", "m", what="searches with a declaration"),
    Quantity("declared_time_s", "time to declare", "s", what="searches with a declaration"),
    Quantity("false_declarations", "false declarations", "1"),
)
"""Of searches in which robots may declare, told where any has; `declared` and `reached` are outcomes."""


def outcomes(plan: Planned, tables: Tables) -> tuple[Quantity, ...]:
    """Those of whole runs."""
    units = table_parts.units(tables.runs.schema)
    return tuple(Quantity(name, name, units[name], what="runs") for name in plan.outcomes)


class Points:
    """The points of a study, and each estimate at each of them.

    table: a row for each point and group, sorted: point, the axes, group, algorithm, runs, failed and missing ones;
    estimates: by the quantity's name, of each row; None where there is nothing to count.
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
            of_trials += SAID
        self.quantities = (*of_trials, *outcomes(plan, tables))
        self.table = self._table()
        self.estimates = {one.name: self._of_rows(one) for one in self.quantities}

    def _declared(self) -> bool:
        """Whether any robot has declared; then the trials get columns of what they are counted by."""
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
        told = [name for name in ("group", "algorithm") if name not in self.axes]
        groups = self.trials[["point", *told]].drop_duplicates(["point", "group"])
        table = table.reset_index().merge(groups, on="point", how="left", sort=False)
        return table[["point", *self.axes, *told, "runs", "failed", "missing"]]

    def estimated(self, one: Quantity, keys: Sequence[str]) -> dict[Any, intervals.Estimate]:
        """The estimates of a quantity by some columns of the trials or, of one of whole runs, of the runs."""
        of = self.runs if one.what == "runs" else self.trials
        known = [key for key in keys if key in of.columns]
        if not len(of):
            return {}
        if not known:  # all together
            known, of = ["all"], of.assign(all=0)
        key = of[known[0]] if len(known) == 1 else list(zip(*(of[name] for name in known), strict=True))
        values = of[one.name].astype("Float64").to_numpy(float, na_value=np.nan)
        # airs of one seed at other points have their eddies and gusts in common
        return intervals.estimates(values, key, of["air_seed"], of["air_by_chance"], one.share)

    def _of_rows(self, one: Quantity) -> list[intervals.Estimate | None]:
        if one.what == "runs":
            told = self.estimated(one, ["point"])
            return [told.get(point) for point in self.table["point"]]
        told = self.estimated(one, ["point", "group"])
        return [told.get(key) for key in zip(self.table["point"], self.table["group"], strict=True)]

    def between_airs(self, one: Quantity) -> dict[Any, float]:
        """The variance of the mean of each point and group (of whole runs: of each point), by that of its airs' means.

        NaN of a single air.
        """
        keys = ["point"] if one.what == "runs" else ["point", "group"]
        of = self.runs if one.what == "runs" else self.trials
        values = of.assign(value=of[one.name].astype("Float64").to_numpy(float, na_value=np.nan))
        means = values[values["value"].notna()].groupby([*keys, "air"], sort=False)["value"].mean()
        by = means.groupby(level=keys, sort=False)
        return (by.var(ddof=1) / by.size()).to_dict()

    def frame(self) -> "pd.DataFrame":
        """The table with a mean, both ends, and the words of each quantity. Units are in `attrs`."""
        import pandas as pd

        made: dict[str, Any] = {name: self.table[name] for name in self.table.columns}
        units = table_parts.units(self.plan.table.schema)
        for one in self.quantities:
            told = self.estimates[one.name]
            for place, end in (("mean", ""), ("low", "_low"), ("high", "_high")):
                made[one.name + end] = [getattr(each, place) if each else np.nan for each in told]
                units[one.name + end] = one.unit
            made[f"{one.name}_words"] = [
                intervals.words(each, one.unit, one.share, one.what) for each in told
            ]
        first = self.estimates[self.quantities[0].name] if self.quantities else []
        made["airs"] = [each.airs if each else 0 for each in first] if first else 0
        frame = pd.DataFrame(made)
        frame.attrs["units"] = {name: units.get(name, "1") for name in frame.columns}
        return frame

    def differences(self, axis: str, one: Quantity = SUCCESS) -> Iterator[dict[str, Any]]:
        """What each value of an axis makes beside its first one, of the same values of all others and the same airs.

        A row has the other axes' values, group, `first` and `second` value, and the Estimate `apart` of the second mean
        minus the first. Only airs in which both searched count.
        """
        others = [name for name in self.axes if name != axis]
        trials = self.trials.assign(
            value=self.trials[one.name].astype("Float64").to_numpy(float, na_value=np.nan)
        )
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
                apart = intervals.differences(*pair)
                yield {
                    **dict(zip(keys, values, strict=True)),
                    "first": first,
                    "second": second,
                    "apart": apart,
                }
