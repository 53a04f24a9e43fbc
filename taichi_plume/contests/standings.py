"""Standings of a contest: a row per algorithm and scenario, from the records in the studies' folders."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from taichi_plume.contests.execution import AXIS, KIND, Contest, Fixed
from taichi_plume.files import disk
from taichi_plume.guard.terminal import say, show, visible
from taichi_plume.scoring.declarations import DECLARED, OUTCOMES
from taichi_plume.scoring.trials import LEAST_VALUES
from taichi_plume.studies.estimates import SUCCESS, Quantity, estimated
from taichi_plume.studies.estimates import TIME as LATE
from taichi_plume.studies.intervals import Estimate
from taichi_plume.studies.results import Results, open_study

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    import pandas

TIME = Quantity("time_s", "time (successes)", "s", what="successes")
WAY = Quantity("path_ratio", "way / shortest way (successes)", "1", what="successes")
ERROR = Quantity("localisation_error_m", "localisation error", "m", what="searches with a declaration")
FALSE = Quantity("false_declarations", "false declarations per search", "1")
RIGHT = Quantity("right_declared_s", "time to the right declaration", "s", what="searches with one")
STRENGTH = Quantity("strength_error", "strength error", "1", what="searches that declared a strength")
"""Error of the declared strength; no value for algorithms whose declarations carry none."""
DECLARING = (ERROR, STRENGTH, RIGHT, FALSE, *(Quantity(name, name, "1", share=True) for name in OUTCOMES))
"""Quantities of algorithms that declare a position of the source."""
MEASURES = (SUCCESS, TIME, LATE, WAY, *DECLARING)
BRIEF = {
    TIME: "time [s]",
    LATE: "with fails [s]",
    WAY: "way",
    ERROR: "error [m]",
    STRENGTH: "strength",
    RIGHT: "right [s]",
    FALSE: "false",
}
"""Titles in a terminal, which shows these quantities and the success."""
NO_INTERVALS = f"No intervals where fewer than {LEAST_VALUES} airs have a value; --airs N gives more airs."


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
        columns = self._asdict()
        for name, each in columns.pop("estimates").items():
            ends = each[:3] if each else (np.nan,) * 3
            columns |= dict(zip((name, f"{name}_low", f"{name}_high"), map(float, ends), strict=True))
        first = self.estimates[SUCCESS.name]
        return columns | {"airs": first.airs if first else 0, "success_words": SUCCESS.words(first)}


def _rows(contest: Contest, scenario: Fixed) -> "Iterator[Row]":
    """Yield the row of each algorithm in a scenario that has been started. Raises RunFolderError."""
    name, study = scenario.name, open_study(contest.study(scenario))
    runs: Any = study.runs()
    trials: Any = study.trials()
    chance = trials["run"].map(dict(zip(runs["run"], runs["air_by_chance"], strict=True)))
    trials = trials.assign(path_ratio=trials["path_m"] / trials["shortest_m"], air_by_chance=chance)
    trials[RIGHT.name] = trials["declared_time_s"].where(trials["outcome"] == DECLARED)
    if STRENGTH.name not in trials:
        trials[STRENGTH.name] = np.nan
    for outcome in OUTCOMES:
        of_all = (trials["outcome"] == outcome).astype("Float64")
        trials[outcome] = of_all.where(trials["outcome"].notna())
    found = {each.name: estimated(trials, each, [AXIS], study.plan.longest_s) for each in MEASURES}
    searches = trials[AXIS].value_counts()
    for entrant in contest.entrants_in(scenario):
        mine = runs[runs[AXIS] == entrant.name]
        failed = mine[mine["status"] == "failed"]
        yield Row(
            name, entrant.name, entrant.robots, len(mine), len(failed), int((mine["status"] == "missing").sum()),
            str(failed["message"].iloc[0]) if len(failed) else "", int(searches.get(entrant.name, 0)),
            {measure.name: found[measure.name].get(entrant.name) for measure in MEASURES},
        )  # fmt: skip


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
        ends = ("", "_low", "_high")
        frame.attrs["units"] = {measure.name + end: measure.unit for measure in MEASURES for end in ends}
        return frame

    def study(self, scenario: str) -> Results:
        """Return the runs and trials of one scenario. Raises RunFolderError if it has not been started."""
        return open_study(self.contest.out / scenario)

    def _repr_html_(self) -> str:
        from taichi_plume.report.html import in_notebook

        heads, *cells = brief(self.rows)
        return in_notebook(cells, heads, notes=notes(self.rows))

    def __repr__(self) -> str:
        import pandas as pd

        heads, *cells = brief(self.rows)
        frame = pd.DataFrame(cells, columns=pd.Index(heads))
        return "\n".join([frame.to_string(index=False), *notes(self.rows)])


def conclude(contest: Contest) -> Standings:
    """Write contest.csv, contest.parquet and the page of the finished runs, if any; equal rows make equal tables.

    Raises RunFolderError, OSError.
    """
    from taichi_plume.contests import page

    started = [each for each in contest.scenarios if (contest.study(each) / "plan.parquet").is_file()]
    rows = [row for scenario in started for row in _rows(contest, scenario)]
    standings = Standings(contest, rows, contest.out / f"{KIND}.html")
    if not rows:
        return standings
    table = standings.table
    table.attrs.clear()
    with disk.written_whole(contest.out / f"{KIND}.csv") as fresh:
        table.to_csv(fresh, index=False, lineterminator="\n", float_format="%.6g")
    with disk.written_whole(contest.out / f"{KIND}.parquet") as fresh:
        table.to_parquet(fresh, index=False)
    page.write(standings)
    return standings


def notes(rows: "Sequence[Row]") -> list[str]:
    """Return the sentence that states why success rates have no interval, if any has none for lack of airs."""
    estimates = (row.estimates[SUCCESS.name] for row in rows)
    return [NO_INTERVALS] if any(e and e.over == "too few airs" for e in estimates) else []


def brief(rows: "Sequence[Row]") -> list[list[str]]:
    """Return heads and cells of the standings: success with its interval, the other quantities as means."""
    shown = [q for q in BRIEF if any(row.estimates[q.name] for row in rows)]
    made = [["scenario", "algorithm", SUCCESS.heading, *(BRIEF[q] for q in shown)]]
    for row in rows:
        means = [q.mean(row.estimates[q.name]) for q in shown]
        success = SUCCESS.cell(row.estimates[SUCCESS.name])
        made.append([row.scenario, visible(row.algorithm), success, *means])
    return made


def show_table(rows: "Sequence[Row]") -> None:
    """Print the contest's standings in the terminal, see `brief`."""
    from rich.table import Table

    heads, *cells = brief(rows)
    table = Table(box=None, padding=(0, 1, 0, 0))
    for n, head in enumerate(("", *heads[2:])):
        table.add_column(head, no_wrap=n < 2, min_width=5)
    before = ""
    for scenario, algorithm, *others in cells:
        if scenario != before:
            table.add_row(scenario, style="bold")
        before = scenario
        table.add_row(f" {algorithm}", *others)
    show(table)
    say(*notes(rows))
