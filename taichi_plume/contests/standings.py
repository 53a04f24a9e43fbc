"""Standings of a contest: a row per algorithm and scenario, from the records in the studies' folders."""

from collections.abc import Hashable, Iterator
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from taichi_plume.contests.execution import AXIS, Contest
from taichi_plume.files import disk
from taichi_plume.files.run_folder import RunFolderError
from taichi_plume.scoring.declarations import OUTCOMES
from taichi_plume.studies.estimates import Quantity, estimated
from taichi_plume.studies.intervals import Estimate
from taichi_plume.studies.results import Results, open_study

if TYPE_CHECKING:
    import pandas

NAME = "contest"


SUCCESS = Quantity("success", "success", "1", share=True)
TIME = Quantity("time_s", "time", "s", what="successes")
LATE = Quantity("time_with_failures_s", "time with failures", "s")
WAY = Quantity("path_ratio", "way / shortest way", "1", what="successes")
ERROR = Quantity("localisation_error_m", "localisation error", "m", what="searches with a declaration")
FALSE = Quantity("false_declarations", "false declarations per search", "1")
DECLARED, REACHED, NEITHER = (Quantity(name, name, "1", share=True) for name in OUTCOMES)
MEASURES = (SUCCESS, TIME, LATE, WAY, ERROR, FALSE, DECLARED, REACHED, NEITHER)
SEARCHES = Quantity("searches", "searches", "1")


class Row(NamedTuple):
    """Result of an algorithm in a scenario. searches: number; failed, missing: numbers of runs; message: of the first
    failed run; estimates: by the names of MEASURES, None without data.
    """

    scenario: str
    algorithm: str
    robots: int
    runs: int
    failed: int
    missing: int
    message: str
    searches: int
    estimates: dict[str, Estimate | None]

    def columns(self) -> dict[str, object]:
        """Return the values of the row by the columns of contest.csv."""
        columns: dict[str, object] = {
            name: value for name, value in self._asdict().items() if name != "estimates"
        }
        for measure in MEASURES:
            each = self.estimates[measure.name]
            ends = (each.mean, each.low, each.high) if each else (np.nan,) * 3
            for end, value in zip(("", "_low", "_high"), ends, strict=True):
                columns[measure.name + end] = float(value)
        first = self.estimates[SUCCESS.name]
        columns["airs"] = first.airs if first else 0
        columns["success_words"] = SUCCESS.words(first)
        return columns


def rows(contest: Contest) -> list[Row]:
    """Return the rows of all scenarios that have been started, in the contest's order. Raises RunFolderError."""
    started = [fixed.name for fixed in contest.scenarios if (contest.study(fixed) / "plan.parquet").is_file()]
    return [row for name in started for row in _of_study(contest, name)]


def _of_study(contest: Contest, name: str) -> Iterator[Row]:
    study = open_study(contest.out / name)
    runs: Any = study.runs()
    found = _estimates(study)
    for entrant in contest.entrants:
        mine = runs[runs[AXIS] == entrant.name]
        searched = found[SEARCHES.name].get(entrant.name)
        failed = mine[mine["status"] == "failed"]
        yield Row(
            name, entrant.name, entrant.robots, len(mine), len(failed), int((mine["status"] == "missing").sum()),
            str(failed["message"].iloc[0]) if len(failed) else "", searched.n if searched else 0,
            {measure.name: found[measure.name].get(entrant.name) for measure in MEASURES},
        )  # fmt: skip


def _estimates(study: Results) -> dict[str, dict[Hashable, Estimate]]:
    """Return an estimate with interval of each measure and of the number of searches, by measure and algorithm."""
    trials: Any = study.trials()
    runs: Any = study.runs()
    chance = trials["run"].map(dict(zip(runs["run"], runs["air_by_chance"], strict=True)))
    ratio = trials["path_m"] / trials["shortest_m"]
    trials = trials.assign(searches=1.0, path_ratio=ratio, air_by_chance=chance)
    for name in OUTCOMES:
        trials[name] = (trials["outcome"] == name).astype("Float64").where(trials["outcome"].notna())
    return {
        measure.name: estimated(trials, measure, [AXIS], study.plan.longest_s)
        for measure in (*MEASURES, SEARCHES)
    }


@dataclass(frozen=True)
class Standings:
    """Results of a contest. rows: a row per algorithm and scenario, in the contest's order; page: path of its page."""

    contest: Contest
    rows: list[Row]
    page: Path

    @property
    def table(self) -> "pandas.DataFrame":
        """A row per algorithm and scenario: the content of contest.csv; units in `attrs["units"]`."""
        import pandas as pd

        frame = pd.DataFrame([row.columns() for row in self.rows])
        units = {measure.name: measure.unit for measure in MEASURES}
        ends = {f"{name}_{end}": unit for name, unit in units.items() for end in ("low", "high")}
        frame.attrs["units"] = units | ends
        return frame

    def study(self, scenario: str) -> Results:
        """Return the runs and trials of one scenario. Raises RunFolderError if it has not been started."""
        return open_study(self.contest.out / scenario)

    @property
    def _brief(self) -> "pandas.DataFrame":
        import pandas as pd

        from taichi_plume.contests.page import brief

        cells, heads = brief(self.rows)
        return pd.DataFrame(cells, columns=pd.Index(heads))

    @property
    def _notes(self) -> list[str]:
        from taichi_plume.contests.page import notes

        return notes(self.rows)

    def _repr_html_(self) -> str:
        return self._brief.to_html(index=False) + "".join(f"<p>{escape(note)}</p>" for note in self._notes)

    def __repr__(self) -> str:
        return "\n".join([self._brief.to_string(index=False), *self._notes])


def conclude(contest: Contest, again: str) -> Standings:
    """Write contest.csv, contest.parquet and the page of the finished runs; equal rows make equal tables.

    again: how to repeat the contest, for the page. Raises RunFolderError, OSError.
    """
    from taichi_plume.contests import page

    started = rows(contest)
    if not started:
        raise RunFolderError("nothing has been run yet")
    standings = Standings(contest, started, contest.out / f"{NAME}.html")
    table = standings.table
    table.attrs.clear()
    with disk.written_whole(contest.out / f"{NAME}.csv") as fresh:
        table.to_csv(fresh, index=False, lineterminator="\n", float_format="%.6g")
    with disk.written_whole(contest.out / f"{NAME}.parquet") as fresh:
        table.to_parquet(fresh, index=False)
    page.write(contest, started, again)
    return standings
